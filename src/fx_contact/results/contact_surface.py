"""Fields on both sides of the contact surfaces, on a mesh of facets."""

from typing import Any

import basix.ufl
import numpy as np
from basix import CellType
from dolfinx import fem
from dolfinx.mesh import create_mesh

from fx_contact.adaptive.contact_line import nodal_means
from fx_contact.adaptive.step import Step, check_step
from fx_contact.fem.leaf_mesh import basix_order, leaf_positions
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.compat import stay
from fx_contact.parallel.meeting import collective
from fx_contact.results.vtx import function_on

#: Scalar fields: nodal ones, then those of the leaf behind the facet.
_SCALARS = ("pressure", "closed", "gap", "body", "level", "rank", "indicator")


@collective("step.forest.comm")
def contact_functions(step: Step) -> dict[str, fem.Function]:
    """Fields of a step with contact on both sides of the contact surfaces, by name, on a mesh of quadrilaterals.

    Collective on the step's communicator.  Facets are on the rank of their leaf and have the order of its geometry or
    of the displacement, the higher one.  They share no nodes: fields may jump between them.

    Returns:
        `displacement` [m]; `pressure` [Pa]; `closed`, 1 for a closed pair and 0 for an open one; open `gap` [m];
        `body`, as numbered in the root mesh; and of the leaf behind the facet `level`, `rank` and `indicator`
        [J^(1/2)].

    Raises:
        SceneError: no step, or one without contact.
    """
    check_step(step, contact=True)
    forest, space = step.forest, step.elasticity.prolongation.space
    leaf_order, degree = step.leaf_mesh.order, step.record.degree
    order = max(leaf_order, degree)
    leaf, face = contact_faces(step)
    on_face = np.arange(len(leaf))[:, None], hexahedron.face_nodes(leaf_order)[face]
    points = face_interpolation(leaf_order, order) @ leaf_positions(forest, leaf, leaf_order)[on_face]
    nodal = face_interpolation(degree, order) @ nodal_values(step)[space.on_faces(leaf, face)]
    nodal[:, :, 4] = nodal[:, :, 4] > 0.5  # 0 or 1 also between nodes
    indicator = np.empty(len(forest))
    indicator[step.leaf_mesh.leaf] = step.estimate.error
    rank = np.full(len(leaf), forest.comm.rank)
    of_facet = np.stack([forest.mesh.body[forest.cell[leaf]], forest.level[leaf], rank, indicator[leaf]], axis=1)
    values = np.concatenate([nodal, np.repeat(of_facet[:, None], points.shape[1], axis=1)], axis=2)

    def element(*shape: int) -> Any:
        """Equispaced Lagrange element of the facets' order."""
        variant = basix.LagrangeVariant.equispaced
        return basix.ufl.element("Lagrange", "quadrilateral", order, lagrange_variant=variant, shape=shape or None)

    turn, first = basix_order(CellType.quadrilateral, order), forest.comm.exscan(len(leaf)) or 0
    nodes = first * len(turn) + np.arange(len(leaf) * len(turn)).reshape(-1, len(turn))
    x, partitioner = points.reshape(-1, 3), stay(forest.comm.rank, 4)
    mesh = create_mesh(forest.comm, cells=nodes[:, turn], e=element(3), x=x, partitioner=partitioner)
    facet = mesh.topology.original_cell_index - first
    values = values[facet][:, turn]
    fields = {"displacement": function_on(mesh, element(3), "displacement", values[..., :3])}
    for column, name in enumerate(_SCALARS, start=3):
        fields[name] = function_on(mesh, element(), name, values[..., column, None])
    return fields


def contact_faces(step: Step) -> tuple[Int64Array, Int64Array]:
    """Leaves (m,) and their local faces (m,) on surfaces of contact, not of ties.  Local."""
    forest = step.forest
    leaf, face = forest.contact_faces()
    touches = ~step.scene.couplings[forest.contact_surfaces.contact[forest.cell[leaf], face]]
    return leaf[touches], face[touches]


def face_interpolation(order: int, finer: int) -> FloatArray:
    """Values at the nodes of a facet of another order: ((finer+1)^2, (order+1)^2).  Local."""
    edge = hexahedron.lagrange(order, np.linspace(0, 1, finer + 1))
    return np.asarray(np.kron(edge, edge), dtype=np.float64)


def nodal_values(step: Step) -> FloatArray:
    """Displacement [m], and pressure [Pa], status (1 closed) and open gap [m], 0 off the contact: (m, 6).

    Collective on the step's communicator.  The m nodes are this rank's.  A node in several contact pairs of the scene
    has the mean of its rows (`nodal_means`).
    """
    values = np.concatenate([step.solution.displacement, nodal_means(step)], axis=1)
    return step.elasticity.prolongation.prolong(values)
