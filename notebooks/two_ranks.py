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
# # Two ranks from a notebook
#
# A notebook is one process. `ipyparallel` starts further processes, its engines, under `mpirun`. Cells that begin with `%%px`
# run on all engines: there `MPI.COMM_WORLD` has two ranks, and the program is the same as on one rank.

# %%
import ipyparallel as ipp

cluster = ipp.Cluster(engines="mpi", n=2)
client = cluster.start_and_connect_sync()

# %%
# %%px
from mpi4py import MPI

from fx_contact import adapt
from fx_contact.plot import draw_mesh
from fx_contact.scenes import hertz

comm = MPI.COMM_WORLD
for step in adapt(hertz(), tolerance=0.08, comm=comm):
    pass
leaves = f"{len(step.forest):,} of {step.record.cells:,} leaves"
print(f"rank {comm.rank} of {comm.size} has {leaves}")

# %% [markdown]
# All ranks must make the calls that the documentation names *collective*, for instance pictures: use a `%%px` cell.
# Rank 0 draws, and only visible data are sent to it.

# %%
# %%px
where = draw_mesh(step, "../results/notebooks/partition.png", zoom=None)
where = draw_mesh(step, "../results/notebooks/ranks.png")

# %%
from IPython.display import Image, display

for name in "partition", "ranks":
    display(Image(f"../results/notebooks/{name}.png", width=600))

# %% [markdown]
# Leaves that face each other across the contact are on one rank, so that node pairs need no messages. The record has the
# number of split pairs and of cut facets.

# %%
# `pull` returns local objects: here the record, the same on both ranks.
client[:].execute("record = step.record").get()
print(client[:].pull("record").get()[0].partition)

# %%
cluster.stop_cluster_sync()
