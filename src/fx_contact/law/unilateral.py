"""The unilateral law of normals, f >= 0, B u <= D, f (B u - D) = 0: first active set and its updates.

Equations are always closed; tangents have the laws of their contacts (`tangential`).

All rows with the wrong status change at once (primal-dual active set: M. Hintermueller, K. Ito, K. Kunisch,
SIAM J. Optim. 13(3), 2002).  If a set recurs, single rows change, the lowest key first, until the number of wrong
rows has a new minimum.  Contact is a linear complementarity problem with a positive definite matrix: single changes
terminate (K. G. Murty, Math. Program. 7, 1974), and so does the combination (L. F. Portugal, J. J. Judice,
L. N. Vicente, Math. Comput. 63, 1994).
"""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_problem import History
from fx_contact.contact.contact_system import Springs
from fx_contact.contact.row_motions import RowMotions
from fx_contact.law.free_motions import LoadedMotions, driven_error
from fx_contact.law.support import Resisting, Support
from fx_contact.law.tangential import tangential_status
from fx_contact.law.tangents import tangential_vectors
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import any_true

#: Advice for a body that friction does not hold.
_HOLD = (
    "prescribe displacements that stop it, or load it less along the contact, with the resultant inside the contact "
    "surface"
)


class Unilateral:
    """Status of the rows, at first closed where a displacement closes them, or brings them closest to touching.

    Collective on the prolongation's comm.

    Args:
        loaded: motions of free bodies, to support those that loads drive; None: there are none.
        u: (owned, 3), displacement [m].
        most: linear solves; None: no limit.
        exact: closed rows do not yield.
        before: the load step before, for tangents.

    Attributes:
        active: (n,), closed normals, and all equations.
        normal: (n,), rows that may open.
        updates: number of active sets, with linear solves that found one (`restart`).
        of_others: updates for rows before the present ones (`exchange_rows`).
    """

    #: Gaps that differ by this part of their range, and rates of unit motions up to it, are rounding [-].
    _ALIKE = 4.0**-12
    #: Penetrations and gaps up to this part of the largest displacement are rounding (1e4 times that of a double),
    #: for instance of rows closed on the coarser mesh.
    _TOUCHING = 1e-12
    #: Gaps from this part of the largest displacement on are open before a load step; curved surfaces that touch have
    #: less.
    _OPEN = 1e-6
    #: Most linear solves for stick and slip; 25 were needed at nu = 0, mu = 1.
    _MOST_SLIDES = 60

    def __init__(
        self,
        rows: ConstraintRows,
        loaded: LoadedMotions | None,
        u: FloatArray,
        most: int | None,
        exact: bool = True,
        before: History = History(),
    ) -> None:
        self._rows, self._most, self._exact, self._before = rows, most, exact, before
        self._comm = rows.prolongation.comm
        self.updates, self.of_others, self._slides = 1, 0, 0
        self._needed = self._carried = 0.0  # tangential force of nodes that all stick, and its bound
        self._always, self.normal = rows.role == Role.EQUATION, rows.role == Role.NORMAL
        self._tangents, self._motions = tangential_status(rows, before), RowMotions.of(rows, turning=False)
        self._support = None if loaded is None else Support(loaded, self._motions)
        self.active = self._always
        penetration = rows.penetration(u)
        deepest, rounding = self._largest(penetration), self._TOUCHING * self._max(np.abs(u))
        closed = self.normal & (penetration >= min(deepest, 0.0) - rounding)
        self.active = self._supporting(closed, penetration)
        self.reset_cycles()

    def reset_cycles(self) -> None:
        """Reset the detection of cycles.  Local."""
        self._tried, self._fewest, self._single = [self.active], np.inf, False
        self._one_by_one: list[BoolArray] = []
        self._penetrate_when_open = False

    def exchange_rows(self, rows: ConstraintRows) -> None:
        """Go on with the same set of rows with other normals and gaps.  Local.  Raises SolveError: too many sets."""
        self._rows, self.of_others = rows, self.updates
        self._tangents = tangential_status(rows, self._before)
        self._count(1)
        self.reset_cycles()

    def springs(self, active: BoolArray | None = None) -> Springs:
        """Springs of the rows for closed normals and equations (n,), by default the present ones."""
        active = self.active if active is None else active
        springs, support = self._springs(active), self._support
        return springs if support is None else replace(springs, free=support.left_out(self._resisting(active)))

    def _springs(self, active: BoolArray) -> Springs:
        """`springs`, without free motions.  Local."""
        rigid = self._exact | self._motions.moving
        springs = Springs(np.where(active, np.where(rigid, np.inf, self._rows.stiffness), 0.0))
        for tangents in self._tangents:
            springs = springs + tangents.springs(active)
        return springs

    def free_motions(self, u: FloatArray) -> tuple[dict[str, str], FloatArray]:
        """As `Support.free`.  Collective."""
        return ({}, u) if self._support is None else self._support.free(self._resisting(self.active), u)

    @property
    def slides(self) -> bool:
        """True if tangents have laws.  Local."""
        return bool(self._tangents)

    def slipping(self) -> BoolArray:
        """(n,), closed normals whose tangents slip with a bounded force.  Local."""
        slipping = [tangents.slipping() for tangents in self._tangents]
        return self.active & np.any([np.zeros_like(self.active), *slipping], axis=0)

    def closed_anew(self, u: FloatArray) -> BoolArray:
        """(n,), closed normals that were open before the load step, for a displacement (owned, 3) [m].  Collective."""
        if not self._tangents:
            return np.zeros_like(self.active)
        left = self._rows.gap - self._before.jump(self._rows)
        return self.active & self.normal & (left > self._OPEN * self._max(np.abs(u)))

    def slip(self, u: FloatArray) -> FloatArray:
        """d (n,) [m] of tangents of closed normals in a displacement (owned, 3) [m], 0 in other rows.  Collective."""
        result: FloatArray = np.zeros(len(self._rows))
        jump = self._rows.jump(u) if self._tangents else result
        for tangents in self._tangents:
            result += np.where(tangents.closed(self.active), jump - tangents.history, 0.0)
        return result

    def turned_rows(self) -> ConstraintRows:
        """The rows in the directions of `springs`.  Local."""
        direction = self._rows.normal.copy()
        for tangents in self._tangents:
            tangents.turn(direction)
        return replace(self._rows, normal=direction)

    def turn_back(self, force: FloatArray) -> None:
        """Exchange forces (n,) in `turned_rows` by those in t1 and t2.  Local."""
        for tangents in self._tangents:
            tangents.turn_back(force)

    def slide(self, u: FloatArray, force: FloatArray, noise: float) -> bool:
        """Update the tangents by a solution; True if statuses change, or forces by more than the noise.

        Args:
            u: (owned, 3) [m].
            force: (n,) [N].
            noise: error of the linear solver in the energy norm [J^(1/2)].

        Raises:
            SolveError: they still change after `_MOST_SLIDES` linear solves.
        """
        rows, tangent = self._rows, self._rows.role == Role.TANGENT
        jump: FloatArray = rows.jump(u)
        sums: FloatArray = np.zeros(3)
        for tangents in self._tangents:
            sums += tangents.update(force, jump, self.active, noise)
        lengths = np.linalg.norm(tangential_vectors(rows, np.where(tangent, force, 0.0)), axis=1)
        sums = np.append(sums, rows.symmetry * lengths.sum())
        self._comm.Allreduce(MPI.IN_PLACE, sums)
        self._slides += 1
        if self._slides == 1:
            self._needed, self._carried = float(sums[3]), max(float(rows.symmetry * sums[2]), 0.0)
        changes = bool(sums[0] > 0 or sums[1] > noise**2)
        if changes and self._slides >= self._MOST_SLIDES:
            raise SolveError(
                f"friction does not settle: after {self._slides} linear solves its forces, or what opens, closes, "
                f"sticks or slips, still change; {self._sliding()}: unless something else holds it, a body slides or "
                "tips; with a large coefficient take smaller increments: solutions may not be unique, or not exist"
            )
        return changes

    def check_sliding(self, error: SolveError) -> None:
        """Raises SolveError for that of a linear solve once nodes may slip.  Local."""
        if self._slides:
            raise SolveError(
                f"a linear solve fails once nodes slip or open: unless something else holds it, a body slides or tips; "
                f"{self._sliding()}; {_HOLD}.  The solver: {error}"
            ) from error

    def _sliding(self) -> str:
        """The force that friction carries, and that of nodes that all stick if it is larger.  Local."""
        more = f" of {self._needed:.4g} that would hold all nodes in place" * (self._carried < self._needed)
        return f"friction carries about {self._carried:.4g}{more}"

    def restart(self, active: BoolArray, u: FloatArray, solves: int) -> None:
        """Continue with another set (n,), and a displacement (owned, 3) [m], found by so many linear solves.

        Raises SolveError if they are too many.
        """
        self._count(solves + 1)
        self.active = self._supporting(active, self._rows.penetration(u))
        self.reset_cycles()

    def wanted(self, trial: FloatArray, noise: float) -> BoolArray:
        """The status (n,) that each row should have, by trial forces (n,), k (B u - D) of open rows [N].

        A row keeps its status if its trial force is below the noise, the error of the linear solver in the energy norm
        [J^(1/2)].  If all are, all rows open, unless they penetrated by more when all were open.
        """
        pressure = trial / np.sqrt(self._rows.capped_stiffness)  # [J^(1/2)], as the noise
        hardest = self._largest(pressure)
        self._penetrate_when_open |= hardest > noise and not self.differs(self._always)
        press = hardest > noise or self._penetrate_when_open
        wanted = self.normal & (pressure > (np.where(self.active, -noise, noise) if press else hardest))
        return self._supporting(wanted, trial / self._rows.capped_stiffness)

    def check_supported(self) -> None:
        """Check the supporting rows of unconstrained bodies.  Local.  Raises SolveError: they are in tension."""
        if self._loose and self._carried > 0:
            raise SolveError(f"body {', '.join(map(repr, self._loose))} slides or tips: {self._sliding()}; {_HOLD}")
        if self._loose:
            raise SolveError(
                f"nothing holds body {', '.join(map(repr, self._loose))} once the contact opens: only contact stops "
                "some of its rigid motions; prescribe displacements that stop them, or load it towards the contact, "
                "with the resultant inside the contact surface"
            )

    def differs(self, other: BoolArray) -> int:
        """Number of rows on all ranks whose status differs."""
        return self._comm.allreduce(int((self.active != other).sum()))

    def cycles(self, wanted: BoolArray) -> bool:
        """True for a set (n,) that was tried before."""
        return self._among(wanted, self._tried)

    def update(self, wanted: BoolArray) -> None:
        """Change all wrong rows, or a single one if the set would recur.

        Raises:
            SolveError: only rows in tension support a body, single changes recur, or there were `most` updates.
        """
        if self.cycles(wanted):
            self.check_supported()
        self._count(1)
        wrong = self.differs(wanted)
        if wrong < self._fewest:
            self._fewest, self._single, self._one_by_one = wrong, False, []
        self._single = self._single or self.cycles(wanted)
        if self._single:
            key = self._rows.key
            lowest = int(key[self.active != wanted].min(initial=np.iinfo(np.int64).max))
            lowest = self._comm.allreduce(lowest, op=MPI.MIN)
            wanted = np.where(key == lowest, wanted, self.active)
            if self._among(wanted, self._one_by_one):
                raise SolveError(
                    f"the active set repeats itself after {self.updates} updates: the linear solver's error exceeds "
                    "the forces or gaps that decide; take Solver(preconditioner='cholesky') or a smaller "
                    "Solver.tolerance"
                )
            self._one_by_one.append(wanted)
        self.active = wanted
        self._tried.append(wanted)

    def _count(self, solves: int) -> None:
        self.updates += solves
        if self._most is not None and self.updates > self._most:
            raise SolveError(
                f"the active set still changes after {self._most} linear solves, the limit that Solver.max_contact sets"
            )

    def _among(self, wanted: BoolArray, sets: list[BoolArray]) -> bool:
        same = np.array([np.array_equal(wanted, other) for other in sets], dtype=np.int8)
        self._comm.Allreduce(MPI.IN_PLACE, same, op=MPI.MIN)
        return bool(same.any())

    def _supporting(self, active: BoolArray, penetration: FloatArray) -> BoolArray:
        """An active set with the rows that touch, and that driven bodies reach.  Raises SolveError: they reach none."""
        support, active = self._support, active | self._always
        self._loose = {} if support is None else support.driven(self._resisting(active))
        if support is None or not self._loose:
            return active
        top, bottom = self._largest(penetration), -self._largest(-penetration)
        gap, touching = min(top, 0.0) - penetration, self._ALIKE * max(top - bottom, 0.0)
        more: BoolArray = active
        held = None  # by cells, before a row is reached
        while driven := support.driven(by := self._resisting(more)):
            rate, balanced = support.rates(by)
            closing = self.normal & ~more & (rate > self._ALIKE)
            way, from_rest = (self._shortest(gaps[closing], rate[closing]) for gaps in (gap, support.gaps(by)))
            if balanced < from_rest < np.inf and held is None and not self._tangents:
                held = more
            near = self.normal & ~more & ~self.active & (gap <= touching)
            if not any_true(self._comm, near):
                if not np.isfinite(way):
                    if self._slides:
                        return active
                    raise driven_error(driven)
                gap = gap - way * rate
                near = closing & (gap <= touching)
            more = more | near
        if held is None or not support.carries(self._resisting(more)):
            return more
        self._loose = {}
        return held

    def _shortest(self, gap: FloatArray, rate: FloatArray) -> float:
        """The least way to rows with positive rates."""
        return -self._max(-np.maximum(gap, 0.0) / rate)

    def _resisting(self, active: BoolArray) -> Resisting:
        """The rows that resist motions with an active set (n,).  Local."""
        closed = self._springs(active).closed
        sticks = closed
        for tangents in self._tangents:
            sticks = sticks | tangents.closed(active)
        return Resisting(self._rows, closed, sticks, self.turned_rows().normal)

    def _largest(self, values: FloatArray) -> float:
        """Largest of values (n,) in rows that may open."""
        return self._max(values[self.normal])

    def _max(self, values: FloatArray) -> float:
        return self._comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
