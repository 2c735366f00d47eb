"""Error control: the choice of cells to refine, and the stopping criterion."""

import warnings
from dataclasses import InitVar, dataclass, fields
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.estimator import Estimate
from fx_contact.estimate.marking import by_criterion, for_tolerance
from fx_contact.fem.space import child_error
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

    The mode "contact" assumes a low effectivity theta of the estimate on a first mesh, and refines cells once or twice
    by the threshold that the tolerance needs.  It also controls the forces of contact pairs, the penetration between
    nodes and that of a penalty (`contact_goals`).

    Attributes:
        mode: "contact" or "energy".
        target: the share of a tolerance that refinement aims at: with 1 runs take 0.67 to 1.16 times the unknowns, and
            a true error was 1.1 times the tolerance (ten scenes, revision 50b7844, a study since removed) [-].
        least_effectivity: theta on the first mesh of a run, whose error in (6) is xi / theta; 0.58 and more was
            measured, 0.37 and more in nearly incompressible bodies (studies.effectivity.first_mesh) [-].
        trusted_effectivity: has no effect.

    Raises:
        SceneError: an unknown mode, or a number that is not positive or above 1.
    """

    mode: str = MODES[0]
    target: float = 0.9
    trusted_effectivity: InitVar[float | None] = None
    least_effectivity: float = 0.4

    def __post_init__(self, trusted_effectivity: float | None) -> None:
        if trusted_effectivity is not None:
            warnings.warn("trusted_effectivity has no effect any more", DeprecationWarning, stacklevel=3)
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

    def effectivity(self, first: bool) -> float:
        """Assumed effectivity theta of the estimate on the first mesh of a run, or on a later one.  Local."""
        return self.least_effectivity if first and self.of_contact else 1.0

    def sought(self, estimate: Estimate, tolerance: float, effectivity: float) -> float | None:
        """The tolerance to refine for, by the prescribed one e [-]; None: xi / (theta omega) is small enough (6).

        Local.  At degree 1 a first mesh (theta < 1) is never enough: (3) alone may be 0 on one layer of cells
        (`other loads/weight of a film`, `between nodes/all held` of studies/stability).
        """
        if estimate.relative > tolerance:
            return tolerance
        enough = effectivity == 1.0 or estimate.child_error < child_error(1)
        return None if enough and estimate.relative <= effectivity * tolerance else effectivity * tolerance

    @collective("comm")
    def marked(self, estimate: Estimate, tolerance: float, effectivity: float, comm: MPI.Intracomm) -> Int8Array:
        """Number of refinements of each cell (ncells,) for a tolerance e [-].

        Collective on comm.  In "contact" all cells are refined of a mesh of which more is `sought` than it shows.
        """
        if not self.of_contact:
            return by_criterion(estimate, tolerance).astype(np.int8)
        sought = self.sought(estimate, tolerance, effectivity)
        if sought is not None and estimate.relative <= sought:
            return np.ones(len(estimate.error), dtype=np.int8)
        return for_tolerance(estimate, sought or tolerance, self.target, comm)
