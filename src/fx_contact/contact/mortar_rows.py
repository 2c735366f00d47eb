"""Rows of B for surfaces meshed apart, by dual multipliers psi_j on the first surface (mortar method).

    n_j . (u_j - sum_l M_jl u_l) <= n_j . int psi_j d / D_j,    M_jl = int psi_j N_l / D_j,    D_j = int psi_j

with the functions N_l of the nodes on the second surface, and the vector d to it.  On surfaces meshed alike these are
the node pairs.  Hanging nodes have no multiplier.  Source: B. Wohlmuth, SIAM J. Numer. Anal. 38, 2000; S. Hueeber,
B. Wohlmuth, CMAME 194, 2005.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix

from fx_contact.contact.constraint_rows import ConstraintRows, Role, RowColumns, RowKind
from fx_contact.contact.contact_facets import moduli, spring_stiffness
from fx_contact.contact.dual_functions import DualFunctions, MultiplierIntegrals, SegmentIntegrals
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.precedence import Precedence, mean_normals
from fx_contact.contact.rim import Rim
from fx_contact.contact.rim_pressure import RimPressure
from fx_contact.contact.row_entries import KeyedEntries
from fx_contact.fem.cell_products import cell_constraints
from fx_contact.fem.prolongation import Prolongation
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import leaf_side
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int32Array, Int64Array, IntArray
from fx_contact.parallel.exchange import Exchange
from fx_contact.scene.scene import Scene

#: Weights below this part of the largest of a row are rounding.
_ROUNDING = 1e-13


class _Multipliers(NamedTuple):
    """The multipliers on this rank's first facets, and those of them that are kept.

    Attributes:
        keys: (m, (p+1)^2), of the nodes of second facets.
        regions: (n,) and (m,), of first and second facets.
        nodes: (n, (p+1)^2), conforming nodes of first facets, positions in the index map.
        kept: (owned + ghosts,), nodes with a row.
    """

    keys: Int64Array
    regions: tuple[IntArray, IntArray]
    nodes: Int64Array
    dual: DualFunctions
    kept: BoolArray


class MortarRows(RowKind):
    """Rows of the conforming nodes of the first surface that the second surface covers."""

    PARTS = 16  # a point on a surface of any mesh costs a hundred times that on a polynomial
    INTEGRATED = True
    FOLLOWED = 16.0  # up to 22 iterations of the Gram system instead of 51 (`studies/nonmatching`)

    def __init__(self, scene: Scene, index: int) -> None:
        super().__init__(scene, index)
        self._surfaces = scene.nonmatching[index]

    def columns(self, prolongation: Prolongation, enforcement: Enforcement) -> RowColumns:
        """As `RowKind.columns`, without rows that yield.  Collective."""
        multipliers, facing = self._multipliers(prolongation), prolongation.space.forest.facing[self.index]
        normal = mean_normals(prolongation, facing.leaf, facing.face)
        yielding = self._precedence(prolongation).yields(normal, Role.NORMAL)
        kept = _not_yielding(multipliers, prolongation, yielding[:, None])
        return self._columns(prolongation, enforcement, multipliers, kept[:, 0])

    def tie_columns(self, prolongation: Prolongation, enforcement: Enforcement) -> list[RowColumns]:
        """As `RowKind.tie_columns`, without rows that yield.  Collective."""
        multipliers, precedence = self._multipliers(prolongation), self._precedence(prolongation)
        yielding = np.stack([precedence.yields(axis, Role.EQUATION) for axis in np.eye(3)], axis=1)
        kept = _not_yielding(multipliers, prolongation, yielding)
        axes = (self._columns(prolongation, enforcement, multipliers, kept[:, axis]) for axis in range(3))
        return [columns.along(np.eye(3)[axis], Role.EQUATION, axis) for axis, columns in enumerate(axes)]

    def _precedence(self, prolongation: Prolongation) -> Precedence:
        return Precedence(self.scene, prolongation, self.index)

    def _multipliers(self, prolongation: Prolongation) -> _Multipliers:
        """Of all covered nodes.  Collective."""
        space, forest = prolongation.space, prolongation.space.forest
        facing = forest.facing[self.index]
        first, second, pairs = facing.first, facing.second, facing.pairs
        depth, direction = self._surfaces.depth, self.contact.unit_direction
        segments = SegmentIntegrals.of(first, second, pairs, space.degree, depth, direction)
        tables, nodes = _conforming(prolongation, space.on_faces(facing.leaf, facing.face))
        dual = DualFunctions(first, space.degree, tables, segments)
        keys = forest.lattice.keys(second.cell, _node_points(facing.anchor, facing.level, second.face, space.degree))
        regions = self.scene.mesh.region[first.cell], self.scene.mesh.region[second.cell]
        return _Multipliers(keys, regions, nodes, dual, _kept(prolongation, dual, nodes))

    def _columns(
        self, prolongation: Prolongation, enforcement: Enforcement, multipliers: _Multipliers, kept: BoolArray
    ) -> RowColumns:
        """The rows of kept nodes (owned + ghosts,).  Collective."""
        regions, nodes, dual = multipliers.regions, multipliers.nodes, multipliers.dual
        integrals = dual.integrals(kept[nodes])
        stiffness, some = np.zeros_like(integrals.area), integrals.area.any(axis=1)
        area = np.maximum(integrals.area[some], 0.0)
        one, two = integrals.pairs[integrals.second.any(axis=(1, 2))].T
        facing = np.stack([regions[0], _least(one, regions[1][two], len(nodes))], axis=1)
        stiffness[some] = spring_stiffness(enforcement, moduli(self.scene, facing[some]), area)
        across = integrals.first_normal - integrals.second_normal
        of_area = integrals.area[..., None], stiffness[..., None], across, integrals.apart, integrals.position
        sums = prolongation.sums_at(nodes, np.concatenate(of_area, axis=2))
        owned = slice(prolongation.owned)
        ours = np.flatnonzero(kept[owned])
        parts = _entries(prolongation, integrals, multipliers)
        parts = replace(parts, row=np.searchsorted(ours, parts.row))
        of_rows = _least(2 * parts.row + parts.side, parts.region, 2 * len(ours)).reshape(-1, 2)
        return RowColumns(
            first=ours,
            entries=_by_row(parts, sums[ours, 0]),
            across=sums[ours, 2:5],
            apart=sums[ours, 5:8] / sums[ours, :1],
            area=sums[ours, 0],
            stiffness=sums[ours, 1],
            modulus=moduli(self.scene, of_rows),
            position=sums[ours, 8:] / sums[ours, :1],
            bodies=self.scene.mesh.body_of_region[of_rows],
            yielded=int((multipliers.kept & ~kept)[owned].sum()),
            rim=Rim.of(prolongation, nodes, dual.crossed, *dual.means(kept[nodes])),
        )

    def pressure_correction(self, rows: ConstraintRows, pressure: FloatArray) -> RimPressure:
        """As `RowKind.pressure_correction`."""
        return RimPressure(rows, pressure, self.index)

    def apart(self, forest: Forest, leaf: Int64Array, face: Int64Array, points: IntArray | FloatArray) -> FloatArray:
        """Vectors along the normal or the direction, longer than all else where they meet nothing.  Local."""
        cell, (count, m, _) = forest.cell[leaf], points.shape
        facets = LeafFacets.of_leaves(forest.mesh, cell, forest.level[leaf], forest.anchor[leaf], face)
        tangents = hexahedron.FACE_TANGENTS[face][:, None]
        side = leaf_side(forest.level[leaf])[:, None, None]
        uv = (np.take_along_axis(points, tangents, axis=2) - facets.low[:, None]) / side
        at = facets.at(np.asarray(uv, np.float64))
        return self.apart_from(at.position.reshape(-1, 3), at.normal.reshape(-1, 3)).reshape(count, m, 3)

    def apart_from(self, position: FloatArray, normal: FloatArray) -> FloatArray:
        """As `apart`.  Local."""
        along, distance = self._faced(position, normal)
        far = 2 * np.linalg.norm(np.ptp(self.scene.mesh.points, axis=0))
        return np.asarray(np.where(np.isnan(distance), far, distance)[:, None] * along)

    def covered(self, facets: LeafFacets, uv: FloatArray) -> BoolArray:
        """As `RowKind.covered`.  Local."""
        at = facets.at(np.broadcast_to(uv, (len(facets), *uv.shape)))
        _, distance = self._faced(at.position.reshape(-1, 3), at.normal.reshape(-1, 3))
        return ~np.isnan(distance).reshape(len(facets), len(uv))

    def _faced(self, position: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Directions (k, 3) from positions (k, 3), and distances along them (k,), NaN of what faces nothing [m]."""
        along = self._surfaces.directions(normal / np.linalg.norm(normal, axis=1)[:, None])
        return along, self._surfaces.faced(position, along).distance


def _node_points(anchor: IntArray, level: IntArray, face: IntArray, degree: int) -> IntArray:
    """Lattice coordinates (n, (p+1)^2, 3) of the nodes of faces of leaves."""
    steps = hexahedron.grid_points(degree)[hexahedron.face_nodes(degree)[face]].astype(np.int32)
    return anchor[:, None] + leaf_side(level)[:, None, None] * steps // degree


def _conforming(prolongation: Prolongation, nodes: IntArray) -> tuple[FloatArray, Int64Array]:
    """Tables (n, k, k) of hanging nodes of facets by their nodes (n, k), and conforming nodes (n, k) of each."""
    conforming, tables = cell_constraints(prolongation, nodes)
    assert conforming.shape == nodes.shape, "a facet has as many conforming functions as nodes"
    # Conforming nodes of the facet itself keep their order, others are in the places of hanging ones.
    same = prolongation.conforming[nodes][:, :, None] == conforming[:, None]
    order = same.argmax(axis=2)
    order[~same.any(axis=2)] = np.nonzero(~same.any(axis=1))[1]
    return np.take_along_axis(tables, order[:, None], axis=2), np.take_along_axis(conforming, order, axis=1)


def _kept(prolongation: Prolongation, dual: DualFunctions, nodes: Int64Array) -> BoolArray:
    """Conforming nodes that have a row: (owned + ghosts,).  Collective."""
    sums = prolongation.sums_at(nodes, np.stack([dual.cover, dual.whole], axis=2))
    cover, whole = prolongation.ghosted(sums).T
    part = np.divide(cover, whole, out=np.zeros_like(cover), where=whole > 0)
    wanted = prolongation.zeros(1)
    wanted[nodes[dual.candidates(part[nodes])]] = 1.0
    return np.asarray(prolongation.ghosted(prolongation.summed(wanted))[:, 0] > 0)


def _not_yielding(multipliers: _Multipliers, prolongation: Prolongation, yielding: BoolArray) -> BoolArray:
    """Kept nodes without those whose rows yield, both (owned + ghosts, k).  Collective.

    With a row each the second surface would lock.  Their multipliers go to neighbours; a facet without any keeps its
    own.  Source: B. Wohlmuth, Discretization Methods and Iterative Solvers Based on Domain Decomposition, 2001, 1.2.
    """
    free = multipliers.kept[:, None] & ~yielding
    lonely = prolongation.zeros(yielding.shape[1])
    covered = np.any(multipliers.dual.cover, axis=1, keepdims=True)
    facet, axis = np.nonzero(covered & ~free[multipliers.nodes].any(axis=1))
    lonely[multipliers.nodes[facet], axis[:, None]] = 1.0
    return free | (multipliers.kept[:, None] & (prolongation.ghosted(prolongation.summed(lonely)) > 0))


@dataclass(frozen=True, eq=False)
class _Parts(KeyedEntries):
    """Integrals of psi_j N over facets, on the owners of the rows: `row` is the owned node, `weight` in [m^2].

    Attributes:
        region: (b,), of the facet with the function N.
    """

    region: IntArray


def _entries(prolongation: Prolongation, integrals: MultiplierIntegrals, multipliers: _Multipliers) -> _Parts:
    """Those of first facets, and of second ones with the sign of the second side.  Collective."""
    keys, regions, nodes = multipliers.keys, multipliers.regions, multipliers.nodes
    comm, imap = prolongation.comm, prolongation.index_map
    (one, two), first, second = integrals.pairs.T, integrals.first, -integrals.second
    row = np.concatenate([_on(nodes[:, :, None], first), _on(nodes[one][:, :, None], second)])
    key = np.concatenate([_on(prolongation.keys[nodes][:, None], first), _on(keys[two][:, None], second)])
    region = np.concatenate([_on(regions[0][:, None, None], first), _on(regions[1][two][:, None, None], second)])
    value, side = np.concatenate([first.ravel(), second.ravel()]), np.repeat([0, 1], [first.size, second.size])
    some = np.flatnonzero(value)
    row = row[some]
    owner = np.concatenate([np.full(imap.size_local, comm.rank), imap.owners])[row]
    exchange = Exchange(comm, owner)
    owned = exchange.forward(imap.local_to_global(row.astype(np.int32))) - imap.local_range[0]
    key, side, region = (exchange.forward(column[some]) for column in (key, side, region))
    return _Parts(owned, key, side, exchange.forward(value[some]), region)


def _on(names: IntArray, values: FloatArray) -> Int64Array:
    """Names for each of the values (k, i, j), broadcast."""
    return np.broadcast_to(names, values.shape).ravel().astype(np.int64)


def _by_row(parts: _Parts, area: FloatArray) -> KeyedEntries:
    """Sums over facets of the parts of rows, over the area of each row (n,)."""
    keys, column = np.unique(parts.key, return_inverse=True)
    places = parts.row, 2 * column.ravel() + parts.side
    sums = coo_matrix((parts.weight / area[parts.row], places), shape=(len(area), 2 * len(keys))).tocsr().tocoo()
    large = np.abs(sums.data) > _ROUNDING
    order = np.lexsort((sums.col[large], sums.row[large]))
    column, side = np.divmod(sums.col[large][order].astype(np.int64), 2)
    return KeyedEntries(sums.row[large][order].astype(np.int64), keys[column], side, sums.data[large][order])


def _least(group: IntArray, values: IntArray, count: int) -> Int32Array:
    """Least of the values (m,) in each group; 0 of none."""
    result = np.full(count, np.iinfo(np.int32).max, dtype=np.int32)
    np.minimum.at(result, group, values)
    return np.where(result == np.iinfo(np.int32).max, 0, result)
