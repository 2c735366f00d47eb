"""Prescribed displacements and symmetry planes of a scene at the conforming nodes of a forest."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from mpi4py import MPI

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.fem.supports import Supports
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import SIDE
from fx_contact.items.boundary_conditions import Dirichlet, ObliquePlane, merged
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.parallel.mpi import together
from fx_contact.scene.scene import Scene

#: Largest difference of two conditions on one component, relative to the largest prescribed displacement: positions of
#: vertices between the nodes of the root mesh are rounded.
_SAME = 1e-9
#: Largest squared sine of the angle between normals of one plane.  Surfaces are plane to 1e-6 of their size
#: (`geometry.hexahedral_mesh.PLANE`), their facets, which may be much smaller, less exactly.
SAME_PLANE = 1e-8
#: Defect of the squared length of an axis projected onto the span of normals: 1e-6 of the length, as for planes.
_ALONG_AXIS = 1e-12


def find_supports(scene: Scene, forest: Forest, prolongation: Prolongation) -> Supports:
    """Displacement conditions of a scene at the owned conforming nodes.

    Collective on forest.comm.

    Raises:
        SceneError: a function fails or is not finite at a node, two conditions prescribe different values at a node,
            or one prescribes a displacement across a symmetry plane.
    """
    conditions = [condition for condition in scene.conditions if isinstance(condition, Dirichlet)]
    with together(forest.comm):
        places = [_conforming_at(prolongation, condition.where) for condition in conditions]
        local = [condition.at(prolongation.space.positions(here)) for condition, here in zip(conditions, places)]
    largest = max((np.nanmax(np.abs(values), initial=0.0) for values in local), default=0.0)
    largest = forest.comm.allreduce(largest, op=MPI.MAX)
    result = np.full((prolongation.owned, 3), np.nan)
    for condition, here, values in zip(conditions, places, local):
        # The owner of a node need not have a leaf face on the surface: the value comes from ranks that have one.
        mean = prolongation.averaged(prolongation.conforming[here], values)
        ours = np.flatnonzero(~np.isnan(mean).all(axis=1))
        with together(forest.comm):
            place = partial(_position, prolongation, ours)
            result[ours] = merged(result[ours], condition, mean[ours], _SAME * largest, place)
    return _with_planes(scene, prolongation, result, largest) if scene.oblique_planes else Supports(result)


def _with_planes(scene: Scene, prolongation: Prolongation, prescribed: FloatArray, largest: float) -> Supports:
    """Supports by prescribed components, those by planes across axes included, and by oblique planes."""
    across: FloatArray = np.zeros((len(prescribed), 3, 3))
    for plane, nodes in zip(scene.oblique_planes, held_nodes(prolongation, scene.oblique_planes)):
        with together(prolongation.comm):
            plane.check(prescribed[nodes], largest, partial(_position, prolongation, nodes))
        across[nodes] += plane.across
    nodes = np.flatnonzero(across.any(axis=(1, 2)))
    free, across = np.isnan(prescribed[nodes]), across[nodes]
    span = spans(across, free)
    axes = free & (np.einsum("nii->ni", span) > 1 - _ALONG_AXIS)
    prescribed[nodes] = np.where(axes, 0.0, prescribed[nodes])
    span = spans(span, free & ~axes)
    some = span.any(axis=(1, 2))
    return Supports(prescribed, (nodes[some], np.eye(3) - span[some]))


def spans(matrices: FloatArray, free: BoolArray) -> FloatArray:
    """Projectors (k, 3, 3) on the ranges of sums n n^T of normals, restricted to free components (k, 3).  Local."""
    both = free[:, :, None] & free[:, None]
    values, vectors = np.linalg.eigh(np.where(both, matrices, 0.0))
    vectors = vectors * (values > SAME_PLANE)[:, None]
    return np.where(both, vectors @ vectors.swapaxes(1, 2), 0.0)


def shared_forces(
    conditions: Sequence[Dirichlet | ObliquePlane], supported: Sequence[IntArray], forces: FloatArray
) -> FloatArray:
    """Minimum-norm distribution of reaction forces r (owned, 3) [N] over the conditions at each node: G^+ r.

    Local.  The force of a condition is H G^+ r with H its `across` and G the sum of H over the conditions of the node:
    in the direction of an axis equal parts of r.  `supported`: from `held_nodes`.
    """
    count: FloatArray = np.zeros(forces.shape)
    tilted = np.zeros(len(forces), dtype=bool)
    for nodes, condition in zip(supported, conditions):
        count[nodes] += np.diag(condition.across)
        tilted[nodes] |= isinstance(condition, ObliquePlane)
    result = np.where(count > 0, forces, 0.0) / np.maximum(count, 1)
    if tilted.any():
        total, place = np.zeros((tilted.sum(), 3, 3)), np.cumsum(tilted) - 1
        for nodes, condition in zip(supported, conditions):
            total[place[nodes[tilted[nodes]]]] += condition.across
        inverse = np.linalg.pinv(total, rcond=SAME_PLANE, hermitian=True)
        result[tilted] = np.einsum("nij,nj->ni", inverse, forces[tilted])
    return result


def held_nodes(prolongation: Prolongation, conditions: Sequence[Dirichlet | ObliquePlane]) -> list[Int64Array]:
    """Owned conforming nodes (k,) on which each condition acts.  Collective on prolongation.comm."""
    on = prolongation.zeros(len(conditions))
    for column, condition in enumerate(conditions):
        on[prolongation.conforming[_conforming_at(prolongation, condition.where)], column] = 1
    return [np.flatnonzero(column) for column in prolongation.summed(on).T]


def _conforming_at(prolongation: Prolongation, where: str) -> IntArray:
    """This rank's conforming nodes on a named surface or curve, or at a named vertex, as positions in the Space."""
    space, forest, mesh = prolongation.space, prolongation.space.forest, prolongation.space.forest.mesh
    if where in mesh.surfaces:
        here = nodes_on(space, mesh.surfaces[where])
    elif where in mesh.curves:
        leaf, edge = forest.boundary_edges(mesh.curves[where])
        here = space.cells[leaf[:, None], space.edge_nodes[edge]]
    else:
        cell, corner = np.nonzero(np.isin(mesh.corners, mesh.nodes_of(where)))
        points = (SIDE * hexahedron.CORNERS[corner])[:, None]
        place = space.find(forest.lattice.keys(cell, points)[:, 0])
        here = place[place >= 0]
    here = np.unique(here)
    return here[~prolongation.hanging[here]]


def _position(prolongation: Prolongation, nodes: Int64Array, row: int) -> FloatArray:
    return prolongation.space.positions(np.flatnonzero(prolongation.conforming == nodes[row]))[0]


def nodes_on(space: Space, facets: IntArray) -> IntArray:
    """This rank's nodes (m, (p+1)^2) of the leaf faces on facets (n, 2) of the root mesh."""
    return space.on_faces(*space.forest.boundary_faces(facets))
