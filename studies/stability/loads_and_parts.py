"""Forty scenes of bonded and orthotropic parts, stress-free strains, preloads, springs and rigid faces.

Fourteen of them are drawn at random, with a seed.  Each has a known answer, or a twin: one material, other axes, a
clamp, the motion that a rigid load finds, another mesh.  Two must be refused.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from fx_contact import Material, Orthotropic, RigidLoad
from fx_contact.results.analytic import ShrinkFit
from studies.stability import draws
from studies.stability import load_shapes as shapes
from studies.stability.cases import SHARP, SMOOTH, Case, Exact, Twin
from studies.stability.interface_shapes import prescribed
from studies.stability.shapes import PLAIN


def _line(young):
    """A material that stretches along a line alone."""
    return Material(young, 0.0)


def _layered(heights, moduli, displacement, base=1.0, **more):
    """Bonded layers on a cube: springs in series."""
    force = displacement / (sum(np.divide(heights, moduli)) + 1 / base)
    make = partial(shapes.layers, heights, [*map(_line, moduli)], displacement, base=_line(base), **more)
    return make, Exact(force, displacement, energy=force * displacement, linear=True)


def _compressed(materials, displacement):
    """Blocks of any materials between plates without friction: uniform stress."""
    force = displacement / sum(np.linalg.inv(material.stiffness)[2, 2] for material in materials)
    make = partial(shapes.turned_blocks, materials, displacement)
    return make, Exact(force, displacement, energy=force * displacement, linear=True)


def _lined(materials, interference):
    """A lined tube on a pin: Lame."""
    scene, force = shapes.lined(materials, interference)
    return lambda: scene, Exact(force, interference, unsure=1e-5)


def bonded():
    """Bonded parts: ratios of moduli, thin layers, contact across an interface and beside rubber."""
    yield "E 1e-6", *_layered((1.0, 1.0), (1.0, 1e-6), 0.01)
    yield "soft", *_layered((1.0, 1e-3, 1.0), (1.0, 1e-3, 1.0), 1e-5)
    yield "hard", *_layered((1.0, 1e-3, 1.0), (1.0, 1e3, 1.0), 0.01)
    known = Exact(0.01 * (1 + 1e6), 0.01, energy=1e-4 * (1 + 1e6), linear=True)
    yield "across", partial(shapes.across, (_line(1.0), _line(1e6)), 0.01), known
    make = partial(shapes.over_a_joint, (PLAIN, Material(100.0, 0.3)))
    yield "joint", partial(make, False), Twin(partial(make, True), **SHARP), 0.25
    yield "lining", *_lined((Material(0.1, 0.4999), PLAIN), 1e-3)
    make = partial(shapes.coated, 0.3, (PLAIN, PLAIN), place=(0.2, 0.1))
    yield "alike", make, Twin(partial(make, parts=False)), 0.25


def orthotropic():
    """Orthotropic parts: ratios of moduli to 1000, oblique axes, the constants of an isotropic one."""
    fibres = Orthotropic((1e3, 1.0, 10.0), (0.3, 0.3, 0.02), (5.0, 5.0, 0.8), ((1, 2, 3), (3, 0, -1)))
    other = Orthotropic((1.0, 1e3, 1.0), (1e-4, 0.2, 0.3), (0.5, 0.4, 5.0), ((1, -1, 1), (1, 1, 0)))
    yield "two", *_compressed((fibres, other), 0.01)
    like = Orthotropic((3.0, 3.0, 3.0), (0.3, 0.3, 0.3), (3 / 2.6,) * 3, ((1, 2, 3), (3, 0, -1)))
    make, place = partial(shapes.coated, 0.3), {"place": (0.3, -0.2)}
    yield (
        "like",
        partial(make, (PLAIN, like), **place),
        Twin(partial(make, (PLAIN, Material(3.0, 0.3)), **place)),
        0.25,
    )
    wood = Orthotropic((30.0, 1.0, 1.0), (0.3, 0.3, 0.3), (2.0, 2.0, 0.4), ((1, 2, 3), (3, 0, -1)))
    about_z = replace(wood, axes=((-2, 1, 3), (0, 3, -1)))
    twin = Twin(partial(make, (PLAIN, about_z), place=(0.2, 0.3)))
    yield "turned", partial(make, (PLAIN, wood), **place), twin, 0.25


def strains():
    """Stress-free strains: free, restrained by contact, beside large expansions, of bonded layers, of rings."""
    tensor = ((0.01, 0.004, -0.002), (0.004, -0.02, 0.003), (-0.002, 0.003, 0.005))
    yield "free", partial(shapes.free_block, tensor), Exact(energy=0.0, linear=True)
    for value, strain, share, poisson in (("gap", 1e-3, 0.5, 0.4995), ("close", 1e-2, 1 - 1e-6, 0.3)):
        gap = 2 * strain * share
        force = strain - gap / 2
        known = Exact(force, 2 * force, energy=2 * force**2, linear=True)
        yield value, partial(shapes.heated_bar, strain, gap, Material(1.0, poisson)), known
    scene, energy = shapes.bimetal((1.0, 10.0), (1e-4, -2e-4))
    yield "bimetal", lambda: scene, Exact(energy=energy)
    # Errors are relative to e omega_0 at least: 0.02 of the stress of full restraint.
    yield "fit", *_fitted((1.0, 1.5, 2.5), 1e-4, 0.01, (PLAIN, Material(3.0, 0.2))), 0.02


def _fitted(radii, misfit, expansion, materials):
    """Rings that expand alike but for a misfit: Lame."""
    pressure = ShrinkFit(radii, misfit * radii[1], *materials).pressure
    make = partial(shapes.fitted, radii, (expansion + misfit / 2, expansion - misfit / 2), materials)
    return make, Exact(pressure * 2 * np.pi * radii[1] * 0.5, misfit * radii[1], unsure=1e-5)


def preloads():
    """Preloaded bolts, softer and stiffer than what they clamp, and below a working load."""
    for value, young, tension in (("soft", 1e-3, 1e-5), ("stiff", 1e3, 2e-3)):
        yield value, *_tightened((young,), 1.0, (tension,))
    closing, pull, sleeve = 2e-3, 1e-3, 10.0
    raised = (pull - closing) / (sleeve + 1)  # two bolts of stiffness 1/2
    force, tension = -raised * sleeve, (raised + closing) / 2
    known = Exact(force, -raised, energy=force**2 / sleeve + 4 * tension**2, unsure=1e-5, linear=True)
    make = partial(shapes.bolted, (1.0, 1.0), sleeve, (None, None), closing, pull)
    yield "pulled", make, known


def _tightened(bolts, sleeve, tensions):
    """Bolts below tensions, by statics; the cap is 1e6 times as stiff."""
    force = sum(tensions)
    energy = force**2 / sleeve + sum(2 * tension**2 / young for tension, young in zip(tensions, bolts))
    make = partial(shapes.bolted, bolts, sleeve, tensions)
    return make, Exact(force, force / sleeve, energy=energy, unsure=1e-5, linear=True)


def springs():
    """Elastic supports, soft and stiff; beyond what double precision holds; as a clamp."""
    for value, stiffness in (("1e-9", 1e-9), ("1e9", 1e9)):
        yield value, *_sprung((1.0, 1.0), stiffness, 0.01)
    yield "1e12", partial(shapes.on_springs, (1.0, 1.0), 1e12, 0.01), None
    make = partial(shapes.coated, 0.3, (PLAIN, Material(3.0, 0.3)))
    yield "clamp", lambda: shapes.bedded(make(), 1e9, "block bottom"), Twin(make), 0.25


def _sprung(moduli, below, displacement, beside=None, gap=0.0):
    """Cubes on springs, in series and side by side."""
    lower, upper = moduli
    onward = 1 / (1 / lower + 1 / below)
    all_below = onward + (beside or 0.0)
    force = (displacement - gap) / (1 / upper + 1 / all_below)
    energy = force**2 / upper + (onward * force / all_below) ** 2 / lower
    make = partial(shapes.on_springs, moduli, below, displacement, beside, gap)
    return make, Exact(force, displacement - gap, energy=energy, linear=True)


def rigid_faces():
    """Rigid loads: slender bending, a point of reference far away, beside contact; and one that pulls off."""
    moment, length = 1e-6, 300.0
    load = RigidLoad("bar top", moment=(moment, 0.0, 0.0))
    yield "bent", partial(shapes.rod, length, load, _line(1.0)), Exact(energy=12 * length * moment**2)
    load = RigidLoad("bar top", (0.0, 0.0, 1e-3), point=(0.5, 0.5, 1e6))
    known = Exact(energy=4 * 1e-3**2, linear=True)
    yield "far", partial(shapes.rod, 4.0, load, _line(1.0), (2, 2, 4)), known
    force, moment = 1e-2, 1e-3
    known = Exact(force, force, energy=force**2 + 12 * moment**2)
    yield "pressed", partial(shapes.rocking, force, moment), known
    yield "pulled", partial(shapes.rocking, -force, 0.0), None


def _layers(rng):
    """Two to four bonded layers, down to 1:1000, of any moduli; the softest one is strained by up to 1 %."""
    count = draws.count(rng, 2, 4)
    heights, moduli = ([draws.decades(rng, low, high) for _ in range(count)] for low, high in ((-3, 0), (-3, 3)))
    base = draws.decades(rng, -3, 3)
    pressure = min(*moduli, base) * draws.decades(rng, -4, -2)
    displacement = pressure * (sum(np.divide(heights, moduli)) + 1 / base)
    return (
        *_layered(heights, moduli, displacement, base, cells=(draws.count(rng, 1, 3), draws.count(rng, 2, 4))),
        0.16,
    )


def _coat(rng):
    """A rigid sphere on a coated block, at any place."""
    core, ratio = draws.material(rng), draws.decades(rng, -2, 2)
    coating = Material(core.young * ratio, rng.uniform(0.0, 0.45))
    known = {"place": tuple(rng.uniform(-0.5, 0.5, 2)), "depth": draws.decades(rng, -3, -2)}
    known |= {"radius": draws.decades(rng, -0.3, 0.5)}
    make = partial(shapes.coated, rng.uniform(0.05, 0.4), (core, coating), **known)
    return partial(make, 2), Twin(partial(make, 3), **SMOOTH, curved=True, each=True), 0.25


def _ortho(rng):
    """Two orthotropic blocks whose axes have any directions, moduli to 1:1000."""
    both = []
    for _ in range(2):
        young = [draws.decades(rng, -1.5, 1.5) for _ in range(3)]
        pairs = (0, 1), (0, 2), (1, 2)
        poisson = [rng.uniform(0.0, 0.3) * np.sqrt(young[i] / young[j]) for i, j in pairs]
        shear = [np.sqrt(young[i] * young[j]) / 2.6 * draws.decades(rng, -0.3, 0.3) for i, j in pairs]
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        both.append(Orthotropic(young, poisson, shear, (axes[:, 0].tolist(), axes[:, 1].tolist())))
    return *_compressed(both, draws.decades(rng, -4, -2)), 0.16


def _heat(rng):
    """Rings of any radii that expand by up to 1 % and differ by up to 0.1 %."""
    middle = 1 + rng.uniform(0.3, 1.0)
    radii = 1.0, middle, middle + rng.uniform(0.3, 1.0)
    both = draws.material(rng, 2.0), draws.material(rng, 2.0)
    return (
        *_fitted(
            radii, draws.decades(rng, -5, -3), draws.decades(rng, -4, -2) * (2 * draws.count(rng, 0, 1) - 1), both
        ),
        0.16,
    )


def _bolt(rng):
    """Two bolts of any moduli, strained by up to 1 %, beside a sleeve."""
    bolts, sleeve = [draws.decades(rng, -2, 2) for _ in range(2)], draws.decades(rng, -1, 1)
    tensions = [min(young, sleeve) * draws.decades(rng, -4, -2) for young in bolts]
    return *_tightened(tuple(bolts), sleeve, tuple(tensions)), 0.16


def _spring(rng):
    """Cubes of any moduli on springs of any stiffness, also beside contact, behind a gap."""
    moduli = draws.decades(rng, -3, 3), draws.decades(rng, -3, 3)
    below, beside = (draws.decades(rng, -5, 5) * moduli[0] for _ in range(2))
    displacement = draws.decades(rng, -4, -2)
    return *_sprung(moduli, below, displacement, beside, displacement * rng.uniform(0.0, 0.5)), 0.16


def _rigid(rng):
    """A bar below a force and a moment of any directions, about any point, to 1000 m away."""
    length, poisson = rng.uniform(3.0, 30.0), rng.uniform(0.0, 0.4)
    force = rng.normal(size=3) * 2.5e-4 / length**2
    moment = rng.normal(size=3) * 1e-4 / length
    point = np.array([0.5, 0.5, length]) + rng.normal(size=3) * draws.decades(rng, -1, 3)
    moment += np.cross([0.5, 0.5, length] - point, force)
    load = RigidLoad("bar top", *(tuple(vector.tolist()) for vector in (force, moment, point)))
    make = partial(shapes.rod, length, load, Material(1.0, poisson), (1, 1, draws.count(rng, 3, 8)))
    return make, Twin(partial(prescribed, make, 0.05), held=True, **SHARP), 0.25


#: Rows with their axes; each scene is a value, what makes it, what is known and its tolerance, 0.16 if none is given.
ROWS = {
    "bonded": ("parts", bonded),
    "orthotropic": ("parts", orthotropic),
    "strains": ("loads", strains),
    "preload": ("loads", preloads),
    "springs": ("loads", springs),
    "rigid faces": ("loads", rigid_faces),
}
#: Families whose numbers are drawn at random, with their rows.
DRAWN = dict.fromkeys((_layers, _coat, _ortho), "parts") | dict.fromkeys((_heat, _bolt, _spring, _rigid), "loads")


def loads_and_parts():
    """Yields Case, all of this module; two of each drawn family."""
    for row, (axis, listed) in ROWS.items():
        for what in listed():
            yield Case(axis, row, *what)
    for family, k, what in draws.draw(2126, 2, DRAWN):
        yield Case("drawn loads", DRAWN[family], f"{family.__name__[1:]} {k}", *what)
