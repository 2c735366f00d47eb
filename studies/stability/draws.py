"""Random parameters of the drawn scenes."""

from functools import partial

import numpy as np

from fx_contact import Material
from studies.stability.cases import SMOOTH, Twin
from studies.stability.shapes import on_block


def draw(seed, each, families):
    """Yields each family, a function of a generator of random numbers, a number from 1 and what the family draws."""
    for number, family in enumerate(families):
        rng = np.random.default_rng([seed, number])
        for k in range(each):
            yield family, k + 1, family(rng)


def compared(scene, twin, how=SMOOTH, curved=False, tolerance=0.25):
    """A scene, its twin on another mesh, by the force of each pair, and a tolerance, for a Case."""
    return scene, Twin(twin, **how, curved=curved, each=True), tolerance


def decades(rng, low, high):
    """A power of ten, by its exponent."""
    return 10.0 ** rng.uniform(low, high)


def count(rng, low, high):
    """An integer, both ends included."""
    return int(rng.integers(low, high + 1))


def material(rng, spread=1.0):
    """A material whose modulus is within so many powers of ten of 1."""
    return Material(decades(rng, -spread, spread), rng.uniform(0.0, 0.45))


def round_body(rng, least):
    """Function of `cells` that makes a body of two curvatures on a block; its pole is anywhere, its depth random."""
    x, y, curvature = rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), decades(rng, -1.2, -0.8)
    ratio, depth, both = rng.uniform(1.0, 3.0), decades(rng, least, -2), (material(rng), material(rng))

    def height(here, there):
        return curvature / 2 * ((here - x) ** 2 + ratio * (there - y) ** 2)

    return partial(on_block, "body", height, order=2, displacement=depth, materials=both)
