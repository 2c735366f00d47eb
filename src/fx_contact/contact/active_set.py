"""Which pairs are closed: the active set, its first guess and its updates.

All pairs with the wrong status change at once (the primal-dual active set: M. Hintermueller, K. Ito, K. Kunisch,
SIAM J. Optim. 13(3), 2002).  That may cycle.  Where a set comes back, single pairs change, the lowest number first,
until fewer pairs are wrong than ever before: the contact problem is a complementarity problem with a positive definite
matrix, for which this rule ends (K. G. Murty, Math. Program. 7, 1974), and so does the whole (L. F. Portugal,
J. J. Judice, L. N. Vicente, Math. Comput. 63, 1994).
"""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.node_pairs import loose_bodies
from fx_contact.parallel.errors import SolveError


class ActiveSet:
    """The closed pairs, from a first guess of the displacement on.

    Collective on the prolongation's comm.

    Args:
        pairs: NodePairs.
        scene: Scene, to see which bodies an active set leaves loose; None: not looked at.
        u: (owned, 3) float64, first guess of the displacement [m].
        most: most updates.

    Attributes:
        active: (n,) bool, closed pairs.
        updates: number of active sets tried.
    """

    #: Widths of the band of closest pairs that close to hold a loose body, relative to the range of the gaps.
    _BANDS = 4.0 ** -np.arange(12, -1, -1)
    #: Overlaps and gaps up to this part of the largest displacement are rounding.
    _TOUCHING = 1e-12

    def __init__(self, pairs, scene, u, most):
        self._pairs, self._scene, self._most = pairs, scene, most
        self._comm = pairs.prolongation.comm
        self.updates, self._loose = 1, []
        penetration = pairs.penetration(u)
        deepest, rounding = self._max(penetration), self._TOUCHING * self._max(np.abs(u))
        overlaps = penetration > 0 if deepest > rounding else penetration >= deepest - rounding
        self.active = self._held(overlaps, penetration)
        self.forget()

    def forget(self):
        """Sets that came before may come again."""
        self._seen, self._fewest, self._single = {self._fingerprint(self.active)}, np.inf, False
        self._overlap_without = False  # of any force

    def wanted(self, trial, noise):
        """The status that each pair should have.

        Collective.  Within the linear solver's error a pair keeps its status; if no pair is pressed harder than that,
        the bodies at most touch without force, and all are open, unless they have overlapped by more then.  Where that
        leaves a body loose the pairs closest to touching stay or become closed; `check_held` says whether that was the
        end of it.

        Args:
            trial: (n,) float64, force of closed pairs, and of open ones the force that a penalty would exert [N].
            noise: error of the displacement in the energy norm [J^(1/2)].

        Returns:
            (n,) bool.
        """
        pressure = trial / np.sqrt(self._pairs.bounded_stiffness)
        hardest = self._max(pressure)
        self._overlap_without |= hardest > noise and not self.differs(np.zeros_like(self.active))
        press = hardest > noise or self._overlap_without
        wanted = pressure > (np.where(self.active, -noise, noise) if press else hardest)
        return self._held(wanted, trial / self._pairs.bounded_stiffness)

    def check_held(self):
        """See that the pairs that hold the bodies press.  Local.

        Raises:
            SolveError: the last status wanted needed pairs that pull, to hold a body.
        """
        if self._loose:
            raise SolveError(
                f"nothing holds body {', '.join(map(repr, self._loose))} once the contact opens: only contact stops "
                "some of its rigid motions; prescribe displacements that stop them, or load it towards the contact"
            )

    def differs(self, other):
        """Number of pairs on all ranks whose status differs.  Collective."""
        return self._comm.allreduce(int((self.active != other).sum()))

    def cycles(self, wanted):
        """Whether all changes at once would lead back to a set that was tried.  Collective."""
        return self._fingerprint(wanted) in self._seen

    def update(self, wanted):
        """Change all pairs that want it, or one if all at once would lead in a circle.

        Collective.

        Args:
            wanted: (n,) bool, not the present set.

        Raises:
            SolveError: there were too many updates, or nothing holds a body but pairs that pull.
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
            number = self._numbers()
            lowest = int(number[self.active != wanted].min(initial=np.iinfo(np.int64).max))
            lowest = self._comm.allreduce(lowest, op=MPI.MIN)
            wanted = np.where(number == lowest, wanted, self.active)
        self.active = wanted
        self._seen.add(self._fingerprint(wanted))

    def _held(self, active, penetration):
        """An active set, and the pairs closest to touching that it needs to hold all bodies."""
        self._loose = self._loose_bodies(active)
        if self._loose:
            top, bottom = self._max(penetration), -self._max(-penetration)
            for band in self._BANDS:
                more = active | (penetration >= top - band * (top - bottom))
                if not self._loose_bodies(more):
                    return more
        return active

    def _loose_bodies(self, active):
        return [] if self._scene is None else loose_bodies(self._scene, self._pairs, active)

    def _max(self, values):
        return self._comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)

    def _ends(self, which):
        """Global numbers of the two vertices of some pairs: two (n,) int64."""
        imap = self._pairs.prolongation.index_map
        columns = self._pairs.first[which], self._pairs.second[which]
        return [imap.local_to_global(column.astype(np.int32)) for column in columns]

    def _numbers(self):
        """A number for each pair: (n,) int64."""
        first, second = self._ends(slice(None))
        return first * self._pairs.prolongation.index_map.size_global + second

    def _fingerprint(self, active):
        """A number that tells active sets apart, the same on all ranks."""
        first, second = (column.astype(np.uint64) for column in self._ends(active))
        with np.errstate(over="ignore"):
            mixed = (first << np.uint64(32)) + second + np.uint64(1)
            mixed = mixed * np.uint64(0x9E3779B97F4A7C15)
            mixed = (mixed ^ mixed >> np.uint64(29)) * np.uint64(0xBF58476D1CE4E5B9)
            mine = int((mixed ^ mixed >> np.uint64(32)).sum() & np.uint64((1 << 48) - 1))
        return self._comm.allreduce(mine)
