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
# # The adaptive loop
#
# `adapt` repeats four stages, solve, estimate, mark and refine, until the error is below the tolerance. It is an iterator:
# each step of the loop below is a solution on one mesh, with all its data.

# %%
from fx_contact import adapt
from fx_contact.plot import draw_mesh
from fx_contact.scenes import hertz

scene = hertz()
records, pictures = [], []
for step in adapt(scene, tolerance=0.04):
    record = step.record
    records.append(record)
    picture = f"../results/notebooks/step-{record.step}.png"
    pictures.append(draw_mesh(step, picture, zoom=5, colour="level"))
    print(f"{record.cells:5} cells, {record.active_pairs:3} pairs closed", end=", ")
    print(f"error {record.estimate:.1%}")

# %% [markdown]
# ## Refine
#
# The root mesh does not resolve the contact. Refinement divides a leaf into eight; leaves that share
# an edge differ by one level at most. The facing leaf of the other body is refined too, so that nodes face nodes.

# %%
import matplotlib.pyplot as plt

figure, panels = plt.subplots(1, len(pictures), figsize=(13, 3.4), layout="constrained")
for number, (axes, picture) in enumerate(zip(panels, pictures)):
    axes.imshow(plt.imread(picture))
    axes.set_title(f"step {number}")
    axes.set_axis_off()

# %% [markdown]
# ## Estimate
#
# The element stress jumps between cells. Zienkiewicz and Zhu average it at the nodes; the difference estimates the error
# $\xi_T$ of a cell. For quadratic displacements, the default, $\xi_T$ is the element residual if that is larger.
# The global estimate is $\xi = (\sum \xi_T^2)^{1/2}$. The run ends when $\xi$, relative to the energy norm $\omega$ of
# the solution, is below the tolerance.

# %%
from IPython.display import Image

from fx_contact.plot import draw_convergence

Image(draw_convergence(records, "../results/notebooks/convergence.png"), width=600)

# %% [markdown]
# In the first step a single pair is closed. Once the mesh resolves the contact, the error decreases faster than
# with uniform refinement.
#
# ## Mark
#
# If each of $N$ cells has the error $e\,\omega/\sqrt N$, the total error is the tolerance $e$. Cells above a
# threshold are marked, twice if the error of their children is expected to exceed it. The threshold is the highest value,
# down to $e\,\omega/\sqrt N$, for which the next step is expected to meet the tolerance.

# %%
import numpy as np

error = step.estimate.error
line = step.record.tolerance * step.estimate.energy_norm / np.sqrt(step.estimate.cells)
positive = error[error > 0]
bins = np.geomspace(positive.min(), positive.max(), 40)
plt.hist(positive, bins=bins, color="#56B4E9")
plt.axvline(line, color="#D55E00", label=r"$e\,\omega/\sqrt{N}$")
plt.xscale("log")
plt.xlabel(r"$\xi_T$ of a cell")
plt.ylabel("cells of the last step")
plt.legend();

# %% [markdown]
# In the last step some cells exceed $e\,\omega/\sqrt N$; cells below compensate for them. The small errors on the
# left belong to cells that cannot be coarser: they have small neighbours or are root cells.
#
# ## Cost of the stages
#
# Each record has the seconds of its stages (compiled kernels are cached on disk).

# %%
stages = ["partition", "mesh", "hanging", "assemble", "system", "setup"]
stages += ["solve", "estimate", "refine"]
bottom = np.zeros(len(records))
for stage in stages:
    seconds = np.array([record.seconds[stage] for record in records])
    plt.bar(range(len(records)), seconds, bottom=bottom, label=stage)
    bottom += seconds
plt.xlabel("step")
plt.ylabel("wall time [s]")
plt.legend(bbox_to_anchor=(1, 1));

# %% [markdown]
# ## Marking by hand
#
# `Beginning.after` refines the leaves that *you* mark, here all leaves near the pole, and `adapt` continues from there.

# %%
from dolfinx.mesh import compute_midpoints

from fx_contact import Beginning

first = next(adapt(scene, tolerance=0.04))
for _ in range(3):
    leaf = first.leaf_mesh.leaf
    cells = np.arange(len(leaf), dtype=np.int32)
    centre = compute_midpoints(first.leaf_mesh.mesh, 3, cells)
    marked = np.zeros(len(first.forest), dtype=bool)
    marked[leaf] = np.linalg.norm(centre, axis=1) < 0.2
    first = next(adapt(scene, tolerance=0.04, beginning=Beginning.after(first, marked)))

print(f"by hand:   {first.record.dofs:6,} dofs, error {first.record.estimate:.1%}")
print(f"by itself: {step.record.dofs:6,} dofs, error {step.record.estimate:.1%}")
