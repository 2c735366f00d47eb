"""The scenes of the stress matrix: each axis of stress, what it stresses, and what the answer must be."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from fx_contact import BodyForce, Enforcement, Material
from fx_contact.geometry.shapes import rotation
from fx_contact.results.analytic import Hertz
from fx_contact.scenes import indentation, punch, stack
from studies.stability.cases import SHARP, SMOOTH, Case, Exact, Twin, exponent
from studies.stability.drawn import drawn
from studies.stability.interfaces import interfaces
from studies.stability.loads_and_parts import loads_and_parts
from studies.stability.references import HERTZ_A, hertz, hertz_force, punch_force, stack_force, stack_pressed
from studies.stability.shapes import (
    PLAIN,
    all_held,
    beam,
    bump,
    clamped,
    corner,
    films,
    in_two,
    oblique,
    on_a_base,
    ring,
    sheared_nodes,
    waves,
    without,
)
from studies.stability.twins import scaled, swapped, turned

material = partial(Material, poisson=0.3)
UNLIKE = [PLAIN, material(3.0)]
#: Twins whose penalty errs otherwise.
OTHER_CONTACT = {"same_contact": False, "curved": True}


def changed(make, *changes):
    """What makes a scene and changes it."""

    def made():
        scene = make()
        for change in changes:
            scene = change(scene)
        return scene

    return made


def units_of(length, stress):
    """What a twin in other units has, as keyword arguments of Twin."""
    return {"force": stress * length**2, "energy": stress * length**3, "pressure": stress}


def in_units(make, length, stress=1.0):
    """The twin of a scene in other units."""
    return Twin(changed(make, partial(scaled, length=length, stress=stress)), **units_of(length, stress))


def enforcements():
    """Enforcement and its factor; families: round, flat, flat and unlike, round and loaded by force."""
    by_force = partial(punch, force=1e-3)
    families = {
        "spheres": (partial(hertz, 1.0, 0.01), HERTZ_A),
        "stack": stack_force([PLAIN] * 2),
        "stack 1 : 1000": stack_force([PLAIN, material(1e3)]),
        "punch by force": (by_force, Twin(by_force, **OTHER_CONTACT)),
    }
    for family, what in families.items():
        yield Case("penalty factor", family, "exact", *what, enforcement=Enforcement("exact"))
    for (family, what), factor in product(families.items(), [10.0**n for n in range(13)]):
        penalty = Enforcement("penalty", factor)
        soft = factor <= 10  # a run may find it too soft for the tolerance
        yield Case("penalty factor", family, exponent(factor), *what, enforcement=penalty, may_refuse=soft)


def ratios():
    """Stiffness ratio of the bodies: of two, of the middle one of three, of punch and block, of two spheres."""
    for ratio in [10.0**n for n in range(-6, 7)]:
        other, value = material(ratio), exponent(ratio)
        yield Case("stiffness ratio", "2 blocks", value, *stack_force([PLAIN, other]))
        yield Case("stiffness ratio", "3 blocks", value, *stack_force([PLAIN, other, PLAIN]))
        make = partial(punch, punch=other)
        twin = Twin(changed(make, swapped), **OTHER_CONTACT)
        yield Case("stiffness ratio", "punch, swapped", value, make, twin)
        yield Case("stiffness ratio", "spheres", value, *hertz_force(1e-3, PLAIN, other))


def compressibility():
    """Poisson's ratio up to nearly incompressible."""
    for poisson in (0.0, 0.2, 0.4, 0.45, 0.49, 0.499, 0.4999, 0.49999):
        both, value = Material(1.0, poisson), f"{poisson:g}"
        yield Case("Poisson", "spheres", value, *hertz_force(1e-3, both, both))
        yield Case("Poisson", "3 blocks", value, *stack_force([PLAIN, both, both]))
        for name, make, curved in (
            ("punch, finer", partial(punch, block=both, punch=both), True),
            ("indentation, finer", partial(indentation, block=both, cube=Material(100.0, poisson)), False),
        ):
            yield Case("Poisson", name, value, make, Twin(make, **SMOOTH, curved=curved), tolerance=0.25)
        for name, height, meshes, closer in (
            ("clamped, flat", 0.1, ((4, 4, 1), (12, 12, 4)), 0.5),  # 0.3 takes 60,000 unknowns at 0.49
            ("clamped, tall", 5.0, ((1, 1, 6), (2, 2, 12)), 0.3),
        ):
            blocks = partial(stack, [both, Material(3.0, poisson)], height=height)
            make, twin = (changed(partial(blocks, cells=c), clamped) for c in meshes)
            known = Twin(twin, **SMOOTH | {"tolerance": closer})
            yield Case("Poisson", name, value, make, known, tolerance=0.25)


def aspects():
    """Aspect of the cells, flat and tall."""
    for aspect in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0):
        yield Case("aspect", "blocks", f"{aspect:g}", *stack_force(UNLIKE, 1e-4, height=aspect))
    cubes = {0.01: (1, 200), 0.03: (1, 66), 0.1: (2, 40), 1.0: (4, 8), 10.0: (10, 2), 30.0: (15, 1), 100.0: (50, 1)}
    for aspect, (wide, high) in cubes.items():
        make, twin = (changed(partial(stack, UNLIKE, cells=c), clamped) for c in ((wide, wide, high), (4, 4, 8)))
        yield Case("aspect", "clamped, cubes", f"{aspect:g}", make, Twin(twin, **SMOOTH), tolerance=0.25)


def degenerate():
    """Cells close to degenerate: inner nodes moved to one side, punches as wide as their sphere."""
    blocks = partial(stack, UNLIKE, order=2)
    for axes, name in (((2,), "nodes moved along z"), ((0, 1, 2), "nodes moved along x, y, z")):
        for amount in (0.5, 0.9, 0.99, 0.999, 0.9999):
            make = changed(blocks, clamped, partial(sheared_nodes, amount=amount, axes=list(axes)))
            twin = Twin(lambda: clamped(stack(UNLIKE)), **SMOOTH)
            if ((1 - amount) / (1 + amount)) ** len(axes) < 1e-8:  # the Jacobian determinant: degenerate by contract
                twin = None
            yield Case("degenerate cells", name, f"{amount:g}", make, twin, tolerance=0.25)
    for side in (1.0, 1.2, 1.3, 1.38, 1.41, 1.414):
        make = partial(punch, side=side, order=4)
        twin = Twin(changed(make, swapped), **OTHER_CONTACT)
        yield Case("degenerate cells", "steep punch, swapped", f"{side:g}", make, twin)


def depths():
    """Approach relative to the radius, and with it the contact radius and the levels that it takes."""
    for depth in [*(10.0**n for n in range(-8, 0)), 0.3]:
        value = exponent(depth)
        make = partial(hertz, 1.0, depth)
        spheres = hertz_force(depth) if depth <= 0.08 else (make, in_units(make, 1e-3))
        yield Case("approach", "spheres, order 6", value, *spheres)
        if depth <= 0.01:
            make, known = hertz_force(depth, order=3)
            # The poles of order 3 leave the sphere by 1.4e-7 R where 1e-6 R is pressed: refused, as too coarse.
            yield Case("approach", "spheres, order 3", value, make, known if depth > 1e-5 else None)
        make = partial(punch, displacement=depth)
        pressed = make, Twin(changed(make, swapped), **OTHER_CONTACT)
        yield Case("approach", "punch", value, *(punch_force(depth, order=6) if depth <= 1e-3 else pressed))
        # Without a gap forces are proportional to displacements.
        make, factor = partial(indentation, displacement=depth), 0.01 / depth
        twin = Twin(indentation, force=factor, energy=factor**2, pressure=factor)
        if factor == 1.0:  # of itself
            twin = Twin(indentation, **SMOOTH)
        yield Case("approach", "indentation", value, make, twin, tolerance=0.2)


def units():
    """Units of length and stress from nano to giga."""
    for length, young in product((1e-9, 1e-6, 1e-3, 1.0, 1e3), (1e-6, 1e-3, 1.0, 1e6, 1e12)):
        if length == young == 1:
            continue
        make = partial(hertz, length, 0.01 * length, material(young), order=2, coarse=2)
        twin = Twin(partial(hertz, 1.0, 0.01, order=2, coarse=2), **units_of(1 / length, 1 / young))
        yield Case("units E", f"spheres, L = {exponent(length)}", exponent(young), make, twin)
    for length, young in product((1e-9, 1e3), (1e-6, 1.0, 1e12)):
        make = partial(punch, length, force=1e-3 * young * length**2, block=material(young), punch=material(young))
        twin = Twin(partial(punch, force=1e-3), **units_of(1 / length, 1 / young))
        yield Case("units E", f"punch by force, L = {exponent(length)}", exponent(young), make, twin)


def grading():
    """Meshes of 8 levels and more."""
    for depth in (1e-4, 1e-5, 1e-6):
        value = exponent(depth)
        yield Case("8 levels", "spheres, 2 root cells", value, *hertz_force(depth, coarse=2))
        if depth >= 1e-5:  # below, two cells of order 6 are not round enough
            yield Case("8 levels", "punch, 2 root cells", value, *punch_force(depth, order=6, coarse=2))


def many_bodies():
    """Stacks, loaded by displacement and by pressure, and a cube in a corner."""
    for count in (2, 3, 4, 6, 8, 12):
        bodies = [Material(10.0 ** (n % 3), 0.1 * (n % 4)) for n in range(count)]
        yield Case("bodies", "stack", str(count), *stack_force(bodies))
        yield Case("bodies", "stack by pressure", str(count), *stack_pressed(bodies, 0.01))
    third, unlike = rotation((1, 1, 1), 120), [PLAIN, material(10.0), Material(100.0, 0.0)]
    for name, make in (("alike", corner), ("unlike", partial(corner, materials=unlike))):
        for change, label in ((swapped, "swapped"), (partial(turned, rotation=third), "turned")):
            twin = Twin(changed(make, change))
            yield Case("bodies", "cube in a corner, 3 pairs", f"{name}, {label}", make, twin, tolerance=0.25)


def tilts():
    """No axis is special: planes of contact in any direction, conditions on any axis."""

    def along_normals(scene):
        return replace(scene, contact=tuple(replace(pair, direction=None) for pair in scene.contact))

    families = {
        "punch": lambda: clamped(punch()),
        "blocks": lambda: clamped(stack(UNLIKE)),
        "blocks, along normals": lambda: along_normals(clamped(stack(UNLIKE))),
        "spheres": lambda: clamped(hertz(1.0, 0.01, order=2)),
    }
    x, space = "x", (1, 2, 3)
    for family, make in families.items():
        for axis, degrees in ((x, 10), (x, 30), (x, 45), (x, 80), (space, 50), (space, 170)):
            value = f"{degrees} about {'x' if axis == x else '(1,2,3)'}"
            tilted = changed(make, partial(turned, rotation=rotation(axis, degrees)))
            yield Case("tilt", family, value, tilted, Twin(make), tolerance=0.25)
    for degrees in (10, 30, 45):
        make, along = (partial(oblique, degrees, direction) for direction in ((0.0, 0.0, 1.0), None))
        yield Case("tilt", "plane across its direction", str(degrees), make, Twin(along), tolerance=0.25)
    right = {"x to y": np.roll(np.eye(3), 1, axis=0), "x to z": np.roll(np.eye(3), 2, axis=0)}
    right |= {"y down": rotation("x", 90), "upside down": np.diag([-1.0, 1.0, -1.0])}
    for value, turn in right.items():
        for family, make in (("quarter of spheres", partial(hertz, coarse=2)), ("indentation", indentation)):
            yield Case("tilt", family, value, changed(make, partial(turned, rotation=turn)), Twin(make))


def held_by_contact():
    """Bodies that contact alone holds, and bodies that nothing holds."""
    for exponents in range(-8, 0):
        force = 10.0**exponents
        make = partial(punch, force=force, order=6 if force < 1e-4 else 2)
        yield Case("held by contact", "punch by force", exponent(force), make, in_units(make, 1e-3, 1e6))
    for ratio in (1e-6, 1e-3, 1e3, 1e6):
        stacked = stack_pressed([PLAIN, material(ratio), PLAIN], 0.01 * min(ratio, 1.0))  # 1 % of strain
        yield Case("held by contact", "blocks by pressure, ratio", exponent(ratio), *stacked)
    for value, make in {
        "pulled up": partial(punch, force=-1e-3),
        "pulled stack": partial(stack, pressure=-0.01),
        "pushed sideways": lambda: replace(without(punch(), "x = 0"), body_forces=BodyForce("cube", (1e-6, 0, 0))),
    }.items():
        yield Case("held by contact", "nothing holds", value, make, None)
    make, twin = (lambda plane=plane: without(punch(), plane) for plane in ("x = 0", "y = 0"))
    yield Case("held by contact", "nothing holds", "free sideways", make, Twin(twin))
    between = partial(stack, displacement=0.01, gap=0.1)
    yield Case("held by contact", "nothing holds", "block between gaps", between, Exact(force=0.0))


def between_nodes():
    """Contact that root nodes do not see, meshes that know nothing at first, surfaces that meet at their vertices."""
    for depth, pole in ((1e-7, 0.281), (1e-6, 0.137), (1e-5, 0.114), (1e-4, 0.21)):
        radius, modulus = 2.4, PLAIN.plane_strain_modulus / 2
        at = Hertz(radius, modulus, 4 / 3 * modulus * radius**0.5 * depth**1.5)
        # Blocks 1 m high are no half-spaces: their compliance differs by a part of about a / (1 m).
        known = Exact(at.force, depth, curved=True, unsure=at.contact_radius)
        make = partial(bump, 2, pole, depth, radius)
        yield Case("between nodes", f"touch at {pole}", exponent(depth), make, known, tolerance=0.25)
    for pole, displacement in product((0.0, 0.2, 1 / 3), (0.005, 0.01, 0.04)):
        make, twin = (partial(bump, cells, pole, displacement) for cells in (3, 4))
        known = Twin(twin, curved=True, **SMOOTH)
        yield Case("between nodes", f"bump at {pole:.1f}", exponent(displacement), make, known, tolerance=0.25)
    for phase in (0.0, 0.05, 0.25, 0.75):
        make, twin = (partial(waves, phase, cells) for cells in (2, 5))
        known = Twin(twin, curved=True, **SMOOTH | {"tolerance": 0.7})
        yield Case("between nodes", "waves: phase", f"{phase:g}", make, known, tolerance=0.25)
    for cells in ((2, 2, 1), (4, 4, 1)):
        for height in (0.25, 1.0, 5.0):
            blocks = partial(stack, UNLIKE, height=height)
            make, twin = (changed(partial(blocks, cells=c), all_held) for c in (cells, (6, 6, 6)))
            row = f"all held, {cells[0]} x {cells[1]}: height"
            yield Case("between nodes", row, f"{height:g}", make, Twin(twin, **SMOOTH), tolerance=0.2)
    for bodies in (5, 6, 8):
        make = partial(ring, bodies)
        twin = Twin(changed(make, partial(turned, rotation=rotation("z", 37))))
        yield Case("between nodes", "ring, turned", str(bodies), make, twin, tolerance=0.1)
    whole = {"spheres": partial(hertz, coarse=3), "corner": corner, "punch": partial(punch, order=6)}
    for name, make in whole.items():
        yield Case("between nodes", "contact cut in two", name, make, Twin(changed(make, in_two)))


def gaps():
    """Penetration before anything moves, gaps wider than the bodies, and no contact at all."""
    for gap in (-0.1, -1e-2, -1e-4, -1e-6, 1e-6, 1e-2, 1.0, 100.0):
        value = f"{'-' * (gap < 0)}{exponent(abs(gap))}"
        displacement = gap + 0.01 if gap > 0 else 0.0
        yield Case("gap", "stack", value, *stack_force(UNLIKE, displacement, gap=gap))
        if abs(gap) >= 1e-4:
            make = partial(punch, displacement=displacement, gap=gap, order=6)
            twin = Twin(partial(punch, displacement=displacement - gap, order=6))
            yield Case("gap", "punch", value, make, twin)
    for ratio, gap, depth in product((1.0, 1e3), (1.0, 100.0), (1e-3, 1e-4, 1e-5)):
        pressed = partial(punch, order=6, punch=material(ratio))
        make, near = (partial(pressed, displacement=g + depth, gap=g) for g in (gap, 0.0))
        row = f"punch, ratio {exponent(ratio)}, gap {exponent(gap)}: depth"
        yield Case("gap", row, exponent(depth), make, Twin(near))
    nothing = Exact(force=0.0)
    for gap in (0.02, 1.0, 100.0):
        value = exponent(gap)
        yield Case("gap", "blocks apart", value, partial(stack, UNLIKE, 0.01, gap=gap), nothing)
        yield Case("gap", "punch apart", value, partial(punch, displacement=0.01, gap=gap), nothing)
    # Of order 3 they dip below their spheres by 5e-9 of the radius, which would be found.
    yield Case("gap", "spheres apart", "0", partial(hertz, 1.0, 0.0, order=6), nothing)
    yield Case("gap", "spheres apart", "0.01", partial(hertz, 1.0, -0.01), nothing)


def other_loads():
    """Contact beside loads that store more than it does, and of beams that they bend towards it."""
    finer = {"same_mesh": False, "tolerance": 0.5, "each": True}

    def case(row, value, make, twin):
        return Case("other loads", row, value, make, Twin(twin, **finer), tolerance=0.25)

    for ratio in (1.0, 5.0, 20.0, 1e3):
        make = partial(on_a_base, light=1e-4 / ratio, heavy=1e-4)
        yield case("heavier plate beside", f"{ratio:g}", make, partial(make, cells=4))
    for pressure in (0.02, 0.5):
        make = partial(on_a_base, pressure=pressure)
        yield case("pressure beside a plate", f"{pressure:g}", make, partial(make, cells=4))
    for weight in (0.4, 4.0):
        make = partial(films, order=1, weight=weight)
        yield case("weight of a film", f"{weight:g}", make, partial(make, cells=4))
    make = partial(films, 1e-4, pressure=0.1)
    yield case("waves of a film beside a pressure", "1e-4", make, make)  # with other cells they were others
    for closing in (0.0, 0.5, 0.9):
        make = partial(beam, closing)
        yield case("beam, gap over deflection", f"{closing:g}", make, make)
    for closing in (0.8, 0.9):
        for row, known in {
            "in tension, nu = 0.4": {"poisson": 0.4, "tension": 1e-2},
            "over a tapered gap": {"tension": 3e-3, "near": 1e-3},
            "beside a heavy load": {"beside": 0.1},
            "beside a touch": {"tension": 3e-3, "touch": 2e-6},
            "that touches at the wall": {"tension": 3e-3, "near": -8e-7},
            "over a block from afar": {"tension": 3e-3, "near": 1e-3, "afar": 0.05},
        }.items():
            make = partial(beam, closing, **known)
            yield case(f"beam {row}, gap over deflection", f"{closing:g}", make, make)


def orders():
    """Order of the root mesh."""
    for order in range(1, 7):
        value, make = str(order), partial(hertz, 1.0, 0.01, order=order)
        # Of order 1 it is straight-sided: another body than a sphere, which only its twins know.
        yield Case("order", "spheres", value, make, HERTZ_A if order > 1 else in_units(make, 1e3, 1e-3))
        yield Case("order", "stack", value, *stack_force(UNLIKE, order=order))
        twin = Twin(indentation) if order > 1 else Twin(indentation, **SMOOTH)
        yield Case("order", "indentation", value, partial(indentation, order=order), twin, tolerance=0.25)
        if order > 1:
            finer = Twin(partial(punch, order=6), curved=True, **SHARP)
            yield Case("order", "punch", value, partial(punch, order=order), finer)


def cases():
    """All scenes, axis by axis: dict name -> Case."""
    axes = [enforcements, ratios, compressibility, aspects, degenerate, depths, units, grading, many_bodies, tilts]
    axes += [held_by_contact, gaps, between_nodes, other_loads, orders, drawn, interfaces, loads_and_parts]
    listed = [case for axis in axes for case in axis()]
    result = {case.name: case for case in listed}
    if len(result) < len(listed):
        raise ValueError("two scenes have one name")
    return result
