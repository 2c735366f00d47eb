"""Random parameters of the drawn scenes."""

from fx_contact import Material


def decades(rng, low, high):
    """A power of ten, by its exponent."""
    return 10.0 ** rng.uniform(low, high)


def count(rng, low, high):
    """An integer, both ends included."""
    return int(rng.integers(low, high + 1))


def material(rng, spread=1.0):
    """A material whose modulus is within so many powers of ten of 1."""
    return Material(decades(rng, -spread, spread), rng.uniform(0.0, 0.45))
