"""Both sides of the contact surfaces as a mesh of facets, with what happens on them."""

import basix.ufl
import numpy as np
from basix import CellType
from dolfinx.mesh import create_mesh

from fx_contact.fem.leaf_mesh import basix_order, leaf_positions
from fx_contact.parallel.compat import stay
from fx_contact.parallel.meeting import collective
from fx_contact.problem import hexahedron
from fx_contact.results.vtx import function_on

#: Fields with one component: at the nodes, then of the leaf behind the facet.
_SCALARS = ("pressure", "closed", "gap", "body", "level", "rank", "indicator")


@collective("step.forest.comm")
def contact_functions(step):
    """Fields on both sides of the contact surfaces.

    Collective on the step's communicator.  Facets have the order of the leaves' geometry or of the displacement, the
    higher one.  They share no nodes: a field may jump from one to the next, and one with a value for each facet is
    constant there.

    Args:
        step: Step with contact.

    Returns:
        dict: name -> dolfinx Function on a mesh of quadrilaterals, each facet on the rank of its leaf: `displacement`
        [m]; `pressure` (`ContactState`) [Pa]; `closed`, 1 for a closed pair and 0 for an open
        one; open `gap` [m]; `body`, as numbered in the root mesh; and of the leaf behind the facet `level`, `rank` and
        `indicator` [J^(1/2)].
    """
    forest, space, leaf_order = step.forest, step.elasticity.prolongation.space, step.leaf_mesh.order
    order = max(leaf_order, space.degree)
    leaf, face = forest.contact_faces()
    on_face = np.arange(len(leaf))[:, None], hexahedron.face_nodes(leaf_order)[face]
    points = face_interpolation(leaf_order, order) @ leaf_positions(forest, leaf, leaf_order)[on_face]
    nodal = face_interpolation(space.degree, order) @ nodal_values(step)[space.on_faces(leaf, face)]
    nodal[:, :, 4] = nodal[:, :, 4] > 0.5  # a status, also between nodes
    indicator = np.empty(len(forest))
    indicator[step.leaf_mesh.leaf] = step.estimate.error
    rank = np.full(len(leaf), forest.comm.rank)
    of_facet = np.stack([forest.mesh.body[forest.cell[leaf]], forest.level[leaf], rank, indicator[leaf]], axis=1)
    values = np.concatenate([nodal, np.repeat(of_facet[:, None], points.shape[1], axis=1)], axis=2)

    def element(*shape):
        """Lagrange element of the facets' order."""
        variant = basix.LagrangeVariant.equispaced
        return basix.ufl.element("Lagrange", "quadrilateral", order, lagrange_variant=variant, shape=shape or None)

    turn, first = basix_order(CellType.quadrilateral, order), forest.comm.exscan(len(leaf)) or 0
    nodes = first * len(turn) + np.arange(len(leaf) * len(turn)).reshape(-1, len(turn))
    mesh = create_mesh(
        forest.comm,
        cells=nodes[:, turn],
        e=element(3),
        x=points.reshape(-1, 3),
        partitioner=stay(forest.comm.rank, 4),
    )
    facet = mesh.topology.original_cell_index - first
    values = values[facet][:, turn]
    fields = {"displacement": function_on(mesh, element(3), "displacement", values[..., :3])}
    for column, name in enumerate(_SCALARS, start=3):
        fields[name] = function_on(mesh, element(), name, values[..., column, None])
    return fields


def face_interpolation(order, finer):
    """Values at the nodes of a facet of one order from those of another.

    Local.

    Args:
        order: of the nodes where values are known.
        finer: order of the nodes where they are wanted.

    Returns:
        ((finer+1)^2, (order+1)^2) float64.
    """
    along = hexahedron.lagrange(order, np.linspace(0, 1, finer + 1))
    return np.kron(along, along)


def nodal_values(step):
    """Displacement, pressure, status and gap at this rank's nodes, the last three zero off the contact.

    Collective on the step's communicator.

    Args:
        step: Step with contact.

    Returns:
        (m, 6) float64: displacement [m], pressure [Pa], 1 where a pair is closed, open gap [m].
    """
    pairs, contact, prolongation = step.pairs, step.contact, step.elasticity.prolongation
    rows = pairs.area[:, None] * np.stack(
        [contact.pressure, contact.active, contact.gap, np.ones(len(contact))], axis=1
    )
    sums = prolongation.zeros(4)
    blocks = pairs.blocks  # a node where contact pairs of the scene meet is in several rows
    weight = np.linalg.norm(blocks.values, axis=1)[:, None]
    np.add.at(sums, blocks.node, weight * rows[blocks.row])
    sums = prolongation.summed(sums)
    means = sums[:, :3] / np.where(sums[:, 3:] > 0, sums[:, 3:], 1.0)
    return prolongation.prolong(np.concatenate([step.solution.displacement, means], axis=1))
