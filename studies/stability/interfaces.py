"""Sixty scenes of surfaces meshed apart, rigid obstacles and ties; twenty of them are drawn at random, with a seed.

Each has a known answer, or a twin without what it tests: surfaces meshed alike, a stiff body, one mesh, an obstacle
that is moved to where the force has moved it.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from fx_contact import ContactPair, Material, RigidCone, RigidPlane, RigidSphere, Tie
from fx_contact.results.analytic import Hertz
from studies.nonmatching.accuracy import spheres
from studies.stability import draws
from studies.stability import interface_shapes as shapes
from studies.stability.cases import SHARP, SMOOTH, Case, Exact, Twin, exponent
from studies.stability.shapes import PLAIN, UP, bump

#: Modulus of a body as good as rigid.
RIGID = Material(1e6, 0.3)


def _compressed(upper, lower, displacement=0.01, **more):
    """Cubes between plates: a uniform pressure."""
    upper_material, lower_material = more.get("materials", (PLAIN, PLAIN))
    force = displacement / (1 / upper_material.young + 1 / lower_material.young)
    return partial(shapes.cubes, upper, lower, displacement=displacement, **more), Exact(
        force, displacement, linear=True
    )


def apart():
    """Surfaces meshed apart: ratios of sizes, slivers, curved surfaces, partial cover, bodies held by contact alone."""
    axis, hard = "meshed apart", Material(1e3, 0.3)
    for n, m in ((3, 4), (1, 4), (1, 10)):
        yield Case(axis, "blocks", f"{n}:{m}", *_compressed((n, n), (m, m), materials=(Material(3.0, 0.1), PLAIN)))
    for n, m in ((1, 4), (1, 10)):  # the stiffer body has the smaller facets: rows are on the larger ones
        yield Case(axis, "blocks", f"{n}:{m} hard", *_compressed((n, n), (m, m), materials=(PLAIN, hard)))
    edge = Twin(partial(shapes.overhanging, 0.5, matched=True), **SHARP)
    for sliver in (1e-14, -1e-14, 1e-10, 1e-4):
        value = f"edge {'-' * (sliver < 0)}{exponent(abs(sliver))}"
        make = partial(shapes.overhanging, 0.5 + sliver)
        yield Case(axis, "slivers", value, make, edge, tolerance=0.25)
    for moved in (1e-14, 1e-10, 1e-4):
        yield Case(axis, "slivers", f"node {exponent(moved)}", *_compressed((4, 3), (4, 2), moved=moved))
    known = Twin(partial(bump, 4, 0.2), curved=True, **SMOOTH)
    for block, body in ((2, 3), (5, 2)):
        yield Case(
            axis, "curved", f"bump {block}:{body}", partial(bump, block, 0.2, other=body), known, tolerance=0.25
        )
    yield Case(
        axis, "curved", "ball", partial(shapes.ball_on_plate, 1e-3), _hertz(1e-3, PLAIN.plane_strain_modulus / 2)
    )
    pressed = _hollow(25.0 * 20**3 / (40**3 - 20**3) * (40**3 / 30**3 - 1))
    yield Case(axis, "curved", "shells", partial(spheres, 2, 3), pressed)
    interference = _hollow(0.01 / (_swelling(30, 40) + _shrinking(20, 30)))
    yield Case(axis, "curved", "shells shrunk", partial(spheres, 3, 2, -0.01), interference)
    for covered in (0.6, 1 / 3):
        make = partial(shapes.overhanging, covered, (3, 2), (4, 3))
        twin = Twin(partial(shapes.overhanging, covered, matched=True), **SHARP)
        yield Case(axis, "cover", f"edge {covered:.2g}", make, twin, tolerance=0.25)
    for ratio in (0.1, 10.0):
        make = partial(shapes.receding, ratio, (11, 3))
        twin = Twin(partial(shapes.receding, ratio), **SHARP)
        yield Case(axis, "cover", f"receding {ratio:g}", make, twin, tolerance=0.25)
    for cube, walls, ratio in ((2, 3, 1.0), (3, 2, 1e3)):
        make = partial(shapes.groove, cube, walls, ratio)
        known = Exact(1e-3 / np.sqrt(2), 1.0, linear=True)  # by statics
        yield Case(axis, "cover", f"groove {cube}:{walls}", make, known, tolerance=0.25)


def _hertz(depth, modulus):
    """A ball of radius 1 pressed on a block 1 m high, neither of them a half-space: off by about a / (1 m)."""
    force = 4 / 3 * modulus * depth**1.5
    size = Hertz(1.0, modulus, force).contact_radius
    return Exact(force * (1 + size), depth, curved=True, unsure=size)


def _hollow(pressure):
    """An octant of nested hollow spheres by their pressure at r = 30; their surfaces are of order 6."""
    return Exact(pressure * 4 * np.pi * 30**2 / 8, 1.0, unsure=1e-5)


def _swelling(inner, outer, young=2000.0, nu=0.3):
    """Lame: displacement of a hollow sphere's inside by a unit pressure there."""
    return inner / young * ((1 - 2 * nu) * inner**3 + (1 + nu) / 2 * outer**3) / (outer**3 - inner**3)


def _shrinking(inner, outer, young=2000.0, nu=0.3):
    """Lame: displacement of a hollow sphere's outside by a unit pressure there."""
    return outer / young * ((1 - 2 * nu) * outer**3 + (1 + nu) / 2 * inner**3) / (outer**3 - inner**3)


def obstacles():
    """Rigid obstacles, moved and below a force."""
    axis, force = "obstacles", 0.04
    roof, floor = RigidPlane((5.0, 0.0, 0.3), (0.0, 0.0, -2.0)), RigidPlane((0.0, 0.0, -1.0), UP)
    make = partial(shapes.below, roof, moved=(0.0, 0.0, -0.31))
    yield Case(axis, "planes", "moved", make, Exact(force, 0.01, linear=True))
    between = {"supported": False, "more": (ContactPair("block bottom", floor),), "force": (0.0, 0.0, -force)}
    stored = Exact(energy=force**2 / 4, linear=True)  # F^2 h / (E A)
    yield Case(axis, "planes", "force", partial(shapes.below, roof, **between), stored)
    six = Exact(6 * 5e-4 * 2 / (1 - 2 * 0.3), 5e-4, linear=True)  # 3 K strain each
    yield Case(axis, "planes", "six", partial(shapes.squeezed, -5e-4), six)
    stiff = Twin(partial(bump, 4, 0.2, materials=(RIGID, PLAIN)), curved=True, **SMOOTH)
    yield Case(axis, "planes", "bump", shapes.bump_on_plane, stiff, tolerance=0.25)
    sphere, modulus = RigidSphere((0.0, 0.0, 1.0), 1.0), PLAIN.plane_strain_modulus
    make = partial(shapes.below, sphere, 3, moved=(0.0, 0.0, -1e-3), direction=UP)
    yield Case(axis, "round", "sphere", make, _hertz(1e-3, modulus))
    for force in (1e-4, 4e-3):
        make = partial(shapes.below, sphere, 3, force=(0.0, 0.0, -force))
        twin = Twin(partial(shapes.prescribed, make, 0.05), curved=True, **SHARP)
        yield Case(axis, "round", f"force {exponent(force)}", make, twin, tolerance=0.1)
    # Lame: u = p (1 + nu) / E ((1 - 2 nu) a^2 + b^2) a / (b^2 - a^2)
    pressure = 1e-3 / 1.3 * 3 / (0.4 + 4)
    yield Case(
        axis, "round", "pin", partial(shapes.shrunk, 1e-3), Exact(pressure * 2 * np.pi * 0.25, 1e-3, unsure=1e-5)
    )
    slope = np.tan(np.radians(86.0))  # Love: F = 2 E* tan(angle) d^2 / pi, a = 2 d tan(angle) / pi
    size = 2 / np.pi * slope * 1e-3
    known = Exact(size * modulus * 1e-3 * (1 + size), 1e-3, curved=True, unsure=size)
    make = partial(shapes.below, RigidCone((0.0, 0.0, 0.0), UP, 86.0), 3, moved=(0.0, 0.0, -1e-3), direction=UP)
    yield Case(axis, "round", "cone", make, known)


def ties():
    """Parts meshed apart that are tied, alone and beside contact; the tolerance is 0.25 if no other one is given."""
    for ratio, cells in ((50.0, (2, 3)), (1e4, (4, 1))):
        both = Material(1.0, 0.0), Material(ratio, 0.0)
        stored = Exact(energy=1e-3**2 * 2 * (1 + 1 / ratio), linear=True)  # springs in series
        yield f"E {exponent(ratio)}", partial(shapes.bar, cells, (1e-3, 0.0, 0.0), both), stored
    whole, halves = partial(shapes.bar, (2,)), partial(shapes.bar, (2, 3))
    load = 1e-4, 1e-4, 2e-4
    yield "bent", partial(halves, load), Twin(partial(whole, load), **SHARP)
    load = 0.0, 1e-4, -2e-4
    yield "stop", partial(halves, load, gap=0.02), Twin(partial(whole, load, gap=0.02), **SHARP)
    yield "bracket", partial(shapes.bracket, True), Twin(partial(shapes.bracket, False), **SHARP)
    yield "stamp", partial(shapes.stamp, (3, 4, 2)), Twin(partial(shapes.stamp, None), **SHARP)
    moduli = 1.0, 10.0, 3.0, 30.0
    stored = Exact(energy=sum(0.01**2 / young for young in moduli), linear=True)
    yield "layers", partial(shapes.layers, moduli, 0.01), stored

    def tied_spheres():
        return replace(spheres(2, 3), contact=(), ties=(Tie("inner outside", "outer inside"),))

    energy = 25.0**2 * _swelling(20, 40) * 4 * np.pi * 20**2 / 8
    yield "shells", tied_spheres, Exact(energy=energy, unsure=1e-5), 0.16


def drawn_apart():
    """Cases, four of each family, whose numbers are drawn at random."""
    families = _blocks, _edge, _round, _obstacle, _tied
    return (Case("drawn apart", row, str(k), *what) for _, k, (row, *what) in draws.draw(2050, 4, families))


def _blocks(rng):
    """Blocks of any moduli with ratios of sizes up to 10, one mesh twisted."""
    both, few, more = (
        (draws.material(rng, 3.0), draws.material(rng, 3.0)),
        draws.count(rng, 1, 3),
        draws.decades(rng, 0.0, 1.0),
    )
    here, there = draws.count(rng, 1, 4), draws.count(rng, 2, 6)
    cells = (few, here), (min(10, round(few * more)), there + (there == here))
    upper, lower = cells[:: 1 if draws.count(rng, 0, 1) else -1]
    known = {"materials": both, "twist": rng.uniform(0.0, 40.0)}
    return "blocks", *_compressed(upper, lower, draws.decades(rng, -4, -2), **known)


def _edge(rng):
    """A block over the edge of another one."""
    covered, both = rng.uniform(0.2, 0.9), (draws.material(rng), draws.material(rng))
    cells = [(draws.count(rng, 2, 5), draws.count(rng, 2, 4)) for _ in both]
    twin = partial(shapes.overhanging, covered, materials=both, matched=True)
    return "edge", *draws.compared(partial(shapes.overhanging, covered, *cells, both), twin, SHARP)


def _round(rng):
    """A body of two curvatures on a block; its pole is anywhere."""
    scene, cells, other = draws.round_body(rng, -3), draws.count(rng, 2, 5), draws.count(rng, 2, 4)
    apart = partial(scene, cells=cells, other=other + (other == cells))
    return "round body", *draws.compared(apart, partial(scene, cells=4), curved=True)


def _obstacle(rng):
    """A rigid sphere on a block, at any place, moved or below a force."""
    x, y, radius, depth = *rng.uniform(-0.5, 0.5, 2), draws.decades(rng, -0.3, 0.5), draws.decades(rng, -3, -2)
    material, cells = draws.material(rng), draws.count(rng, 2, 3)
    scene = partial(shapes.beneath, RigidSphere((x, y, radius), radius), material=material)
    if draws.count(rng, 0, 1):
        scene = partial(scene, moved=(0.0, 0.0, -depth), direction=UP)
        return "sphere", *draws.compared(partial(scene, cells), partial(scene, cells + 1), SMOOTH, curved=True)
    force = 4 / 3 * material.plane_strain_modulus * radius**0.5 * depth**1.5
    scene = partial(scene, force=(0.0, 0.0, -force))
    twin = partial(shapes.prescribed, partial(scene, cells + 1))
    return "sphere", *draws.compared(partial(scene, cells), twin, SMOOTH, curved=True)


def _tied(rng):
    """A stamp anywhere on a base of two tied layers."""
    place, height = tuple(rng.uniform(0.2, 0.8, 2)), rng.uniform(0.5, 1.5)
    cells = draws.count(rng, 2, 4), draws.count(rng, 2, 4), draws.count(rng, 1, 3)
    known = {
        "depth": draws.decades(rng, -4, -2),
        "place": place,
        "materials": (draws.material(rng), draws.material(rng)),
    }
    scene = partial(shapes.stamp, cells, height=height, **known)
    return "tied base", *draws.compared(scene, partial(shapes.stamp, None, **known), SHARP)


def interfaces():
    """Yields Case, all of this module."""
    yield from apart()
    yield from obstacles()
    for value, make, known, *tolerance in ties():
        yield Case("ties", "tied", value, make, known, *(tolerance or [0.25]))
    yield from drawn_apart()
