"""Facing root facets of contact surfaces that are meshed alike, and the partners of leaves by integer arithmetic.

Facets are paired once, on the root mesh.  The partners of leaves and lattice points follow from integers, without
search or communication ("éléments appariés", section 2 of the paper).  All is local.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import MAX_LEVEL, SIDE, faces_in, leaf_corners, leaf_side
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import Contact, ContactPair
from fx_contact.items.ties import Tie
from fx_contact.parallel.arrays import BoolArray, Int8Array, Int32Array, Int64Array, IntArray
from fx_contact.parallel.errors import PairingError

Coordinate = TypeVar("Coordinate", bound=np.number[Any])

#: The eight relative orientations of two facing quadrilaterals: swap the tangents, then flip the first, the second.
_SYMMETRIES = np.array(list(product((0, 1), repeat=3)), dtype=bool)

#: Largest distance of facing nodes, projected along a given direction, relative to the size of the facet.
_MATCH = 1e-6
#: Largest tangential offset t of facing nodes without a given direction, relative to the size d of the facet.  On a
#: radius R it changes the gap by t d^2/(2 R), less than half of d^2/(8 R), the distance between facet and chord.
_OFFSET = 0.1


class Pairing:
    """Facing facets of the surfaces of each ContactPair and Tie, the same on all ranks.

    Raises SceneError for an unknown surface, PairingError if surfaces that match face away from a given direction.

    Attributes:
        nonmatching: why surfaces do not match facet by facet and node by node, by the index of the contact; these have
            no partners, as those that share facets with another contact.
        second: (ncells, 6), paired faces on second surfaces.
        partner: (ncells, 6, 2), facing (root cell, local face) of each local face, -1 where it has none.
        rim: (ncells, 12), edges of paired faces that also belong to cells without a face on the surface, which are
            not refined with it.
    """

    def __init__(self, mesh: RootMesh, contacts: Sequence[Contact]) -> None:
        ncells = len(mesh.cells)
        self.partner: Int32Array = np.full((ncells, 6, 2), -1, dtype=np.int32)
        self.rim: BoolArray = np.zeros((ncells, 12), dtype=bool)
        self._symmetry = np.zeros((ncells, 6), dtype=np.int8)
        self.second: BoolArray = np.zeros((ncells, 6), dtype=bool)
        self.nonmatching: dict[int, str] = {}
        pairs = [i for i, one in enumerate(contacts) if isinstance(one, (ContactPair, Tie)) and one.obstacle is None]
        users = np.zeros((ncells, 6), dtype=np.int32)
        for name in (name for index in pairs for name in contacts[index].surfaces):
            users[tuple(mesh.surface(name).T)] += 1
        for index in pairs:
            pair = contacts[index]
            assert isinstance(pair, (ContactPair, Tie))
            first, second = map(mesh.surface, pair.surfaces)
            try:
                if any((users[tuple(facets.T)] > 1).any() for facets in (first, second)):
                    raise _NoMatch("another contact or tie has facets of them")
                match, symmetry = _match(mesh, pair, first, second)
            except _NoMatch as error:
                self.nonmatching[index] = str(error)
                continue
            if isinstance(pair, ContactPair):
                _check_facing(mesh, f"contact pair ({pair.label})", pair, first, second[match])
            second = second[match]
            self.second[tuple(second.T)] = True
            for facing, other, code in ((first, second, symmetry), (second, first, _inverse(symmetry))):
                self.partner[facing[:, 0], facing[:, 1]] = other
                self._symmetry[facing[:, 0], facing[:, 1]] = code
                self.rim[facing[:, :1], hexahedron.FACE_EDGES[facing[:, 1]]] |= _rim(mesh, facing)

    @property
    def paired(self) -> BoolArray:
        """(ncells, 6), root faces that have a partner."""
        return self.partner[:, :, 0] >= 0

    def opposite(
        self, cell: IntArray, face: IntArray, points: npt.NDArray[Coordinate]
    ) -> tuple[Int32Array, Int32Array, npt.NDArray[Coordinate]]:
        """Facing root cells (n,), their local faces (n,), and points (n, m, 3) there, of points on paired faces.

        Points are in lattice coordinates, integer or not.
        """
        swap, *flips = _SYMMETRIES[self._symmetry[cell, face]].T
        other, other_face = self.partner[cell, face].T
        uv = np.take_along_axis(points, hexahedron.FACE_TANGENTS[face][:, None], axis=2)
        uv = np.where(swap[:, None, None], uv[:, :, ::-1], uv)
        uv = np.where(np.stack(flips, axis=1)[:, None], SIDE - uv, uv)
        result = np.empty_like(points)
        np.put_along_axis(result, hexahedron.FACE_TANGENTS[other_face][:, None], uv, axis=2)
        normal = np.where(hexahedron.FACE_SIDE[other_face] == 1, SIDE, 0).astype(points.dtype)
        np.put_along_axis(result, hexahedron.FACE_AXIS[other_face][:, None, None], normal[:, None, None], axis=2)
        return other, other_face, result

    def partners(
        self, cell: Int32Array, level: Int8Array, anchor: Int32Array, face: IntArray
    ) -> tuple[Int32Array, Int32Array]:
        """Root cells (n,) and anchors (n, 3) of the leaves, of equal level, that face paired faces (n,) of leaves."""
        ends = hexahedron.FACE_CORNERS[face][:, [0, 3]]
        corners = np.take_along_axis(leaf_corners(anchor, level), ends[:, :, None], axis=1)
        other, other_face, points = self.opposite(cell, face, corners)
        low = points.min(axis=1)
        high_side = np.flatnonzero(hexahedron.FACE_SIDE[other_face] == 1)
        low[high_side, hexahedron.FACE_AXIS[other_face[high_side]]] -= leaf_side(level[high_side])
        return other, low

    def representatives(self, cell: Int32Array, level: Int8Array, anchor: Int32Array) -> Int64Array:
        """Lowest `leaf_code` (n,) in the group of each leaf: all leaves that it faces, directly or through others."""
        result = leaf_code(cell, anchor)
        origin, face = faces_in(self.paired, cell, level, anchor)
        seen = np.stack([np.arange(len(cell)), result], axis=1)[np.unique(origin)]
        cells, anchors = cell[origin], anchor[origin]
        while len(origin):
            cells, anchors = self.partners(cells, level[origin], anchors, face)
            code = leaf_code(cells, anchors)
            np.minimum.at(result, origin, code)
            reached = np.stack([origin, code], axis=1)
            known = len(seen)
            seen, index = np.unique(np.concatenate([seen, reached]), axis=0, return_index=True)
            fresh = index[index >= known] - known
            origin, cells, anchors = origin[fresh], cells[fresh], anchors[fresh]
            leaf, face = faces_in(self.paired, cells, level[origin], anchors)
            origin, cells, anchors = origin[leaf], cells[leaf], anchors[leaf]
        return result


def leaf_code(cell: Int32Array, anchor: Int32Array) -> Int64Array:
    """Codes (n,) of leaves, unique in a forest, from root cells (n,) and anchors (n, 3)."""
    x, y, z = (anchor.T >> 1).astype(np.int64)
    return ((cell.astype(np.int64) << MAX_LEVEL | x) << MAX_LEVEL | y) << MAX_LEVEL | z


def decode_leaf(code: Int64Array) -> tuple[Int32Array, Int32Array]:
    """Root cells (n,) and anchors (n, 3) of leaf codes (n,): the inverse of `leaf_code`."""
    mask = (1 << MAX_LEVEL) - 1
    anchor = np.stack([code >> 2 * MAX_LEVEL & mask, code >> MAX_LEVEL & mask, code & mask], axis=1) << 1
    return (code >> 3 * MAX_LEVEL).astype(np.int32), anchor.astype(np.int32)


class _NoMatch(Exception):
    """Two surfaces are not meshed alike; the message says why."""


def _match(
    mesh: RootMesh, pair: ContactPair | Tie, first: Int32Array, second: Int32Array
) -> tuple[Int64Array, Int64Array]:
    """Partner (n,) of each facet of the first surface, and code (n,) in `_SYMMETRIES`.  Raises _NoMatch.

    Partners have the nearest centres, both ways, and coincident nodes, seen along the direction or the normal.
    """
    if len(first) != len(second):
        raise _NoMatch(f"{len(first)} facets face {len(second)}")
    points = [mesh.facet_points(facets) for facets in (first, second)]
    direction = pair.unit_direction
    if direction is not None:
        points = [x - (x @ direction)[..., None] * direction for x in points]
    diagonal, facing = (np.linalg.norm(np.ptp(x, axis=1), axis=1) for x in points)
    size = np.sqrt(diagonal * facing.max())
    centres = [x.mean(axis=1) for x in points]
    match = cKDTree(centres[1]).query(centres[0])[1]
    back = cKDTree(centres[0]).query(centres[1])[1]
    images = points[1][match][:, _face_orders(mesh.order)]
    symmetry = ((points[0][:, None] - images) ** 2).sum(axis=(2, 3)).argmin(axis=1)
    difference = points[0] - images[np.arange(len(match)), symmetry]
    if direction is None:
        normal = mesh.outward_normals(first)
        difference -= np.einsum("nmi,ni,nj->nmj", difference, normal, normal)
    distance = np.linalg.norm(difference, axis=2).max(axis=1)
    # The rows of a tie have all components: they compare displacements at one place.
    limit = (_OFFSET if direction is None and isinstance(pair, ContactPair) else _MATCH) * size
    unmatched = (back[match] != np.arange(len(match))) | (distance > limit)
    if unmatched.any():
        raise _NoMatch(
            f"{unmatched.sum()} of {len(first)} facets have no partner, the first near "
            f"{mesh.middle(first[unmatched])}; nodes are up to {distance.max():.3g} apart"
        )
    _check_one_to_one(mesh, first, second[match], symmetry)
    return match, symmetry


def _check_facing(mesh: RootMesh, label: str, pair: ContactPair, first: Int32Array, second: Int32Array) -> None:
    """Raises PairingError unless facets (n, 2) face each other, along a given direction or by their normals."""
    direction = pair.unit_direction
    if pair.direction is None or direction is None:
        normals = mesh.outward_normals(first), mesh.outward_normals(second)
        same = np.einsum("ni,ni->n", *normals) >= 0
        if same.any():
            raise PairingError(
                f"{label}: both surfaces look the same way, at {mesh.middle(first[same])}; name "
                "the sides that face each other"
            )
        return
    for name, facets, sign in zip(pair.surfaces, (first, second), (1, -1)):
        away = sign * mesh.outward_normals(facets) @ direction <= 0
        if away.any():
            raise PairingError(
                f"{label}: {name!r} looks away from the other surface near {mesh.middle(facets[away])}; the "
                f"direction {tuple(pair.direction)} must lead from the first surface to the second: exchange them, or "
                "turn it round"
            )


def _face_orders(order: int) -> Int64Array:
    """Node of the second facet that faces each node of the first, by symmetry code: (8, (p+1)^2)."""
    v, u = np.divmod(np.arange((order + 1) ** 2), order + 1)
    swap, flip_u, flip_v = _SYMMETRIES.T[:, :, None]
    a, b = np.where(swap, v, u), np.where(swap, u, v)
    return np.where(flip_u, order - a, a) + (order + 1) * np.where(flip_v, order - b, b)


def _inverse(symmetry: IntArray) -> Int64Array:
    """Codes of the inverse maps: undo the flips, then the swap."""
    swap, flip_u, flip_v = _SYMMETRIES[symmetry].T
    return 4 * swap + 2 * np.where(swap, flip_v, flip_u) + np.where(swap, flip_u, flip_v)


def _check_one_to_one(mesh: RootMesh, first: Int32Array, second: Int32Array, symmetry: Int64Array) -> None:
    """Raises _NoMatch if a node faces several nodes."""
    one = mesh.facet_nodes(first)
    two = np.take_along_axis(mesh.facet_nodes(second), _face_orders(mesh.order)[symmetry], axis=1)
    links = np.unique(np.stack([one.ravel(), two.ravel()], axis=1), axis=0)
    for column in links.T:
        nodes, count = np.unique(column, return_counts=True)
        if (count > 1).any():
            raise _NoMatch(f"the node at {mesh.points[nodes[count > 1][0]]} faces several nodes")


def _rim(mesh: RootMesh, facets: Int32Array) -> BoolArray:
    """Mask (n, 4) of the edges of facets (n, 2) on the rim, where a vertex could be hanging on one side only."""
    edges = mesh.edges[facets[:, :1], hexahedron.FACE_EDGES[facets[:, 1]]]
    around = np.bincount(mesh.edges.ravel())
    facing = np.unique(np.stack([np.repeat(facets[:, 0], 4), edges.ravel()], axis=1), axis=0)[:, 1]
    return around[edges] != np.bincount(facing, minlength=len(around))[edges]
