"""Solution of the laws: active sets with stick and slip, the interior-point method after many updates without."""

from fx_contact.contact.contact_system import ContactSystem
from fx_contact.law.interior_point import find_closed_rows
from fx_contact.law.unilateral import Unilateral
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError

#: Updates of the active set before the interior-point method takes over: as many as its linear solves, so that both
#: together take at most twice those of the better one.
_UPDATES = 20
#: Factor by which tolerances fall with friction, first below the loose one (`studies.cost.friction`).
_FALL = 0.02


def solve_law(
    system: ContactSystem, law: Unilateral, u: FloatArray, options: Solver
) -> tuple[FloatArray, FloatArray]:
    """Displacement (owned, 3) [m] and trial forces (n,) [N] of the final set, from a first guess.

    Loose tolerance first, then the tight one; with tangents tolerances that fall by `_FALL`.

    Collective on system.comm.  Raises SolveError as `solve_system`.
    """
    tolerance, fall = options.loose_tolerance, 0.0
    if law.slides:
        tolerance, fall = max(options.tolerance, _FALL * tolerance), _FALL
    while True:
        if law.slides:
            system.exchange_rows(law.turned_rows())
        try:
            u = system.solve(law.springs(), u, tolerance)
        except SolveError as error:
            law.check_sliding(error)
            raise
        trial = system.trial(u)
        law.turn_back(trial)
        loose = tolerance > options.tolerance
        noise = max(system.solver.energy_error * options.tolerance / tolerance, system.solver.rounding(u))
        wanted = law.wanted(trial, noise)
        if law.slides and law.slide(u, trial, system.solver.energy_error):
            law.restart(wanted, u, 0)
        elif law.differs(wanted) and not (loose and law.cycles(wanted)):
            if law.updates == law.of_others + _UPDATES and not law.slides:
                u, wanted, solves = find_closed_rows(system, law, u)
                law.restart(wanted, u, solves)
            else:
                law.update(wanted)
        elif loose:
            tolerance = max(options.tolerance, fall * tolerance)
            law.reset_cycles()
        else:
            return u, trial
