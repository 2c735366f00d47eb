"""The control of the error: what a run refines for, and when it stops."""

from dataclasses import dataclass, fields, replace

import numpy as np

from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.marking import by_criterion, for_tolerance, smooth_loss
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_count, check_name, check_number

#: The modes, the default first.
MODES = ("contact", "energy")


@dataclass(frozen=True)
class ErrorControl:
    """What a run refines for, and when it stops.

    The mode "energy" is that of the paper: cells of criterion (2) are refined once, with their partners (5), until
    xi / (e omega) <= 1 (6), on the first mesh too.  It uses none of the parameters below, and judges no penalty.

    The mode "contact" uses the measured effectivity theta of the estimator, and refines cells once or twice by the
    threshold that the tolerance needs.  It holds to the tolerance also the forces of contact pairs, open gaps, the
    penetration between nodes and that of a penalty (`contact_goals`).

    Measured by studies/parameters: each parameter halved and doubled on nine scenes at degree 2; "unknowns" are those
    of all steps, over those with the default.

    Attributes:
        mode: "contact" or "energy".
        target: the share of the tolerance that refinement aims at: with 1 0.96 to 1.02 times the unknowns, with
            0.45 0.88 to 1.55 times [-].
        lowest_threshold: of marking, relative to that of criterion (2): a solve on a mesh of intermediate size costs
            more than the cells that it would spare.  0.125 and 0.5 change nothing in the study [-].
        thresholds: number of thresholds that marking tries; half and double change nothing.
        least_loss_rate: the least loss of xi^2 that refinement is expected to bring, relative to a smooth solution:
            with it marking is bounded where a step has brought nothing.  0.05 and 0.2 change nothing in the study [-].
        least_reduction: the least xi that one step aims at, relative to the present one, at degree 2: what refining all
            cells brings where the solution is smooth.  Coarse meshes do not know where the cells of the last will be
            needed: Hertz at 1 % ends with 102 thousand unknowns, without this bound with 276 thousand [-].
        trusted_effectivity: with a theta of this or more xi is taken at its word (6), with less it is xi / theta [-].
        first_effectivity: theta before it is measured: 0.56 was measured on one and two layers of tall cells between
            clamped ends, where degree 1 locks in bending [-].
        least_effectivity: the least theta that is believed: 0.43 was measured in thin plates, and refinement that
            changes nothing would show ever less [-].
        goal_target: the share of the allowed error of a force or gap that its refinement aims at: with 0.4 1.02 to
            1.23 times the unknowns, with 1 0.88 times; forces meet the tolerance with all [-].
        goal_kept: the share of it that the cells not refined keep at most, where refining twice is not enough:
            0.125 changes nothing in the study, 0.5 one scene, by 0.93 times the unknowns [-].
        gap_accuracy: allowed error of a mean gap, relative to it: the least gap is about half of the mean [-].
        dual_limit: relative error from which a dual solution is taken to know nothing: 0.69 and 0.70 were measured
            where thin cells lock in bending (`test_a_mesh_that_locks_tells_nothing`), 0.59 where a single node is
            pressed [-].
        dual_error: the relative error of a dual solution that is not computed [-].
        candidate_movement: movement by strains, relative to the gap left, from which a place is a candidate for
            contact; the most moved place of an open surface always is one.  0.025 and 0.1 change nothing in the
            study [-].
        candidate_spread: parts of one surface whose movements differ by this factor or less are one place: 1 changes
            nothing in the study, 4 one scene, by 0.79 times the unknowns [-].

    Raises:
        SceneError: an unknown mode, a number that is not positive, or above 1 where it is a share, a candidate_spread
            below 1, a first_effectivity below the least one.
    """

    mode: str = MODES[0]
    target: float = 0.9
    lowest_threshold: float = 0.25
    thresholds: int = 1024
    least_loss_rate: float = 0.1
    least_reduction: float = 0.25
    trusted_effectivity: float = 0.8
    first_effectivity: float = 0.5
    least_effectivity: float = 0.4
    goal_target: float = 0.8
    goal_kept: float = 0.25
    gap_accuracy: float = 0.25
    dual_limit: float = 0.65
    dual_error: float = 0.5
    candidate_movement: float = 0.05
    candidate_spread: float = 2.0

    def __post_init__(self):
        check_name("mode of the error control", self.mode, MODES)
        check_count("the number of thresholds", self.thresholds, least=4)
        for field in fields(self)[1:]:
            value = check_number(f"{field.name} of the error control", getattr(self, field.name), positive=True)
            if value > 1 and field.default <= 1:
                raise SceneError(f"{field.name} of the error control must be at most 1, got {value:g}")
        if self.candidate_spread < 1:
            raise SceneError(
                f"candidate_spread of the error control must be at least 1, got {self.candidate_spread:g}"
            )
        if self.first_effectivity < self.least_effectivity:
            raise SceneError(
                "first_effectivity of the error control must be at least least_effectivity, "
                f"{self.least_effectivity:g}, got {self.first_effectivity:g}"
            )

    def __repr__(self):
        return f"ErrorControl({', '.join(f'{name}={value!r}' for name, value in self.used().items())})"

    def used(self):
        """The parameters that the mode uses, by name: dict.  Local."""
        used = fields(self) if self.of_contact else fields(self)[:1]
        return {field.name: getattr(self, field.name) for field in used}

    @property
    def of_contact(self):
        """Whether contact has an error of its own to control."""
        return self.mode == "contact"

    def begin(self):
        """The RefinementHistory of a run that begins.  Local."""
        return RefinementHistory(self.first_effectivity)

    def effectivity(self, history):
        """The effectivity that the estimate is taken to have: the measured one, 1 in the mode "energy".  Local."""
        return history.effectivity if self.of_contact else 1.0

    def correction(self, history):
        """The part of the tolerance that xi / omega may use: theta, or 1 where the estimate is trusted.  Local."""
        theta = self.effectivity(history)
        return 1.0 if theta >= self.trusted_effectivity else theta

    def sought(self, estimate, tolerance, history):
        """The tolerance to refine for, or None where xi / omega is small enough (6).

        Local.  "contact" needs two meshes at least: on a first mesh the estimate may be zero and wrong, as where all
        vertices are held.

        Args:
            estimate: Estimate on the present mesh.
            tolerance: prescribed accuracy e [-].
            history: RefinementHistory.

        Returns:
            float [-] or None.
        """
        if estimate.relative > tolerance:
            return tolerance
        corrected = self.correction(history) * tolerance
        if estimate.relative > corrected or (self.of_contact and not history.compared):
            return corrected
        return None

    @collective("comm")
    def marked(self, estimate, tolerance, history, comm):
        """Cells of the present mesh to refine: in "contact" all of a first mesh that meets the tolerance.

        Collective on comm.

        Args:
            estimate: Estimate on the present mesh.
            tolerance: prescribed accuracy e [-].
            history: RefinementHistory.
            comm: MPI communicator of the mesh's forest.

        Returns:
            (ncells,) int8, how often to refine each cell, and the RefinementHistory of the refined mesh.
        """
        if not self.of_contact:
            return by_criterion(estimate, tolerance).astype(np.int8), history
        square, sought = estimate.error_global**2, self.sought(estimate, tolerance, history) or tolerance
        if not history.compared and estimate.relative <= sought:
            times, loss = np.ones(len(estimate.error), dtype=np.int8), smooth_loss(estimate.child_error) * square
        else:
            rate = history.loss_rate(estimate, self.least_loss_rate)
            times, loss = for_tolerance(estimate, sought, rate, self, comm)
        return times, replace(history, error2=square, expected_loss=loss, refined=True)
