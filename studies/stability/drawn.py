"""Sixty scenes whose numbers are drawn at random, so that no rule of the program is tuned to them.

They ask for what the program promises: the force of each contact pair to the tolerance e of it, or e^2 of the largest.
Each is compared with a known answer, or with a run on other cells to 0.3 of the tolerance.
"""

from functools import partial

from fx_contact import Material
from fx_contact.scenes import punch
from studies.stability import draws
from studies.stability.cases import Case
from studies.stability.references import hertz_force, stack_force, stack_pressed
from studies.stability.shapes import beam, corner, films, on_a_base, on_block, plate_over_a_stop
from studies.stability.twins import swapped


def drawn():
    """Cases, six of each family."""
    families = (
        _round,
        _crests,
        partial(_crests, pairs=2),
        _beam,
        _neighbours,
        _plate,
        _stack,
        _corner,
        _spheres,
        _films,
    )
    return (Case("drawn", row, str(k), *what) for _, k, (row, *what) in draws.draw(2026, 6, families))


def _compared(scene, twin, **how):
    return draws.compared(scene, twin, **{"tolerance": 0.16} | how)


def _round(rng):
    """A body of two curvatures on a block; its pole is anywhere."""
    scene, cells = draws.round_body(rng, -3.5), draws.count(rng, 2, 4)
    return "round body", *_compared(partial(scene, cells=cells), partial(scene, cells=cells + 1), curved=True)


def _crests(rng, pairs=1):
    """A body with two crests, one higher by about what it is pressed by: the second touches, or nearly does."""
    high, depth, both = (
        rng.uniform(0.02, 0.05),
        draws.decades(rng, -3, -2),
        (draws.material(rng), draws.material(rng)),
    )
    slope, middle = depth * rng.uniform(0.0, 1.5), rng.uniform(0.5, 0.65)

    def height(x, y):
        return high * ((x / middle) ** 2 - 1) ** 2 + slope * (1 - x / middle) / 2 + y**2 / 8

    one, other = (partial(on_block, "body", height, n, 4, depth, both, pairs) for n in (2, 4))
    return f"two crests, {pairs} pair{'s' * (pairs > 1)}", *_compared(one, other, curved=True, tolerance=0.25)


def _beam(rng):
    """A cantilever that bends towards a block."""
    known = {"poisson": rng.uniform(0.0, 0.4), "thick": rng.uniform(0.7, 1.5)}
    known |= {"tension": draws.decades(rng, -4, -2)} if draws.count(rng, 0, 1) else {}
    known |= {"near": draws.decades(rng, -3, -1)} if draws.count(rng, 0, 1) else {}
    scene = partial(beam, rng.uniform(0.05, 0.75), **known)
    return "beam", *_compared(scene, scene)


def _neighbours(rng):
    """A light plate beside a heavier one, or beside a pressure."""
    known = {"thick": rng.uniform(0.3, 1.0), "wide": rng.uniform(2.0, 4.0), "light": draws.decades(rng, -4, -3)}
    known |= (
        {"heavy": 1e-2 * draws.decades(rng, -1, 0)}
        if draws.count(rng, 0, 1)
        else {"pressure": draws.decades(rng, -3, -1.5)}
    )
    scene = partial(on_a_base, **known)
    return "plates on a base", *_compared(scene, partial(scene, cells=4))


def _plate(rng):
    """A plate held at its rim, bent on a stop below its middle."""
    thick, share, wide = rng.uniform(0.3, 1.0), rng.uniform(0.0, 0.8), draws.count(rng, 1, 3)
    scene = partial(plate_over_a_stop, thick, share, wide, draws.decades(rng, -1, 1), rng.uniform(0.0, 0.4))
    return "plate over a stop", *_compared(scene, partial(scene, cells=8))


def _stack(rng):
    """Blocks one on another."""
    blocks = [draws.material(rng, 3.0) for _ in range(draws.count(rng, 2, 5))]
    if draws.count(rng, 0, 1):
        softest = min(block.young for block in blocks)
        return "stack", *stack_pressed(blocks, 0.01 * softest * rng.uniform(0.1, 1.0))
    gap = rng.uniform(-1.0, 1.0) * 1e-3
    return "stack", *stack_force(blocks, max(0.0, gap * (len(blocks) - 1)) + draws.decades(rng, -4, -2), gap=gap)


def _corner(rng):
    """A cube pressed into a corner."""
    scene = partial(corner, draws.decades(rng, -4, -2), tuple(draws.material(rng) for _ in range(3)))
    return "cube in a corner", *_compared(scene, lambda: swapped(scene()))


def _spheres(rng):
    """Spheres, or a punch."""
    if draws.count(rng, 0, 1):
        young = draws.decades(rng, -3, 3)
        return "spheres and punches", *hertz_force(draws.decades(rng, -6, -2), *[Material(young, 0.3)] * 2)
    known = {
        "displacement": draws.decades(rng, -5, -1.5),
        "block": draws.material(rng),
        "punch": draws.material(rng, 2.0),
    }
    scene = partial(punch, order=6, **known)
    return "spheres and punches", *_compared(scene, partial(scene, coarse=6), curved=True)


def _films(rng):
    """Thin films pressed on each other, one of them loaded."""
    known = (
        {"pressure": draws.decades(rng, -3, -1)}
        if draws.count(rng, 0, 1)
        else {"weight": draws.decades(rng, -1, 0.5)}
    )
    scene = partial(films, order=1, **known)
    return "films", *_compared(scene, partial(scene, cells=4))
