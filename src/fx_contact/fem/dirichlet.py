"""Prescribed displacements and symmetry planes of a scene on the conforming unknowns of a forest."""

import numpy as np
from mpi4py import MPI

from fx_contact.fem.supports import Supports
from fx_contact.parallel.mpi import together
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import Dirichlet, ObliquePlane, merged
from fx_contact.problem.lattice import SIDE

#: Two conditions that prescribe one component agree where they differ by no more, relative to the largest of all:
#: positions of vertices between the nodes of the root mesh are rounded.
_SAME = 1e-9
#: Squared sine of the angle between normals of planes up to which these are one plane: surfaces are plane to 1e-6 of
#: their size (`problem.boundary_conditions.PLANE`), their facets, which may be much smaller, to less.
SAME_PLANE = 1e-8
#: What an axis that normals span may lack of its squared length: 1e-6 of the length, as planes across axes.
_ALONG_AXIS = 1e-12


def find_supports(scene, forest, prolongation):
    """What the displacement conditions of a scene hold at this rank's conforming nodes.

    Collective on forest.comm.  Hanging nodes have none of their own.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        Supports at the owned conforming nodes.

    Raises:
        SceneError: a displacement that is a function fails or is not finite somewhere, or two conditions prescribe
            different values at one vertex, or one across a symmetry plane.
    """
    conditions = [condition for condition in scene.conditions if isinstance(condition, Dirichlet)]
    with together(forest.comm):
        said = [_said(condition, scene, prolongation) for condition in conditions]
    largest = max((np.nanmax(np.abs(values), initial=0.0) for _, values in said), default=0.0)
    largest = forest.comm.allreduce(largest, op=MPI.MAX)
    result = np.full((prolongation.owned, 3), np.nan)
    for condition, (at, values) in zip(conditions, said):
        # The owner of a node need not have a leaf face on the surface: ranks that have one tell it.
        mean = prolongation.averaged(at, values)
        ours = np.flatnonzero(~np.isnan(mean).all(axis=1))
        with together(forest.comm):
            result[ours] = merged(
                result[ours], condition, mean[ours], _SAME * largest, lambda row: _position(prolongation, ours[row])
            )
    if not scene.oblique_planes:
        return Supports(result)
    return Supports(*_with_planes(scene, prolongation, result, largest))


def _with_planes(scene, prolongation, prescribed, largest):
    """Arguments of Supports: what is prescribed, axes that planes hold among it, and P of what else they hold."""
    across = np.zeros((len(prescribed), 3, 3))
    for plane, nodes in zip(scene.oblique_planes, held_nodes(scene, prolongation, scene.oblique_planes)):
        with together(prolongation.comm):
            plane.check(prescribed[nodes], largest, lambda row: _position(prolongation, nodes[row]))
        across[nodes] += plane.across
    nodes = np.flatnonzero(across.any(axis=(1, 2)))
    free, across = np.isnan(prescribed[nodes]), across[nodes]
    span = _span(across, free)
    axes = free & (np.einsum("nii->ni", span) > 1 - _ALONG_AXIS)
    prescribed[nodes] = np.where(axes, 0.0, prescribed[nodes])
    span = _span(span, free & ~axes)
    some = span.any(axis=(1, 2))
    return prescribed, (nodes[some], np.eye(3) - span[some])


def _span(matrices, free):
    """Projectors on the ranges of sums n n^T of normals, in free components (k, 3): (k, 3, 3)."""
    both = free[:, :, None] & free[:, None]
    values, vectors = np.linalg.eigh(np.where(both, matrices, 0.0))
    vectors = vectors * (values > SAME_PLANE)[:, None]
    return np.where(both, vectors @ vectors.swapaxes(1, 2), 0.0)


def shared_forces(conditions, held, forces):
    """The least forces of conditions at nodes that add up to given ones: f of each is its `across` times the result.

    Local.  G = sum of H = `across` over the conditions of a node, f = H G^+ r; along an axis equal parts of r.

    Args:
        conditions: of the scene.
        held: list of (k,) int, the nodes of each, as from `held_nodes`.
        forces: (owned, 3) float64, r [N].

    Returns:
        (owned, 3) float64, G^+ r [N].
    """
    count, tilted = np.zeros(forces.shape), np.zeros(len(forces), dtype=bool)
    for nodes, condition in zip(held, conditions):
        count[nodes] += np.diag(condition.across)
        tilted[nodes] |= isinstance(condition, ObliquePlane)
    result = np.where(count > 0, forces, 0.0) / np.maximum(count, 1)
    if tilted.any():
        total, place = np.zeros((tilted.sum(), 3, 3)), np.cumsum(tilted) - 1
        for nodes, condition in zip(held, conditions):
            total[place[nodes[tilted[nodes]]]] += condition.across
        inverse = np.linalg.pinv(total, rcond=SAME_PLANE, hermitian=True)
        result[tilted] = np.einsum("nij,nj->ni", inverse, forces[tilted])
    return result


def held_nodes(scene, prolongation, conditions=None):
    """The nodes that each condition of a scene holds.

    Collective on prolongation.comm.

    Args:
        scene: Scene.
        prolongation: Prolongation of a Space on a forest of its root mesh.
        conditions: some of `scene.conditions`; None: all.

    Returns:
        list of (k,) int64, for each condition the conforming nodes that this rank owns of those it is on.
    """
    conditions = scene.conditions if conditions is None else conditions
    on = prolongation.zeros(len(conditions))
    for column, condition in enumerate(conditions):
        on[prolongation.conforming[_conforming_at(scene, prolongation, condition.where)], column] = 1
    return [np.flatnonzero(column) for column in prolongation.summed(on).T]


def _said(condition, scene, prolongation):
    """What a condition says of this rank's conforming nodes: (n,) their positions in the index map, (n, 3) [m]."""
    here = _conforming_at(scene, prolongation, condition.where)
    return prolongation.conforming[here], condition.at(prolongation.space.positions(here))


def _conforming_at(scene, prolongation, where):
    """This rank's conforming nodes at a named place: (n,) positions in the Space."""
    here = np.unique(_nodes_at(scene, prolongation.space, where))
    return here[~prolongation.hanging[here]]


def _position(prolongation, node):
    """Where an owned conforming node is: (3,) float64 [m]."""
    return prolongation.space.positions(np.flatnonzero(prolongation.conforming == node))[0]


def _nodes_at(scene, space, name):
    """This rank's nodes on a named surface or curve, or at a named vertex, of the root mesh."""
    forest, mesh = space.forest, space.forest.mesh
    if name in mesh.surfaces:
        return nodes_on(space, mesh.surfaces[name])
    if name in mesh.curves:
        leaf, edge = forest.boundary_edges(mesh.curves[name])
        return space.cells[leaf[:, None], space.edge_nodes[edge]]
    cell, corner = np.nonzero(np.isin(mesh.corners, scene.place(name)))
    points = (SIDE * hexahedron.CORNERS[corner])[:, None]
    place = space.find(forest.lattice.keys(cell, points)[:, 0])
    return place[place >= 0]


def nodes_on(space, facets):
    """This rank's nodes of the leaf faces on facets (n, 2) of the root mesh: (m, (p+1)^2)."""
    return space.on_faces(*space.forest.boundary_faces(facets))
