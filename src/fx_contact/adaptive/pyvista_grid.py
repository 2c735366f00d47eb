"""A step as a grid of pyvista."""

import warnings
from types import ModuleType
from typing import Any

import numpy as np
from dolfinx import fem

from fx_contact.estimate.solved_state import SolvedState
from fx_contact.estimate.stress_recovery import von_mises
from fx_contact.items.materials import VOIGT


def import_pyvista() -> ModuleType:
    """The module pyvista, without its warning in notebooks that progress bars are missing.  Local."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="IProgress not found")
        import pyvista
    return pyvista


def leaf_grid(step: SolvedState, displacement: fem.Function, stress: fem.Function) -> Any:
    """Undeformed pyvista UnstructuredGrid of this rank's leaves, with the data of `Step.to_pyvista`.

    Local.  Its nodes are those of the stress: of the displacement's elements, shared or of each cell.
    """
    from dolfinx.plot import vtk_mesh

    forest, leaf, space = step.forest, step.elasticity.leaf_mesh.leaf, stress.function_space
    grid = import_pyvista().UnstructuredGrid(*vtk_mesh(space))
    tensors, vectors = stress.x.array.reshape(-1, 9), np.empty((grid.n_points, 3))
    vectors[space.dofmap.list] = displacement.x.array.reshape(-1, 3)[displacement.function_space.dofmap.list]
    grid.point_data["displacement"] = vectors
    grid.point_data["stress"] = tensors
    grid.point_data["von Mises stress"] = von_mises(tensors[:, np.array(VOIGT) @ [3, 1]])
    grid.cell_data["body"] = forest.mesh.body[forest.cell[leaf]]
    grid.cell_data["region"] = forest.mesh.region[forest.cell[leaf]]
    grid.cell_data["level"] = forest.level[leaf]
    grid.cell_data["rank"] = np.full(len(leaf), forest.comm.rank)
    grid.cell_data["indicator"] = step.estimate.error
    return grid
