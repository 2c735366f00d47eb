"""The energy that contact forces store, which the tolerance of each contact is relative to."""

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

#: Around a contact is what is no farther than so many times the root of its area: nearly all of a half-space's energy.
_AROUND = 3.0


def stored_energy(forest, energy, pairs, force, group, count):
    """Twice the energy that forces of groups of pairs store, about: what other loads store is no measure of contact.

    Collective on forest.comm.  A punch with the force F and the area A stores F^2 / (E* A^(1/2)) in a half-space.  In
    bodies that are stiffer, like thin plates, it is less: no more than there is around the contact in its two bodies;
    and all groups together store no more than there is in the bodies that they touch.

    Args:
        forest: Forest.
        energy: (nleaves,) float64, strain energy of this rank's leaves, twice [J].
        pairs: NodePairs.
        force: (n,) float64, compression positive [N].
        group: (n,) int, the group of each pair that presses.
        count: number of groups on all ranks.

    Returns:
        (count,) float64 [J].
    """
    total, approach = pairs.pressing(force, group, count)
    touched, centre, radius = _extents(pairs, force > 0, group, count, len(forest.mesh.bodies))
    body, tree = forest.mesh.body[forest.cell], cKDTree(forest.centres)
    half = np.linalg.norm(forest.positions(np.arange(len(forest)), 0) - forest.centres, axis=1)
    widest = half.max(initial=0.0)
    around = np.zeros(count + 1)
    for spot in range(count):
        near = np.array(tree.query_ball_point(centre[spot], radius[spot] + widest), dtype=np.int64)
        near = near[touched[spot, body[near]]]
        distance = np.linalg.norm(forest.centres[near] - centre[spot], axis=1)
        around[spot] = energy[near[distance <= radius[spot] + half[near]]].sum()
    around[-1] = energy[touched.any(axis=0)[body]].sum()
    forest.comm.Allreduce(MPI.IN_PLACE, around)
    stored = np.minimum(total * approach, around[:-1])
    return stored * min(1.0, around[-1] / max(stored.sum(), np.finfo(float).tiny))


def _extents(pairs, presses, group, count, bodies):
    """(count, nbodies) bool, bodies that groups touch where they press; (count, 3), (count,) balls around that [m]."""
    comm, group = pairs.prolongation.comm, group[presses]
    touched = np.zeros((count, bodies), dtype=np.int32)
    touched[group[:, None], pairs.bodies[presses]] = 1
    area, position = pairs.area[presses], pairs.position[presses]
    sums = np.zeros((count, 4))
    np.add.at(sums, group, np.column_stack([area, area[:, None] * position]))
    comm.Allreduce(MPI.IN_PLACE, touched, op=MPI.MAX)
    comm.Allreduce(MPI.IN_PLACE, sums)
    centre = np.divide(sums[:, 1:], sums[:, :1], out=np.zeros((count, 3)), where=sums[:, :1] > 0)
    reach = np.zeros(count)
    np.maximum.at(reach, group, np.linalg.norm(position - centre[group], axis=1))
    comm.Allreduce(MPI.IN_PLACE, reach, op=MPI.MAX)
    return touched > 0, centre, reach + _AROUND * np.sqrt(pairs.symmetry * sums[:, 0])
