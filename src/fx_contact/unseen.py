"""Contact that no node sees: bodies that overlap between the nodes of a facet, away from all closed pairs.

Node-to-node contact knows the gap at vertices.  A round body that approaches by less than its distance there is not
stopped at all; the leaves behind such facets must be refined, whatever their estimated error.
"""

import numpy as np

from fx_contact import reference
from fx_contact.contact import facets_of, positions_across

#: Overlaps up to this part of what the gap varies by on a facet may come from its quadratic interpolation,
_VARIATION = 1e-3
#: and up to this part of the facet's size from rounding.
_ROUNDING = 1e-9
#: Levels of leaves that may be as curved as root cells of a higher order than 2; their children are less and less.
_COARSE = 3


def _on_facets(functions, points):
    """Products of one-dimensional Lagrange functions, at points on a line, in a grid of these points on a facet."""
    line = reference.lagrange(functions, np.linspace(0, 1, points))
    return np.einsum("va,ub->vuab", line, line).reshape(points**2, -1)


#: Points along a facet's side -> bilinear functions at these points, and what interpolates from them between them.
_SAMPLES = {3: (_on_facets(1, 3), _on_facets(2, 9)), 17: (_on_facets(1, 17), np.identity(17**2))}


def unseen_contact(forest, pairs, contact):
    """Leaves whose contact facets overlap with others between their nodes.

    Collective on forest.comm.  Facets around closed pairs are left out: there it is the estimate that refines.

    Args:
        forest: Forest.
        pairs: NodePairs.
        contact: ContactSolution.

    Returns:
        (n,) bool, for this rank's leaves, on the first surfaces alone.
    """
    unseen = np.zeros(len(forest), dtype=bool)
    for index in range(int(forest.pairing.pair.max()) + 1):
        leaf, face, corner = facets_of(index, forest)
        nodal = _at_vertices(pairs, contact, index)[forest.vertices.cells[leaf[:, None], corner]]
        away = ~_around(forest, pairs.prolongation, leaf, corner, (nodal[:, :, 1] > 0).any(axis=1))
        leaf, face, corner, nodal = leaf[away], face[away], corner[away], nodal[away]
        coarse = (forest.level[leaf] <= _COARSE) & (forest.mesh.order > 2)
        for count, these in ((3, ~coarse), (17, coarse)):
            if these.any():
                found = _overlap(forest, leaf[these], face[these], corner[these], nodal[these], count)
                unseen[leaf[these][found]] = True
    return unseen


def _overlap(forest, leaf, face, corner, nodal, count):
    """Whether contact facets overlap with those that face them, somewhere between so many points a side: (n,) bool."""
    bilinear, finer = _SAMPLES[count]
    steps = (count - 1) ** 2
    points = np.einsum(
        "pv,nvi->npi", np.rint(steps * bilinear).astype(np.int64), forest.corners[leaf[:, None], corner]
    )
    here, there = positions_across(forest, leaf, face, (points // steps).astype(np.int32))
    at = np.einsum("pv,nvk->npk", bilinear, nodal)
    normal = at[:, :, 2:] / np.linalg.norm(at[:, :, 2:], axis=2)[:, :, None]
    gap = np.einsum("npi,npi->np", normal, there - here) - at[:, :, 0]
    size = np.linalg.norm(here[:, -1] - here[:, 0], axis=1)
    allowed = _VARIATION * np.ptp(gap, axis=1) + _ROUNDING * size
    return (gap @ finer.T).min(axis=1) < -allowed


def _at_vertices(pairs, contact, index):
    """Jump of the displacement, status and normal of a contact pair's node pairs at this rank's vertices: (m, 5)."""
    prolongation, ours = pairs.prolongation, pairs.contact == index
    said = np.zeros((prolongation.index_map.size_local + prolongation.index_map.num_ghosts, 5))
    rows = np.concatenate([(contact.penetration + pairs.gap)[:, None], contact.active[:, None], pairs.normal], axis=1)
    said[pairs.first[ours]] = rows[ours]
    return prolongation.prolong(prolongation.summed(said))


def _around(forest, prolongation, leaf, corner, closed):
    """Facets that share a vertex with a closed one, or a master of one: (n,) bool."""
    marks = np.zeros((len(forest.vertices), 1))
    marks[forest.vertices.cells[leaf[closed, None], corner[closed]].ravel()] = 1
    marks = prolongation.prolong(prolongation.restrict(marks))[:, 0]
    return (marks[forest.vertices.cells[leaf[:, None], corner]] > 0).any(axis=1)
