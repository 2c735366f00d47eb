"""Error control: the choice of cells to refine, and the stopping criterion."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.estimator import Estimate
from fx_contact.estimate.marking import by_criterion, for_tolerance
from fx_contact.items.materials import LOCKING_POISSON
from fx_contact.parallel.arrays import Int8Array
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number

#: The modes, the default first.
MODES = ("contact", "energy")


@dataclass(frozen=True)
class ErrorControl:
    """Error control of a run.

    The mode "energy" is that of the paper: cells of criterion (2) are refined once, with their partners (5), until
    xi / (e omega) <= 1 (6).  It uses none of the parameters below, and controls no errors of contact.

    The mode "contact" uses the measured effectivity theta of the estimator, and refines cells once or twice by the
    threshold that the tolerance needs.  It also controls the forces of contact pairs, the penetration between nodes
    and that of a penalty (`contact_goals`).

    Attributes:
        mode: "contact" or "energy".
        target: the share of a tolerance that refinement aims at (studies/parameters) [-].
        trusted_effectivity: the error in (6) is xi with a theta of this or more, else xi / theta [-].  With 1 runs take
            1.6 to 1.7 times the unknowns if theta is 0.8 to 0.9 (studies/parameters).
        least_effectivity: lower bound of theta, and theta before it is measured; 0.43 was measured in thin plates at
            degree 1 (studies/effectivity), 0.58 on first meshes of studies.effectivity.first_mesh that may be enough
            [-].

    Raises:
        SceneError: an unknown mode, or a number that is not positive or above 1.
    """

    mode: str = MODES[0]
    target: float = 0.9
    trusted_effectivity: float = 0.8
    least_effectivity: float = 0.4

    def __post_init__(self) -> None:
        check_name("mode of the error control", self.mode, MODES)
        for field in fields(self)[1:]:
            value = check_number(f"{field.name} of the error control", getattr(self, field.name), positive=True)
            if value > 1:
                raise SceneError(f"{field.name} of the error control must be at most 1, got {value:g}")

    def __repr__(self) -> str:
        return f"ErrorControl({', '.join(f'{name}={value!r}' for name, value in self.used().items())})"

    def used(self) -> dict[str, Any]:
        """The parameters of the mode, by name.  Local."""
        used = fields(self) if self.of_contact else fields(self)[:1]
        return {field.name: getattr(self, field.name) for field in used}

    @property
    def of_contact(self) -> bool:
        """True if the mode controls errors of contact too."""
        return self.mode == "contact"

    def begin(self, degree: int, poisson: float, functions: bool = False) -> RefinementHistory:
        """The RefinementHistory of a run that begins, by the degree and the largest Poisson's ratio.

        Local.  One mesh is not enough in three cases.  At degree 1 (3) alone may be 0 on one layer of cells (`other
        loads/weight of a film`, `between nodes/all held` of studies/stability).  In nearly incompressible bodies theta
        may be less than `least_effectivity` (studies.effectivity.first_mesh).  Functions of position may vary within
        a cell.
        """
        enough = degree > 1 and poisson < LOCKING_POISSON and not functions
        return RefinementHistory(self.least_effectivity, compared=enough)

    def effectivity(self, history: RefinementHistory) -> float:
        """The measured effectivity of the estimate, 1 in the mode "energy".  Local."""
        return history.effectivity if self.of_contact else 1.0

    def correction(self, history: RefinementHistory) -> float:
        """Factor of the tolerance of xi / omega: theta, or 1 if it is trusted.  Local."""
        theta = self.effectivity(history)
        return 1.0 if theta >= self.trusted_effectivity else theta

    def sought(self, estimate: Estimate, tolerance: float, history: RefinementHistory) -> float | None:
        """The tolerance to refine for, by the prescribed one e [-]; None: xi / omega is small enough (6).

        Local.  In "contact" one mesh is enough if its theta is known, or bounded (`begin`).
        """
        if estimate.relative > tolerance:
            return tolerance
        corrected = self.correction(history) * tolerance
        if estimate.relative > corrected or (self.of_contact and not history.compared):
            return corrected
        return None

    @collective("comm")
    def marked(
        self, estimate: Estimate, tolerance: float, history: RefinementHistory, comm: MPI.Intracomm
    ) -> tuple[Int8Array, RefinementHistory]:
        """Number of refinements of each cell (ncells,) for a tolerance e [-], and history of the refined mesh.

        Collective on comm.  In "contact" all cells of a mesh that is not enough (`begin`) are refined.
        """
        if not self.of_contact:
            return by_criterion(estimate, tolerance).astype(np.int8), history
        square, sought = estimate.error_global**2, self.sought(estimate, tolerance, history) or tolerance
        times: Int8Array
        if not history.compared and estimate.relative <= sought:
            times, loss = np.ones(len(estimate.error), dtype=np.int8), 0.0
        else:
            rate = history.loss_rate(estimate)
            times, loss = for_tolerance(estimate, sought, rate, self.target, comm)
        return times, replace(history, error2=square, expected_loss=loss, refined=True)
