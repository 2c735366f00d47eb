"""Leaf facets across surfaces whose meshes do not match: sizes after refinement, pairs, partition."""

import numpy as np
import pytest
from conftest import WORLD
from model_problems import gathered, grown, leaves

from fx_contact import Beginning, ContactPair, Dirichlet, Material, Scene, block, root_mesh_from_shapes
from fx_contact.adaptive.beginning import first_forest
from fx_contact.forest.partition import repartition
from fx_contact.forest.partition_quality import PartitionSummary


def cubes(upper, lower, width=1.0):
    """A unit cube, and a block of a width above it, with cells along x and y at their contact."""
    bodies = {
        "upper": block((0, 0, 1), (width, 1, 2), (upper, upper, 1), 1),
        "lower": block((0, 0, 0), (1, 1, 1), (lower, lower, 1), 1),
    }
    return Scene(
        name="cubes",
        mesh=root_mesh_from_shapes(bodies),
        materials={name: Material(1.0, 0.3) for name in bodies},
        dirichlet=(Dirichlet("lower bottom", 0, 0, 0), Dirichlet("upper top", 0, 0, 0)),
        contact=(ContactPair("upper bottom", "lower top"),),
    )


def squares(forest, name):
    """Low corner and side of the leaf facets of a surface, of all ranks: (n, 3) [m]."""
    leaf, face = forest.boundary_faces(forest.mesh.surfaces[name])
    corners = forest.evaluate(forest.cell[leaf], forest.corners[leaf])
    low, high = corners.min(axis=1), corners.max(axis=1)
    assert len(face) == len(leaf)
    return gathered(forest.comm, np.column_stack([low[:, :2], high[:, :2]]))


def largest_ratio(forest, scene):
    """Of root areas of first facets over those that their inside faces, by brute force."""
    first, second = (squares(forest, name) for name in scene.oriented[0].surfaces)
    meet = np.minimum(first[:, None, 2:], second[None, :, 2:]) - np.maximum(first[:, None, :2], second[None, :, :2])
    # A quarter of the facets' width in both directions holds a sample.
    one, two = (np.sqrt(np.prod(rows[:, 2:] - rows[:, :2], axis=1)) for rows in (first, second))
    seen = (meet >= 0.25 * np.minimum(one[:, None], two)[..., None]).all(axis=2)
    return np.where(seen, one[:, None] / two, 0).max()


@pytest.mark.parametrize("upper, lower, width", [(3, 4, 1.0), (4, 3, 1.0), (2, 8, 1.0), (3, 3, 0.7)])
def test_sizes(upper, lower, width):
    """First facets are at most sqrt(2) times as large as those that they face, after any refinement."""
    scene = cubes(upper, lower, width)
    forest = first_forest(scene, WORLD, "contact-sfc")
    for salt in range(3):
        forest = grown(forest, 1, share=0.15, salt=salt)
        assert largest_ratio(forest, scene) <= 2**0.5 * (1 + 1e-9)


def test_first_forest():
    """Root facets of the first surface that face smaller ones are refined before the first step, here once."""
    scene = cubes(2, 3)  # larger on the softer body
    stiff = Scene(
        name="cubes",
        mesh=scene.mesh,
        materials={"upper": Material(1.0, 0.3), "lower": Material(100.0, 0.3)},
        dirichlet=scene.dirichlet,
        contact=scene.contact,
    )
    assert stiff.oriented[0].first == "upper bottom" and scene.oriented[0].first == "lower top"
    forest = first_forest(stiff, WORLD, "contact-sfc")
    assert forest.size_global == 4 * 8 + 9 and first_forest(scene, WORLD, "contact-sfc").size_global == 13


def test_ranks():
    """The same leaves on any number of ranks, and the same pairs."""
    scene = cubes(3, 4)
    forest = Beginning.uniform(scene, 1, WORLD).forest
    alone = Beginning.uniform(scene, 1, WORLD.Split(WORLD.rank)).forest
    for salt in range(2):
        forest, alone = (grown(one, 1, share=0.2, salt=salt) for one in (forest, alone))
        forest, _ = repartition(forest, None)
    assert np.array_equal(leaves(forest), leaves(alone))
    pairs, known = (int(one.facing[0].faced.sum()) for one in (forest, alone))
    assert WORLD.allreduce(pairs) == known
    split = PartitionSummary.of(forest, "contact-sfc").split_pairs
    assert 0 <= split < known / 2 and (split > 0) == (WORLD.size > 1)
