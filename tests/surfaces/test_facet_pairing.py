"""Which facets face each other, and which do not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from model_problems import corner_scene, find_leaves, grown, pressed, roots, two_boxes, whole
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fx_contact.scenes import stack
from fx_contact.surfaces.contact_surfaces import ContactSurfaces
from fx_contact.surfaces.facet_pairing import leaf_code


def test_other_contact_surfaces():
    """Surfaces are others if they belong to another contact, or are on the other side of one."""
    scene = stack()
    one, two = scene.contact
    ours, exchanged = scene.contact_surfaces, replace(one, first=one.second, second=one.first, direction=None)
    assert ours.same(stack().contact_surfaces)
    for contact in ((two, one), (exchanged, two), (one,)):
        assert not ours.same(ContactSurfaces(scene.mesh, contact))


def test_one_leaf_stands_for_each_group_of_facing_leaves():
    """In a corner a leaf faces two others: all three are one group, and the lowest code stands for it."""
    forest = whole(grown(roots(corner_scene()), 2))
    leaf, face = forest.contact_faces()
    cell, anchor = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
    other = find_leaves(forest, cell, anchor)
    assert (other >= 0).all()
    links = coo_matrix((np.ones(len(leaf)), (leaf, other)), shape=2 * (len(forest),))
    _, group = connected_components(links, directed=False)
    assert np.bincount(group).max() >= 3
    code = leaf_code(forest.cell, forest.anchor)
    lowest = np.full(group.max() + 1, np.iinfo(np.int64).max)
    np.minimum.at(lowest, group, code)
    assert np.array_equal(forest.representatives, lowest[group])


@pytest.mark.parametrize("direction, amount", [((0.0, 0.0, 1.0), 1e-4), (None, 0.2)], ids=["along it", "by normals"])
def test_nodes_must_face_nodes(direction, amount):
    """Surfaces do not match that are apart along themselves: at all where a direction is given, much where none is."""
    scene = pressed(two_boxes(distortion=0.0), direction=direction)
    mesh, where = scene.mesh, scene.mesh.cells[scene.mesh.body == 1]
    for shift, fits in ((1e-3 * amount, True), (amount, False)):
        points = mesh.points.copy()
        points[np.unique(where)] += [shift, 0.0, 0.0]
        moved = replace(mesh, points=points)
        if fits:
            assert (replace(scene, mesh=moved).pairing.partner >= 0).any()
        else:
            pairing = replace(scene, mesh=moved).pairing
            assert not pairing.paired.any()
            near = np.array(
                re.search(r"have no partner, the first near \[(.*?)\]", pairing.nonmatching[0])[1].split(), float
            )
            facets = mesh.facet_points(mesh.surface(scene.contact[0].first)).mean(axis=1)
            assert np.abs(facets - near).max(axis=1).min() < 0.01 + amount, "the centre of no facet"


@pytest.mark.parametrize("direction, expected", [((1.0, 0.0, 2.0), (5**-0.5, 0.0, 2 * 5**-0.5)), (None, (0, 0, 1))])
def test_direction_of_facets(direction, expected):
    """They face others along the direction that is given, whatever its length, else along their normals."""
    scene = pressed(two_boxes(distortion=0.0), direction=direction)
    facets = np.argwhere(scene.contact_surfaces.on(0, 0))
    found = scene.contact_directions(0, facets)
    assert len(found) and np.allclose(found, expected, rtol=0, atol=1e-14)
