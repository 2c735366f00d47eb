"""A step as a grid of pyvista."""

import warnings

import numpy as np

from fx_contact.estimate.shear_free import VOIGT
from fx_contact.estimate.stress_recovery import von_mises


def import_pyvista():
    """The module pyvista, without its warning in notebooks that progress bars of downloads are missing.  Local."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="IProgress not found")
        import pyvista
    return pyvista


def leaf_grid(step):
    """This rank's leaves, undeformed, as a grid of pyvista; what `Step.to_pyvista` gives.

    Collective on the step's communicator.

    Args:
        step: Step.

    Returns:
        pyvista UnstructuredGrid.
    """
    from dolfinx.plot import vtk_mesh

    space, tensor, forest, leaf = step.displacement.function_space, step.stress, step.forest, step.leaf_mesh.leaf
    grid = import_pyvista().UnstructuredGrid(*vtk_mesh(space))
    stress = np.empty((grid.n_points, 9))
    stress[space.dofmap.list] = tensor.x.array.reshape(-1, 9)[tensor.function_space.dofmap.list]
    grid.point_data["displacement"] = step.displacement.x.array.reshape(-1, 3)
    grid.point_data["stress"] = stress
    grid.point_data["von Mises stress"] = von_mises(stress[:, np.ravel_multi_index(np.transpose(VOIGT), (3, 3))])
    grid.cell_data["body"] = forest.mesh.body[forest.cell[leaf]]
    grid.cell_data["level"] = forest.level[leaf]
    grid.cell_data["rank"] = np.full(len(leaf), forest.comm.rank)
    grid.cell_data["indicator"] = step.estimate.error
    return grid
