"""Contact that no node sees: what goes on between the nodes of contact facets.

Node-to-node contact knows the gap at vertices.  A round body that approaches by less than its distance there is not
stopped at all; the leaves behind such facets must be refined, whatever their estimated error.  Between closed pairs
unlike surfaces overlap or stand apart, as a sphere on coarse facets does: that is refined where it matters, for the
estimate knows only the strains of what the nodes see.
"""

from copy import copy

import numpy as np

from fx_contact.contact.node_pairs import facets_of, positions_across
from fx_contact.estimate.facet_gap import Gap
from fx_contact.problem import hexahedron

#: Overlaps up to this part of what the gap varies by on a facet may come from the linear solver,
_VARIATION = 1e-8
#: and up to this part of the facet's size, the root of its area, from rounding.
_ROUNDING = 1e-9
#: Columns of what is known at the vertices of a contact facet.
_PRESSURE, _MODULUS, _JUMP, _NORMAL = 0, 1, slice(2, 5), slice(5, 8)


def unseen_contact(forest, pairs, contact, tolerance, spots, energy):
    """Leaves whose contact facets overlap with others between their nodes, or are apart there though they press.

    Collective on forest.comm.  Away from closed pairs any overlap counts.  On the facets around them the gap differs
    from that interpolated from the nodes, by d, on any mesh of a round body: of what the pressures p would do on it
    and of what it would take to press an overlap o beyond that of the nodes apart, the sum of p |d| and (E*/h) o^2,
    each contact spot may leave e^2 of the energy that its force stores, or what the linear solver leaves.  Where it
    leaves more, facets with more than their share are named.

    Args:
        forest: Forest.
        pairs: NodePairs.
        contact: ContactSolution.
        tolerance: prescribed accuracy e [-].
        spots: Spots of the closed pairs.
        energy: (spots.number,) float64, what the forces of each spot store, twice [J].

    Returns:
        (n,) bool, for this rank's leaves, on the first surfaces alone.
    """
    unseen, most = np.zeros(len(forest), dtype=bool), np.maximum(tolerance**2 * energy, contact.energy_error**2)
    left, around = np.zeros((2, spots.number)), []
    for index, spot in enumerate(spots.facet):
        leaf, face = facets_of(index, forest)
        nodal = _at_nodes(pairs, contact, index)[pairs.prolongation.space.on_faces(leaf, face)]
        near, facets = spot >= 0, _Facets(forest, leaf, face, nodal)
        unseen[leaf[~near][facets.where(~near).overlap()]] = True
        around.append((leaf[near], spot[near], facets.where(near).energy()))
        np.add.at(left, (0, spot[near]), around[-1][-1])
        np.add.at(left, (1, spot[near]), around[-1][-1] > 0)
    total, count = forest.comm.allreduce(left)
    for leaf, spot, own in around:
        unseen[leaf[(total > most)[spot] & (own > (most / np.maximum(count, 1))[spot])]] = True
    return unseen


class _Facets:
    """Contact facets and those that face them, in points enough to know the root mesh's geometry between them.

    Local.

    Args:
        forest: Forest.
        leaf, face: (n,) int64, leaves and their local faces.
        nodal: (n, 4, 8) float64, columns of what is known at their nodes.
    """

    def __init__(self, forest, leaf, face, nodal):
        parts = 2 * ((forest.mesh.order + 1) // 2)  # even, for Simpson's rule
        self._count, self._nodal, self._orientation = parts + 1, nodal, hexahedron.FACE_ORIENTATION[face]
        line = hexahedron.lagrange(1, np.linspace(0, 1, self._count))
        self._bilinear = np.einsum("va,ub->vuab", line, line).reshape(self._count**2, 4)
        anchors = forest.corners[leaf[:, None], hexahedron.FACE_CORNERS[face]]
        points = np.einsum("pv,nvi->npi", np.rint(parts**2 * self._bilinear).astype(np.int64), anchors)
        # How far a function may leave the range of its samples, relative to that: less than by Lebesgue's constant.
        self._swing = np.abs(hexahedron.lagrange(parts, np.linspace(0, 1, 101))).sum(axis=1).max() ** 2
        self._here, self._there = positions_across(forest, leaf, face, points / parts**2)
        diagonals = self._here[:, -1] - self._here[:, 0], self._here[:, parts] - self._here[:, -parts - 1]
        self._area = np.linalg.norm(np.cross(*diagonals), axis=1) / 2

    def where(self, which):
        """Some of the facets: _Facets.  Args: which: (n,) bool."""
        some = copy(self)
        for name in ("_nodal", "_orientation", "_here", "_there", "_area"):
            setattr(some, name, getattr(self, name)[which])
        return some

    def _sampled(self, columns):
        """A column, or some, of what is known at vertices, at all points: (n, points, ...) float64."""
        return np.einsum("pv,nv...->np...", self._bilinear, self._nodal[:, :, columns])

    def _gap(self):
        """The gap at all points along normals between those of the vertices: (n, points) float64 [m]."""
        normal = self._sampled(_NORMAL)
        apart = self._there - self._here - self._sampled(_JUMP)  # small, however far the bodies come
        return np.einsum("npi,npi->np", normal, apart) / np.linalg.norm(normal, axis=2)

    @property
    def _corners(self):
        """Positions of the corners among the points, in the order of a facet's vertices."""
        return np.array([0, self._count - 1, -self._count, -1])

    def overlap(self):
        """Whether facets overlap more than at their nodes, and than may come from rounding: (n,) bool."""
        sampled = self._gap()
        some = sampled.min(axis=1) < self._swing * np.ptp(sampled, axis=1)
        few = self.where(some)
        gap = Gap(few._here, few._there, few._sampled(_JUMP), few._orientation)
        nodes = gap.at(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1])).min(axis=1)
        limit = np.minimum(nodes, 0.0) - _VARIATION * np.ptp(sampled[some], axis=1) - _ROUNDING * np.sqrt(few._area)
        some[some] = gap.least(limit) < limit
        return some

    def energy(self):
        """What facets would do and take between their nodes, twice the energy: (n,) float64 [J]."""
        gap, size = self._gap(), np.sqrt(self._area)
        at_nodes, rounding = gap[:, self._corners], _ROUNDING * size[:, None]
        off = np.maximum(np.abs(gap - at_nodes @ self._bilinear.T) - rounding, 0.0)
        # A penalty's overlap at the nodes is its own affair.
        overlap = np.maximum(-gap - np.maximum(-at_nodes, 0.0) @ self._bilinear.T - rounding, 0.0)
        pressure, modulus = self._sampled(_PRESSURE), self._sampled(_MODULUS)
        return self._area * ((pressure * off + modulus / size[:, None] * overlap**2) @ _simpson(self._count))


def _simpson(count):
    """Simpson's rule on a facet of area 1, for so many points a side: (count^2,) float64."""
    line = np.full(count, 2.0)
    line[1::2], line[[0, -1]] = 4.0, 1.0
    line /= line.sum()
    return np.outer(line, line).ravel()


def _at_nodes(pairs, contact, index):
    """What is known of a contact pair's node pairs, at this rank's nodes: (m, 8) float64."""
    prolongation, ours = pairs.prolongation, pairs.contact == index
    said = np.zeros((prolongation.index_map.size_local + prolongation.index_map.num_ghosts, 8))
    modulus, u = 1 / (1 / pairs.modulus).sum(axis=1), prolongation.ghosted(contact.displacement)
    jump = u[pairs.first] - u[pairs.second]
    columns = contact.force / pairs.area, modulus, *jump.T, *pairs.normal.T
    said[pairs.first[ours]] = np.stack(columns, axis=1)[ours]
    return prolongation.prolong(prolongation.summed(said))
