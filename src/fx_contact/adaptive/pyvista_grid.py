"""A step as a grid of pyvista."""

import warnings

import numpy as np

from fx_contact.estimate.recovery import TENSOR, von_mises


def import_pyvista():
    """The module pyvista, without its warning in notebooks that progress bars of downloads are missing.  Local."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="IProgress not found")
        import pyvista
    return pyvista


def leaf_grid(step):
    """This rank's leaves, undeformed, as a grid of pyvista; what `Step.to_pyvista` gives.

    Local.

    Args:
        step: Step.

    Returns:
        pyvista UnstructuredGrid.
    """
    from dolfinx.plot import vtk_mesh

    space, recovered, forest, leaf = (
        step.displacement.function_space,
        step.estimate.stress,
        step.forest,
        step.leaf_mesh.leaf,
    )
    grid = import_pyvista().UnstructuredGrid(*vtk_mesh(space))
    stress = np.empty((grid.n_points, 6))
    stress[space.dofmap.list] = recovered.x.array.reshape(-1, 6)[recovered.function_space.dofmap.list]
    grid.point_data["displacement"] = step.displacement.x.array.reshape(-1, 3)
    grid.point_data["stress"] = stress[:, np.ravel(TENSOR)]
    grid.point_data["von Mises stress"] = von_mises(stress)
    grid.cell_data["body"] = forest.mesh.body[forest.cell[leaf]]
    grid.cell_data["level"] = forest.level[leaf]
    grid.cell_data["rank"] = np.full(len(leaf), forest.comm.rank)
    grid.cell_data["indicator"] = step.estimate.error
    return grid
