"""Refinement, its closure over balance, partners and rims, and what the leaves carry along."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    DISTRIBUTIONS,
    chosen,
    corner_scene,
    find_leaves,
    gathered,
    grown,
    leaves,
    pressed,
    roots,
    scramble,
    split,
    strewn,
    two_boxes,
    whole,
)
from mpi4py import MPI

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import MAX_LEVEL, SIDE, face_centres
from fx_contact.parallel.errors import GeometryError
from fx_contact.surfaces.facet_pairing import decode_leaf, leaf_code

pytestmark = pytest.mark.ranks(1, 2, 3)

SCENES = {}, dict(upper=(1, 2, 1), margin=1), dict(margin=1, flat_contact=False)


@pytest.fixture(params=SCENES, ids=["alike", "wider", "wider, in plane"])
def scene(request):
    scene = pressed(two_boxes(**request.param))
    assert scene.contact_surfaces.every.any()
    return scene


def corner_marks(forest, cells, corner=0):
    """Leaves in a corner of root cells."""
    at = np.where(hexahedron.CORNERS[corner] == 1, SIDE - (SIDE >> forest.level.astype(int))[:, None], 0)
    return (forest.anchor == at).all(axis=1) & np.isin(forest.cell, cells)


def edge_points(forest, numerator):
    """Keys of the points at numerator/4 of all edges of this rank's leaves, taken from a forest of this rank."""
    ends = forest.corners[:, hexahedron.EDGE_CORNERS].astype(np.int64)
    points = (ends[:, :, 0] * (4 - numerator) + ends[:, :, 1] * numerator) // 4
    return forest.lattice.keys(forest.cell, points)


def facing_vertices(forest):
    """Keys of all vertices of first contact surfaces and of those that face them, distinct rows."""
    leaf, face = forest.contact_faces()
    own = ~forest.pairing.second[forest.cell[leaf], face]
    leaf, face = leaf[own], face[own]
    points = forest.corners[leaf[:, None], hexahedron.FACE_CORNERS[face]]
    cell, _, opposite = forest.pairing.opposite(forest.cell[leaf], face, points)
    rows = [forest.lattice.keys(forest.cell[leaf], points), forest.lattice.keys(cell, opposite)]
    return np.unique(np.stack([r.ravel() for r in rows], axis=1), axis=0)


def hanging_keys(forest):
    """Keys of the vertices of a serial forest that are the midpoint of a leaf's edge or the centre of a leaf's face."""
    centres = forest.lattice.keys(forest.cell, face_centres(forest.corners))
    middles = np.concatenate([edge_points(forest, 2).ravel(), centres.ravel()])
    return np.intersect1d(forest.lattice.keys(forest.cell, forest.corners), middles)


def balanced(forest):
    """Whether no edge of a leaf of a serial forest has a vertex at one of its quarters."""
    vertices = forest.lattice.keys(forest.cell, forest.corners)
    coarse = forest.level < MAX_LEVEL
    quarters = np.concatenate([edge_points(forest, n)[coarse].ravel() for n in (1, 3)])
    return not np.isin(quarters, vertices).any()


def test_refinement_keeps_the_volume(scene):
    """The leaves fill every root cell exactly, without overlap, whatever was refined."""
    forest = grown(roots(scene), 4)
    total = whole(forest)
    assert len(np.unique(total.level)) > 2
    volume = np.bincount(total.cell, weights=8.0 ** -total.level.astype(float), minlength=len(scene.mesh.cells))
    assert (volume == 1).all()
    code = leaf_code(total.cell, total.anchor)
    assert len(np.unique(code)) == len(code)
    assert (total.anchor % (SIDE >> total.level.astype(int))[:, None] == 0).all()


def test_balance(scene):
    """No leaf has a quarter point of one of its edges as a vertex; a tree refined without rules would."""
    forest = grown(roots(scene), 5, share=0.05)
    everywhere(balanced(whole(forest)), "a quarter point on an edge of a leaf")
    unruly = whole(roots(scene))
    for _ in range(3):
        unruly = split(unruly, corner_marks(unruly, 0, 7))
    assert not balanced(unruly), "the check does not see an unbalanced forest"


def test_marked_leaves_and_no_others_without_need(scene):
    """Marked leaves are refined by one level; on a uniform forest only partners and rim neighbours follow."""
    forest = grown(roots(scene), 2)
    marked = chosen(forest, 0.1, 5)
    fine, children = forest.refined(marked)
    everywhere((children.child[marked[children.parent]] >= 0).all(), "a marked leaf was not refined")
    expected = forest.level[children.parent] + (children.child >= 0)
    everywhere((fine.level == expected).all(), "a level grew by more than one")
    everywhere((fine.cell == forest.cell[children.parent]).all(), "a leaf left its root cell")
    start = roots(scene)
    fine, _ = start.refined(start.cell == np.flatnonzero(~scene.contact_surfaces.every.any(axis=1))[0])
    assert fine.size_global == start.size_global + 7, "an unpaired root cell away from the rim took others along"


def test_refined_repeatedly(scene):
    """Leaves marked twice are refined by two levels, and a linear field goes along."""
    forest = grown(roots(scene), 1)
    times = chosen(forest, 0.1, 5) + 2 * (forest.cell == 0)
    fine, values = forest.refined_with(times, forest.corners @ [[1.0], [2.0], [-3.0]])
    everywhere(np.array_equal(values, fine.corners @ [[1.0], [2.0], [-3.0]]), "the field is another one")
    # Where a leaf was is where the first corners of its descendants are.
    below = find_leaves(fine, forest.cell, forest.anchor)
    everywhere((below >= 0).all(), "a leaf has gone")
    everywhere((fine.level[below] >= forest.level + times).all(), "a leaf was refined less often than asked for")
    assert WORLD.allreduce(int((fine.level[below] - forest.level).max(initial=0)), op=MPI.MAX) >= 2


def test_finest_level(scene):
    """Refinement to one corner of a paired root cell stops at the finest level, then raises on all ranks."""
    cell = int(scene.contact_surfaces.table[0, 2])
    forest = roots(scene)
    for _ in range(MAX_LEVEL - 1):
        forest, _ = forest.refined(corner_marks(forest, cell, 3))
    forest, _ = forest.refined_with(2 * corner_marks(forest, cell, 3).astype(int))
    assert WORLD.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX) == MAX_LEVEL
    total = whole(forest)
    volume = np.bincount(total.cell, weights=8.0 ** -total.level.astype(float))
    everywhere((volume == 1).all() and balanced(total), "the deep forest is not balanced")
    assert len(total) < 100_000
    for refine in (forest.refined, forest.refined_with):
        with pytest.raises(GeometryError, match="finest level"):
            refine(corner_marks(forest, cell, 3))


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_facing_leaves(scene, distribution):
    """Each leaf face on a contact surface has a leaf of the same level on the other side, whose partner it is."""
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 4))
    leaf, face = forest.contact_faces()
    if distribution == "contact-sfc" and WORLD.size > 1:
        assert WORLD.allreduce(int(len(leaf) > 0)) > 1, "one rank holds the whole contact surface"
    cell, anchor = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
    total = whole(forest)
    place = find_leaves(total, cell, anchor)
    everywhere((place >= 0).all(), "a leaf faces nothing")
    everywhere((total.level[place] == forest.level[leaf]).all(), "facing leaves have different levels")
    other = scene.pairing.partner[forest.cell[leaf], face][:, 1]
    back, low = forest.pairing.partners(cell, forest.level[leaf], anchor, other)
    everywhere((back == forest.cell[leaf]).all() and (low == forest.anchor[leaf]).all(), "not its partner's partner")
    if distribution == "contact-sfc":
        everywhere((find_leaves(forest, cell, anchor) >= 0).all(), "facing leaves on two ranks")


@pytest.mark.parametrize("corner", [False, True])
def test_facing_vertices_hang_together(scene, corner):
    """A vertex on a contact surface hangs if and only if the vertex that faces it does, on the rim too.

    So it is where the contact surface has a concave edge, with a cell there that has no face on it.
    """
    forest = grown(roots(corner_scene(one_pair=True)), 3, share=0.2) if corner else grown(roots(scene), 5, share=0.1)
    forest = whole(forest)
    rows, hanging = facing_vertices(forest), hanging_keys(forest)
    first, second = (np.isin(column, hanging) for column in rows.T)
    assert first.sum() > 5 and (~first).sum() > 5, "no hanging vertex on the contact surface"
    assert (first == second).all()


def test_refinement_interpolates_trilinear_fields():
    """RefinementMap.interpolated is exact for fields trilinear in a root cell, over several refinements."""
    forest = grown(roots(pressed(two_boxes())), 1)

    def field(forest):
        x, y, z = np.moveaxis(forest.corners / SIDE, 2, 0)
        number = forest.cell[:, None] + 1.0
        return np.stack([number * x * y * z + x - 2 * y * z + 3, y * x + number], axis=2)

    values, before = field(forest), forest.size_global
    for salt in range(3):
        forest, children = forest.refined(chosen(forest, 0.3, salt))
        values = children.interpolated(values)
    assert forest.size_global > 2 * before
    everywhere(np.abs(values - field(forest)).max(initial=0) < 1e-12, "an interpolated field differs")


def test_same_forest_on_any_number_of_ranks(scene):
    """The leaves are those of a serial run, even if they change ranks between refinements."""
    serial, parallel, moving = roots(scene, MPI.COMM_SELF), roots(scene), roots(scene)
    for salt in range(4):
        serial, _ = serial.refined(chosen(serial, 0.15, salt))
        parallel, _ = parallel.refined(chosen(parallel, 0.15, salt))
        moving, _ = strewn(moving, salt).refined(chosen(strewn(moving, salt), 0.15, salt))
    expected = leaves(serial)
    assert len(expected) > 200
    for forest in (parallel, moving):
        found = leaves(forest)
        everywhere(len(found) == len(expected) and (found == expected).all(), "other leaves than in serial")
    everywhere((np.concatenate([serial.size_global], axis=None) == parallel.size_global).all(), "size_global")


def test_moving_carries_data_and_loses_nothing():
    """A moved forest has the same leaves, and the exchange carries their data to where they went."""
    forest = grown(roots(pressed(two_boxes())), 3)
    code = leaf_code(forest.cell, forest.anchor)
    cell, anchor = decode_leaf(code)
    everywhere((cell == forest.cell).all() and (anchor == forest.anchor).all(), "a code does not name its leaf")
    moved, exchange = forest.moved(scramble(code, 9) % np.uint64(WORLD.size))
    everywhere((exchange.forward(code) == leaf_code(moved.cell, moved.anchor)).all(), "data do not follow their leaf")
    assert (leaves(moved) == leaves(forest)).all()
    everywhere((exchange.backward(exchange.forward(code)) == code).all(), "data do not come back")
    if WORLD.size > 1:
        assert WORLD.allreduce(len(moved) == len(forest), op=MPI.LAND) is False


def test_refinement_of_an_empty_rank():
    """Ranks without leaves take part in refinement."""
    forest, _ = roots(pressed(two_boxes())).moved(np.zeros(len(roots(pressed(two_boxes()))), dtype=int))
    forest = grown(forest, 2)
    assert gathered(WORLD, [len(forest)])[0] == forest.size_global > 12
    assert Prolongation(Space(forest, 1)).hanging_global > 0
