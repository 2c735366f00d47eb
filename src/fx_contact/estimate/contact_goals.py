"""What of the error is contact's own: of its forces and gaps, between its nodes, and of a penalty.

A force F of a contact pair may have the relative error e, or e^2 of the largest force.  With xi and xi(z) the estimated
errors of the solution and of the dual solution z of F, its error is at most xi xi(z), and omega(z) is F / sqrt(W), with
W the energy that F stores.  With xi(z) = 0.5 omega(z) (`dual_error`) that is a bound without a dual solution, which
suffices where contact alone loads bodies.  Elsewhere dual solutions are computed (`dual_weighted`).
"""

from dataclasses import dataclass, replace

import numpy as np

from fx_contact.contact.contact_patches import ContactPatches
from fx_contact.estimate.candidate_contact import CandidateZones
from fx_contact.estimate.contact_energy import PressureClusters, stored_energy
from fx_contact.estimate.inter_node_gap import inter_node_penetration
from fx_contact.estimate.marking import for_goal


@dataclass(frozen=True, eq=False)
class ContactError:
    """How well a step resolves contact.

    Attributes:
        refine: (n,) int8, how often to refine each leaf of this rank for contact, whatever xi_T is.
        leaves: number of these leaves on all ranks.
        between_nodes: number of those on all ranks that the gap between nodes needs; None: not computed.
        of_pairs: list of float, for each contact pair the estimated error of its force, with what candidate places
            would add, relative to the force; without force the largest error of a gap, relative to the gap; None: not
            computed, before (6) is met [-].
        leaves_of_pairs: list of int, number of leaves on all ranks that the force and the gaps of each pair need.
        penalty_share: the largest share of a contact pair's energy that the penetration of a penalty takes; None: not
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

    Collective on state.forest.comm.  Penetration between nodes is looked at in each step, forces and gaps once (6) is
    met.

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
    comm, solution, estimate = state.forest.comm, state.solution, state.estimate
    patches = ContactPatches(state.forest, state.pairs, solution.active)
    clusters = PressureClusters(state.pairs, solution.force, patches.pair, patches.number)
    energy = stored_energy(state, clusters)
    between = inter_node_penetration(state, tolerance, patches, energy)
    force, flexibility, penalty_share = _of_pairs(state, patches, clusters.force, energy, np.array(forces))

    refine, errors, leaves = between.astype(np.int8), [None] * len(forces), [0] * len(forces)
    if control.sought(estimate, tolerance, history) is None:
        theta = control.correction(history)
        bounds = np.zeros(len(forces))
        if estimate.error_global:
            bounds = control.dual_error * estimate.error_global / theta * np.sqrt(flexibility)
        allowed = allowed_errors(forces, tolerance, theta)
        zones = CandidateZones(state, patches, clusters, control)
        for index in range(len(forces)):
            accuracy = _Accuracy(comm, len(estimate.error), force[index], bounds[index], allowed[index], control)
            if bounds[index] > allowed[index]:
                accuracy.judge_force(goals.force(index))
            for weight in zones.places(index):
                goal = goals.gap(weight)
                accuracy.judge_gap(goal, theta * max(control.gap_accuracy * goal.value, tolerance**2 * goal.moved))
            errors[index] = accuracy.error
            leaves[index] = comm.allreduce(int((accuracy.refine > 0).sum()))
            of_leaf = np.zeros_like(refine)
            of_leaf[state.elasticity.leaf_mesh.leaf] = accuracy.refine
            np.maximum(refine, of_leaf, out=refine)
    between_nodes, total = comm.allreduce(np.array([between.sum(), (refine > 0).sum()])).tolist()
    return ContactError(refine, total, between_nodes, errors, leaves, float(penalty_share.max(initial=0.0)))


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


def _of_pairs(state, patches, patch_force, energy, forces):
    """Force of each contact pair, its flexibility 1/W, and the share of its energy that penetration takes.

    Patches are springs beside each other: F^2 / W of a contact pair is the sum of F^2 / W of its patches.

    Args:
        state: SolvedState.
        patches: ContactPatches.
        patch_force, energy: (count,) float64, force [N] and stored energy [J] of each patch.
        forces: (npairs,) float64, `pair_forces` of the record [N].

    Returns:
        three (npairs,) float64: [N], of the modelled part; [1/J]; [-].
    """
    solution, presses = state.solution, patches.pair >= 0
    work = np.bincount(patches.pair[presses], (solution.force * solution.penetration)[presses], patches.number)
    work = state.forest.comm.allreduce(work)

    def summed(of_patches):
        """Sums of values of the patches over each contact pair."""
        return np.bincount(patches.contact, of_patches, len(forces))

    force = np.where(forces > 0, summed(patch_force), 0.0)  # a pair that pulls at last does so by rounding
    share = _quotient(patch_force, force[patches.contact])
    flexibility = np.divide(share**2, energy, out=np.where(share > 0, np.inf, 0.0), where=energy > 0)
    return force, summed(flexibility), summed(_quotient(share * work, energy))


def _quotient(part, whole):
    """The quotient of two arrays of non-negative numbers, 0 where the second is."""
    return np.divide(part, whole, out=np.zeros(len(whole)), where=whole > 0)


class _Accuracy:
    """How accurate the force and the gaps of a contact pair are, and which cells they need; the force comes first.

    Collective on comm.

    Args:
        comm: MPI communicator.
        cells: number of this rank's cells.
        force: of the contact pair's modelled part; 0: it has none [N].
        bound: of the relative error of that force, without a dual solution [-].
        allowed: relative error that the force may have [-].
        control: ErrorControl.

    Attributes:
        error: as in `ContactError.of_pairs` [-].
        refine: (cells,) int8, how often to refine each cell.
    """

    def __init__(self, comm, cells, force, bound, allowed, control):
        self._comm, self._force, self._allowed, self._control = comm, float(force), float(allowed), control
        self.error, self.refine = float(bound) if force else None, np.zeros(cells, dtype=np.int8)

    def judge_force(self, goal):
        """Let the dual solution of the force give its error, in place of the bound."""
        self.error = goal.total / goal.value
        self._mark(goal, self._allowed * goal.value)

    def judge_gap(self, goal, allowed):
        """Let the dual solution of a gap give its error.

        With C the compliance of the place, the force that would close the gap g is g / C.  So beside a force of the
        same contact pair a gap may also have the error C dF, with dF the allowed error of the force; and an error of
        more than g adds a force.

        Args:
            goal: Goal of the gap.
            allowed: its error with which it surely is open [m].
        """
        if not self._force:
            error = goal.total / goal.value if goal.value else float(goal.total > 0)
            self.error = max(self.error or 0.0, error)
        elif goal.compliance:
            self.error += max(goal.total - goal.value, 0.0) / goal.compliance / self._force
        self._mark(goal, max(allowed, self._allowed * self._force * goal.compliance))

    def _mark(self, goal, allowed):
        """Mark cells for a goal with more than the allowed error, or first for a dual solution that has too much."""
        dual, limit = goal.dual, self._control.dual_limit
        how = dual.child_error, self._control, self._comm
        if dual.relative > limit:
            self.error = max(self.error, 1.0)
            refine = for_goal(dual.error**2, (limit * dual.energy_norm) ** 2, *how)
        elif goal.total > allowed:
            refine = for_goal(goal.error, allowed, *how)
        else:
            return
        np.maximum(self.refine, refine, out=self.refine)
