"""Precedence of constraints that meet at a node: conditions, then ties, then contacts, each by its index.

At a node those before an interface hold the span H of some directions.  On surfaces meshed apart a row along d
yields: a normal if d is within 15 degrees of H, an equation unless d is within 15 degrees of the complement of H.  Rows
of node pairs and obstacles never yield, and come before those that do.  They may be dependent where contacts or ties
cross; which of them are depends on what is closed, and the projection solves them in the least-squares sense.
"""

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.fem.dirichlet import held_nodes, spans
from fx_contact.fem.prolongation import Prolongation
from fx_contact.items.contact import SMOOTH
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int32Array, Int64Array
from fx_contact.scene.scene import Scene


class Precedence:
    """The constraints before an interface, by its index, at the conforming nodes.  Collective on prolongation.comm.

    Attributes:
        held: (owned + ghosts, 3, 3), projectors on H.
    """

    def __init__(self, scene: Scene, prolongation: Prolongation, index: int) -> None:
        across, every = prolongation.zeros(9), np.arange(len(scene.interfaces))
        ties = np.array([interface.EQUALITY for interface in scene.interfaces])
        rank = np.where(ties, every, every + len(every))
        before = (every != index) & ((rank < rank[index]) | ~np.isin(every, list(scene.pairing.nonmatching)))
        _add_conditions(scene, prolongation, across)
        for other in np.flatnonzero(before & ties):
            here = _nodes(prolongation, *_acting(prolongation, other))
            across[here[here >= 0]] += np.eye(3).ravel()
        across = prolongation.ghosted(prolongation.summed(across)).reshape(-1, 3, 3)
        for other in np.flatnonzero(before & ~ties & ~ties[index]):
            normal = mean_normals(prolongation, *_acting(prolongation, other, index))
            across += normal[:, :, None] * normal[:, None]
        self.held = _projectors(across)

    def yields(self, direction: FloatArray, role: Role) -> BoolArray:
        """(owned + ghosts,), whether a row along a unit vector, (3,) or one a node, yields; not along 0.  Local."""
        along = np.broadcast_to(direction, (len(self.held), 3))
        part = np.einsum("ni,nij,nj->n", along, self.held, along)
        return np.asarray(part > (SMOOTH**2 if role == Role.NORMAL else 1 - SMOOTH**2))


def held_jumps(scene: Scene, rows: ConstraintRows) -> FloatArray:
    """Projectors (n, 3, 3) on the directions in which conditions prescribe the jumps [u] of rows.  Collective."""
    prolongation, entries = rows.prolongation, rows.entries
    across = prolongation.zeros(9)
    _add_conditions(scene, prolongation, across)
    held = _projectors(prolongation.ghosted(prolongation.summed(across)).reshape(-1, 3, 3))
    free = np.zeros((len(rows), 3, 3))
    np.add.at(free, entries.row, np.eye(3) - held[entries.node])
    return np.asarray(np.eye(3) - _projectors(free))


def _add_conditions(scene: Scene, prolongation: Prolongation, across: FloatArray) -> None:
    """Add the sums of n n^T, n the prescribed directions, to those of nodes (owned + ghosts, 9).  Collective."""
    for nodes, condition in zip(held_nodes(prolongation, scene.conditions), scene.conditions):
        across[nodes] += condition.across.ravel()


def _projectors(across: FloatArray) -> FloatArray:
    """Projectors (n, 3, 3) on the ranges of positive semidefinite matrices."""
    held, some = np.zeros_like(across), np.flatnonzero(across.any(axis=(1, 2)))
    held[some] = spans(across[some], np.ones((len(some), 3), dtype=bool))
    return held


def mean_normals(prolongation: Prolongation, leaf: Int64Array, face: Int64Array) -> FloatArray:
    """Mean unit normals of leaf facets at their nodes, 0 elsewhere: (owned + ghosts, 3).  Collective."""
    here = _nodes(prolongation, leaf, face)
    outward = np.repeat(prolongation.space.forest.facets(leaf, face).mean_outward[:, None], here.shape[1], axis=1)
    result = prolongation.ghosted(prolongation.sums_at(here[here >= 0], outward[here >= 0]))
    return np.asarray(result / np.maximum(np.linalg.norm(result, axis=1), np.finfo(float).tiny)[:, None])


def _nodes(prolongation: Prolongation, leaf: Int64Array, face: Int64Array) -> Int32Array:
    """Conforming nodes (n, (p+1)^2) of facets, -1 where they hang.  Local."""
    return prolongation.conforming[prolongation.space.on_faces(leaf, face)]


def _acting(prolongation: Prolongation, other: int, index: int | None = None) -> tuple[Int64Array, Int64Array]:
    """Leaf facets on which `other` precedes interfaces: leaves (n,) and local faces (n,).  Collective.

    On surfaces meshed apart those that are covered.  Of a tie both sides; of a contact, which precedes the interface
    `index`, the side with the rows if meshed apart, and else no facets of that interface.
    """
    forest = prolongation.space.forest
    surfaces, facing = forest.contact_surfaces, forest.facing.get(other)
    if facing is not None:
        one, two = facing.covered
        return one if index is not None else (np.concatenate([one[0], two[0]]), np.concatenate([one[1], two[1]]))
    leaf, face = forest.contact_faces()
    wanted = surfaces.on(other)
    if index is not None:
        wanted &= ~surfaces.on(index)
    some = wanted[forest.cell[leaf], face]
    return leaf[some], face[some]
