"""Which rows are closed: the active set, its first guess and its updates.

All rows with the wrong status change at once (primal-dual active set: M. Hintermueller, K. Ito, K. Kunisch,
SIAM J. Optim. 13(3), 2002).  That may cycle.  When a set comes back, single rows change, the lowest key first, until
fewer rows are wrong than ever before.  Contact is a linear complementarity problem with a positive definite matrix, for
which this rule ends (K. G. Murty, Math. Program. 7, 1974), and so does the whole (L. F. Portugal, J. J. Judice,
L. N. Vicente, Math. Comput. 63, 1994).
"""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.body_contact import loose_bodies
from fx_contact.parallel.errors import SolveError


class ActiveSet:
    """The closed rows, from a first guess of the displacement on.

    Collective on the prolongation's comm.

    Args:
        rows: ConstraintRows.
        scene: Scene, to see which bodies an active set leaves loose; None: not looked at.
        u: (owned, 3) float64, first guess of the displacement [m].
        most: most updates.

    Attributes:
        active: (n,) bool, closed rows.
        updates: number of active sets tried.
    """

    #: Bands of rows closest to touching that close to hold a loose body, relative to the range of the gaps: from
    #: rounding to all of them, in factors of 4.
    _BANDS = 4.0 ** -np.arange(12, -1, -1)
    #: Penetrations and gaps up to this part of the largest displacement are rounding: 1e4 times that of a double.  Rows
    #: that were closed on the coarser mesh have no other: they begin closed.
    _TOUCHING = 1e-12

    def __init__(self, rows, scene, u, most):
        self._rows, self._scene, self._most = rows, scene, most
        self._comm = rows.prolongation.comm
        self.updates, self._loose = 1, []
        penetration = rows.penetration(u)
        deepest, rounding = self._max(penetration), self._TOUCHING * self._max(np.abs(u))
        closed = penetration >= min(deepest, 0.0) - rounding
        self.active = self._held(closed, penetration)
        self.reset_cycles()

    def reset_cycles(self) -> None:
        """Reset the detection of cycles.  Local."""
        self._tried, self._fewest, self._single = [self.active], np.inf, False
        self._penetrate_when_open = False

    def wanted(self, trial, noise):
        """The status that each row should have.

        Collective.  A row keeps its status if its trial force is below the error of the linear solver.  If all are,
        the bodies touch without force, and all rows open, unless they have penetrated by more when all were open.
        Where a body is left loose, the rows closest to touching are closed; `check_held` tells whether they press.

        Args:
            trial: (n,) float64, force of closed rows, and k (B u - D) of open ones [N].
            noise: error of the displacement in the energy norm [J^(1/2)].

        Returns:
            (n,) bool.
        """
        pressure = trial / np.sqrt(self._rows.capped_stiffness)  # [J^(1/2)], as the noise
        hardest = self._max(pressure)
        self._penetrate_when_open |= hardest > noise and not self.differs(np.zeros_like(self.active))
        press = hardest > noise or self._penetrate_when_open
        wanted = pressure > (np.where(self.active, -noise, noise) if press else hardest)
        return self._held(wanted, trial / self._rows.capped_stiffness)

    def check_held(self):
        """See that the rows that hold the bodies press.  Local.

        Raises:
            SolveError: the last status wanted needs rows that pull, to hold a body.
        """
        if self._loose:
            raise SolveError(
                f"nothing holds body {', '.join(map(repr, self._loose))} once the contact opens: only contact stops "
                "some of its rigid motions; prescribe displacements that stop them, or load it towards the contact, "
                "with the resultant inside the contact surface"
            )

    def differs(self, other):
        """Number of rows on all ranks whose status differs.  Collective."""
        return self._comm.allreduce(int((self.active != other).sum()))

    def cycles(self, wanted):
        """Whether a set, (n,) bool, was tried before.  Collective."""
        same = np.array([np.array_equal(wanted, tried) for tried in self._tried], dtype=np.int8)
        self._comm.Allreduce(MPI.IN_PLACE, same, op=MPI.MIN)
        return bool(same.any())

    def update(self, wanted):
        """Change all rows that are wrong, or one of them if all at once would lead back to a set that was tried.

        Collective.

        Args:
            wanted: (n,) bool, not the present set.

        Raises:
            SolveError: there were too many updates, or nothing holds a body but rows that pull.
        """
        if self.cycles(wanted):
            self.check_held()
        self.updates += 1
        if self.updates > self._most:
            raise SolveError(
                f"the active set still changes after {self._most} updates; allow more (Solver.max_contact), or apply "
                "less load"
            )
        wrong = self.differs(wanted)
        if wrong < self._fewest:
            self._fewest, self._single = wrong, False
        self._single = self._single or self.cycles(wanted)
        if self._single:
            key = self._rows.key
            lowest = int(key[self.active != wanted].min(initial=np.iinfo(np.int64).max))
            lowest = self._comm.allreduce(lowest, op=MPI.MIN)
            wanted = np.where(key == lowest, wanted, self.active)
        self.active = wanted
        self._tried.append(wanted)

    def _held(self, active, penetration):
        """An active set, with the rows closest to touching that it needs to hold all bodies."""
        self._loose = self._loose_bodies(active)
        if self._loose:
            top, bottom = self._max(penetration), -self._max(-penetration)
            for band in self._BANDS:
                more = active | (penetration >= top - band * (top - bottom))
                if not self._loose_bodies(more):
                    return more
        return active

    def _loose_bodies(self, active):
        return [] if self._scene is None else loose_bodies(self._scene, self._rows, active)

    def _max(self, values):
        return self._comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
