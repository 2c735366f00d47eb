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
# Two elastic half-spheres are pressed together, pole to pole. Where do they touch, how hard, and how large is the
# stress below the surface? One rank is enough; by symmetry a quarter of each body is modelled.

# %%
from IPython.display import Image

from fx_contact import Material, adapt
from fx_contact.plot import draw_mesh
from fx_contact.scenes import hertz

material = Material(young=1.0, poisson=0.3)
scene = hertz(radius=1.0, displacement=0.01, material=material)
steps = list(adapt(scene, tolerance=0.2))
Image(draw_mesh(steps[-1], "../results/notebooks/mesh.png", colour="level"), width=700)

# %% [markdown]
# `adapt` solved the problem several times and refined where its own estimate saw the largest errors, until the stress
# field was good to 20 % in the energy norm. Every step has a record: the same numbers that a run on many ranks writes to
# `steps.jsonl`. Force, radius and pressure come much closer than 20 %.

# %%
from fx_contact.results import table_head, table_row

print(table_head(), *(table_row(step.record) for step in steps), sep="\n")

# %% [markdown]
# ## Pressure
#
# A dot is the pressure at a pair of facing nodes, of which a facet has nine. The curve is Hertz's, of half-spaces,
# through the same force. The dots bend away where the contact ends, within one facet.

# %%
from fx_contact.results import Hertz
from fx_contact.plot import draw_pressure

*_, step = adapt(scene, tolerance=0.08)
theory = Hertz.of_equal_spheres(1.0, material, step.record.force)
Image(draw_pressure(step, "../results/notebooks/pressure.png", theory), width=600)

# %%
print(f"largest pressure {step.record.max_pressure:.5f} Pa, Hertz {theory.max_pressure:.5f} Pa")
print(f"contact radius   {step.record.contact_radius:.5f} m,  Hertz {theory.contact_radius:.5f} m")

# %% [markdown]
# ## Stress
#
# The material yields below the surface, not at it: the von Mises stress is largest half a contact radius down. This is
# why gears and bearings fail from within. The lines are the leaves that refinement has left.

# %%
from fx_contact.plot import draw_stress

Image(draw_stress(step, "../results/notebooks/stress.png", zoom=2), width=700)

# %% [markdown]
# ## Change something
#
# Hertz's force grows with the approach to the power 3/2. Do finite bodies follow?

# %%
import matplotlib.pyplot as plt
import numpy as np

approach = np.array([0.005, 0.01, 0.02, 0.04])
force = []
for delta in approach:
    *_, last = adapt(hertz(displacement=delta, material=material), tolerance=0.08)
    force.append(last.record.force)

plt.loglog(approach, force, "o", label="two half-spheres")
plt.loglog(approach, 4 / 3 * theory.modulus * theory.radius**0.5 * approach**1.5, label="half-spaces")
plt.xlabel("approach [m]")
plt.ylabel("force [N]")
plt.legend();

# %% [markdown]
# Almost. They are a little stiffer: the faces that push are flat and near, not infinitely far away.
#
# `fx_contact.results.output.write_fields(step, "results")` writes all fields for ParaView; the last two cells of
# [how the adaptive loop works](adaptive_loop.ipynb) take the loop apart.
