"""Facing root facets of contact surfaces that are meshed alike, and the partner of a leaf by integer arithmetic.

Facets are paired once, on the root mesh.  The partner of a leaf or of a lattice point then follows from integers alone,
without search or communication ("éléments appariés", section 2 of the paper).  All is local.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from fx_contact.parallel.errors import PairingError
from fx_contact.problem import hexahedron
from fx_contact.problem.contact import Contact, ContactPair
from fx_contact.problem.lattice import MAX_LEVEL, SIDE, leaf_corners, leaf_side, root_faces
from fx_contact.problem.root_mesh import RootMesh

#: The eight ways two quadrilaterals can face each other: swap the tangents, then flip the first, flip the second.
_SYMMETRIES = np.array(list(product((0, 1), repeat=3)), dtype=bool)

#: Distance within which nodes coincide, projected along a given direction, over the facet's size.
_MATCH = 1e-6
#: Largest tangential offset t of facing nodes over the facet's size d, where no direction is given.  On a surface of
#: radius R it changes the gap by t d^2/(2 R), at 0.1 less than half of d^2/(8 R), the distance between the facet and
#: its chord.  Concentric surfaces with a gap g have t = g/(2 R).
_ASTRAY = 0.1


class Pairing:
    """Facing facets of the contact surfaces that are meshed alike, replicated on all ranks.

    Local (every rank computes the same).

    Args:
        mesh: RootMesh.
        contacts: of a scene; facets of those that are no ContactPair have no partners.

    Attributes:
        partner: (ncells, 6, 2) int32, facing (root cell, local face) of each local face, -1 where it has none.
        rim: (ncells, 12) bool, edges of paired faces that cells without a face on the surface have too.

    Raises:
        SceneError: an unknown surface.
        PairingError: surfaces that do not match facet by facet and node by node.
    """

    def __init__(self, mesh: RootMesh, contacts: Sequence[Contact]) -> None:
        ncells = len(mesh.cells)
        self.partner = np.full((ncells, 6, 2), -1, dtype=np.int32)
        self.rim = np.zeros((ncells, 12), dtype=bool)
        self._symmetry = np.zeros((ncells, 6), dtype=np.int8)
        for pair in (contact for contact in contacts if isinstance(contact, ContactPair)):
            facets = mesh.surface(pair.first), mesh.surface(pair.second)
            match, symmetry = _match(mesh, pair, *facets)
            facets = facets[0], facets[1][match]
            for facing, other, code in zip(facets, facets[::-1], (symmetry, _inverse(symmetry))):
                self.partner[facing[:, 0], facing[:, 1]] = other
                self._symmetry[facing[:, 0], facing[:, 1]] = code
                self.rim[facing[:, :1], hexahedron.FACE_EDGES[facing[:, 1]]] |= _rim(mesh, facing)

    @property
    def paired(self) -> npt.NDArray[np.bool_]:
        """(ncells, 6), root faces that have a partner."""
        return self.partner[:, :, 0] >= 0

    def opposite(self, cell, face, points):
        """Lattice points that face given lattice points on paired root facets.

        Args:
            cell: (n,) int, root cells.
            face: (n,) int, local faces, all paired.
            points: (n, m, 3) int32, lattice coordinates on those faces; float64 between lattice points.

        Returns:
            (n,) int32 facing root cells, (n,) int32 their faces, (n, m, 3) lattice coordinates there, of that dtype.
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

    def faces(self, cell, level, anchor):
        """Paired faces of leaves.

        Args:
            cell, level, anchor: (n,) int32, (n,) int8, (n, 3) int32 leaves.

        Returns:
            (m,) int64 leaf indices and (m,) int64 local faces, by leaf then face.
        """
        return np.nonzero(root_faces(anchor, level) & self.paired[cell])

    def partners(self, cell, level, anchor, face):
        """The leaf on the other side of paired faces.

        Args:
            cell, level, anchor, face: (n,) int32, (n,) int8, (n, 3) int32, (n,) int leaves and their paired faces.

        Returns:
            (n,) int32 root cells and (n, 3) int32 anchors; the level is the same.
        """
        ends = hexahedron.FACE_CORNERS[face][:, [0, 3]]
        corners = np.take_along_axis(leaf_corners(anchor, level), ends[:, :, None], axis=1)
        other, other_face, points = self.opposite(cell, face, corners)
        low = points.min(axis=1)
        high_side = np.flatnonzero(hexahedron.FACE_SIDE[other_face] == 1)
        low[high_side, hexahedron.FACE_AXIS[other_face[high_side]]] -= leaf_side(level[high_side])
        return other, low

    def representatives(self, cell, level, anchor):
        """Lowest code (`leaf_code`) among each leaf and those that it faces, directly or through others.

        Args:
            cell, level, anchor: (n,) int32, (n,) int8, (n, 3) int32 leaves.

        Returns:
            (n,) int64; its own code for a leaf that faces nothing.
        """
        result = leaf_code(cell, anchor)
        origin, face = self.faces(cell, level, anchor)
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
            leaf, face = self.faces(cells, level[origin], anchors)
            origin, cells, anchors = origin[leaf], cells[leaf], anchors[leaf]
        return result


def leaf_code(cell, anchor):
    """Code of a leaf: root cell, then anchor.  No two leaves of a forest have the same.

    Args:
        cell: (n,) int32.
        anchor: (n, 3) int32.

    Returns:
        (n,) int64.
    """
    x, y, z = (anchor.T >> 1).astype(np.int64)
    return ((cell.astype(np.int64) << MAX_LEVEL | x) << MAX_LEVEL | y) << MAX_LEVEL | z


def decode_leaf(code):
    """Inverse of `leaf_code`: (n,) int32 root cells and (n, 3) int32 anchors."""
    mask = (1 << MAX_LEVEL) - 1
    anchor = np.stack([code >> 2 * MAX_LEVEL & mask, code >> MAX_LEVEL & mask, code & mask], axis=1) << 1
    return (code >> 3 * MAX_LEVEL).astype(np.int32), anchor.astype(np.int32)


def _match(mesh, pair, first, second):
    """Partner of each facet of the first surface: (n,) index, and (n,) code in `_SYMMETRIES`; PairingError if none.

    Facets are projected along the direction, if there is one; partners have the nearest centres, each way, and nodes
    that coincide.
    """
    label = f"contact pair ({pair.first!r}, {pair.second!r})"
    if len(first) != len(second):
        raise PairingError(
            f"{label}: {len(first)} facets face {len(second)}; mesh both surfaces alike, facet for facet, and name "
            "those parts only that face each other"
        )
    _check_facing(mesh, label, pair, first, second)
    points = [mesh.facet_points(facets) for facets in (first, second)]
    if pair.direction is not None:
        direction = pair.unit_direction
        points = [x - (x @ direction)[..., None] * direction for x in points]
    size = np.sqrt(
        np.linalg.norm(np.ptp(points[0], axis=1), axis=1) * np.linalg.norm(np.ptp(points[1], axis=1), axis=1).max()
    )
    centres = [x.mean(axis=1) for x in points]
    match = cKDTree(centres[1]).query(centres[0])[1]
    back = cKDTree(centres[0]).query(centres[1])[1]
    astray = back[match] != np.arange(len(match))
    seen = points[1][match]
    images = np.stack([seen[:, _face_order(mesh.order, code)] for code in range(8)], axis=1)
    offset = ((points[0][:, None] - images) ** 2).sum(axis=(2, 3))
    symmetry = offset.argmin(axis=1)
    difference = points[0] - images[np.arange(len(match)), symmetry]
    if pair.direction is None:
        normal = mesh.outward_normals(first)
        difference -= np.einsum("nmi,ni,nj->nmj", difference, normal, normal)
    far = np.linalg.norm(difference, axis=2).max(axis=1)
    astray |= far > (_MATCH if pair.direction is not None else _ASTRAY) * size
    if astray.any():
        cell, face = first[astray][0]
        centre, alike = mesh.facet_points(first[astray][:1]).mean(axis=(0, 1)), "mesh both surfaces alike"
        if pair.direction is None:
            advice = f"{alike}, or give the direction in which they face each other"
        else:
            advice = f"{alike}: seen along the direction {tuple(pair.direction)}, facing nodes must coincide"
        raise PairingError(
            f"{label}: {astray.sum()} of {len(first)} facets have no partner, the first near {centre} (face {face} of "
            f"root cell {cell}); nodes are up to {far.max():.3g} apart; {advice}"
        )
    _check_one_to_one(mesh, label, first, second[match], symmetry)
    return match, symmetry


def _check_facing(mesh, label, pair, first, second):
    """A given direction must lead out of the first body and into the second."""
    if pair.direction is None:
        return
    direction = pair.unit_direction
    for name, facets, sign in ((pair.first, first, 1), (pair.second, second, -1)):
        away = sign * mesh.outward_normals(facets) @ direction <= 0
        if away.any():
            cell, face = facets[away][0]
            raise PairingError(
                f"{label}: face {face} of root cell {cell} of {name!r} looks away from the other surface; the "
                f"direction {tuple(pair.direction)} must lead from the first surface to the second: exchange them, or "
                "turn it round"
            )


def _face_order(order, code):
    """Node of the second facet that faces each node of the first, for a symmetry code: ((p+1)^2,) int."""
    swap, flip_u, flip_v = _SYMMETRIES[code]
    v, u = np.divmod(np.arange((order + 1) ** 2), order + 1)
    a, b = (v, u) if swap else (u, v)
    a, b = (order - a if flip_u else a), (order - b if flip_v else b)
    return a + (order + 1) * b


def _inverse(symmetry):
    """Codes of the inverse maps: undo the flips, then the swap."""
    swap, flip_u, flip_v = _SYMMETRIES[symmetry].T
    return 4 * swap + 2 * np.where(swap, flip_v, flip_u) + np.where(swap, flip_u, flip_v)


def _check_one_to_one(mesh, label, first, second, symmetry):
    nodes = hexahedron.face_nodes(mesh.order)
    one = mesh.cells[first[:, :1], nodes[first[:, 1]]]
    two = mesh.cells[second[:, :1], nodes[second[:, 1]]]
    two = np.take_along_axis(two, np.array([_face_order(mesh.order, code) for code in range(8)])[symmetry], axis=1)
    links = np.unique(np.stack([one.ravel(), two.ravel()], axis=1), axis=0)
    for column in links.T:
        nodes, count = np.unique(column, return_counts=True)
        if (count > 1).any():
            raise PairingError(
                f"{label}: the node at {mesh.points[nodes[count > 1][0]]} faces several nodes; "
                "give the direction in which the surfaces face each other"
            )


def _rim(mesh, facets):
    """Which of the `hexahedron.FACE_EDGES` of facets are on the rim (`Pairing`): (n, 4) bool.

    A cell that meets the surface in an edge only need not be refined with the facing leaves: a vertex could hang on one
    side only.
    """
    edges = mesh.edges[facets[:, :1], hexahedron.FACE_EDGES[facets[:, 1]]]
    around = np.bincount(mesh.edges.ravel())
    facing = np.unique(np.stack([np.repeat(facets[:, 0], 4), edges.ravel()], axis=1), axis=0)[:, 1]
    return around[edges] != np.bincount(facing, minlength=len(around))[edges]
