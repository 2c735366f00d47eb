"""A primal-dual interior-point method, for active sets that take many updates.

Rows have forces f > 0, gaps s = D - B u + f/k > 0, and compliances 1/k of a penalty, 0 in exact contact.  Iterates
follow s_i f_i = mu to mu = 0.  Each linear solve has springs in all rows:

    K u' + B^T f' = L,    f' = (B u' - D + s + mu/f) / (s/f + 1/k),    s' = s + mu/f - f' s/f.

The step towards u', f', s' keeps s and f positive.  At the end rows are closed where f/s is above its mean.  If all
rows have the same status, they are closed where f/s is above the capped stiffness.

Other rows than normals keep their springs.

In bodies that bend, updates of the active set open a line of nodes each.  The number of these iterations hardly depends
on the mesh (`studies.cost.leaf_springs`).

Source: S. J. Wright, Primal-Dual Interior-Point Methods, SIAM, 1997, chapter 1.
"""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fx_contact.contact.contact_system import ContactSystem
from fx_contact.law.unilateral import Unilateral
from fx_contact.parallel.arrays import BoolArray, FloatArray

#: Reduction of mu in an iteration, and part of the way to the boundary that a step goes (Wright, chapter 1).
_CENTRING, _TO_BOUNDARY = 0.1, 0.95
#: Last s . f relative to the energy, and tolerances of a linear solve: the loosest, and that relative to the root of
#: s . f over the energy.
_GAP, _LOOSE, _OF_GAP = 1e-12, 1e-2, 0.1
#: First gaps and penetrations over those of springs k.  In leaf springs of 10 to 25 cells 1 takes more than 40 linear
#: solves where all rows open, 100 up to 35 elsewhere, 10 at most 34 in both (with 80 and 160 cells of 1:200: 39 to 48).
_FIRST = 10.0
#: All rows have one status if the mean of f times that of s is less, over the energy and the rows: 2e-12 to 2e-11 where
#: all open, 2e-8 or more in leaf springs of 1:20 to 1:500.
_ALIKE = 1e-9
#: Most linear solves.
_ITERATIONS = 60


def find_closed_rows(system: ContactSystem, law: Unilateral, u: FloatArray) -> tuple[FloatArray, BoolArray, int]:
    """Displacement (owned, 3) [m], closed normals (n,), and the number of linear solves.

    Collective.  Raises SolveError as `ContactSystem.solve`.

    Args:
        u: (owned, 3), displacement to start from [m].
    """
    normal, springs = law.normal, law.springs(law.active | law.normal)
    k, comm, some = np.where(normal, system.capped_stiffness, 1.0), system.comm, system.movable & normal
    compliance = np.where(normal, 1 / springs.stiffness, 0.0)
    others = np.where(normal, 0.0, springs.stiffness)
    shifts = np.zeros(len(k)) if springs.shift is None else np.where(normal, 0.0, springs.shift)

    def solved(stiffness: FloatArray, shift: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray]:
        """Displacement and forces of springs (n,) with shifts (n,) in the normals."""
        every = replace(springs, stiffness=np.where(normal, stiffness, others), shift=np.where(normal, shift, shifts))
        towards = system.solve(every, u, tolerance, anew=True)
        return towards, system.forces(towards)

    def total(values: FloatArray) -> float:
        """Sum over the movable rows of all ranks."""
        return comm.allreduce(float(values[some].sum()))

    u, f = solved(k, np.zeros_like(k), _LOOSE)
    energy, number = system.energy_norm(u) ** 2, total(np.ones_like(k))
    size = _FIRST * np.sqrt(energy / total(k))
    s, f = np.maximum(-f / k, size), np.maximum(f, k * size)
    solves = 1
    while solves < _ITERATIONS and (gap := total(s * f)) > _GAP * energy:
        ratio, shift = s / f, s + _CENTRING * gap / number / f
        tolerance = min(_LOOSE, _OF_GAP * np.sqrt(gap / energy))
        towards, force = solved(1 / (ratio + compliance), -shift, tolerance)
        steps = np.where(some, shift - ratio * force - s, 0.0), np.where(some, force - f, 0.0)
        reach = min(_reach(s, steps[0]), _reach(f, steps[1]))
        length = min(1.0, _TO_BOUNDARY * comm.allreduce(reach, op=MPI.MIN))
        u, s, f = u + length * (towards - u), s + length * steps[0], f + length * steps[1]
        energy, solves = system.energy_norm(u) ** 2, solves + 1
    alike = total(s) * total(f) < _ALIKE * number * energy
    border = k if alike else np.full_like(k, total(f) / total(s))
    return u, some & (f > border * s), solves


def _reach(values: FloatArray, step: FloatArray) -> float:
    """Largest multiple of a step with which no value is negative."""
    return float((values[step < 0] / -step[step < 0]).min(initial=np.inf))
