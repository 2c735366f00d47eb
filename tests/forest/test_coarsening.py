"""Coarser forests: the coarsest that has the levels that are needed, by the rules of refinement."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import leaves, roots, scramble

from fx_contact.forest.coarsening import coarsened
from fx_contact.forest.partition import repartition
from fx_contact.scenes import hertz
from fx_contact.surfaces.facet_pairing import leaf_code

pytestmark = pytest.mark.ranks(1, 2, 3)


def refined(rounds=3):
    """A forest with some leaves refined, the same ones on any number of ranks."""
    forest = repartition(roots(hertz(order=2, coarse=2)), None)[0]
    for number in range(rounds):
        codes = leaf_code(forest.cell, forest.anchor) * 16 + forest.level
        forest, _ = forest.refined(scramble(codes, number) % np.uint64(7) == 0)
        forest = repartition(forest, None)[0]
    everywhere(len(np.unique(forest.level)) > 2 or WORLD.size > 1, "leaves of several levels")
    return forest


def test_all_and_nothing():
    """With all leaves needed it is the same forest, with none the root cells."""
    forest = refined()
    everywhere(np.array_equal(leaves(coarsened(forest, forest.level)), leaves(forest)), "the same leaves")
    merged = coarsened(forest, 0 * forest.level)
    everywhere(np.array_equal(leaves(merged), leaves(roots(hertz(order=2, coarse=2)))), "root cells")


def test_no_leaf_is_coarser_than_needed_nor_finer_than_before():
    """And what is merged can be refined to the same again: only leaves that the rules demand are finer than needed."""
    forest = refined()
    codes = leaf_code(forest.cell, forest.anchor) * 16 + forest.level
    level = np.maximum(forest.level - (scramble(codes, 9) % np.uint64(4)).astype(np.int8), 0)
    merged = coarsened(forest, level)
    before, after = leaves(forest), leaves(merged)
    everywhere(len(after) < len(before), "some leaves merge")
    # Leaves of ascending codes lie side by side: each leaf before is in the last one after that begins no later.
    holder = np.searchsorted(after[:, 0], before[:, 0], side="right") - 1
    names = np.stack([leaf_code(forest.cell, forest.anchor), level.astype(np.int64)], axis=1)
    needed = np.concatenate(WORLD.allgather(names))
    needed = needed[np.argsort(needed[:, 0])][:, 1]
    everywhere((after[holder, 1] <= before[:, 1]).all(), "none is finer than before")
    everywhere((after[holder, 1] >= np.minimum(needed, before[:, 1])).all(), "none is coarser than needed")
    again = coarsened(merged, merged.level)
    everywhere(np.array_equal(leaves(again), after), "balanced: its own levels need no more leaves")


def test_what_one_rank_needs_stays():
    """However coarse the leaves of the others may become."""
    forest = refined()
    last = WORLD.rank == WORLD.size - 1
    merged = coarsened(forest, forest.level * last)
    names = np.stack([leaf_code(forest.cell, forest.anchor), forest.level], axis=1)
    wanted, found = (set(map(tuple, rows)) for rows in (WORLD.bcast(names, WORLD.size - 1), leaves(merged)))
    everywhere(wanted <= found and max(level for _, level in wanted) > 1, "a leaf that is needed has merged")
    everywhere(WORLD.size == 1 or len(found) < forest.size_global, "no leaf has merged")
