# ---
# jupyter:
#   jupytext:
#     cell_metadata_filter: -all
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.16.4
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Reading a work-precision plot
#
# A work-precision plot shows the *true* error of a result over the time of the run: a point for each run, a line for each
# method. `studies/work_precision` makes such plots for both degrees in half an hour; here are four runs.

# %%
import sys

sys.path.insert(0, "..")

from studies.work_precision.points import Point, reference
from studies.runs import Case

uniform = "--records-only --reference hertz-a --coarse 3 --tolerance 0.04"
one_level = Case("hertz", f"{uniform} --uniform 0 --true-error 0.3", ranks=1)
two_levels = Case("hertz", f"{uniform} --uniform 1 --true-error 0.25", ranks=1)
wanted = [
    Point("HERTZ-A", "adaptive", reference(0.08, "--true-error 0.04", ranks=1)),
    Point("HERTZ-A", "adaptive", reference(0.04, "--true-error 0.02", ranks=1)),
    Point("HERTZ-A", "uniform", one_level),
    Point("HERTZ-A", "uniform", two_levels),
]
for point in wanted:
    print(point.line, "--", point.case.command)

# %% [markdown]
# Each run is a command. `--true-error` computes a finer solution after the timed part and measures the distance to it;
# `--reference hertz-a` compares force, pressure and radius with an independent computation.

# %%
from pathlib import Path

from studies.work_precision.run import load, measure

folder = Path("../results/notebooks/work_precision")
folder.mkdir(parents=True, exist_ok=True)
measure(wanted, folder, repeats=1)
runs = {run["command"]: run for run in load(folder / "runs.jsonl")}
for command, run in runs.items():
    assert "failed" not in run, f"{command}: {run['failed']}; delete {folder}, repeat"

# %%
import matplotlib.pyplot as plt

figure, axes = plt.subplots()
for line, style in (("adaptive", "o-"), ("uniform", "s--")):
    of_line = [runs[point.case.command] for point in wanted if point.line == line]
    wall = [run["wall"] for run in of_line]
    true = [100 * run["last"]["true_error"]["relative"] for run in of_line]
    axes.loglog(wall, true, style, label=line)
    for run, x, y in zip(of_line, wall, true):
        text, offset = f" {run['last']['dofs']:,} dofs", {"textcoords": "offset points"}
        axes.annotate(text, (x, y), xytext=(4, 4), **offset, fontsize=9)
axes.set_xlabel("wall time of all steps [s]")
axes.set_ylabel("true relative energy error [%]")
axes.yaxis.set_minor_formatter("{x:g}")
axes.margins(x=0.3)
axes.legend();

# %% [markdown]
# Interpretation:
#
# - **Low and left is better.** At a given error the leftmost method is the cheapest; at a given time the lowest method
#   is the most accurate.
# - **The slope is the cost of accuracy.** Uniform cells of degree 2 need eight times the unknowns for a quarter of
#   the error of a smooth solution, and contact is not smooth.
# - **All steps count.** The time of the adaptive line includes its first coarse solutions; at low accuracy they may cost
#   more than they save.
# - **The error is the true one.** The effectivity, estimated over true error, is near 1 for a reliable estimate:

# %%
for point in wanted:
    last = runs[point.case.command]["last"]
    true = last["true_error"]["relative"]
    print(f"{point.line:9} estimated {last['estimate']:6.1%}  true {true:6.1%}", end="")
    print(f"  effectivity {last['effectivity']:.2f}")

# %% [markdown]
# Other quantities have other errors. On adapted cells the force is accurate to about a percent on meshes with a much larger
# stress error; uniform cells do not resolve the contact.

# %%
for point in wanted:
    last = runs[point.case.command]["last"]
    error = last["errors"]["force"]
    print(f"{point.line:9} {last['dofs']:7,} dofs  error of the force {error:+.2%}")
