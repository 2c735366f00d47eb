"""Fields on both sides of the contact surfaces, as a grid of pyvista."""

from typing import Any

import numpy as np

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.adaptive.step import Step, check_step
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.meeting import collective


@collective("step.forest.comm")
def contact_grid(step: Step) -> Any:
    """This rank's facets of the contact surfaces, both sides, as an undeformed pyvista UnstructuredGrid.

    Collective on the step's communicator.  Facets are Lagrange quadrilaterals on the rank of their leaf, of the order
    of its geometry or of the displacement, the higher one.  They share no nodes: fields may jump between them.  Where
    the rim of the other surface crosses facets fields go on beyond it.

    Returns:
        Grid with point data `displacement` (n, 3) [m], `pressure` [Pa], `closed`, 1 for a closed pair and 0 for an
        open one, and open `gap` [m]; with friction `traction`, `slip` (n, 3) and `slips` (1 or 0) as in
        `ContactTable`; cell data `body`, as numbered in the root mesh, and of the leaf behind the facet `level`, `rank`
        and `indicator` [J^(1/2)].

    Raises:
        SceneError: no step, or one without contact.
    """
    check_step(step, contact=True)
    pyvista, forest, space = import_pyvista(), step.forest, step.elasticity.prolongation.space
    leaf_order, degree = step.leaf_mesh.order, step.record.degree
    order = max(leaf_order, degree)
    leaf, face = contact_faces(step)
    turn = _vtk_order(order)
    on_face = np.arange(len(leaf))[:, None], hexahedron.face_nodes(leaf_order)[face]
    geometry, functions = (hexahedron.face_interpolation(known, order)[turn] for known in (leaf_order, degree))
    points = geometry @ leaf_positions(forest, leaf, leaf_order)[on_face]
    nodal = functions @ nodal_values(step)[space.on_faces(leaf, face)]
    cells = np.insert(np.arange(points.size // 3).reshape(len(leaf), len(turn)), 0, len(turn), axis=1)
    kinds = np.full(len(leaf), pyvista.CellType.LAGRANGE_QUADRILATERAL)
    grid = pyvista.UnstructuredGrid(cells.ravel(), kinds, points.reshape(-1, 3))
    values = nodal.reshape(-1, nodal.shape[2])
    grid.point_data["displacement"] = values[:, :3]
    grid.point_data["pressure"], grid.point_data["gap"] = values[:, 3], values[:, 5]
    grid.point_data["closed"] = (values[:, 4] > 0.5).astype(float)  # 0 or 1 also between nodes
    if step.solution.traction is not None:
        grid.point_data["traction"], grid.point_data["slip"] = values[:, 6:9], values[:, 9:12]
        grid.point_data["slips"] = (values[:, 12] > 0.5).astype(float)
    indicator = np.empty(len(forest))
    indicator[step.leaf_mesh.leaf] = step.estimate.error
    grid.cell_data["body"] = forest.mesh.body[forest.cell[leaf]]
    grid.cell_data["level"] = forest.level[leaf]
    grid.cell_data["rank"] = np.full(len(leaf), forest.comm.rank)
    grid.cell_data["indicator"] = indicator[leaf]
    return grid


def _vtk_order(order: int) -> Int64Array:
    """Nodes of a facet, first tangent fastest, in the order of VTK: corners, sides around, inner ones."""
    grid = np.arange((order + 1) ** 2).reshape(order + 1, order + 1)
    corners = grid[[0, 0, -1, -1], [0, -1, -1, 0]]
    sides = grid[0, 1:-1], grid[1:-1, -1], grid[-1, 1:-1], grid[1:-1, 0]
    return np.concatenate([corners, *sides, grid[1:-1, 1:-1].ravel()])


def contact_faces(step: Step) -> tuple[Int64Array, Int64Array]:
    """Leaves (m,) and their local faces (m,) on surfaces of contact, not of ties.  Local."""
    contacts = range(len(step.scene.contact))
    return step.forest.boundary_faces(np.argwhere(step.forest.contact_surfaces.on(contacts)))


def nodal_values(step: Step) -> FloatArray:
    """Displacement [m], and pressure [Pa], status (1 closed) and open gap [m], 0 off the contact: (m, 6).

    With friction also traction [Pa], slip [m] and status (1 slips): (m, 13).

    Collective on the step's communicator.  The m nodes are this rank's.  A node in several contact pairs of the scene
    has the mean of its rows, weighted by their areas.
    """
    rows, solution, prolongation = step.contact_rows, step.solution, step.elasticity.prolongation
    columns = [np.ones(len(rows)), solution.pressure, solution.active, -solution.penetration]
    if solution.traction is not None:
        columns += [solution.traction, solution.slip_vector, solution.slides]
    values = rows.area[:, None] * np.column_stack(columns)
    sums = prolongation.zeros(values.shape[1])
    entries = rows.entries
    np.add.at(sums, entries.node, np.abs(entries.weight)[:, None] * values[entries.row])
    sums = prolongation.summed(sums)
    means = sums[:, 1:] / np.where(sums[:, :1] > 0, sums[:, :1], 1.0)
    return prolongation.prolong(np.concatenate([solution.displacement, means], axis=1))
