"""Hilbert keys, and cutting a weighted curve that is spread over the ranks."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import grown, pressed, roots, scramble, two_boxes
from mpi4py import MPI

from fx_contact.forest import space_filling_curve
from fx_contact.forest.partition import curve_keys
from fx_contact.geometry.lattice import BITS
from fx_contact.surfaces.facet_pairing import leaf_code

pytestmark = pytest.mark.ranks(1, 2, 3)


def cube(bits):
    """All points of a cube of side 2^bits."""
    return np.stack(np.meshgrid(*[np.arange(1 << bits)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("bits", [1, 2, 3, 4])
def test_hilbert_curve(bits):
    """Keys number all points, those of neighbours are neighbours, and the points of each octant are contiguous."""
    points = cube(bits)
    keys = space_filling_curve.hilbert(points, bits)
    order = np.argsort(keys)
    assert np.array_equal(keys[order], np.arange(len(points)))
    assert (np.abs(np.diff(points[order], axis=0)).sum(axis=1) == 1).all()
    for level in range(1, bits):
        octant = (points >> bits - level) @ [1, 1 << level, 1 << 2 * level]
        prefix = keys >> 3 * (bits - level)
        assert len(np.unique(np.stack([octant, prefix], axis=1), axis=0)) == 8**level


def test_hilbert_at_full_depth():
    """At 21 bits keys stay distinct int64, and neighbours on the curve within an octant are neighbours in space."""
    corner = np.array([(1 << 21) - 8, 0, (1 << 20) - 8])
    points = cube(3) + corner
    keys = space_filling_curve.hilbert(points, 21)
    assert keys.dtype == np.int64 and (keys >= 0).all()
    order = np.argsort(keys)
    assert np.array_equal(np.diff(keys[order]), np.ones(511))
    assert (np.abs(np.diff(points[order], axis=0)).sum(axis=1) == 1).all()


def items(seed, many=400, distinct=150):
    """A weighted curve with repeated keys, the same on all ranks."""
    rng = np.random.default_rng(seed)
    keys = rng.choice(rng.integers(0, 1 << 50, distinct), many)
    return keys, rng.integers(1, 9, many)


def share_of(part, many):
    """This rank's part of so many items, a mask: in blocks, strewn, or all on the last rank."""
    if part == "blocks":
        return np.arange(many) * WORLD.size // many == WORLD.rank
    if part == "strewn":
        return scramble(np.arange(many)) % np.uint64(WORLD.size) == WORLD.rank
    return np.full(many, WORLD.rank == WORLD.size - 1)


def share(part, seed):
    """Keys and weights of this rank's part of the items."""
    keys, weights = items(seed)
    mine = share_of(part, len(keys))
    return keys[mine], weights[mine]


@pytest.mark.parametrize("parts", [1, 2, 3, 7])
@pytest.mark.parametrize("seed", range(3))
def test_cut_is_balanced(parts, seed):
    """Each cut is at most half the weight of the keys beside it from its ideal place; equal keys stay together."""
    keys, weights = items(seed)
    assert len(np.unique(keys)) < len(keys)
    distinct, slot = np.unique(keys, return_inverse=True)
    heavy = np.bincount(slot, weights=weights)
    cuts = space_filling_curve.cut_curve(WORLD, *share("blocks", seed), parts)
    assert len(cuts) == parts - 1 and (np.diff(cuts) >= 0).all()
    for number, threshold in enumerate(cuts, 1):
        below, ideal = weights[keys < threshold].sum(), weights.sum() * number / parts
        possible = np.concatenate([[0], np.cumsum(heavy)])
        assert abs(below - ideal) == np.abs(possible - ideal).min(), "another cut would be closer"
    part = np.searchsorted(cuts, keys, side="right")
    total = np.bincount(part, weights=weights, minlength=parts)
    assert np.abs(total - weights.sum() / parts).max() <= heavy.max()
    assert all(len(np.unique(part[keys == key])) == 1 for key in distinct)


@pytest.mark.parametrize("parts", [2, 3, 7])
def test_cut_does_not_depend_on_the_distribution(parts):
    """The cuts are the same however the items lie on the ranks, in whatever order."""
    expected = space_filling_curve.cut_curve(MPI.COMM_SELF, *items(5), parts)
    for part in ("blocks", "strewn", "last"):
        keys, weights = share(part, 5)
        turn = np.argsort(scramble(np.arange(len(keys)), 2))
        cuts = space_filling_curve.cut_curve(WORLD, keys[turn], weights[turn], parts)
        everywhere(np.array_equal(cuts, expected), f"{part}: other cuts")


def test_cuts_that_are_found_cost_nothing_more(monkeypatch):
    """Keys that differ in their first six bits take six rounds, whatever follows, and a threshold is asked for once."""
    asked, below = [], space_filling_curve._below
    monkeypatch.setattr(space_filling_curve, "_below", lambda *a: asked.append(a[-1]) or below(*a))
    keys = np.arange(64) << 40 | scramble(np.arange(64)).astype(np.int64) & (1 << 40) - 1
    mine = share_of("strewn", 64)
    keys[-1] = (1 << 46) - 1  # so that bisection halves a power of two
    space_filling_curve.cut_curve(WORLD, keys[mine], np.ones(len(keys[mine]), dtype=np.int64), 64)
    assert [len(thresholds) for thresholds in asked] == [1, 2, 4, 8, 16, 32]


def test_cut_of_nothing():
    """No items, or all of one key, give valid cuts on all ranks."""
    empty = np.empty(0, dtype=np.int64)
    assert len(space_filling_curve.cut_curve(WORLD, empty, empty, 3)) == 2
    cuts = space_filling_curve.cut_curve(WORLD, np.full(5, 42), np.ones(5, dtype=np.int64), 3)
    assert len(np.unique(np.searchsorted(cuts, np.full(5, 42), side="right"))) == 1


def test_curve_of_a_forest():
    """Facing leaves have the same key, others their own; the children of a leaf are contiguous on the curve."""
    forest = grown(roots(pressed(two_boxes(margin=1)), MPI.COMM_SELF), 3)
    keys = curve_keys(forest)
    group = forest.representatives
    assert len(np.unique(group)) < len(group)
    assert len(np.unique(np.stack([keys, group], axis=1), axis=0)) == len(np.unique(keys)) == len(np.unique(group))
    alone = np.flatnonzero(group == leaf_code(forest.cell, forest.anchor))
    along = alone[np.argsort(keys[alone])]
    for level in (0, 1, 2):
        corner = (forest.anchor[along] >> BITS - level).astype(np.int64) @ [1, 1 << 8, 1 << 16]
        box = (corner + (forest.cell[along].astype(np.int64) << 24))[forest.level[along] >= level]
        assert (np.diff(box) != 0).sum() + 1 == len(np.unique(box)), "leaves of one box are not contiguous"


def test_curve_does_not_depend_on_the_frames_of_cells():
    """Cells in other local frames, with other numbers, are passed through in the same order of places."""
    paths = []
    for seed in (1, 2, 3):
        forest = roots(pressed(two_boxes(margin=1, distortion=0.0, seed=seed)), MPI.COMM_SELF)
        for _ in range(2):
            forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
        path = forest.centres[np.argsort(curve_keys(forest, pairs=False))]
        assert np.abs(np.diff(path, axis=0)).sum(axis=1).max() < 4, "the curve jumps"
        paths.append(path)
    assert not np.array_equal(*(two_boxes(seed=seed).cells for seed in (1, 2)))
    assert np.allclose(paths[0], paths[1], atol=1e-12) and np.allclose(paths[0], paths[2], atol=1e-12)
