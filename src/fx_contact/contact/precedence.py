"""Precedence of constraints that meet at a node: conditions, then ties, then contacts, each by its index.

At a node those before an interface hold the span H of some directions.  On surfaces meshed apart a row along d
yields: a normal if d is within 15 degrees of H, an equation unless d is within 15 degrees of the complement of H.  Rows
of node pairs and obstacles never yield, and come before those that do.  They may be dependent where contacts or ties
cross; which of them are depends on what is closed, and the projection solves them in the least-squares sense.
"""

from collections.abc import Callable

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.fem.dirichlet import SAME_PLANE, held_nodes
from fx_contact.fem.prolongation import Prolongation
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.items.contact import SMOOTH
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int32Array, IntArray
from fx_contact.scene.scene import Scene


class Precedence:
    """The constraints before an interface, by its index, at the conforming nodes.  Collective on prolongation.comm.

    Attributes:
        held: (owned + ghosts, 3, 3), projectors on H.
    """

    def __init__(self, scene: Scene, prolongation: Prolongation, index: int) -> None:
        across, ties, every = prolongation.zeros(9), scene.couplings[:-1], np.arange(len(scene.interfaces))
        rank = np.where(ties, every, every + len(every))
        before = (every != index) & ((rank < rank[index]) | ~np.isin(every, list(scene.pairing.nonmatching)))
        _add_conditions(scene, prolongation, across)
        here = _on_surfaces(prolongation, lambda contact, _: (before & ties)[contact])[0]
        across[here[here >= 0]] += np.eye(3).ravel()
        across = prolongation.ghosted(prolongation.summed(across)).reshape(-1, 3, 3)
        for other in np.flatnonzero(before & ~ties & ~ties[index]):
            normal = mean_normals(prolongation, other)
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
    for nodes, condition in zip(held_nodes(scene, prolongation), scene.conditions):
        across[nodes] += condition.across.ravel()


def _projectors(across: FloatArray) -> FloatArray:
    """Projectors (n, 3, 3) on the ranges of positive semidefinite matrices."""
    held, some = np.zeros_like(across), np.flatnonzero(across.any(axis=(1, 2)))
    values, vectors = np.linalg.eigh(across[some])
    spanned = vectors * (values > SAME_PLANE)[:, None]
    held[some] = spanned @ spanned.swapaxes(1, 2)
    return held


def mean_normals(prolongation: Prolongation, index: int) -> FloatArray:
    """Mean unit normals of a contact at the nodes of its rows, 0 elsewhere: (owned + ghosts, 3).  Collective."""
    sides = 1 if index in prolongation.space.forest.contact_surfaces.nonmatching else 2
    here, facets = _on_surfaces(prolongation, lambda contact, side: (contact == index) & (side < sides))
    outward, result = np.repeat(facets.mean_outward, here.shape[1], axis=0), prolongation.zeros(3)
    some = np.flatnonzero(here.ravel() >= 0)
    np.add.at(result, here.ravel()[some], outward[some])
    result = prolongation.ghosted(prolongation.summed(result))
    return np.asarray(result / np.maximum(np.linalg.norm(result, axis=1), np.finfo(float).tiny)[:, None])


def _on_surfaces(
    prolongation: Prolongation, wanted: Callable[[IntArray, IntArray], BoolArray]
) -> tuple[Int32Array, LeafFacets]:
    """Conforming nodes (n, (p+1)^2), -1 where they hang, and leaf facets by contact and side.  Local."""
    space, forest = prolongation.space, prolongation.space.forest
    leaf, face = forest.contact_faces()
    contact, side = (
        of[forest.cell[leaf], face] for of in (forest.contact_surfaces.contact, forest.contact_surfaces.side)
    )
    some = wanted(contact, side)
    leaf, face = leaf[some], face[some]
    return prolongation.conforming[space.on_faces(leaf, face)], forest.facets(leaf, face)
