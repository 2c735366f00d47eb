"""Contact of the whole bodies: forces of the pairs, their directions and centre, radius, pressure and penetration."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.law.contact_solver import ContactSolution
from fx_contact.parallel.arrays import FloatArray
from fx_contact.scene.scene import Scene
from fx_contact.verdict.model_warning import RESOLVED

#: Contact is round if b >= (1 - ROUND) a and A >= (1 - ROUND)^2 pi r^2.  a and b are the semi-axes of the ellipse
#: with the second moments of the forces, r^2 = (a^2 + b^2) / 2, and A is the closed area: r is within 6 % of a and b.
#: A sphere whose pole is beside the nodes has b / a = 0.81, 0.88, 0.94 with 4, 26, 11 closed pairs, 0.998 with 142.
ROUND = 0.1
#: The gap D is quadratic if the square of its correlation with r^2, weighted by the forces, is larger.  Closed pairs of
#: spheres have 0.9997 and more; D ~ r^1.5: 0.990, r^3: 0.978, r^4: 0.935, r (a cone): 0.945.  The radii of the last two
#: would be off by 9 %.  Three closed pairs of a quarter have two distances: any D fits.
QUADRATIC = 0.98
#: Largest pressure of Hertz's contact, relative to that of the same radius and force, may be off by this part [-].  Of
#: spheres with 9 closed pairs and more it is off by 0.024 at most, and their radius by 2 %; on a thin layer, where the
#: radius is 9 % too small, by 0.08 to 0.11, and with 3 or 4 closed pairs by 0.26 to 1.7 (studies/goals/pressures.py).
PEAK = 0.05
#: The same where the mesh resolves round contact (`RESOLVED` in a quarter): larger by 0.002 at most below spheres.  On
#: a layer the pressure is (1 - r^2 / a^2)^s, s = 1/2 to 1; where it is larger by 0.01 the radius is 0.8 % too small.
RESOLVED_PEAK = 0.01
#: Contact has an axis if |sum f| / sum |f| of its forces f is larger: the value of uniform pressure on a hemisphere;
#: on a cap up to the angle t it is (1 + cos t) / 2.
AXIS = 0.5
#: Largest square of the radius, over the closed area, that is rounding: all force is at one pair.
_POINT = 1e-9
#: Largest variation of the gap over the mean distance that is rounding: the surfaces are parallel.
_PARALLEL = 1e-9


@dataclass(frozen=True, kw_only=True)
class ContactFigures:
    """Contact of the whole bodies, whatever symmetry is used.

    Attributes:
        active_pairs: closed node pairs.
        force: sum of `pair_forces` [N].
        pair_forces: normal contact force of each contact pair [N].
        pair_alignments: |sum f| / sum |f| of the forces f of each pair [-], 1 if they are parallel; None: the pair is
            open.
        pair_areas: area of the closed rows of each pair, exact to about a facet along its edge [m^2].
        contact_centre: (3,) `Scene.contact_centre`, or the centroid of the contact forces; without forces the middle
            of the bodies [m].
        contact_radius: radius of Hertz's contact with the same second moments of the forces about `contact_centre` [m];
            None if these differ across the contact, are 0 (one closed pair), are too large for the closed area (a flat
            punch), the gap is not quadratic there (a cone), the largest pressure is not Hertz's (a thin layer, a few
            closed pairs), or several pairs have force; 0 without contact.
        max_pressure: largest nodal pressure [Pa].
        max_penetration: largest penetration of a node pair [m].
        sticking_pairs, slipping_pairs: closed node pairs with friction that stick, and that slip; None: no friction.
        dissipated_energy: by friction, in the load step [J]; None: no friction.
    """

    active_pairs: int
    force: float
    pair_forces: list[float]
    pair_alignments: list[float | None] | None = None
    pair_areas: list[float] | None = None
    contact_centre: list[float] | None = None
    contact_radius: float | None
    max_pressure: float
    max_penetration: float
    sticking_pairs: int | None = None
    slipping_pairs: int | None = None
    dissipated_energy: float | None = None


def figures_of_contact(
    scene: Scene, rows: ConstraintRows | None, solution: ContactSolution, comm: MPI.Intracomm
) -> ContactFigures:
    """Figures of the contact of the whole bodies; rows None: the scene has none.  Collective on comm."""
    sums, moments, mirrors = np.zeros((len(scene.contact), 11)), np.zeros(14), scene.mirrors
    if rows is not None:
        force = rows.force_components(solution.force)
        columns = force, solution.force, solution.force[:, None] * rows.normal, force[:, None] * rows.position
        closed = solution.active, solution.active * rows.area
        np.add.at(sums, rows.contact, np.column_stack([*columns, *closed, force * rows.gap]))
    comm.Allreduce(MPI.IN_PLACE, sums)
    of_pair, lengths, vectors = sums[:, 0], mirrors.parts * sums[:, 1], mirrors.force(sums[:, 2:5])
    total, active, area, gaps = sums[:, [0, 8, 9, 10]].sum(axis=0)
    centre = _centre(scene, total, sums[:, 5:8].sum(axis=0))
    if rows is not None:
        arm = rows.position - centre
        radius2 = (arm**2).sum(axis=1) - np.einsum("ni,ni->n", arm, rows.normal) ** 2
        gap = rows.gap - (gaps / total if total else 0.0)
        powers = np.stack([radius2, radius2**2, gap, radius2 * gap, gap**2])
        moments = comm.allreduce(np.append((arm.T * force) @ arm, powers @ force))
    tensor = mirrors.second_moment(moments[:9].reshape(3, 3))
    one_contact = mirrors.parts == scene.symmetry and np.count_nonzero(of_pair) == 1
    is_round = one_contact and _is_round(tensor, vectors.sum(axis=0), lengths.sum(), mirrors.parts * area)
    radius = float(np.sqrt(max(2.5 * moments[9] / total, 0.0))) if total else 0.0
    is_round = is_round and radius**2 > _POINT * area and _is_quadratic(moments[9:] / total)
    largest = comm.allreduce(float(solution.pressure.max(initial=0.0)), op=MPI.MAX)
    if is_round:
        over = largest * np.pi * radius**2 / (1.5 * total * scene.symmetry) - 1
        is_round = -PEAK <= over <= (RESOLVED_PEAK if active * scene.symmetry >= 4 * RESOLVED else PEAK)
    return ContactFigures(
        active_pairs=int(active),
        force=float(total * scene.symmetry),
        pair_forces=list(map(float, of_pair * scene.symmetry)),
        pair_alignments=[
            float(np.linalg.norm(vector) / length) if length else None for vector, length in zip(vectors, lengths)
        ],
        pair_areas=list(map(float, sums[:, 9] * scene.symmetry)),
        contact_centre=list(map(float, centre)),
        contact_radius=radius if is_round or not total else None,
        max_pressure=largest,
        max_penetration=comm.allreduce(float(solution.penetration.max(initial=0.0)), op=MPI.MAX),
        **_of_friction(scene, rows, solution, comm),
    )


def _of_friction(
    scene: Scene, rows: ConstraintRows | None, solution: ContactSolution, comm: MPI.Intracomm
) -> dict[str, Any]:
    """Figures of contact with friction; none without.  Collective on comm."""
    rough = np.array([pair.tangential is not None for pair in scene.contact], dtype=bool)
    if rows is None or not rough.any():
        return {}
    closed, work = solution.active & rough[rows.contact], float(solution.row_force @ solution.slip)
    counts = closed & ~solution.slipping, closed & solution.slipping
    sums = comm.allreduce(np.array([*(np.count_nonzero(some) for some in counts), work]))
    names = "sticking_pairs", "slipping_pairs"
    return dict(zip(names, map(int, sums))) | {"dissipated_energy": float(sums[2] * scene.symmetry)}


def _centre(scene: Scene, total: float, moment: FloatArray) -> FloatArray:
    """Centre (3,) of the contact [m] from the sum of the forces [N] and of forces times positions (3,) [N m]."""
    points = scene.mesh.points
    if scene.contact_centre is not None:
        centre = np.array(scene.contact_centre, dtype=np.float64)
    else:
        centre = np.asarray(moment / total if total else (points.min(axis=0) + points.max(axis=0)) / 2)
    return scene.mirrors.centre(centre)


def _is_quadratic(means: FloatArray) -> bool:
    """True if the gap grows with r^2 as Hertz assumes, from the weighted means of r^2, r^4, D, r^2 D and D^2."""
    radius2, radius4, gap, mixed, gap2 = means
    covariance, variances = mixed - radius2 * gap, (radius4 - radius2**2) * (gap2 - gap**2)
    return bool(gap2 > _PARALLEL**2 * radius2 and covariance > 0 and covariance**2 >= QUADRATIC * variances)


def _is_round(tensor: FloatArray, vector: FloatArray, length: float, area: float) -> bool:
    """True if the forces have the spread of round bodies across their resultant.

    Hertz's pressure on a circle of radius a, p ~ sqrt(1 - r^2 / a^2), has a mean r^2 of 2 a^2 / 5.  The area of that
    circle over the closed area is 0.59 to 1.08 for spheres (four or more closed pairs in a quarter).  It is 1.25 for
    uniform pressure on a circle, 1.31 on a square, 1.67 for a flat round punch.

    Args:
        tensor: (3, 3), second moments of the forces [N m^2].
        vector, length: sum (3,) of the forces, and of their lengths [N].
        area: closed area [m^2].
    """
    resultant = np.linalg.norm(vector)
    if resultant <= AXIS * length:
        return False
    across = np.eye(3) - np.outer(vector, vector) / resultant**2
    _, least, most = np.sort(np.linalg.eigvalsh(across @ tensor @ across))
    radius2 = 2.5 * (least + most) / length
    return bool(least >= (1 - ROUND) ** 2 * most and (1 - ROUND) ** 2 * np.pi * radius2 <= area)
