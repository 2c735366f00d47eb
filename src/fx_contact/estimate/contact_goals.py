"""What of the error is contact's own: of its forces, between its nodes, and of a penalty.

The force F of a contact pair may have the relative error e, or e^2 of the largest force.  Its dual solution z has the
contact pressure p_z.  With the gap g, and g_I that a step takes for it between the nodes,

    |F - F_h| <= sum_T xi_T(u) xi_T(z) + int |p_z| |g - g_I| dA.

Where a single pair does all the work, and its surfaces move alike, z is about u over that movement, F times which is
omega(u)^2.  Then, with xi(z) / omega(z) taken as `_DUAL_ERROR` and no dual solution,

    |F - F_h| / F <= xi(u) / omega(u) xi(z) / omega(z) + int p |g - g_I| dA / omega(u)^2.
"""

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from fx_contact.estimate.marking import for_goal

#: xi(z) / omega(z) of a dual solution that is not computed.  This constant and the next two: `studies.goals.duals`.
_DUAL_ERROR = 0.5
#: Largest part of the energy that is not the work of contact,
_ELSEWHERE = 0.01
#: and least ratio of movements by strains, for surfaces that move alike.
_ALIKE = 0.4


@dataclass(frozen=True, eq=False)
class ContactError:
    """How well a step resolves contact.

    Attributes:
        refine: (n,) int8, how often to refine each leaf of this rank for contact, whatever xi_T is.
        leaves: number of these leaves on all ranks.
        between_nodes: number of those on all ranks that are penetrated between nodes; None: not computed.
        of_pairs: list of float, for each contact pair the estimated error of its force, relative to it; None: not
            computed, before (6) is met, or no force [-].
        leaves_of_pairs: list of int, number of leaves on all ranks that the force of each pair needs.
        penalty_share: the largest share of a contact pair's force that the penetration of a penalty takes; None: not
            computed [-].
    """

    refine: np.ndarray
    leaves: int
    between_nodes: int | None
    of_pairs: list
    leaves_of_pairs: list
    penalty_share: float | None

    @classmethod
    def unknown(cls, leaves, pairs):
        """That of a step of so many leaves on this rank and so many contact pairs for which it is not asked.  Local."""
        between_nodes, share = (None, None) if pairs else (0, 0.0)
        return cls(np.zeros(leaves, dtype=np.int8), 0, between_nodes, [None] * pairs, [0] * pairs, share)

    def with_more(self, refine, comm):
        """The same with leaves to refine for something else.

        Collective on comm.

        Args:
            refine: (n,) int8, how often to refine each leaf.
            comm: MPI communicator.
        """
        refine = np.maximum(self.refine, refine)
        return replace(self, refine=refine, leaves=comm.allreduce(int((refine > 0).sum())))


def contact_error(state, goals, forces, tolerance, control, history):
    """Estimate the errors of contact in a step, and mark leaves for them.

    Collective on state.forest.comm.  Penetration between nodes is looked at in each step, forces once (6) is met.

    Args:
        state: SolvedState.
        goals: Goals of that.
        forces: (npairs,) float64, or a list, `pair_forces` of the record [N].
        tolerance: prescribed accuracy e [-].
        control: ErrorControl.
        history: RefinementHistory.

    Returns:
        ContactError.
    """
    comm, leaf, between = state.forest.comm, state.elasticity.leaf_mesh.leaf, GapBetweenNodes(state)
    missed = between.penetrated()
    refine, errors, leaves = missed.astype(np.int8), [None] * len(forces), [0] * len(forces)
    shares = _yielded(state, len(forces))
    if control.sought(state.estimate, tolerance, history) is None:
        theta = control.correction(history)
        bound = _bound(state, between, forces)
        for index, allowed in enumerate(allowed_errors(forces, tolerance, theta)):
            if forces[index] <= 0:
                continue
            if bound <= allowed:
                errors[index] = bound
                continue
            goal = goals.force(index)
            shares[index] = _part_of_penetration(state, goal)
            error = goal.error + between.on_cells(goal.pressure)
            total = comm.allreduce(float(error.sum()))
            errors[index] = total / goal.value if goal.value else float(total > 0)
            if errors[index] > allowed:
                times = for_goal(error, allowed * goal.value, goal.dual.child_error, control, comm)
                leaves[index] = comm.allreduce(int((times > 0).sum()))
                refine[leaf] = np.maximum(refine[leaf], times)
    between_nodes, total = comm.allreduce(np.array([missed.sum(), (refine > 0).sum()])).tolist()
    return ContactError(refine, total, between_nodes, errors, leaves, float(np.max(shares, initial=0.0)))


def allowed_errors(forces, tolerance, effectivity):
    """Relative errors that forces of contact pairs may have: e of what each should be, or e^2 of the largest.

    Local.

    Args:
        forces: (npairs,) float64, or a list, `pair_forces` of a record [N].
        tolerance: prescribed accuracy e [-].
        effectivity: by which estimated errors are corrected [-].

    Returns:
        (npairs,) float64, relative to the forces that they have [-].
    """
    forces = np.abs(forces)
    light = np.divide(forces.max(initial=0.0), forces, out=np.full(len(forces), np.inf), where=forces > 0)
    allowed = np.maximum(tolerance, tolerance**2 * light)
    return effectivity / (1 + 1 / allowed)


def _yielded(state, count):
    """The share of the energy that is the work of each contact pair's force on its penetration: (count,) float64."""
    work = np.bincount(state.pairs.contact, state.solution.force * state.solution.penetration, count)
    work, energy = np.maximum(state.forest.comm.allreduce(work), 0.0), state.estimate.energy_norm**2
    return work / energy if energy else np.zeros(count)


def _bound(state, between, forces):
    """A bound of the relative error of the force of a pair that stores all energy, its surfaces moved alike; or inf.

    Collective.
    """
    if np.count_nonzero(np.asarray(forces) > 0) != 1:
        return np.inf
    elsewhere, alike = likeness(state)
    if elsewhere > _ELSEWHERE or alike < _ALIKE:
        return np.inf
    estimate = state.estimate
    gap = state.forest.comm.allreduce(float(between.on_cells(state.solution.pressure).sum()))
    return _DUAL_ERROR * estimate.relative + gap / estimate.energy_norm**2


def likeness(state):
    """How much the solution is like the dual solution of the contact force.

    Collective on state.forest.comm.

    Args:
        state: SolvedState.

    Returns:
        |f . B v - omega^2| / omega^2, with v = u less the rigid motions, 0 where contact does all the work (Clapeyron)
        [-]; the least over the largest movement by strains of node pairs that press, 1 where they move alike [-].
    """
    comm, estimate = state.forest.comm, state.estimate
    force, moved = state.solution.force, -moved_by_strains(state)
    least, most = moved[force > 0].min(initial=np.inf), moved[force > 0].max(initial=-np.inf)
    least, most = comm.allreduce(least, op=MPI.MIN), comm.allreduce(most, op=MPI.MAX)
    work, energy = comm.allreduce(float(force @ moved)), estimate.energy_norm**2 - estimate.error_global**2
    return abs(work - energy) / energy if energy > 0 else np.inf, least / most if most > 0 else 0.0


def moved_by_strains(state):
    """How far strains have moved the surfaces of node pairs towards each other.

    Collective.  It is B u less the rigid motions of the bodies: those that conditions prescribe, and of those that no
    condition stops the ones that bring closed contact together.

    Args:
        state: SolvedState.

    Returns:
        (n,) float64 [m].
    """
    scene, pairs, solution = state.scene, state.pairs, state.solution
    moved, sides = solution.penetration + pairs.gap, list(zip((1, -1), pairs.bodies.T))
    for sign, side in sides:
        modes = np.einsum("nmi,ni->nm", scene.rigid_motions.modes(pairs.position, side), pairs.normal)
        moved -= sign * np.where(side >= 0, (modes * scene.rigid_motions.prescribed[side]).sum(axis=1), 0.0)
    if len(scene.rigid_motions.free):
        free = sum(sign * scene.rigid_motions.free_along(pairs.position, side, pairs.normal) for sign, side in sides)
        weighted = solution.active * pairs.area * free.T
        sums = np.column_stack([weighted @ free, weighted @ moved])
        pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        motion, *_ = np.linalg.lstsq(sums[:, :-1], sums[:, -1], rcond=1e-10)  # as RigidMotions tells free from held
        moved -= free @ motion
    return moved


def _part_of_penetration(state, goal):
    """The part of a pair's force that penetration of a penalty takes, by the dual solution: float [-].  Collective."""
    work = float((goal.pressure * state.pairs.area) @ state.solution.penetration)
    return abs(state.forest.comm.allreduce(work)) / goal.value if goal.value else 0.0
