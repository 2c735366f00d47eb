"""Resultants: force and moment of contact pairs, ties, loads and reactions, and the balance of each body.

All are of the undeformed bodies, about the contact's centre c.  The residual at the conforming nodes x_i is
r = K u - L + B^T f.  The reaction of a condition is the sum of r_i over the components that it prescribes, its moment
that of (x_i - c) x r_i.  Conditions that prescribe the same components share r_i (`fem.dirichlet.shared_forces`).

On each body loads, contact forces and reactions add up to the solver's error, by the partition of unity.  So do their
moments if the order q of the leaves' geometry is at most the degree p.  For q > p rotations are not among the
displacements; on the coarsest Hertz mesh (q = 2, p = 1) the error is 3e-3 of the force times the radius.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.dirichlet import held_nodes, shared_forces
from fx_contact.items.boundary_conditions import SymmetryPlane
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.validation import percent
from fx_contact.scene.scene import Scene
from fx_contact.verdict.model_warning import ModelWarning

#: Limit of an unbalanced moment, relative to the contact force times the size of the body: the force is off by this
#: part of the size [-].
UNBALANCED = 0.01


@dataclass(frozen=True)
class Resultant:
    """Resultant force and moment.

    Attributes:
        name: of the contact pair or tie (`ContactPair.name`, `Tie.name`), the place of the condition or load, or the
            body.
        kind: "contact": of the first surface on the second, or on the obstacle; "tie": of the first surface on the
            second, section force and moment; "rigid load": on the body; "traction", "pressure" or "body force": a load;
            "reaction" of a condition on the bodies; "spring": of an elastic support on the bodies; "symmetry": of the
            other part on the modelled one, across a plane of symmetry; "balance": of all forces on a body, as it is
            modelled, 0 but for errors.
        force: [N].
        moment: about `point` [N m].
        point: [m].
        parts: number of mirrored modelled parts in the sum; 1 for symmetry and balance, and for all where the symmetry
            planes of the scene do not make `Scene.symmetry` copies.
    """

    name: str
    kind: str
    force: tuple[float, float, float]
    moment: tuple[float, float, float]
    point: tuple[float, float, float]
    parts: int


def sum_up(state: SolvedState, residual: FloatArray, totals: FloatArray, centre: FloatArray) -> tuple[Resultant, ...]:
    """Resultants of contacts, ties, tractions, body forces, conditions, springs and bodies, in the order of the scene.

    Collective on state.forest.comm.

    Args:
        residual: (owned, 3), as `nodal_residual` [N].
        totals: (k, nbodies, 6), of the loads on this rank's leaves, as from `load_and_totals`.
        centre: (3,), the point of moments, on all mirrors of the scene [m].
    """
    scene, elasticity = state.scene, state.elasticity
    # Entries x bodies x (force, moment).
    parts = [*_of_interfaces(state, centre), _about(centre, totals), _of_conditions(state, residual, centre)]
    if elasticity.springs is not None:
        parts.append(_about(centre, elasticity.springs.totals(elasticity.at_leaves(state.field.function))))
    sums = state.forest.comm.allreduce(np.concatenate(parts))
    names = [(interface.name, interface.KIND) for interface in scene.interfaces]
    names += [(force.surface, type(force).__name__.lower()) for force in scene.tractions]
    names += [(force.body, "body force") for force in scene.body_forces]
    names += [(c.where, "symmetry" if isinstance(c, SymmetryPlane) else "reaction") for c in scene.dirichlet]
    names += [(support.surface, "spring") for support in scene.springs]
    names += [(body, "balance") for body in scene.mesh.bodies]
    values = np.concatenate([sums[len(scene.interfaces) :].sum(axis=1), sums.sum(axis=0)])
    for index, interface in enumerate(scene.interfaces):
        if len(interface.surfaces) == 1:  # on the obstacle, or of a rigid load on the body
            values[index] = (1 if interface.EQUALITY else -1) * sums[index].sum(axis=0)
    return tuple(_resultant(name, kind, row, centre, scene) for (name, kind), row in zip(names, values))


def unbalanced_moments(scene: Scene, resultants: Sequence[Resultant]) -> Iterator[ModelWarning]:
    """Moments on bodies that are free to turn, which cells of a higher order than the displacements balance.  Local."""
    contact = max((float(np.linalg.norm(one.force)) for one in resultants if one.kind == "contact"), default=0.0)
    balances = [one for one in resultants if one.kind == "balance"]
    for one, turning, size in zip(balances, scene.rigid_motions.turning, scene.rigid_motions.sizes):
        lever = float(np.linalg.norm(turning @ np.array(one.moment)) / (contact * size)) if contact else 0.0
        if lever > UNBALANCED:
            message = (
                f"forces on body {one.name!r} are in balance but for a moment, of the largest contact force times "
                f"{percent(lever)} of its size, limit {percent(UNBALANCED)}: it touches between nodes, or would roll "
                "or tip; take a smaller tolerance, or degree 2"
            )
            yield ModelWarning("unbalanced moment", lever, UNBALANCED, one.name, message)


def _resultant(name: str, kind: str, row: FloatArray, centre: FloatArray, scene: Scene) -> Resultant:
    """A Resultant from the force and moment (6,) of the modelled part."""
    (force, moment), parts = np.split(row, 2), 1
    if kind not in ("symmetry", "balance"):
        force, moment, parts = scene.mirrors.force(force), scene.mirrors.moment(moment), scene.mirrors.parts
    return Resultant(name, kind, _vector(force), _vector(moment), _vector(centre), parts)


def _about(centre: FloatArray, totals: FloatArray) -> FloatArray:
    """Totals (..., 6) about the origin with moments about a point."""
    shifted = totals.copy()
    shifted[..., 3:] -= np.cross(centre, totals[..., :3])
    return shifted


def _vector(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _of_interfaces(state: SolvedState, centre: FloatArray) -> FloatArray:
    """Forces of contacts, then ties, on first and second bodies, of this rank's nodes: (2, n, bodies, 6).

    Collective.
    """
    scene, rows, force, sums = state.scene, state.solution.rows, state.solution.row_force, []
    for index in range(len(scene.interfaces)):
        assert rows is not None
        entries, ours = rows.entries, rows.contact == index
        push = -np.where(ours, force, 0.0)[entries.row, None] * rows.values
        nodal = rows.prolongation.zeros(6)
        given = entries.side ^ (scene.oriented[index] is not scene.interfaces[index])  # as the user gave the surfaces
        columns = 3 * given[:, None] + np.arange(3)
        np.add.at(nodal, (entries.node[:, None], columns), push)
        nodal = rows.prolongation.summed(nodal)
        for side in np.split(nodal, 2, axis=1):
            nodes = np.flatnonzero(side.any(axis=1))
            sums.append(_on_bodies(state, nodes, side[nodes], np.zeros_like(nodes), 1, centre))
    shape = len(scene.interfaces), 2, len(scene.mesh.bodies), 6
    return np.reshape(sums, shape).transpose(1, 0, 2, 3)


def _of_conditions(state: SolvedState, residual: FloatArray, centre: FloatArray) -> FloatArray:
    """Reactions at this rank's nodes: (conditions, bodies, 6).  Collective."""
    conditions = state.scene.conditions
    constrained = held_nodes(state.elasticity.prolongation, conditions)
    shared = shared_forces(conditions, constrained, residual)
    entry = np.repeat(np.arange(len(constrained)), list(map(len, constrained)))
    nodes = np.concatenate([np.zeros(0, dtype=np.int64), *constrained])
    across = np.array([condition.across for condition in conditions]).reshape(-1, 3, 3)[entry]
    force = np.einsum("nij,nj->ni", across, shared[nodes])
    return _on_bodies(state, nodes, force, entry, len(constrained), centre)


def _on_bodies(
    state: SolvedState, nodes: IntArray, force: FloatArray, entry: IntArray, entries: int, centre: FloatArray
) -> FloatArray:
    """Sums (entries, bodies, 6) of forces (k, 3) [N] at owned conforming nodes (k,), and of moments [N m]."""
    prolongation = state.elasticity.prolongation
    space, mesh = prolongation.space, state.scene.mesh
    leaf, local = space.example[prolongation.injected(np.arange(len(space)))[nodes]].T
    arm = state.elasticity.leaf_mesh.positions(leaf, local, space.degree) - centre
    sums, body = np.zeros((entries, len(mesh.bodies), 6)), mesh.body[state.forest.cell[leaf]]
    np.add.at(sums, (entry, body), np.concatenate([force, np.cross(arm, force)], axis=1))
    return sums
