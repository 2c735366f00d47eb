"""Contact that no node sees: what goes on between the nodes of contact facets.

Node-to-node contact knows the gap at vertices.  A round body that approaches by less than its distance there is not
stopped at all; the leaves behind such facets must be refined, whatever their estimated error.  Between closed pairs
unlike surfaces overlap or stand apart, as a sphere on coarse facets does: that is refined where it matters, for the
estimate knows only the strains of what the nodes see.
"""

import numpy as np

from fx_contact import reference
from fx_contact.contact import facets_of, positions_across

#: Overlaps up to this part of what the gap varies by on a facet may come from its quadratic interpolation,
_VARIATION = 1e-5
#: and up to this part of the facet's size, the root of its area, from rounding.
_ROUNDING = 1e-9
#: Sweeps along both directions of a facet to the least value of a parabola.
_SWEEPS = 20
#: Columns of what is known at the vertices of a contact facet.
_CLOSED, _PRESSURE, _MODULUS, _JUMP, _NORMAL = 0, 1, 2, slice(3, 6), slice(6, 9)
#: Levels of leaves that may be as curved as root cells of a higher order than 2; their children are less and less.
_COARSE = 3


def _on_facets(functions, points):
    """Products of one-dimensional Lagrange functions, at points on a line, in a grid of these points on a facet."""
    line = reference.lagrange(functions, np.linspace(0, 1, points))
    return np.einsum("va,ub->vuab", line, line).reshape(points**2, -1)


#: Points along a facet's side -> bilinear functions at these points, and what interpolates from them between them.
_SAMPLES = {3: (_on_facets(1, 3), _on_facets(2, 9)), 17: (_on_facets(1, 17), np.identity(17**2))}


def unseen_contact(forest, pairs, contact, most):
    """Leaves whose contact facets overlap with others between their nodes, or are apart there though they press.

    Collective on forest.comm.  Away from closed pairs any overlap counts.  On the facets around them the gap differs
    from that interpolated from the nodes, by d, on any mesh of a round body: of what the pressures p would do on it
    and of what it would take to press an overlap o beyond that of the nodes apart, the sum of p |d| and (E*/h) o^2, as
    much may be left as is given.  Where it is more, the facets with more than their share are named.

    Args:
        forest: Forest.
        pairs: NodePairs.
        contact: ContactSolution.
        most: energy that may be left around the closed pairs, as in (4) twice the one stored [J].

    Returns:
        (n,) bool, for this rank's leaves, on the first surfaces alone.
    """
    unseen, energy = np.zeros(len(forest), dtype=bool), np.zeros(len(forest))
    for index in range(int(forest.pairing.pair.max()) + 1):
        leaf, face, corner = facets_of(index, forest)
        nodal = _at_vertices(pairs, contact, index)[forest.vertices.cells[leaf[:, None], corner]]
        around = _around(forest, pairs.prolongation, leaf, corner, (nodal[:, :, _CLOSED] > 0).any(axis=1))
        coarse = (forest.level[leaf] <= _COARSE) & (forest.mesh.order > 2)
        for count, curved in ((3, False), (17, True)):
            these = coarse == curved
            if not these.any():
                continue
            near, here = around[these], leaf[these]
            gap, area = _sampled(forest, here, face[these], corner[these], nodal[these], count)
            unseen[here[~near][_overlaps(gap[~near], area[~near], count)]] = True
            np.add.at(energy, here[near], _energy(gap[near], area[near], nodal[these][near], count))
    total, facets = forest.comm.allreduce(np.array([energy.sum(), np.count_nonzero(energy)]))
    if total > most:
        unseen |= energy > most / facets
    return unseen


def _sampled(forest, leaf, face, corner, nodal, count):
    """Gaps between contact facets and those that face them, at so many points a side: (n, count^2), and (n,) areas."""
    bilinear, _ = _SAMPLES[count]
    steps = (count - 1) ** 2
    points = np.einsum(
        "pv,nvi->npi", np.rint(steps * bilinear).astype(np.int64), forest.corners[leaf[:, None], corner]
    )
    here, there = positions_across(forest, leaf, face, (points // steps).astype(np.int32))
    normal, jump = (np.einsum("pv,nvk->npk", bilinear, nodal[:, :, columns]) for columns in (_NORMAL, _JUMP))
    normal /= np.linalg.norm(normal, axis=2)[:, :, None]
    gap = np.einsum("npi,npi->np", normal, there - here - jump)  # small, however far the bodies come
    diagonals = here[:, -1] - here[:, 0], here[:, count - 1] - here[:, -count]
    return gap, np.linalg.norm(np.cross(*diagonals), axis=1) / 2


def _overlaps(gap, area, count):
    """Whether facets overlap more than at their nodes, and than may come from sampling and rounding: (n,) bool."""
    _, finer = _SAMPLES[count]
    allowed = _VARIATION * np.ptp(gap, axis=1) + _ROUNDING * np.sqrt(area)
    nodes = gap[:, _corners(count)].min(axis=1)
    return _least(gap @ finer.T) < np.minimum(nodes, 0.0) - allowed


def _least(values):
    """The least values of functions on facets, by a parabola around the least one of a grid (n, m^2): (n,) float64."""
    side = int(np.sqrt(values.shape[1]))
    lowest = np.stack(np.divmod(values.argmin(axis=1), side)).clip(1, side - 2)
    around = np.arange(-1, 2)
    rows, columns = (middle[:, None] + around for middle in lowest)
    grid = values.reshape(-1, side, side)[np.arange(len(values))[:, None, None], rows[:, :, None], columns[:, None]]
    slope = [(grid[:, 2, 1] - grid[:, 0, 1]) / 2, (grid[:, 1, 2] - grid[:, 1, 0]) / 2]
    bend = [values @ [1, -2, 1] for values in (grid[:, :, 1], grid[:, 1])]
    twist = (grid[:, 2, 2] - grid[:, 2, 0] - grid[:, 0, 2] + grid[:, 0, 0]) / 4
    place = np.zeros((2, len(values)))
    for _ in range(_SWEEPS):
        for one, other in ((0, 1), (1, 0)):
            down = -(slope[one] + twist * place[other])
            step = np.divide(down, bend[one], out=np.zeros(len(values)), where=bend[one] > 0)
            place[one] = step.clip(-1, 1)
    x, y = place
    found = grid[:, 1, 1] + slope[0] * x + slope[1] * y + twist * x * y + (bend[0] * x**2 + bend[1] * y**2) / 2
    return np.minimum(found, values.min(axis=1))


def _corners(count):
    """Positions of a facet's corners in a grid of so many points a side, in the order of its vertices."""
    return np.array([0, count - 1, -count, -1])


def _energy(gap, area, nodal, count):
    """What facets would do and take between their nodes, twice the energy: (n,) float64 [J]."""
    bilinear, _ = _SAMPLES[count]
    size = np.sqrt(area)
    at_nodes, rounding = gap[:, _corners(count)], _ROUNDING * size[:, None]
    off = np.maximum(np.abs(gap - at_nodes @ bilinear.T) - rounding, 0.0)
    # A penalty's overlap at the nodes is its own affair.
    overlap = np.maximum(-gap - np.maximum(-at_nodes, 0.0) @ bilinear.T - rounding, 0.0)
    pressure, modulus = (nodal[:, :, column] @ bilinear.T for column in (_PRESSURE, _MODULUS))
    return area * ((pressure * off + modulus / size[:, None] * overlap**2) @ _weights(count))


def _weights(count):
    """Simpson's rule on a facet of area 1, for so many points a side: (count^2,) float64."""
    line = np.full(count, 2.0)
    line[1::2], line[[0, -1]] = 4.0, 1.0
    line /= line.sum()
    return np.outer(line, line).ravel()


def _at_vertices(pairs, contact, index):
    """What is known of a contact pair's node pairs, at this rank's vertices: (m, 9) float64."""
    prolongation, ours = pairs.prolongation, pairs.contact == index
    said = np.zeros((prolongation.index_map.size_local + prolongation.index_map.num_ghosts, 9))
    modulus, u = 1 / (1 / pairs.modulus).sum(axis=1), prolongation.ghosted(contact.displacement)
    jump = u[pairs.first] - u[pairs.second]
    columns = contact.active, contact.force / pairs.area, modulus, *jump.T, *pairs.normal.T
    said[pairs.first[ours]] = np.stack(columns, axis=1)[ours]
    return prolongation.prolong(prolongation.summed(said))


def _around(forest, prolongation, leaf, corner, closed):
    """Facets that share a vertex with a closed one, or a master of one: (n,) bool."""
    marks = np.zeros((len(forest.vertices), 1))
    marks[forest.vertices.cells[leaf[closed, None], corner[closed]].ravel()] = 1
    marks = prolongation.prolong(prolongation.restrict(marks))[:, 0]
    return (marks[forest.vertices.cells[leaf[:, None], corner]] > 0).any(axis=1)
