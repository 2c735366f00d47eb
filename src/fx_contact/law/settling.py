"""Equilibrium of rigid obstacles below given forces, by Newton's method for their distances t.

An obstacle moves along the unit vector d of its force F.  Its rows penetrate at the rates w = -n . d.  With the forces
f of the rows at t, equilibrium and its derivatives are

    w_i . f(t) = F_i,    d(w_i . f)/dt_j = -w_i . m_j,    K z_j + B^T m_j = 0,    B z_j = w_j on the closed rows.

For fixed n the forces w_i . f are the gradient of a convex function of t, the energy of the bodies.  So a step ends
before the minimum along it, or is halved until the excess of the forces is not larger than before.  Motions that do
not turn normals are part of the linear system (`contact.row_motions`).
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.contact_problem import ContactProblem
from fx_contact.contact.contact_system import ContactSystem
from fx_contact.contact.jump import Jump
from fx_contact.contact.row_motions import RowMotions
from fx_contact.law.active_set import solve_law
from fx_contact.law.unilateral import Unilateral
from fx_contact.linalg.solver_options import Solver
from fx_contact.linalg.stopping import ROUNDING
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import any_true
from fx_contact.parallel.validation import percent
from fx_contact.surfaces.surface_projection import LEAST_COSINE

#: Rows for distances (k,) of the obstacles along their forces [m]; collective.
RowsAt: TypeAlias = Callable[[FloatArray], ConstraintRows]

#: Most solves of the contact problem.
_MOST = 60
#: Distance up to which an obstacle touches, relative to its expected indentation, and most steps to it.
_TOUCHING, _STEPS = 0.01, 30
#: Bisections for the expected indentation, a first guess.
_BISECTIONS = 20


def settle(
    problem: ContactProblem, jump: Jump, system: ContactSystem, law: Unilateral, u: FloatArray, options: Solver
) -> tuple[FloatArray, Jump, FloatArray, FloatArray, float]:
    """Move obstacles to where contact forces balance the forces on them, up to the linear solver's error.

    Collective.

    Args:
        jump: of the system, with rows where the obstacles begin.
        u: (owned, 3), first guess [m].

    Returns:
        t (k,) [m], the jump there, displacement (owned, 3) [m], trial forces (n,) [N], and energy error [J^(1/2)].

    Raises:
        SolveError: an obstacle does not settle, or as `solve_law`.
    """
    assert problem.rows_at is not None
    motions = RowMotions.of(jump.rows, turning=True)
    t = problem.distances
    step, before, z = np.zeros_like(t), np.inf, np.zeros((len(t), *u.shape))
    size = np.abs(jump.rows.kinds[0].scene.mesh.points).max() + np.abs(t).max()  # of positions
    for _ in range(_MOST):
        u, trial = solve_law(system, law, u, options)
        error, closed = system.solver.energy_error, law.active & jump.movable
        excess = motions.sum(motions.rates @ np.where(closed, trial, 0.0)) - motions.loads
        if excess @ step > before:
            step, before = step / 2, before / 2
            t, u = t - step, u + np.tensordot(step, z, axes=1)
        else:
            z, m = sensitivities(system, motions, closed, options.loose_tolerance, z)
            slope = -motions.sum(motions.rates @ m.T)
            stiffness = np.maximum(slope.diagonal(), 0.0)
            # A solve changes the force by up to its energy error times the norm of z; two are compared.
            allowed = 2 * error * np.sqrt(stiffness) + ROUNDING * size * stiffness
            allowed += options.tolerance * motions.loads  # a free body in balance has no stiffness
            if (np.abs(excess) <= allowed).all():
                return t, jump, u, trial, error
            step = _step(motions, u, excess, slope)
            before = -float(excess @ step)
            t, u = t + step, u - np.tensordot(step, z, axes=1)
        rows = problem.rows_at(t)
        motions = RowMotions.of(rows, turning=True)
        system.exchange_rows(rows)
        law.exchange_rows(rows)
        jump = system.jump
    law.check_supported()
    off = np.abs(excess) / motions.loads
    worst = motions.interface[int(off.argmax())]
    label = next(kind.contact.label for kind in motions.kinds if kind.index == worst)
    told = f"its force differs from the given one by {percent(off.max())}" if off.max() < 1 else "nothing resists it"
    if not any_true(system.comm, law.active & law.normal):
        told += ", and no contact is closed"
    raise SolveError(
        f"{label} does not settle: after {_MOST} solves {told}; does the body resist it there, does the force pull it "
        "out of contact, and is it in the units of moduli and lengths?"
    )


def sensitivities(
    system: ContactSystem, motions: RowMotions, closed: BoolArray, tolerance: float, guess: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """z (k, owned, 3) [-], and m (k, n) [N/m] of the closed rows; 0 of obstacles without any.

    Collective.  Raises SolveError as `ContactSystem.dual`.

    Args:
        closed: (n,), movable closed rows of the system.
        tolerance: of z, relative to its energy norm.
        guess: (k, owned, 3), first guess of z.
    """
    z, m, rates = np.zeros_like(guess), np.zeros_like(motions.rates), np.where(closed, motions.rates, 0.0)
    for index, rate in enumerate(rates):
        if any_true(system.comm, rate != 0):
            z[index], m[index] = system.dual(np.zeros_like(guess[index]), rate, tolerance, guess[index])
    return z, np.where(closed, m, 0.0)


def touching(rows_at: RowsAt, count: int, u: FloatArray) -> FloatArray:
    """Distances (k,) [m] at which the forces are expected to press the obstacles in a displacement (owned, 3) [m].

    Collective.  Raises SolveError unless the obstacles meet the surface.
    """
    t: FloatArray = np.zeros(count)
    for _ in range(_STEPS):
        gap, indentation = _expected(RowMotions.of(rows_at(t), turning=True), u)
        t = t + gap
        if (np.abs(gap) <= _TOUCHING * indentation).all():
            return t + indentation
    raise SolveError("a rigid obstacle misses the surface: move it to where its force presses it onto the surface")


def _step(motions: RowMotions, u: FloatArray, excess: FloatArray, slope: FloatArray) -> FloatArray:
    """Newton's step (k,) [m]; obstacles without closed rows go on to the surface."""
    resisted = slope.diagonal() > 0
    step, both = np.zeros_like(excess), np.ix_(resisted, resisted)
    if not resisted.all():
        step = np.where(resisted, 0.0, np.sum(_expected(motions, u), axis=0))
    step[resisted] = np.linalg.solve(slope[both], -excess[resisted])
    return step


def _expected(motions: RowMotions, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance of each obstacle from the deformed surface, and its indentation d beyond, to first order: two (k,) [m].

    Rows that the obstacle passes along do not count.  The indentation is that of a flat punch as large as the area A
    that it penetrates, F = E* d A(d)^(1/2): two thirds of Hertz's.
    """
    rows = motions.rows
    gap = -rows.penetration(u)
    ours = [np.flatnonzero(rate > LEAST_COSINE) for rate in motions.rates]
    ahead = [gap[some] / motions.rates[one, some] for one, some in enumerate(ours)]
    least = np.array([one.min(initial=np.inf) for one in ahead])
    rows.prolongation.comm.Allreduce(MPI.IN_PLACE, least, op=MPI.MIN)
    if not np.isfinite(least).all():
        raise SolveError(
            "along the force on it a rigid obstacle does not meet the surface: the force pulls it away, moves it past "
            "the surface, or has pressed it through the body; reverse the force, or check the place of the obstacle "
            "and the unit of the force"
        )
    soft = rows.area * (1 / rows.modulus).sum(axis=1)

    def punches(depth: FloatArray) -> FloatArray:
        """The indentation of flat punches as large as the areas that obstacles penetrate at a depth (k,)."""
        inside = [some[one <= to] for some, one, to in zip(ours, ahead, least + depth)]
        area, compliance = motions.sum(np.array([[rows.area[one].sum(), soft[one].sum()] for one in inside])).T
        return np.asarray(np.sqrt(rows.symmetry) * motions.loads * compliance / area**1.5)

    low: FloatArray = np.zeros(len(least))
    high = punches(low)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        beyond = punches(middle) < middle
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return least, high
