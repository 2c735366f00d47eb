"""Canonical keys of lattice points: the same on every rank, without communication.

Each root cell has an integer lattice with 2^15 intervals a side, twice as fine as the finest leaves: midpoints of
leaf edges and faces are lattice points too.  The key of a lattice point combines the root entity (vertex, edge, face
or cell) whose interior contains it with its integer coordinates in the entity's frame, which starts at its lowest root
vertex.  In an int64 a vertex takes one number, an edge 2^15, a face 2^30, a cell 2^45.  All functions are local.
"""

from itertools import product

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.root_mesh_checks import MOST_CELLS
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int8Array, Int32Array, Int64Array, IntArray
from fx_contact.parallel.errors import GeometryError

#: Of each root entity, ascending: first key, a cell that has it, and its part of that cell.
Entities = tuple[Int64Array, Int64Array, Int64Array]
MAX_LEVEL = 14
BITS = MAX_LEVEL + 1
#: Intervals of the lattice along a root edge; a leaf of level l has the side `SIDE >> l`.
SIDE = 1 << BITS

_LOW, _HIGH, _INSIDE = 0, 1, 2
#: The 27 parts of a closed cell, x fastest: at the low end, at the high end, or inside along each axis.
_CODES = [code[::-1] for code in product((_LOW, _HIGH, _INSIDE), repeat=3)]


class Lattice:
    """Keys of the lattice points of a root mesh.  Raises GeometryError for too many root cells."""

    def __init__(self, mesh: RootMesh) -> None:
        ncells = len(mesh.cells)
        _, vertices = np.unique(mesh.corners, return_inverse=True)
        vertices = vertices.reshape(ncells, 8)
        # Of each part of each cell: its first key, unused low bits of a key, and its frame relative to the cell's axes.
        self._start = np.zeros((ncells, 27), dtype=np.int64)
        self._unused = np.array([BITS * (3 - code.count(_INSIDE)) for code in _CODES])
        self._flip = np.zeros((ncells, 27, 3), dtype=bool)
        self._swap = np.zeros((ncells, 27), dtype=bool)
        self._axes = np.full((27, 3), 3)
        used = 0
        for dimension in range(4):
            parts = [i for i, code in enumerate(_CODES) if code.count(_INSIDE) == dimension]
            corners = np.stack([vertices[:, _part_corners(_CODES[i])] for i in parts], axis=1)
            rows = np.sort(corners, axis=2).reshape(ncells * len(parts), -1)
            ids = _numbered(rows)
            before, used = used, used + (int(ids.max() + 1) << dimension * BITS)
            if used >= 1 << 63:
                raise GeometryError(
                    f"the root mesh has {ncells:,} cells, and keys of their points end at {MOST_CELLS:,}"
                )
            self._start[:, parts] = before + (ids.reshape(ncells, len(parts)) << dimension * BITS)
            for slot, part in enumerate(parts):
                inside = [axis for axis in range(3) if _CODES[part][axis] == _INSIDE]
                self._axes[part, :dimension] = inside
                if dimension in (1, 2):
                    self._orient(part, dimension, corners[:, slot])

    def _orient(self, part: int, dimension: int, corners: IntArray) -> None:
        """Canonical frame of an edge or face: from the lowest root vertex, the lower of its neighbours first."""
        origin = corners.argmin(axis=1)
        self._flip[:, part, :dimension] = origin[:, None] >> np.arange(dimension) & 1
        if dimension == 2:
            rows = np.arange(len(corners))
            self._swap[:, part] = corners[rows, origin ^ 2] < corners[rows, origin ^ 1]

    def keys(self, cell: IntArray, points: IntArray) -> Int64Array:
        """Keys (n, m) of lattice points, the same from every cell that shares the point.

        Args:
            cell: (n,), root cells.
            points: (n, m, 3), lattice coordinates in 0..SIDE within those cells.
        """
        cell = np.asarray(cell)[:, None]
        part = np.where(points == 0, _LOW, np.where(points == SIDE, _HIGH, _INSIDE)) @ [1, 3, 9]
        padded = np.concatenate([points, np.zeros((*points.shape[:2], 1), points.dtype)], axis=2)
        local = np.take_along_axis(padded, self._axes[part], axis=2).astype(np.int64)
        local = np.where(self._flip[cell, part], SIDE - local, local)
        swap = self._swap[cell, part]
        first = np.where(swap, local[:, :, 1], local[:, :, 0])
        second = np.where(swap, local[:, :, 0], local[:, :, 1])
        inside = ((first << BITS | second) << BITS | local[:, :, 2]) >> self._unused[part]
        return self._start[cell, part] + inside

    def entities(self, prefer: BoolArray) -> Entities:
        """Root entities, each as a part of the lowest cell that has it, with preference for a mask (ncells, 27)."""
        order = np.argsort(~prefer.ravel(), kind="stable")
        starts, first = np.unique(self._start.ravel()[order], return_index=True)
        return starts, *np.divmod(order[first], 27)

    def located(self, keys: Int64Array, entities: Entities) -> tuple[Int64Array, Int32Array]:
        """Entities (n,) of keys (n,), and lattice coordinates (n, 3) in their cells: the inverse of `keys`."""
        starts, cells, parts = entities
        entity = np.searchsorted(starts, keys, side="right") - 1
        cell, part = cells[entity], parts[entity]
        inside = keys - starts[entity] << self._unused[part]
        first, second, third = (inside >> shift & SIDE - 1 for shift in (2 * BITS, BITS, 0))
        swap = self._swap[cell, part]
        local = np.stack([np.where(swap, second, first), np.where(swap, first, second), third], axis=1)
        local += self._flip[cell, part] * (SIDE - 2 * local)
        points = np.append(SIDE * (np.array(_CODES) == _HIGH), np.zeros((27, 1), dtype=int), axis=1)
        points = points.astype(np.int32)[part]  # the fourth column receives coordinates without an axis of the part
        np.put_along_axis(points, self._axes[part], local.astype(np.int32), axis=1)
        return entity, points[:, :3]


def part_faces() -> BoolArray:
    """(27, 6), parts of a closed cell that lie on each of its faces."""
    codes = np.array(_CODES)
    return codes[:, hexahedron.FACE_AXIS] == np.where(hexahedron.FACE_SIDE == 1, _HIGH, _LOW)


def _numbered(rows: IntArray) -> Int64Array:
    """Number (n,) of each row (n, 2^k) of int below 2^31 among the different ones, in lexicographic order."""
    while rows.shape[1] > 1:
        pairs = rows[:, ::2] << 32 | rows[:, 1::2]
        rows = np.stack([np.unique(pair, return_inverse=True)[1] for pair in pairs.T], axis=1)
    return np.unique(rows[:, 0], return_inverse=True)[1]


def _part_corners(code: tuple[int, ...]) -> list[int]:
    """Corners of a part of the cell, its first inside axis fastest."""
    free = [[0, 1] if c == _INSIDE else [c] for c in code]
    return [x + 2 * y + 4 * z for z, y, x in product(*free[::-1])]


def leaf_side(level: IntArray) -> Int32Array:
    """Sides (n,) in lattice units of leaves of levels (n,)."""
    return (SIDE >> level.astype(np.int32)).astype(np.int32)


def leaf_corners(anchor: Int32Array, level: Int8Array) -> Int32Array:
    """Lattice coordinates (n, 8, 3) of the corners, in tensor order, of leaves with low corner `anchor` (n, 3)."""
    return anchor[:, None] + leaf_side(level)[:, None, None] * hexahedron.CORNERS.astype(np.int32)


def anchors_on_faces(face: IntArray, uv: FloatArray) -> Int32Array:
    """Anchors (n, 3) of the finest leaves at places on faces (n,) of root cells, by coordinates (n, 2) in [0, 1]."""
    last = SIDE - 2
    result = np.empty((len(face), 3), dtype=np.int32)
    tangents = np.minimum((uv * SIDE).astype(np.int32) & ~1, last)
    np.put_along_axis(result, hexahedron.FACE_TANGENTS[face], tangents, axis=1)
    np.put_along_axis(result, hexahedron.FACE_AXIS[face][:, None], last * hexahedron.FACE_SIDE[face][:, None], axis=1)
    return result


def edge_midpoints(corners: Int32Array) -> Int32Array:
    """Midpoints (n, 12, 3) of the edges, from corners (n, 8, 3)."""
    return corners[:, hexahedron.EDGE_CORNERS].sum(axis=2) // 2


def face_centres(corners: Int32Array) -> Int32Array:
    """Centres (n, 6, 3) of the faces, from corners (n, 8, 3)."""
    return corners[:, hexahedron.FACE_CORNERS[:, [0, 3]]].sum(axis=2) // 2


def root_faces(anchor: Int32Array, level: Int8Array) -> BoolArray:
    """Mask (n, 6) of the faces of leaves that lie on faces of their root cells; arguments as in `leaf_corners`."""
    ends = np.stack([anchor == 0, anchor + leaf_side(level)[:, None] == SIDE], axis=1)
    return ends[:, hexahedron.FACE_SIDE, hexahedron.FACE_AXIS]


def faces_in(mask: BoolArray, cell: IntArray, level: Int8Array, anchor: Int32Array) -> tuple[Int64Array, Int64Array]:
    """Leaves (m,) and their local faces (m,), by leaf, then face, on faces of root cells in a mask (ncells, 6)."""
    leaf, face = np.nonzero(root_faces(anchor, level) & mask[cell])
    return leaf, face


def root_edges(anchor: Int32Array, level: Int8Array) -> BoolArray:
    """Mask (n, 12) of the edges of leaves that lie on edges of their root cells."""
    return np.all(root_faces(anchor, level)[:, hexahedron.EDGE_FACES], axis=2)
