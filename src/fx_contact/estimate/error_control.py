"""The control of the error: what a run refines for, and when it stops."""

from dataclasses import dataclass, fields, replace

import numpy as np

from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.marking import by_criterion, for_tolerance
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number

#: The modes, the default first.
MODES = ("contact", "energy")


@dataclass(frozen=True)
class ErrorControl:
    """What a run refines for, and when it stops.

    The mode "energy" is that of the paper: cells of criterion (2) are refined once, with their partners (5), until
    xi / (e omega) <= 1 (6), on the first mesh too.  It uses none of the parameters below, and judges no penalty.

    The mode "contact" uses the measured effectivity theta of the estimator, and refines cells once or twice by the
    threshold that the tolerance needs.  It holds to the tolerance also the forces of contact pairs, the penetration
    between nodes and that of a penalty (`contact_goals`).

    Attributes:
        mode: "contact" or "energy".
        target: the share of a tolerance that refinement aims at (studies/parameters) [-].
        trusted_effectivity: with a theta of this or more xi is taken at its word (6), with less it is xi / theta [-].
            With 1 runs take 1.6 to 1.7 times the unknowns where theta is 0.8 to 0.9 (studies/parameters).
        least_effectivity: the least theta that is believed, and theta before it is measured: 0.43 was measured in thin
            plates (studies/effectivity), and refinement that changes nothing would show ever less [-].

    Raises:
        SceneError: an unknown mode, or a number that is not positive or above 1.
    """

    mode: str = MODES[0]
    target: float = 0.9
    trusted_effectivity: float = 0.8
    least_effectivity: float = 0.4

    def __post_init__(self):
        check_name("mode of the error control", self.mode, MODES)
        for field in fields(self)[1:]:
            value = check_number(f"{field.name} of the error control", getattr(self, field.name), positive=True)
            if value > 1:
                raise SceneError(f"{field.name} of the error control must be at most 1, got {value:g}")

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
        return RefinementHistory(self.least_effectivity)

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
            times, loss = np.ones(len(estimate.error), dtype=np.int8), 0.0
        else:
            rate = history.loss_rate(estimate)
            times, loss = for_tolerance(estimate, sought, rate, self, comm)
        return times, replace(history, error2=square, expected_loss=loss, refined=True)
