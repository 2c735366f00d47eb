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
# # Force against approach
#
# A rigid ball is pressed into an elastic block. How does the force grow with the approach? `sweep` solves a scene for a list of values, and
# starts each point from the displacement of the previous one, on its coarsened mesh.

# %%
from fx_contact import ContactPair, Dirichlet, Material, RigidSphere, Scene
from fx_contact import SymmetryPlane, block, root_mesh_from_shapes

quarter = block((0, 0, -2), (2, 2, 0), cells=(4, 4, 4), order=1)
mesh = root_mesh_from_shapes({"block": quarter})
ball = RigidSphere(centre=(0, 0, 1), radius=1)


def pressed(approach, obstacle=ball):
    """A quarter of the block, on which the obstacle has moved down."""
    return Scene(
        name="ball on block",
        mesh=mesh,
        materials={"block": Material(young=1.0, poisson=0.3)},
        dirichlet=(
            Dirichlet("block bottom", z=0),
            SymmetryPlane("block left"),
            SymmetryPlane("block front"),
        ),
        contact=ContactPair("block top", obstacle, moved=(0, 0, -approach)),
        symmetry=4,
    )


# %% [markdown]
# ## Path
#
# The points may have any order, since frictionless contact has no memory. Here the largest approach is first: each
# smaller contact lies inside the refined region of the previous one.

# %%
from fx_contact import sweep

values = [0.02, 0.01, 0.005]
path = sweep(pressed, values, tolerance=0.1)
for point in path:
    record = point.step.record
    print(f"{point.value:.4f}: force {record.force:.3e}, {record.dofs:,} unknowns")
    print(f"        {point.record.solves} solves, begun {point.record.begun}")

# %%
from IPython.display import Image

from fx_contact.plot import draw_sweep

file = "../results/notebooks/path.png"
Image(draw_sweep(path, file, label="approach", logarithmic=True), width=600)

# %% [markdown]
# ## Comparison with Hertz
#
# Hertz: $F = \tfrac43 E^* R^{1/2} d^{3/2}$ on a half-space. The slope in the logarithmic plot is the exponent:

# %%
import numpy as np

force = [one.record.force for one in path.records]
exponent, _ = np.polyfit(np.log(values), np.log(force), 1)
modulus = 1 / (1 - 0.3**2)
hertz = 4 / 3 * modulus * np.array(values) ** 1.5
print(f"exponent {exponent:.3f}; force over Hertz", np.round(force / hertz, 3))

# %% [markdown]
# The block is finite: its base is held at a depth of 2. It is stiffer than a half-space, more so for a larger contact. Therefore the exponent is
# larger than 1.5, and the force is 4 to 9 % above Hertz's.
#
# ## Exercises
#
# 1. What is the exponent for a cone with a half-angle of 70 degrees?
# 2. The ball is pressed by a force of 1e-3 instead. What is the approach?
#
# <details><summary>Answer 1</summary>
#
# ```python
# from fx_contact import RigidCone
#
# cone = RigidCone(apex=(0, 0, 0), axis=(0, 0, 1), angle=70)
# path = sweep(lambda approach: pressed(approach, cone), [0.04, 0.02], tolerance=0.2)
# force = [point.step.record.force for point in path]
# print(np.log2(force[0] / force[1]))
# ```
#
# 2.0: the force of a cone grows with the square of the approach. At its apex the pressure is infinite; the computed maximum grows with each mesh.
#
# </details>
#
# <details><summary>Answer 2</summary>
#
# ```python
# from dataclasses import replace
# from fx_contact import solve
#
# below = ContactPair("block top", ball, force=(0, 0, -1e-3))
# step = solve(replace(pressed(0.0), contact=below), tolerance=0.2)
# print(step.record.motions)
# ```
#
# The record has a motion by the name of the contact: 0.0075. Hertz's formula for a half-space gives 0.0078.
#
# </details>
