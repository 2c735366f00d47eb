"""Resultants: force and moment of contact pairs, loads and reactions, and what they leave of each body.

All are of the undeformed bodies, about one point c, the contact's centre.  Nodes are where the leaves of the mesh have
them.  The residual at the conforming nodes x_i is r = K u - L + B^T f.  The reaction of a condition is the sum of r_i
over the components that it prescribes, its moment that of (x_i - c) x r_i.  What several conditions hold is shared
among them, equally or by least squares (`fem.dirichlet.shared_forces`).

On each body loads, contact forces and reactions add up to the solver's error, by the partition of unity.  So do their
moments where the order of the leaves' geometry is at most the degree, for then rotations are among the displacements.
Elsewhere the moments are off by what the displacement cannot follow of the geometry: 3e-3 of the force times the radius
on the coarsest Hertz mesh, of order 2, at degree 1.
"""

from dataclasses import dataclass

import numpy as np

from fx_contact.fem.dirichlet import held_nodes, shared_forces
from fx_contact.problem.boundary_conditions import SymmetryPlane

#: Length of the sum of a pair's forces over the sum of their lengths from which on the pair has one direction: the
#: force in the records is then the length of the vector to 1 %.
DIRECTED = 0.99
#: What is shown as 0 beside the sum of magnitudes: less than its digits on the screen.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Resultant:
    """What forces add up to.

    Attributes:
        name: of the contact pair (`ContactPair.name`), the place of the condition or load, or the body.
        kind: "contact": of the first surface on the second, or on the obstacle; "traction", "pressure" or "body
            force": a load; "reaction" of a condition on the bodies; "symmetry": of the other part on the modelled one,
            across a plane of symmetry; "balance": of all that acts on a body, as it is modelled, 0 but for errors.
        force: (3,) float [N].
        moment: (3,) float, about `point` [N m].
        point: (3,) float [m].
        parts: modelled parts that are added up, each mirrored: those of the whole; 1 for symmetry and balance, and for
            all where the symmetry planes of the scene do not make `Scene.symmetry` copies.
    """

    name: str
    kind: str
    force: tuple[float, float, float]
    moment: tuple[float, float, float]
    point: tuple[float, float, float]
    parts: int

    @classmethod
    def from_json(cls, entries):
        """As `json.loads` makes it of a record.  Local."""
        return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in entries.items()})


def undirected(record):
    """Lines on the contact pairs whose force is no vector: the sum of magnitudes is more than its length.

    Local.

    Args:
        record: StepRecord.

    Returns:
        list of str.
    """
    pairs, lines = [one for one in record.resultants or () if one.kind == "contact"], []
    for pair, force, alignment in zip(pairs, record.pair_forces, record.pair_alignments or ()):
        if alignment is not None and alignment < DIRECTED:
            vector = ", ".join(f"{0.0 if abs(value) < _ROUNDING * force else value:.5g}" for value in pair.force)
            lines.append(
                f"{pair.name!r} presses in many directions: its forces add up to ({vector}), {alignment:.1%} of the "
                "sum of their magnitudes"
            )
    return lines


def sum_up(state, residual, totals, centre):
    """The resultants of a solution.

    Collective on state.forest.comm.

    Args:
        state: SolvedState.
        residual: (owned, 3) float64, as `nodal_residual` [N].
        totals: (k, nbodies, 6) float64, of the loads on this rank's leaves, as from `load_and_totals`: forces [N] and
            moments about the origin [N m].
        centre: (3,) float64, the point of moments, on all mirrors of the scene [m].

    Returns:
        tuple of Resultant: contact pairs, tractions, body forces, conditions, bodies, in the order of the scene.
    """
    scene = state.scene
    # Of each pair on its two bodies, then of the others: entries x bodies x (force, moment).
    on_first, on_second = _of_contact(state, centre)
    shifted = totals.copy()
    shifted[..., 3:] -= np.cross(centre, totals[..., :3])
    reactions = _of_conditions(state, residual, centre)
    sums = state.forest.comm.allreduce(np.concatenate([on_first, on_second, shifted, reactions]))
    names = [(pair.name, "contact") for pair in scene.contact]
    names += [(force.surface, type(force).__name__.lower()) for force in scene.tractions]
    names += [(force.body, "body force") for force in scene.body_forces]
    names += [(c.where, "symmetry" if isinstance(c, SymmetryPlane) else "reaction") for c in scene.dirichlet]
    names += [(body, "balance") for body in scene.mesh.bodies]
    values = np.concatenate([sums[len(scene.contact) :].sum(axis=1), sums.sum(axis=0)])
    for index, contact in enumerate(scene.contact):
        if len(contact.surfaces) == 1:  # on the obstacle
            values[index] = -sums[index].sum(axis=0)
    point = tuple(map(float, centre))
    return tuple(_resultant(name, kind, row, point, scene) for (name, kind), row in zip(names, values))


def _resultant(name, kind, row, point, scene):
    """A Resultant from the force and moment (6,) of the modelled part."""
    (force, moment), parts = np.split(row, 2), 1
    if kind not in ("symmetry", "balance"):
        force, moment, parts = scene.mirrors.force(force), scene.mirrors.moment(moment), scene.mirrors.parts
    return Resultant(name, kind, tuple(map(float, force)), tuple(map(float, moment)), point, parts)


def _of_contact(state, centre):
    """What this rank's nodes press on first and on second bodies: two (pairs, bodies, 6).  Collective."""
    scene, rows, sums = state.scene, state.pairs, []
    for index in range(len(scene.contact)):
        blocks, ours = rows.blocks, rows.contact == index
        push = -np.where(ours, state.solution.force, 0.0)[blocks.row, None] * blocks.values
        nodal = rows.prolongation.zeros(6)
        columns = 3 * blocks.side[:, None] + np.arange(3)
        np.add.at(nodal, (blocks.node[:, None], columns), push)
        nodal = rows.prolongation.summed(nodal)
        for side in np.split(nodal, 2, axis=1):
            nodes = np.flatnonzero(side.any(axis=1))
            sums.append(_on_bodies(state, nodes, side[nodes], np.zeros_like(nodes), 1, centre))
    shape = len(scene.contact), 2, len(scene.mesh.bodies), 6
    return np.reshape(sums, shape).transpose(1, 0, 2, 3)


def _of_conditions(state, residual, centre):
    """Reactions at this rank's nodes: (conditions, bodies, 6).  Collective."""
    conditions = state.scene.conditions
    held = held_nodes(state.scene, state.elasticity.prolongation)
    shared = shared_forces(conditions, held, residual)
    entry = np.repeat(np.arange(len(held)), list(map(len, held)))
    nodes = np.concatenate([np.zeros(0, dtype=np.int64), *held])
    across = np.array([condition.across for condition in conditions]).reshape(-1, 3, 3)[entry]
    force = np.einsum("nij,nj->ni", across, shared[nodes])
    return _on_bodies(state, nodes, force, entry, len(conditions), centre)


def _on_bodies(state, nodes, force, entry, entries, centre):
    """Sums of forces at conforming nodes that this rank owns, and of their moments, by entry and body.

    Local.

    Args:
        state: SolvedState.
        nodes: (k,) int, positions in the index map.
        force: (k, 3) float64 [N].
        entry: (k,) int, what each is added to.
        entries: number of these.
        centre: (3,) float64 [m].

    Returns:
        (entries, bodies, 6) float64, force [N] and moment [N m].
    """
    prolongation = state.elasticity.prolongation
    space, mesh = prolongation.space, state.scene.mesh
    leaf, local = space.example[prolongation.injected(np.arange(len(space)))[nodes]].T
    arm = state.elasticity.leaf_mesh.positions(leaf, local, space.degree) - centre
    sums, body = np.zeros((entries, len(mesh.bodies), 6)), mesh.body[state.forest.cell[leaf]]
    np.add.at(sums, (entry, body), np.concatenate([force, np.cross(arm, force)], axis=1))
    return sums
