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
# # Hysteresis loop
#
# Two balls are pressed together and then moved tangentially, to and fro, by less than what makes them slide. A ring of the contact slips. Friction there
# makes the curve of the tangential force a loop, and its area is the dissipated energy. Mindlin's solution for two like balls with $\nu = 0$ is exact on half-spaces.

# %%
import numpy as np

from fx_contact import ContactPair, Dirichlet, Material, Scene, SymmetryPlane
from fx_contact import ball, root_mesh_from_shapes

mu, material, amplitude = 0.5, Material(young=1.0, poisson=0.0), 0.008
upper = ball(1.0, 2, order=3, octants=2)
bodies = {
    "upper": upper.placed(lambda x: (x[0], -x[1], 1.0 - x[2])),
    "lower": upper.shifted(z=-1.0),
}
mesh = root_mesh_from_shapes(bodies)
planes = SymmetryPlane("upper x = 0"), SymmetryPlane("lower x = 0")
fixed = Dirichlet("lower z = 0", 0.0, 0.0, 0.0)


def displacement(time):
    """Pressed at time 1; there at 2, on the other side at 4, back at 6."""
    return amplitude * np.interp(time, (1, 2, 4, 6), (0, 1, -1, 1))


def moved(time):
    """Half of both balls, pressed together by 0.02."""
    along = Dirichlet("upper z = 0", 0.0, displacement(time), -0.02)
    return Scene(
        name="hysteresis",
        mesh=mesh,
        materials=dict.fromkeys(bodies, material),
        dirichlet=(*planes, fixed, along),
        contact=ContactPair("upper outside", "lower outside", friction=mu),
        symmetry=2,
    )


# %% [markdown]
# ## Load steps
#
# `increments` solves the points in order. Each is a load step that begins with the state of the one before. `dissipated_energy` of a point is the sum
# over all load steps up to it; `step.record.dissipated_energy` is that of one.

# %%
from fx_contact import increments
from fx_contact.plot import draw_contact

path = increments(moved, (1, 2, 3, 4, 6), tolerance=0.1)
pictures = []
for point in path:
    record, work = point.step.record, point.record.dissipated_energy
    shear, stick = record.resultants[0].force[1], record.sticking_pairs
    print(f"time {point.value:g}: displacement {displacement(point.value):g}")
    print(f"    P {record.force:.4e}, Q {shear:.4e}, dissipated {work:.3e}")
    print(f"    {stick} nodes stick, {record.slipping_pairs} slip")
    file = f"../results/notebooks/status_{point.value:g}.png"
    pictures.append(draw_contact(point.step, file, "status"))

# %% [markdown]
# ## Stick and slip
#
# On the way there a ring slips at the edge of the contact. After the reversal all nodes stick at first, then a ring slips the other way. When the balls are back
# in the middle this ring is narrower than the first one.

# %%
import matplotlib.pyplot as plt

figure, panels = plt.subplots(1, 3, figsize=(13, 3.4), layout="constrained")
for axes, index, name in zip(panels, (1, 2, 3), ("there", "middle", "other side")):
    axes.imshow(plt.imread(pictures[index]))
    axes.set_title(name)
    axes.axis("off")

# %% [markdown]
# ## Loop
#
# With $q = Q / (\mu P)$, the contact radius $a$ and $C = \sum (2 - \nu) / G$ the first loading is
#
# $$ \delta(q) = D\, (1 - (1 - q)^{2/3}), \qquad D = \frac{3 \mu P}{16 a}\, C. $$
#
# A branch after a reversal at $q_0$ is twice as large: $\delta_0 - \delta = 2\, \delta((q_0 - q) / 2)$. The half-balls, which are held at their middle planes, yield more than
# half-spaces. This part is linear in $Q$ and not of the contact; it is found from the first reversal.

# %%
from fx_contact.results.analytic import Hertz

records = [one.record for one in path.records]
force = records[1].force
q = np.array([one.resultants[0].force[1] for one in records]) / (mu * force)
there = [displacement(one.value) for one in path.records]
radius = Hertz.of_equal_spheres(1.0, material, force).contact_radius
nu, modulus = material.poisson, material.young / (2 * (1 + material.poisson))
compliance = 2 * (2 - nu) / modulus
scale = 3 * mu * force / (16 * radius) * compliance


def loading(q):
    """Mindlin's first loading."""
    return scale * (1 - (1 - q) ** (2 / 3))


top = q[1]
distant = (amplitude - loading(top)) / top
first, branch = np.linspace(0, top, 100), np.linspace(-top, top, 200)
back = loading(top) - 2 * loading((top - branch) / 2)
color = "#D55E00"
plt.plot(loading(first) + distant * first, first, color=color, label="Mindlin")
plt.plot(back + distant * branch, branch, color=color)
plt.plot(-back - distant * branch, -branch, color=color)
plt.plot(there, q, "o", color="#0072B2", label="load steps")
plt.xlabel("displacement [m]")
plt.ylabel("tangential force Q / (mu P)")
plt.legend();

# %% [markdown]
# ## Dissipated energy
#
# The area of the loop is
#
# $$ W = \frac{9 \mu^2 P^2}{10 a}\, C \left(1 - (1 - q)^{5/3} - \tfrac56 q\, (1 + (1 - q)^{2/3})\right). $$
#
# The first loading dissipates a quarter of it, since slip is twice as large on each of the two branches.

# %%
part = 1 - (1 - top) ** (5 / 3) - 5 * top / 6 * (1 + (1 - top) ** (2 / 3))
work = 9 * mu**2 * force**2 / (10 * radius) * compliance * part
dissipated = [one.dissipated_energy for one in path.records]
print(f"first loading {dissipated[1]:.3e}, Mindlin {work / 4:.3e}")
print(f"cycle {dissipated[-1] - dissipated[1]:.3e}, Mindlin {work:.3e}")

# %% [markdown]
# The cycle dissipates four times what the first loading did, and $Q$ is back at its value: the loop closes. With six nodes along the radius the energy is
# 9 % above Mindlin's; with `tolerance=0.05` that of the first loading is 2 % above.
#
# ## Size of the load steps
#
# `repeated(2)` solves the path again from rest on its last mesh, each load step in two halves. The change has two causes: meshes of
# earlier points, and the size of the load steps.

# %%
print(path.repeated(2))

# %% [markdown]
# The change is far below the tolerance: between two reversals Mindlin's solution does not depend on the steps. [Friction](../docs/howto/friction.md) has
# the entries of the records and the limits.
