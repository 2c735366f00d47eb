"""Error control: the choice of cells to refine, and the stopping criterion."""

from dataclasses import dataclass, fields
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

#: Effectivities from this one on are taken as 1.  With 0.8 the true errors of four runs of degree 1 of the stress
#: matrix are 1.01 to 1.10 times the tolerance; with 0.9 one of them is, 1.02 times (`studies.stability.run`).
_TRUSTED = 0.9


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
            measured, 0.37 and more in nearly incompressible bodies (studies.effectivity.first_mesh) [-].  On later
            meshes theta is 0.7, 0.85 and 1 at degree 1, 0.85 and 1 at degree 2 (`effectivity`).

    Raises:
        SceneError: an unknown mode, or a number that is not positive or above 1.
    """

    mode: str = MODES[0]
    target: float = 0.9
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

    def effectivity(self, degree: int, before: float | None = None) -> float:
        """Assumed effectivity theta on a mesh, by that on the mesh before; None: on a first mesh.  Local.

        1 - theta falls as h^p, the error of the recovered stress over that of the stress at degree p.
        """
        if not self.of_contact:
            return 1.0
        theta = self.least_effectivity if before is None else 1 - (1 - before) * 0.5**degree
        return theta if theta < _TRUSTED else 1.0

    def sought(self, estimate: Estimate, tolerance: float, effectivity: float) -> float | None:
        """The tolerance to refine for, by the prescribed one e [-]; None: xi / (theta omega) is small enough (6).

        Local.  At degree 1 a first mesh is never enough: (3) alone may be 0 on one layer of cells
        (`other loads/weight of a film`, `between nodes/all held` of studies/stability).
        """
        if estimate.relative > tolerance:
            return tolerance
        enough = effectivity > self.least_effectivity or estimate.child_error < child_error(1)
        return None if enough and estimate.relative <= effectivity * tolerance else effectivity * tolerance

    @collective("comm")
    def marked(
        self,
        estimate: Estimate,
        tolerance: float,
        effectivity: float,
        comm: MPI.Intracomm,
        later: float = 1.0,
        loss_rate: float = 1.0,
    ) -> Int8Array:
        """Number of refinements of each cell (ncells,) for a tolerance e [-], by theta here and `later`.

        Collective on comm.  In "contact" all cells are refined of a mesh of which more is `sought` than it shows.
        """
        if not self.of_contact:
            return by_criterion(estimate, tolerance).astype(np.int8)
        sought = self.sought(estimate, tolerance, effectivity)
        if sought is not None and estimate.relative <= sought:
            return np.ones(len(estimate.error), dtype=np.int8)
        sought = min(sought or tolerance, later * tolerance)
        return for_tolerance(estimate, sought, self.target, comm, loss_rate)
