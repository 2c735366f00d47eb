"""Unknown motions along given forces, of obstacles, bolts and rigid faces, by Newton's method for distances t.

An obstacle moves along the unit vector d of its force F.  Its rows penetrate at the rates w = -n . d.  The sides of a
preloaded section with the tension F are pulled together by t, a rigid face has up to six t; their w are constant.  With
the forces f of the rows at t, equilibrium and its derivatives are

    w_i . f(t) = F_i,    d(w_i . f)/dt_j = -w_i . m_j,    K z_j + B^T m_j = 0,    B z_j = w_j on the closed rows.

For fixed n the forces w_i . f are the gradient of a convex function of t, the energy of the bodies.  So a step ends
before the minimum along it, or is halved until the excess of the forces is not larger than before.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_problem import ContactProblem
from fx_contact.contact.contact_system import ContactSystem
from fx_contact.contact.jump import Jump
from fx_contact.law.active_set import solve_law
from fx_contact.law.unilateral import Unilateral
from fx_contact.linalg.solver_options import Solver
from fx_contact.linalg.stopping import ROUNDING
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.validation import percent
from fx_contact.scene.scene import Scene
from fx_contact.surfaces.surface_projection import LEAST_COSINE

#: Rows for distances of the obstacles, as of `Scene.approached`.
RowsAt: TypeAlias = Callable[[Sequence[Any]], ConstraintRows]

#: Excess of the contact force over the force on the obstacle, relative to it, up to which solves become tight.
_NEAR = 0.1
#: Most solves of the contact problem.
_MOST = 60
#: In thin bodies the contact force is less accurate than the linear solver's bound: 3e-6 in plates of 1:50 and 1:200,
#: 2e-4 with factors of thin rubber (`Solver.tolerance`).  An excess up to this part of the force is accepted if so many
#: solves in turn have not halved it.
_ROUNDED, _STALLED = 2e-4, 3
#: Distance up to which an obstacle touches, relative to its expected indentation, and most steps to it.
_TOUCHING, _STEPS = 0.01, 30
#: Stiffness of a section or face, relative to that of a flat punch as large, up to which nothing resists, times the
#: largest ratio of moduli: rounding.  A bolt that closes freely below a cap 1e6 times as stiff has 4e-9; a beam of
#: 1:300 in bending 1e-8, a quarter of its slenderness cubed (`test_rigid_loads.py`, `test_preload.py`).
_RESISTS = 1e-12
#: Bisections for the expected indentation, a first guess.
_BISECTIONS = 20


class Settled(NamedTuple):
    """Equilibrium: the jump there, displacement (owned, 3) [m], trial forces (n,) [N], energy error [J^(1/2)]."""

    jump: Jump
    displacement: FloatArray
    trial: FloatArray
    energy_error: float


def settle(
    problem: ContactProblem, jump: Jump, system: ContactSystem, status: Unilateral, u: FloatArray, options: Solver
) -> Settled:
    """Move obstacles to where contact forces balance the forces on them, and close sections up to their tensions.

    The balance is up to the linear solver's error.

    Collective.

    Args:
        jump: of the system, with rows where the obstacles begin.
        u: (owned, 3), first guess [m].

    Raises:
        SolveError: an obstacle does not settle, or as `solve_law`.
    """
    assert problem.rows_at is not None and problem.scene is not None
    rows, loose = jump.rows, replace(options, tolerance=options.loose_tolerance)
    t, force, solver = _distances(problem.scene, rows), _forces(rows), loose
    step, before, z = np.zeros_like(t), np.inf, np.zeros((len(t), *u.shape))
    size = np.abs(problem.scene.mesh.points).max() + np.abs(t).max()  # of positions
    least, stalled, scale = np.inf, 0, _scales(rows)
    moduli = [material.plane_strain_modulus for material in problem.scene.materials.values()]
    resists = _RESISTS * max(moduli) / min(moduli)
    for _ in range(_MOST):
        u, trial = solve_law(system, status, u, solver)
        error, closed = system.solver.energy_error, status.active & jump.movable
        excess = _sum(rows, rows.rates @ np.where(closed, trial, 0.0)) - force
        scale = np.where(scale > 0, scale, np.abs(excess).max())  # of faces below no force, at first
        off = float((np.abs(excess) / np.maximum(scale, np.finfo(float).tiny)).max())
        if solver is options:
            least, stalled = (off, 0) if off < least / 2 else (least, stalled + 1)
        if stalled >= _STALLED and off <= _ROUNDED:
            return Settled(jump, u, trial, error)
        if excess @ step > before:
            step, before = step / 2, before / 2
            t, u = t - step, u + np.tensordot(step, z, axes=1)
        else:
            z, m = sensitivities(system, rows, closed, options.loose_tolerance, z)
            slope = -_sum(rows, rows.rates @ m.T)
            stiffness = np.maximum(slope.diagonal(), 0.0)
            # A solve changes the force by up to its energy error times the norm of z; two are compared.
            allowed = 2 * error * np.sqrt(stiffness) + ROUNDING * size * stiffness
            if solver is options and (np.abs(excess) <= allowed).all():
                return Settled(jump, u, trial, error)
            step = _step(rows, u, t, excess, slope, resists)
            before = -float(excess @ step)
            if solver is loose and ((np.abs(excess) <= _NEAR * scale + allowed) | (stiffness == 0)).all():
                solver, before = options, np.inf  # the excess of a loose solve is not to be compared with
            t, u = t + step, u - np.tensordot(step, z, axes=1)
        rows = problem.rows_at(_listed(problem.scene, rows, t))
        jump = Jump(rows, problem.supports)
        system.exchange_rows(jump)
        status.exchange_rows(rows)
    status.check_supported()
    worst = int((np.abs(excess) / np.maximum(scale, np.finfo(float).tiny)).argmax())
    label = next(kind.contact.label for kind in rows.kinds if kind.index == rows.pressed[worst])
    told = f"its force differs from the given one by {percent(off)}" if off < 1 else "nothing resists it"
    if not _sum(rows, np.array([(status.active & status.normal).sum()], dtype=np.float64)).any():
        told += ", and no contact is closed"
    raise SolveError(
        f"{label} does not settle: after {_MOST} solves {told}; does the body resist it there, does the force pull it "
        "out of contact, and is it in the units of moduli and lengths?"
    )


def sensitivities(
    system: ContactSystem, rows: ConstraintRows, closed: BoolArray, tolerance: float, guess: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """z (k, owned, 3) [-], and m (k, n) [N/m] of the closed rows; 0 of obstacles without any.

    Collective.  Raises SolveError as `ContactSystem.dual`.

    Args:
        closed: (n,), movable closed rows of the system.
        tolerance: of z, relative to its energy norm.
        guess: (k, owned, 3), first guess of z.
    """
    z, m, rates = np.zeros_like(guess), np.zeros_like(rows.rates), np.where(closed, rows.rates, 0.0)
    for index, rate in enumerate(rates):
        if rows.prolongation.comm.allreduce(bool(rate.any()), op=MPI.LOR):
            z[index], m[index] = system.dual(np.zeros_like(guess[index]), rate, tolerance, guess[index])
    return z, np.where(closed, m, 0.0)


def touching(scene: Scene, rows_at: RowsAt, u: FloatArray) -> ConstraintRows:
    """Rows with the obstacles in a displacement (owned, 3) [m] as far as their forces are expected to press them.

    Collective.  Sections are as in the scene.  Raises SolveError unless the obstacles meet the surface.
    """
    rows = rows_at([None] * len(scene.interfaces))
    t, obstacles = np.zeros(len(rows.pressed)), _obstacles(rows)
    if not obstacles.any():
        return rows
    for _ in range(_STEPS):
        gap, indentation = _expected(rows, u)
        t[obstacles] += gap
        if (np.abs(gap) <= _TOUCHING * indentation).all():
            t[obstacles] += indentation
            return rows_at(_listed(scene, rows, t))
        rows = rows_at(_listed(scene, rows, t))
    raise SolveError("a rigid obstacle misses the surface: move it to where its force presses it onto the surface")


def _step(
    rows: ConstraintRows, u: FloatArray, t: FloatArray, excess: FloatArray, slope: FloatArray, resists: float
) -> FloatArray:
    """Newton's step (k,) [m]; obstacles without closed rows go on to the surface, unresisted sections close doubly.

    Args:
        t: (k,), distances so far [m].
        resists: relative stiffness of motions that something resists [-].
    """
    stiffness, obstacles = slope.diagonal(), _obstacles(rows)
    if obstacles.all() and (stiffness > 0).all():
        return np.asarray(np.linalg.solve(slope, -excess))
    punch, loads = _punches(rows), _forces(rows)
    onwards = loads / punch + np.sign(loads) * np.abs(t)
    scale = np.where(obstacles & (stiffness > 0), stiffness, punch)
    values, vectors = np.linalg.eigh((slope + slope.T) / (2 * np.sqrt(scale[:, None] * scale)))
    resisted = values > resists
    if obstacles.any() and not resisted.all():
        gap, indentation = _expected(rows, u)
        onwards[obstacles] = gap + indentation
    along = vectors.T @ (np.sqrt(scale) * onwards)
    along[resisted] = (vectors.T @ (-excess / np.sqrt(scale)))[resisted] / values[resisted]
    return np.asarray(vectors @ along / np.sqrt(scale))


def _expected(rows: ConstraintRows, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance of each obstacle from the deformed surface, and its indentation d beyond, to first order: two (m,) [m].

    Rows that the obstacle passes along do not count.  The indentation is that of a flat punch as large as the area A
    that it penetrates, F = E* d A(d)^(1/2): two thirds of Hertz's.
    """
    gap, comm, obstacles = -rows.penetration(u), rows.prolongation.comm, _obstacles(rows)
    rates, forces = rows.rates[obstacles], _forces(rows)[obstacles]
    ours = [np.flatnonzero(rate > LEAST_COSINE) for rate in rates]
    ahead = [gap[some] / rates[one, some] for one, some in enumerate(ours)]
    least = np.array([one.min(initial=np.inf) for one in ahead])
    comm.Allreduce(MPI.IN_PLACE, least, op=MPI.MIN)
    if not np.isfinite(least).all():
        raise SolveError(
            "along the force on it a rigid obstacle does not meet the surface: the force pulls it away, moves it past "
            "the surface, or has pressed it through the body; reverse the force, or check the place of the obstacle "
            "and the unit of the force"
        )
    soft = rows.area * (1 / rows.modulus).sum(axis=1)

    def punches(depth: FloatArray) -> FloatArray:
        """The indentation of flat punches as large as the areas that obstacles penetrate at a depth (m,)."""
        inside = [some[one <= to] for some, one, to in zip(ours, ahead, least + depth)]
        area, compliance = _sum(rows, np.array([[rows.area[one].sum(), soft[one].sum()] for one in inside])).T
        return np.sqrt(rows.symmetry) * forces * compliance / area**1.5

    low: FloatArray = np.zeros(len(least))
    high = punches(low)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        beyond = punches(middle) < middle
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return least, high


def _obstacles(rows: ConstraintRows) -> BoolArray:
    """(k,), True for the unknown motions of obstacles."""
    return np.array([not rows.kinds[index].contact.EQUALITY for index in rows.pressed], dtype=bool)


def _punches(rows: ConstraintRows) -> FloatArray:
    """(k,), stiffness E* A^(1/2) of a flat punch as large as the whole surface of each unknown motion [N/m]."""
    share = rows.area / np.where(rows.role == Role.EQUATION, 3, 1)  # rows along three axes
    soft = share * (1 / rows.modulus).sum(axis=1)
    ours = [rows.contact == index for index in rows.pressed]
    area, compliance = _sum(rows, np.array([[share[one].sum(), soft[one].sum()] for one in ours])).T
    return np.asarray(area**1.5 / compliance / np.sqrt(rows.symmetry))


def _forces(rows: ConstraintRows) -> FloatArray:
    """(k,), the given forces, of the modelled part [N]."""
    return np.concatenate([np.zeros(0), *(kind.contact.loads for kind in rows.kinds)]) / rows.symmetry


def _scales(rows: ConstraintRows) -> FloatArray:
    """(k,), length of all given forces along the unknown motions of one contact, of the modelled part [N]."""
    each = (kind.contact.loads for kind in rows.kinds)
    lengths = [np.full(len(loads), np.linalg.norm(loads)) for loads in each]
    return np.concatenate([np.zeros(0), *lengths]) / rows.symmetry


def _distances(scene: Scene, rows: ConstraintRows) -> FloatArray:
    """(k,), distances of the unknown motions from the scene [m]."""
    moved = (kind for kind in rows.kinds if len(kind.contact.loads))
    found = [kind.contact.approach_from(scene.oriented[kind.index]) for kind in moved]
    return np.concatenate([np.zeros(0), *found])


def approaches(scene: Scene, rows: ConstraintRows | None) -> list[Any] | None:
    """`StepRecord.approaches` of the rows of a scene; None: there are no unknown motions.  Local."""
    return None if rows is None or not rows.pressed else _listed(scene, rows, _distances(scene, rows))


def _listed(scene: Scene, rows: ConstraintRows, t: FloatArray) -> list[Any]:
    """Distances (k,) as a list with an entry for each interface of the scene."""
    pressed = np.array(rows.pressed)
    result: list[Any] = [None] * len(scene.interfaces)
    for kind in rows.kinds:
        if len(kind.contact.loads):
            result[kind.index] = kind.contact.along(t[pressed == kind.index])
    return result


def _sum(rows: ConstraintRows, values: FloatArray) -> FloatArray:
    """Sums over all ranks."""
    total = np.ascontiguousarray(values, dtype=np.float64)
    rows.prolongation.comm.Allreduce(MPI.IN_PLACE, total)
    return total
