"""Leaf facets of contact surfaces: opposite positions, tributary areas, and nodes with a row."""

import numpy as np

from fx_contact.contact.enforcement import Enforcement
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.parallel.mpi import Directory
from fx_contact.scene.scene import Scene


def positions_across(
    forest: Forest, leaf: Int64Array, face: Int64Array, points: IntArray | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions of points of paired facets, as in `RowKind.apart`, and of those opposite: two (n, m, 3) [m].  Local."""
    cell, _, opposite = forest.pairing.opposite(forest.cell[leaf], face, points)
    return forest.evaluate(forest.cell[leaf], points), forest.evaluate(cell, opposite)


def facet_shares(space: Space, nodes: FloatArray, face: Int64Array) -> tuple[FloatArray, FloatArray]:
    """Integrals of shape functions over facets by their nodes (n, (p+1)^2, 3) [m], exact for a uniform pressure.

    Local.  Returns (n, (p+1)^2) areas [m^2], and (n, (p+1)^2, 3) areas times the outward normals.
    """
    weights, value, along_u, along_v = space.facet_rule
    normal = np.cross(along_u @ nodes, along_v @ nodes) * hexahedron.FACE_ORIENTATION[face][:, None, None]
    value = weights[:, None] * value
    return np.linalg.norm(normal, axis=2) @ value, value.T @ normal


def moduli(scene: Scene, regions: IntArray) -> FloatArray:
    """E/(1 - nu^2) of the mesh's regions by their number, inf of none (-1): shaped as `regions` [Pa].  Local."""
    known = [scene.materials[name].plane_strain_modulus for name in scene.mesh.regions]
    return np.asarray(np.array([*known, np.inf])[regions])


def mean_moduli(scene: Scene, regions: IntArray, compliances: FloatArray) -> FloatArray:
    """E/(1 - nu^2) at both sides of rows, where parts meet the harmonic mean by area: (n, 2) [Pa].

    Local.

    Args:
        regions: (n, 2), of one of the facets of each row, -1: none.
        compliances: (n, 3), of the row the area, and the sums of area/modulus of its facets on both sides.
    """
    if not scene.mesh.parts:
        return moduli(scene, regions)
    with np.errstate(divide="ignore"):
        return np.asarray(compliances[:, :1] / compliances[:, 1:])


def spring_stiffness(enforcement: Enforcement, modulus: FloatArray, area: FloatArray) -> FloatArray:
    """Shares (n, k) [N/m] of facet nodes in c E*/h of each facet, from moduli (n, 2) and areas (n, k).  Local."""
    surface = enforcement.penalty_factor / (1 / modulus).sum(axis=1) / np.sqrt(area.sum(axis=1))
    return np.asarray(surface[:, None] * area)


def nodal_sums(
    prolongation: Prolongation, leaf: Int64Array, face: Int64Array, values: FloatArray
) -> tuple[Int64Array, Int64Array, FloatArray]:
    """Conforming nodes of facets, each on one rank, and sums of nodal values (n, (p+1)^2, k) over facets of all ranks.

    Collective.  Shares of hanging nodes go to their masters.  A node is on a rank that has a facet of it: its owner,
    unless contacts meet.

    Returns:
        (m,) nodes, positions in the index map; (m,) an example of each in the raveled facet nodes; (m, k) sums.
    """
    space, forest = prolongation.space, prolongation.space.forest
    node, sums = space.on_faces(leaf, face), np.zeros((len(space), values.shape[2]))
    np.add.at(sums, node, values)
    distinct, example = np.unique(node, return_index=True)
    conform = ~prolongation.hanging[distinct]
    distinct, example = distinct[conform], example[conform]
    _, owner = Directory(forest.comm, space.keys[distinct], forest.homes.of_points).number()
    own = owner == forest.comm.rank
    first = prolongation.conforming[distinct[own]].astype(np.int64)
    return first, example[own], prolongation.ghosted(prolongation.restrict(sums))[first]
