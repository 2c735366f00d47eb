"""Sixty scenes whose numbers are drawn at random, so that no rule of the program is tuned to them.

They ask for what the program promises: the force of each contact pair to the tolerance e of it, or e^2 of the largest.
Each is compared with a known answer, or with a run on other cells to 0.3 of the tolerance.
"""

from functools import partial

import numpy as np

from fx_contact import ContactPair, Dirichlet, Material, Pressure, Scene, SymmetryPlane
from fx_contact.scenes import punch
from studies.boxes import BACK, DOWN, FRONT, LEFT, RIGHT, UP, Boxes
from studies.stability.cases import Case
from studies.stability.checks import Twin
from studies.stability.references import hertz_force, material, stack_force, stack_pressed
from studies.stability.shapes import beam, corner, films, on_a_base, on_block
from studies.stability.twins import swapped

#: Of the random numbers, and how many scenes of each family.
_SEED, _EACH = 2026, 6


def drawn():
    """The scenes: yields Case."""
    families = (_round, _crests, _crests_of_pairs, _beams, _neighbours, _plates, _stacks, _corners, _spheres, _films)
    for number, family in enumerate(families):
        numbers = np.random.default_rng([_SEED, number])
        for k in range(_EACH):
            row, what = family(_Draw(numbers))
            yield Case("drawn", row, str(k + 1), **what)


class _Draw:
    """Numbers that are uniform, or whose logarithms are."""

    def __init__(self, numbers):
        self._numbers = numbers

    def between(self, low, high):
        return float(self._numbers.uniform(low, high))

    def decades(self, low, high):
        """A power of ten, by its exponent."""
        return 10.0 ** self.between(low, high)

    def count(self, low, high):
        """An integer, both ends included."""
        return int(self._numbers.integers(low, high + 1))

    def material(self, decades=1.0):
        return material(self.decades(-decades, decades), self.between(0.0, 0.45))


def _compared(make, twin=None, tolerance=0.16, curved=False):
    known = Twin(twin or make, same_mesh=False, same_contact=False, tolerance=0.3, curved=curved, each=True)
    return {"scene": make, "reference": known, "tolerance": tolerance}


def _round(draw):
    """A body of two curvatures on a block; its pole is anywhere."""
    x, y, curvature = draw.between(-0.5, 0.5), draw.between(-0.5, 0.5), draw.decades(-1.2, -0.8)
    ratio, depth = draw.between(1.0, 3.0), draw.decades(-3.5, -2)
    both, cells = (draw.material(), draw.material()), draw.count(2, 4)

    def make(cells):
        def height(here, there):
            return curvature / 2 * ((here - x) ** 2 + ratio * (there - y) ** 2)

        return on_block("body", height, cells, 2, depth, both, (" 0",))

    return "round body", _compared(partial(make, cells), partial(make, cells + 1), curved=True)


def _crests(draw, pairs=1):
    """A body with two crests, one higher by about what it is pressed by: the second touches, or nearly does."""
    height, depth, both = draw.between(0.02, 0.05), draw.decades(-3, -2), (draw.material(), draw.material())
    slope, middle = depth * draw.between(0.0, 1.5), draw.between(0.5, 0.65)

    def make(cells):
        def above(x, y):
            return height * ((x / middle) ** 2 - 1) ** 2 + slope * (1 - x / middle) / 2 + y**2 / 8

        return on_block("body", above, cells, 4, depth, both, [f" {k}" for k in range(pairs)])

    row = f"two crests, {pairs} pair{'s' * (pairs > 1)}"
    return row, _compared(partial(make, 2), partial(make, 4), curved=True, tolerance=0.25)


def _crests_of_pairs(draw):
    """The same, each crest a contact pair of its own."""
    return _crests(draw, pairs=2)


def _beams(draw):
    """A cantilever that bends towards a block."""
    known = {"poisson": draw.between(0.0, 0.4), "thick": draw.between(0.7, 1.5)}
    known |= {"tension": draw.decades(-4, -2)} if draw.count(0, 1) else {}
    known |= {"near": draw.decades(-3, -1)} if draw.count(0, 1) else {}
    return "beam", _compared(partial(beam, draw.between(0.05, 0.75), **known))


def _neighbours(draw):
    """A light plate beside a heavier one, or beside a pressure."""
    known = {"thick": draw.between(0.3, 1.0), "wide": draw.between(2.0, 4.0), "light": draw.decades(-4, -3)}
    known |= {"heavy": 1e-2 * draw.decades(-1, 0)} if draw.count(0, 1) else {"pressure": draw.decades(-3, -1.5)}
    make = partial(on_a_base, **known)
    return "plates on a base", _compared(make, partial(make, cells=4))


def _plates(draw):
    """A plate held at its rim, bent on a stop below its middle."""
    thick, share, wide = draw.between(0.3, 1.0), draw.between(0.0, 0.8), draw.count(1, 3)
    both, poisson = draw.decades(-1, 1), draw.between(0.0, 0.4)
    make = partial(_plate, thick, share, wide, both, poisson)
    return "plate over a stop", _compared(make, partial(make, cells=8))


def _stacks(draw):
    """Blocks one on another."""
    blocks = [draw.material(3.0) for _ in range(draw.count(2, 5))]
    if draw.count(0, 1):
        softest = min(block.young for block in blocks)
        return "stack", stack_pressed(blocks, 0.01 * softest * draw.between(0.1, 1.0))
    gap = draw.between(-1.0, 1.0) * 1e-3
    return "stack", stack_force(blocks, max(0.0, gap * (len(blocks) - 1)) + draw.decades(-4, -2), gap=gap)


def _corners(draw):
    """A cube pressed into a corner."""
    make = partial(corner, draw.decades(-4, -2), tuple(draw.material() for _ in range(3)))
    return "cube in a corner", _compared(make, lambda: swapped(make()))


def _spheres(draw):
    """Spheres, or a punch."""
    if draw.count(0, 1):
        young = draw.decades(-3, 3)
        return "spheres and punches", hertz_force(draw.decades(-6, -2), material(young), material(young))
    known = {"displacement": draw.decades(-5, -1.5), "block": draw.material(), "punch": draw.material(2.0)}
    make = partial(punch, order=6, **known)
    return "spheres and punches", _compared(make, partial(make, coarse=6), curved=True)


def _films(draw):
    """Thin films pressed on each other, one of them loaded."""
    known = {"pressure": draw.decades(-3, -1)} if draw.count(0, 1) else {"weight": draw.decades(-1, 0.5)}
    make = partial(films, order=1, **known)
    return "films", _compared(make, partial(make, cells=4))


def _plate(thick, share, wide, ratio, poisson, cells=4):
    """A quarter of a plate of 8 m that is held at two ends, bent on a stop by a pressure.

    Args:
        thick: height of the plate [m].
        share: gap over the deflection of a beam without the stop [-].
        wide: root cells of the stop, of 4 along the plate's half.
        ratio: of the stop's Young's modulus to the plate's.
        poisson: of both.
        cells: root cells along half of the plate.
    """
    boxes, half = Boxes(1), 4.0
    pressure = 1e-3 * thick**3
    gap = share * pressure * (2 * half) ** 4 / (32 * thick**3)  # clamped ends: p L^4 / (384 E I)
    boxes.add("plate", (0.0, 0.0, 0.0), (half, 2.0, thick), (cells, cells // 2, 1))
    boxes.add("stop", (0.0, 0.0, -1.0), (float(wide), 2.0, 0.0), (wide * cells // 4, cells // 2, 1))

    def place(name, x):
        return x - [0, 0, gap * (name == "stop")]

    below = boxes.facets(DOWN, 0.0, "plate")
    surfaces = {
        "rim": boxes.facets(RIGHT, half, "plate"),
        "load": boxes.facets(UP, thick, "plate"),
        "foot": boxes.facets(DOWN, -1.0, "stop"),
        "head": boxes.facets(UP, 0.0, "stop"),
        "below": below[below[:, 0] % cells < wide * cells // 4],
        "x = 0": boxes.facets(LEFT, 0.0),
        "y = 0": boxes.facets(FRONT, 0.0),
        "y = 2": boxes.facets(BACK, 2.0),
    }
    held = Dirichlet("rim", 0.0, 0.0, 0.0), Dirichlet("foot", 0.0, 0.0, 0.0)
    planes = tuple(map(SymmetryPlane, ("x = 0", "y = 0")))
    return Scene(
        "plate over a stop",
        boxes.mesh(surfaces, place=place),
        {"plate": Material(1.0, poisson), "stop": Material(ratio, poisson)},
        held + planes,
        (ContactPair("below", "head", direction=(0, 0, -1)),),
        (Pressure("load", pressure),),
    )
