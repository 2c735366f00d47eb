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
# "Fast" and "accurate" mean nothing alone. A work-precision plot has the time that a run took on one axis and the *true*
# error of its result on the other, a point a run, a line a method. `studies/work_precision` makes them for both degrees
# of this program, in half an hour; here are four runs.

# %%
import sys

sys.path.insert(0, "..")

from studies.work_precision.points import Point, reference
from studies.runs import Case

uniform = "--records-only --reference hertz-a --coarse 3 --tolerance 0.04"
wanted = [
    Point("HERTZ-A", "adaptive", reference(0.08, ranks=1)),
    Point("HERTZ-A", "adaptive", reference(0.04, ranks=1)),
    Point("HERTZ-A", "uniform", Case("hertz", f"{uniform} --uniform 0 --true-error 0.3", ranks=1)),
    Point("HERTZ-A", "uniform", Case("hertz", f"{uniform} --uniform 1 --true-error 0.25", ranks=1)),
]
for point in wanted:
    print(point.line, "--", point.case.command)

# %% [markdown]
# Each is a command that you can run yourself. `--true-error` goes on, after the clock has stopped, to a finer solution
# and measures the distance to it; `--reference hertz-a` compares force, pressure and radius with a computation that does
# not use this program.

# %%
from pathlib import Path

from studies.work_precision.run import load, measure

folder = Path("../results/notebooks/work_precision")
folder.mkdir(parents=True, exist_ok=True)
measure(wanted, folder, repeats=1)
runs = {run["command"]: run for run in load(folder / "runs.jsonl")}
for command, run in runs.items():
    assert "failed" not in run, f"{command}: {run['failed']}; delete {folder} to run it again"

# %%
import matplotlib.pyplot as plt

figure, axes = plt.subplots()
for line, style in (("adaptive", "o-"), ("uniform", "s--")):
    of_line = [runs[point.case.command] for point in wanted if point.line == line]
    wall = [run["wall"] for run in of_line]
    true = [100 * run["last"]["true_error"]["relative"] for run in of_line]
    axes.loglog(wall, true, style, label=line)
    for run, x, y in zip(of_line, wall, true):
        axes.annotate(f" {run['last']['dofs']:,} dofs", (x, y), xytext=(4, 4), textcoords="offset points", fontsize=9)
axes.set_xlabel("wall time of all steps [s]")
axes.set_ylabel("true relative energy error [%]")
axes.yaxis.set_minor_formatter("{x:g}")
axes.margins(x=0.3)
axes.legend();

# %% [markdown]
# How to read it:
#
# - **Down and to the left is better.** Draw a horizontal line at the error that you need: the leftmost method there is
#   the cheapest for you. Draw a vertical one at the time that you have: the lowest method is the most accurate.
# - **The slope says what more accuracy costs.** Uniform cells of degree 2 need eight times the unknowns for a quarter of
#   the error of a smooth solution, and contact is not smooth.
# - **All steps count.** The adaptive line pays for its first coarse solutions too; at low accuracy that can cost more than
#   it brings.
# - **The error is the true one.** A method that judges itself may flatter itself. Is the estimate honest? Then the
#   effectivity, estimated over true error, is near 1:

# %%
for point in wanted:
    last = runs[point.case.command]["last"]
    print(
        f"{point.line:9} estimated {last['estimate']:6.1%}  true {last['true_error']['relative']:6.1%}"
        f"  effectivity {last['effectivity']:.2f}"
    )

# %% [markdown]
# Last, energy is not all: whoever needs the force alone looks at the plot of the force. On adapted cells it is right to
# a percent or so long before the stress field is; on uniform ones not even the contact is resolved.

# %%
for point in wanted:
    last = runs[point.case.command]["last"]
    print(f"{point.line:9} {last['dofs']:7,} dofs  force {last['errors']['force']:+.2%} from the reference")
