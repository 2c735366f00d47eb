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
# # Hertz in five minutes
#
# Two elastic half-spheres are pressed together, pole to pole. This notebook computes the contact radius, the contact
# pressure and the stress below the surface on one rank. A quarter of each body is modelled.

# %%
from IPython.display import Image

from fx_contact import Material, adapt
from fx_contact.plot import draw_mesh
from fx_contact.scenes import hertz

material = Material(young=1.0, poisson=0.3)
scene = hertz(radius=1.0, displacement=0.01, material=material)
run = adapt(scene, tolerance=0.2)
steps = list(run)
Image(draw_mesh(steps[-1], "../results/notebooks/mesh.png", colour="level"), width=700)

# %% [markdown]
# `adapt` solved the problem several times and refined the cells with the largest estimated errors, until the stress error
# was at most 20 % in the energy norm. Every step has a record. Force, radius and
# pressure are much more accurate than 20 %.

# %%
print(run)

# %% [markdown]
# ## Pressure
#
# A dot is the pressure at a pair of facing nodes; a facet has nine. The curve is Hertz's solution of half-spaces for the
# same force. The dots deviate at the rim of the contact, by at most one facet.

# %%
from fx_contact.plot import draw_pressure
from fx_contact.results.analytic import Hertz

*_, step = adapt(scene, tolerance=0.08)
theory = Hertz.of_equal_spheres(1.0, material, step.record.force)
Image(draw_pressure(step, "../results/notebooks/pressure.png", theory), width=600)

# %%
for name in "max_pressure", "contact_radius":
    print(f"{name} {getattr(step.record, name):.5f}, Hertz {getattr(theory, name):.5f}")

# %% [markdown]
# ## Stress
#
# The von Mises stress has its maximum half a contact radius below the surface. There the material yields first,
# for instance in gears and bearings. The lines are the leaves of the refined mesh.

# %%
from fx_contact.plot import draw_stress

Image(draw_stress(step, "../results/notebooks/stress.png", zoom=2), width=700)

# %% [markdown]
# ## Variation of the approach
#
# Hertz's force grows with the approach to the power 3/2. The same scene at four approaches:

# %%
import matplotlib.pyplot as plt
import numpy as np

approach = np.array([0.005, 0.01, 0.02, 0.04])
force = []
for delta in approach:
    *_, last = adapt(hertz(displacement=delta, material=material), tolerance=0.08)
    force.append(last.record.force)

plt.loglog(approach, force, "o", label="two half-spheres")
hertzian = 4 / 3 * theory.modulus * theory.radius**0.5 * approach**1.5
plt.loglog(approach, hertzian, label="half-spaces")
plt.xlabel("approach [m]")
plt.ylabel("force [N]")
plt.legend();

# %% [markdown]
# Finite bodies are slightly stiffer, since the loaded faces are flat and at a finite distance.
#
# `fx_contact.results.write_fields(step, "results")` writes all fields for ParaView.
# [The adaptive loop](adaptive_loop.ipynb) shows the stages of a step.
