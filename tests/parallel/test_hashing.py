"""Bits are mixed one to one, and neighbouring keys spread evenly."""

import numpy as np

from fx_contact.parallel.hashing import GOLDEN, mixed


def test_neighbours_spread_evenly():
    """The home ranks of neighbouring keys, and of keys that differ in their high bits alone, are about as many each."""
    for step in (1, 8, 1 << 20, 1 << 40):
        home = (mixed(step * np.arange(1 << 14)) >> np.uint64(33)) % np.uint64(16)
        count = np.bincount(home.astype(int), minlength=16)
        assert count.min() > 0.5 * 1024 and count.max() < 1.5 * 1024


def test_one_to_one():
    """Numbers are mixed as the formula says, with its inverse, so that no two of them are mixed alike."""
    numbers = np.random.default_rng(1).integers(0, 2**63, 1000).astype(np.uint64)
    inverse = np.uint64(pow(int(GOLDEN), -1, 2**64))
    folded = mixed(numbers) * inverse
    assert (folded ^ folded >> np.uint64(32) == numbers).all()
