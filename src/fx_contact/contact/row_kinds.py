"""Rows of all contacts and ties of a scene, each made by the kind that its type asks for.

A new kind of contact is a subclass of `Contact` (its definition in a scene), a subclass of `RowKind` (its rows), and
an entry here.
"""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.contact.constraint_rows import ConstraintRows, Role, RowColumns, RowKind
from fx_contact.contact.enforcement import SOFTEST, STIFFEST, Enforcement
from fx_contact.contact.mortar_rows import MortarRows
from fx_contact.contact.node_pairs import NodePairs
from fx_contact.contact.obstacle_rows import ObstacleRows, PlaneRows, RigidFaceRows
from fx_contact.contact.precedence import Precedence, held_jumps
from fx_contact.contact.row_entries import Entries, KeyedEntries
from fx_contact.fem.prolongation import Prolongation
from fx_contact.items.contact import SMOOTH, Contact, ContactPair
from fx_contact.items.obstacles import Obstacle, RigidPlane
from fx_contact.items.ties import Tie
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.rigid_faces import RigidFace
from fx_contact.scene.scene import Scene

#: Kind of rows by the type of the contact, or of its obstacle; a type without an entry has that of its base class.
KINDS: dict[type[Contact] | type[Obstacle], type[RowKind]] = {
    ContactPair: NodePairs,
    Tie: NodePairs,
    RigidFace: RigidFaceRows,
    Obstacle: ObstacleRows,
    RigidPlane: PlaneRows,
}


#: Gaps up to this part of the size of a facet are closed at first; curved surfaces that touch have less.
_TOUCHING = 1e-6

#: Rows of contacts, one each, and of ties, three each, by index.
Columns: TypeAlias = dict[int, list[RowColumns]]


def kinds_of(scene: Scene) -> tuple[RowKind, ...]:
    """Kinds of the contacts and ties of a scene.  Local.  Raises SceneError: a contact of an unknown type."""
    kinds = []
    for index, contact in enumerate(scene.interfaces):
        decisive = type(contact if contact.obstacle is None else contact.obstacle)
        kind = next((KINDS[base] for base in decisive.__mro__ if base in KINDS), None)
        if kind is NodePairs and index in scene.pairing.nonmatching:
            kind = MortarRows
        if kind is None:
            known = ", ".join(base.__name__ for base in KINDS)
            raise SceneError(f"there are no rows for a {type(contact).__name__}: a contact must be one of {known}")
        kinds.append(kind(scene, index))
    return tuple(kinds)


def columns_at_rest(scene: Scene, prolongation: Prolongation, enforcement: Enforcement) -> Columns:
    """Rows of contacts and ties, by index, without those of obstacles that settle; gaps of ties come later.

    Collective on prolongation.comm.  Raises SceneError as `create_rows`.
    """
    resting = (kind for kind in kinds_of(scene) if kind.contact.force is None)
    return {kind.index: _columns(kind, prolongation, enforcement) for kind in resting}


def _columns(kind: RowKind, prolongation: Prolongation, enforcement: Enforcement) -> list[RowColumns]:
    """Rows of a contact, or of a tie along three axes.  Collective."""
    tied = kind.contact.EQUALITY
    return kind.tie_columns(prolongation, enforcement) if tied else [kind.columns(prolongation, enforcement)]


def create_rows(
    scene: Scene, prolongation: Prolongation, enforcement: Enforcement, known: Columns | None = None
) -> ConstraintRows:
    """The rows of all contacts and ties of a scene, with the prolongation or one with the nodes of other ranks in them.

    Collective on prolongation.comm.

    Args:
        known: some of the columns, as from `columns_at_rest`.

    Raises:
        SceneError: a contact of an unknown type, or a node_stiffness beyond the factors `SOFTEST` and `STIFFEST`.
    """
    kinds, known = kinds_of(scene), known or {}
    of_kind = [known.get(kind.index) or _columns(kind, prolongation, enforcement) for kind in kinds]
    parts = [part for columns in of_kind for part in columns]
    of = np.repeat(np.arange(len(kinds), dtype=np.int32), [len(columns) for columns in of_kind])
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS}
    if enforcement.node_stiffness is not None:
        columns["stiffness"] = np.full(len(columns["first"]), float(enforcement.node_stiffness))
    across = columns.pop("across")
    normal = across / np.linalg.norm(across, axis=1)[:, None]
    counts = [len(part.first) for part in parts]
    keyed = _joined([part.entries for part in parts], counts)
    prolongation = prolongation.reaching(keyed.key)
    rows = ConstraintRows(
        prolongation=prolongation,
        kinds=kinds,
        entries=_at_conforming(keyed, prolongation),
        normal=normal,
        gap=np.zeros(len(normal)),
        node_area=columns["area"],
        contact=np.repeat(of, counts),
        role=np.repeat([part.role for part in parts], counts).astype(np.int8),
        axis=np.repeat([part.axis for part in parts], counts).astype(np.int8),
        symmetry=scene.symmetry,
        yielded=sum(part.yielded for part in parts),
        rims={kinds[one].index: part.rim for one, part in zip(of, parts) if part.rim is not None},
        **columns,
    )
    stiffest = prolongation.comm.allreduce(float(rows.penalty_factor.max(initial=0.0)), op=MPI.MAX)
    if enforcement.node_stiffness is not None and not SOFTEST <= stiffest <= STIFFEST:
        raise SceneError(
            f"a node_stiffness of {enforcement.node_stiffness:g} is up to {stiffest:.0e} times that of the "
            f"bodies, it must be {SOFTEST:g} to {STIFFEST:g} times: softer ones let bodies through each other, the "
            "penetrations of stiffer ones are rounding; the enforcement 'exact' needs none"
        )
    rows = _with_clearance(rows if len(scene.contact) < 2 else _sharing(rows, across, enforcement.node_stiffness))
    return _with_tangents(rows) if any(kind.contact.tangential is not None for kind in kinds) else rows


#: Columns of `RowColumns` that are joined as they are.
_COLUMNS = "first across apart area stiffness modulus position bodies".split()


def _with_tangents(rows: ConstraintRows) -> ConstraintRows:
    """The rows, with tangents t1, t2 of those of contacts with a tangential law behind all normals."""
    sticky = np.array([kind.contact.tangential is not None for kind in rows.kinds])
    normals, equations = (np.flatnonzero((rows.role == Role.EQUATION) == equation) for equation in (False, True))
    some = normals[sticky[rows.contact[normals]]]
    tangents = np.concatenate([some, some])
    result = rows.taken(np.concatenate([normals, tangents, equations]))
    ours = slice(len(normals), len(normals) + len(tangents))
    axes = _not_yielding(rows, some, np.stack(tangent_axes(rows.normal[some]), axis=1))
    # The arrays of the result are its own.
    result.normal[ours], result.apart[ours], result.gap[ours] = np.concatenate([axes[:, 0], axes[:, 1]]), 0.0, 0.0
    result.role[ours], result.axis[ours] = Role.TANGENT, np.repeat([1, 2], len(some))
    return result


def _not_yielding(rows: ConstraintRows, some: IntArray, axes: FloatArray) -> FloatArray:
    """Tangents (m, 2, 3) of normals (m,) among rows, turned so that each yields or not; those that do are 0.

    Collective.  On surfaces meshed apart they yield to the constraints before them, else to conditions on both sides:
    the normal of a node on a plane of symmetry may be oblique to it, and its tangents are not.  At an edge where
    contacts touch at first they yield to each other's normals, whose forces would not be unique beside friction.
    """
    axes = axes.copy()
    for kind in rows.kinds:
        if kind.contact.tangential is not None:
            ours = rows.contact[some] == kind.index
            if kind.index in kind.scene.pairing.nonmatching:
                held = Precedence(kind.scene, rows.prolongation, kind.index).held[rows.first[some[ours]]]
            else:
                held = held_jumps(kind.scene, rows)[some[ours]]
            held = held + _across_others(rows, kind.index)[some[ours]]
            share, turn = np.linalg.eigh(axes[ours] @ held @ axes[ours].swapaxes(1, 2))
            kept = (share <= 1 - SMOOTH**2)[:, :, None]
            axes[ours] = np.where(kept, turn.swapaxes(1, 2) @ axes[ours], 0.0)
    return axes


def _across_others(rows: ConstraintRows, contact: int) -> FloatArray:
    """Sums of n n^T at the nodes of rows, of other contacts' normals n that touch at first: (n, 3, 3).  Collective."""
    entries, prolongation, result = rows.entries, rows.prolongation, np.zeros((len(rows), 9))
    others = (rows.role == Role.NORMAL) & (rows.contact != contact) & (rows.gap <= _TOUCHING * np.sqrt(rows.area))
    if not prolongation.comm.allreduce(bool(others.any()), op=MPI.LOR):
        return result.reshape(-1, 3, 3)
    part = np.abs(entries.weight)[:, None]
    outer = np.einsum("ni,nj->nij", rows.normal, rows.normal).reshape(-1, 9) * others[:, None]
    across = prolongation.ghosted(prolongation.sums_at(entries.node, part * outer[entries.row]))
    np.add.at(result, entries.row, part * across[entries.node])
    return result.reshape(-1, 3, 3)


def tangent_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors t1, t2 (n, 3) that make right-handed frames with normals (n, 3); along axes for those along axes.

    Local.  Source: T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017.
    """
    x, y, z = normal.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1), np.stack([b, sign + y * y * a, -y], axis=1)


def _joined(parts: list[KeyedEntries], counts: list[int]) -> KeyedEntries:
    """Entries of several contacts."""
    start = np.concatenate([[0], np.cumsum(counts)])
    rows = np.concatenate([part.row + first for part, first in zip(parts, start)])
    names = "key", "side", "weight"
    return KeyedEntries(rows, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _at_conforming(entries: KeyedEntries, prolongation: Prolongation) -> Entries:
    """Entries at conforming nodes: shares of hanging ones go to their masters."""
    node = prolongation.find(entries.key)
    if (node >= 0).all():
        return Entries(entries.row, node, entries.side, entries.weight)
    row = 2 * entries.row + entries.side
    places = csr_matrix((entries.weight, (row, np.arange(len(row)))), (row.max() + 1, len(row)))
    sums = (places @ prolongation.rows(entries.key)).tocoo()
    order = np.lexsort((sums.col, sums.row))
    row, side = np.divmod(sums.row[order].astype(np.int64), 2)
    return Entries(row, sums.col[order].astype(np.int64), side, sums.data[order])


def _sharing(rows: ConstraintRows, across: FloatArray, node_stiffness: float | None) -> ConstraintRows:
    """Rows of several contacts at one node as of one surface: stiffness by area, and one normal if it is smooth."""
    prolongation, ours = rows.prolongation, rows.role == Role.NORMAL
    sums = prolongation.sums_at(rows.first[ours], np.column_stack([rows.stiffness, rows.area, across])[ours])
    stiffness, area, *mean = prolongation.ghosted(sums)[rows.first].T
    mean = np.stack(mean, axis=1) / np.maximum(np.linalg.norm(mean, axis=0), np.finfo(float).tiny)[:, None]
    smooth = np.einsum("ni,ni->n", mean, rows.normal) > SMOOTH
    normal = np.where((smooth & ours)[:, None], mean, rows.normal)
    area, stiffness = np.where(ours, area, rows.area), np.where(ours, stiffness, rows.stiffness)
    stiffness = stiffness if node_stiffness is None else node_stiffness
    return replace(rows, node_area=area, stiffness=rows.area * stiffness / area, normal=normal)


def _with_clearance(rows: ConstraintRows) -> ConstraintRows:
    """Rows whose gaps, and vectors between the sides, have the clearance of their contacts or the closing of bolts."""
    clearance, closing = np.zeros(len(rows)), np.zeros((len(rows), 3))
    for kind in rows.kinds:
        ours = rows.contact == kind.index
        clearance[ours] = float(kind.contact.clearance)
        opening = kind.contact.opening(rows.position[ours])
        if opening is not None:
            closing[ours] = opening
    apart = rows.apart + clearance[:, None] * rows.normal + closing
    return replace(rows, apart=apart, gap=np.einsum("ni,ni->n", rows.normal, apart))
