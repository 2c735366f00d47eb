"""Contact as a whole: forces of the pairs, their directions and centre, radius, pressure and penetration."""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.body_contact import force_components

#: Contact is round where the semi-axes of the ellipse with its second moments differ by no more than this part, and its
#: radius is not longer by more than that of its area: it is then within 6 % of both semi-axes.  A sphere whose pole is
#: beside the nodes has semi-axes 1 : 0.81, 0.88, 0.94 with 4, 26, 11 closed pairs, 1 : 0.998 with 142 (a unit sphere
#: 0.01 deep in a block, E = 1).
ROUND = 0.1
#: Least length of the sum of the forces over the sum of their lengths of contact that has an axis: that of uniform
#: pressure on a hemisphere; (1 + cos t) / 2 on a cap up to the angle t.
_AXIS = 0.5


def figures_of_contact(scene, pairs, solution, comm):
    """Force, radius, pressure and penetration of the whole bodies, whatever symmetry was used.

    Collective on comm.

    Args:
        scene: Scene.
        pairs: ConstraintRows; None without contact.
        solution: ContactSolution.
        comm: MPI communicator.

    Returns:
        dict of entries of a StepRecord, and `contact_centre` as (3,) float64 [m].
    """
    if pairs is None:
        return {
            "active_pairs": 0,
            "force": 0.0,
            "pair_forces": [],
            "pair_alignments": [],
            "contact_centre": _centre(scene, 0.0, np.zeros(3)),
            "contact_radius": 0.0,
            "max_pressure": 0.0,
            "max_penetration": 0.0,
        }
    force, mirrors = force_components(scene, pairs, solution.force), scene.mirrors
    sums = np.zeros((len(scene.contact), 10))
    columns = force, solution.force, solution.force[:, None] * pairs.normal, force[:, None] * pairs.position
    np.add.at(sums, pairs.contact, np.column_stack([*columns, solution.active, solution.active * pairs.area]))
    comm.Allreduce(MPI.IN_PLACE, sums)
    of_pair, lengths, vectors = sums[:, 0], sums[:, 1], mirrors.force(sums[:, 2:5])
    total, active, area = sums[:, [0, 8, 9]].sum(axis=0)
    centre = _centre(scene, total, sums[:, 5:8].sum(axis=0))
    arm = pairs.position - centre
    radius2 = (arm**2).sum(axis=1) - np.einsum("ni,ni->n", arm, pairs.normal) ** 2
    moments = comm.allreduce(np.append((arm.T * force) @ arm, force @ radius2))
    moment, lengths = moments[-1], mirrors.parts * lengths
    tensor = mirrors.second_moment(moments[:-1].reshape(3, 3))
    one_contact = mirrors.parts == scene.symmetry and np.count_nonzero(of_pair) == 1
    is_round = one_contact and _is_round(tensor, vectors.sum(axis=0), lengths.sum(), mirrors.parts * area)
    radius = float(np.sqrt(2.5 * moment / total)) if total else 0.0
    pressure = comm.allreduce(float(solution.pressure.max(initial=0.0)), op=MPI.MAX)
    return {
        "active_pairs": int(active),
        "force": float(total * scene.symmetry),
        "pair_forces": (of_pair * scene.symmetry).tolist(),
        "pair_alignments": [
            float(np.linalg.norm(vector) / length) if length else None for vector, length in zip(vectors, lengths)
        ],
        "contact_centre": centre,
        "contact_radius": radius if is_round or not total else None,
        "max_pressure": pressure,
        "max_penetration": comm.allreduce(float(solution.penetration.max(initial=0.0)), op=MPI.MAX),
    }


def _centre(scene, total, moment):
    """The centre of the whole contact (3,) [m]: as the scene says, or of the forces, or of the root mesh.

    Args:
        scene: Scene.
        total: sum of the forces [N].
        moment: (3,) sum of forces times positions [N m].
    """
    given, points = scene.contact_centre, scene.mesh.points
    if given is None:
        given = moment / total if total else (points.min(axis=0) + points.max(axis=0)) / 2
    return scene.mirrors.centre(np.array(given, dtype=np.float64))


def _is_round(tensor, vector, length, area):
    """Whether the forces of the whole contact are spread as those of round bodies, across their resultant.

    Hertz's pressure on a circle of radius a, p ~ sqrt(1 - r^2 / a^2), has a mean r^2 of 2 a^2 / 5.  A circle of the
    radius that the mean gives has then the closed area; on meshes with four or more closed pairs in a quarter it has
    0.59 to 1.08 times that of spheres.  It is too large where more force is outside: 1.25 times the area under uniform
    pressure on a circle, 1.31 times on a square, 1.67 times under a flat round punch.

    Args:
        tensor: (3, 3) second moments of the forces [N m^2].
        vector: (3,) sum of the forces [N].
        length: sum of their lengths [N].
        area: closed [m^2].
    """
    along = np.linalg.norm(vector)
    if along <= _AXIS * length:
        return False
    across = np.eye(3) - np.outer(vector, vector) / along**2
    _, least, most = np.sort(np.linalg.eigvalsh(across @ tensor @ across))
    radius2 = 2.5 * (least + most) / length
    return bool(least >= (1 - ROUND) ** 2 * most and (1 - ROUND) ** 2 * np.pi * radius2 <= area)
