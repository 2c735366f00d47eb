"""The prolongation P against its definition, and what it keeps."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    DISTRIBUTIONS,
    chosen,
    gathered_prolongation,
    grown,
    pressed,
    roots,
    split,
    two_boxes,
    vertex_positions,
    whole,
)
from scipy.sparse import coo_matrix

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import edge_midpoints, face_centres

pytestmark = pytest.mark.ranks(1, 2, 3)

MESHES = dict(), dict(upper=(1, 2, 1), margin=1, flat_contact=False)


def by_definition(forest):
    """P of a serial forest, rows and columns by key, and the longest chain of masters.

    One step replaces each vertex in the middle of a leaf's edge or face by the mean of its corners; steps are repeated
    until nothing hangs.
    """
    vertex = forest.lattice.keys(forest.cell, forest.corners)
    keys = np.unique(vertex)
    masters = {}
    edges = edge_midpoints(forest.corners), hexahedron.EDGE_CORNERS
    for middles, corners in (edges, (face_centres(forest.corners), hexahedron.FACE_CORNERS)):
        middle = forest.lattice.keys(forest.cell, middles)
        for leaf, local in np.argwhere(np.isin(middle, keys)):
            masters[middle[leaf, local]] = vertex[leaf, corners[local]]
    rows, columns, weights = [], [], []
    for row, key in enumerate(keys):
        ends = np.searchsorted(keys, masters.get(key, [key]))
        rows += [row] * len(ends)
        columns += list(ends)
        weights += [1 / len(ends)] * len(ends)
    step = coo_matrix((weights, (rows, columns)), shape=(len(keys), len(keys))).tocsr()
    hanging = np.isin(keys, list(masters))
    total, links = step, 1
    while abs(total[:, hanging]).sum() > 0:
        total, links = step @ total, links + 1
        assert links < 50
    return total[:, ~hanging], keys, keys[~hanging], links


@pytest.fixture(params=MESHES, ids=["alike", "wider"])
def forest(request):
    """A balanced forest with hanging vertices; balance leaves no chains of them."""
    forest = grown(roots(pressed(two_boxes(**request.param))), 4, share=0.1)
    assert by_definition(whole(forest))[3] == 1, "a balanced forest with chains"
    return forest


@pytest.fixture
def unruly():
    """A forest without balance, with chains of hanging vertices at least three long."""
    forest = roots(pressed(two_boxes()))
    for salt in range(5):
        forest = split(forest, chosen(forest, 0.25, salt))
    assert by_definition(whole(forest))[3] >= 3, "no chains"
    return forest


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_prolongation_by_definition(forest, distribution):
    """P on any distribution is the matrix that the definition gives for the gathered leaves."""
    forest = DISTRIBUTIONS[distribution](forest)
    expected, rows, columns, links = by_definition(whole(forest))
    prolongation = Prolongation(Space(forest, 1))
    found, found_rows, found_columns = gathered_prolongation(prolongation)
    assert np.array_equal(rows, found_rows) and np.array_equal(columns, found_columns)
    assert abs(found - expected).max() == 0
    assert prolongation.hanging_global == len(rows) - len(columns) > 0
    assert prolongation.index_map.size_global == len(columns)


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_chains(unruly, distribution):
    """Masters that hang are replaced by theirs, whichever ranks hold them; linear functions survive."""
    forest = DISTRIBUTIONS[distribution](unruly)
    test_prolongation_by_definition(forest, "roots")
    test_linear_functions(forest, "roots")


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_constants_and_injection(forest, distribution):
    """Rows of P sum to one, and R P = I where R takes the values at the conforming vertices."""
    forest = DISTRIBUTIONS[distribution](forest)
    prolongation = Prolongation(Space(forest, 1))
    assert prolongation.hanging_global > 0
    everywhere(np.abs(prolongation.matrix.sum(axis=1) - 1).max() < 1e-15, "a row of P does not sum to one")
    total, rows, columns = gathered_prolongation(prolongation)
    injection = total[np.searchsorted(rows, columns)]
    assert abs(injection - np.eye(len(columns))).max() == 0
    values = np.sin(np.arange(3 * prolongation.owned, dtype=float).reshape(-1, 3) + 100 * WORLD.rank)
    found = prolongation.injected(prolongation.prolong(values))
    everywhere(np.array_equal(found, values), "R P is not the identity")
    everywhere((prolongation.hanging == (prolongation.conforming < 0)).all(), "a hanging vertex has a number")


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_linear_functions(forest, distribution):
    """P reproduces linear functions exactly on straight-sided meshes, along chains too."""
    forest = DISTRIBUTIONS[distribution](forest)
    prolongation = Prolongation(Space(forest, 1))
    linear = vertex_positions(forest) @ np.array([[1.0, 0.5], [-2.0, 0.3], [0.7, 0.0]]) + 4
    found = prolongation.prolong(prolongation.injected(linear))
    everywhere(np.abs(found - linear).max() < 1e-13, "a linear function is not reproduced")


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_restrict_is_the_transpose(forest, distribution):
    """y^T (P x) = (P^T y)^T x with y given cell by cell on every rank."""
    forest = DISTRIBUTIONS[distribution](forest)
    prolongation = Prolongation(Space(forest, 1))
    x = np.cos(np.arange(2.0 * prolongation.owned).reshape(-1, 2) + WORLD.rank)
    y = np.sin(np.arange(2.0 * len(prolongation.space)).reshape(-1, 2) - WORLD.rank)
    left = WORLD.allreduce((y * prolongation.prolong(x)).sum())
    right = WORLD.allreduce((prolongation.restrict(y) * x).sum())
    assert abs(left - right) < 1e-12 * WORLD.allreduce(np.abs(y).sum())
