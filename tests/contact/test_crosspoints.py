"""Contact of surfaces meshed apart where other constraints hold its nodes: conditions, ties, other contacts."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD
from model_problems import gathered

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    RigidPlane,
    Scene,
    SceneError,
    Solver,
    Tie,
    adapt,
    block,
    root_mesh_from_shapes,
)
from fx_contact.parallel.errors import PairingError

pytestmark = pytest.mark.ranks(1, 2, 3)

PRESSURE, POISSON = 0.01, 0.3
#: Of all directions, in bodies under `PRESSURE` on all sides.
STRAIN = -PRESSURE * (1 - 2 * POISSON)
SIDES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
EXACT = {name: lambda x, axis=axis: STRAIN * x[axis] for axis, name in enumerate("xyz")}


def compressed(bodies, contact, ties=(), clamped=(), cut=None):
    """Blocks, by name with corners and cells, under pressure on all sides: u = STRAIN x, and sides at 0 slide.

    All components are prescribed on `clamped` sides.  `cut`: named parts of sides, by a function of position.
    """
    shapes = {name: block(*corners, cells, 1) for name, (*corners, cells) in bodies.items()}
    for name, (body, side, where) in (cut or {}).items():
        shapes[body] = shapes[body].named(name, side, where=where)
    touching = {name for one in (*contact, *ties) for name in one.surfaces}
    held, loads = [Dirichlet(side, **EXACT) for side in clamped], []
    for body, (low, high, _) in bodies.items():
        for side, (axis, end) in SIDES.items():
            name = f"{body} {side}"
            whole = not any(one == body and other == side for one, other, _ in (cut or {}).values())
            if name in touching or name in clamped or not whole:
                continue
            if (low, high)[end][axis] == 0:
                held.append(Dirichlet(name, **{"xyz"[axis]: 0.0}))
            else:
                loads.append(Pressure(name, PRESSURE))
    return Scene(
        "compressed",
        root_mesh_from_shapes(shapes),
        dict.fromkeys(bodies, Material(1.0, POISSON)),
        tuple(held),
        tuple(contact),
        tuple(loads),
        ties=tuple(ties),
    )


def two(upper, lower, clamped=("left", "right", "front", "back")):
    """A block on another one, clamped on sides that the contact meets."""
    bodies = {"upper": ((0, 0, 1), (1, 1, 2), (*upper, 2)), "lower": ((0, 0, 0), (1, 1, 1), (*lower, 2))}
    sides = [f"{body} {side}" for body in bodies for side in clamped]
    return compressed(bodies, [ContactPair("upper bottom", "lower top")], clamped=sides)


def on_support(upper, lower):
    """A block on a part of a larger surface, which is held along the normal around it."""
    bodies = {
        "upper": ((0, 0, 1), (1, 1, 2), (upper, upper, 2)),
        "lower": ((-1, -1, 0), (2, 2, 1), (3 * lower, 3 * lower, 1)),
    }

    def seat(x):
        return (np.abs(x[:2] - 0.5) < 0.51).all(axis=0)

    def beside(x):
        return (np.abs(x[:2] - 0.5) > 0.49).any(axis=0)

    cut = {"seat": ("lower", "top", seat), "support": ("lower", "top", beside)}
    return compressed(bodies, [ContactPair("upper bottom", "lower seat")], clamped=["lower support"], cut=cut)


def tee(base, one, other):
    """Two blocks side by side on a third one, each on a part of its surface, and in contact with each other."""
    bodies = {
        "base": ((0, 0, 0), (2, 1, 1), (2 * base, base, 2)),
        "one": ((0, 0, 1), (1, 1, 2), (one, one, 2)),
        "other": ((1, 0, 1), (2, 1, 2), (other, other, 2)),
    }
    cut = {"west": ("base", "top", lambda x: x[0] < 1.01), "east": ("base", "top", lambda x: x[0] > 0.99)}
    pairs = [("one bottom", "base west"), ("other bottom", "base east"), ("one right", "other left")]
    return compressed(bodies, [ContactPair(*pair) for pair in pairs], cut=cut)


def beside_obstacle(upper, lower):
    """A block of which a half lies on another one, and a half on a rigid plane that comes down with it."""
    bodies = {
        "upper": ((0, 0, 1), (2, 1, 2), (2 * upper, upper, 2)),
        "lower": ((0, 0, 0), (1, 1, 1), (lower, lower, 2)),
    }
    cut = {"west": ("upper", "bottom", lambda x: x[0] < 1.01), "east": ("upper", "bottom", lambda x: x[0] > 0.99)}
    scene = compressed(bodies, [ContactPair("upper west", "lower top")], cut=cut)
    plane = ContactPair("upper east", RigidPlane((0, 0, 1), (0, 0, 1)), moved=(0, 0, STRAIN))
    return replace(scene, contact=(*scene.contact, plane))


def around(counts, tie=False):
    """Four blocks around an edge, in contact, or two of them glued."""
    lows = (0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1)
    bodies = {name: (low, tuple(np.add(low, 1)), (n, n, n)) for name, low, n in zip("abcd", lows, counts)}
    pairs = [("a right", "b left"), ("c right", "d left"), ("a top", "c bottom"), ("b top", "d bottom")]
    contact = [ContactPair(*pair) for pair in pairs]
    return compressed(bodies, contact[:2] + contact[3:], [Tie(*pairs[2])]) if tie else compressed(bodies, contact)


SCENES = {
    "clamped around": lambda: two((3, 3), (4, 4)),
    "clamped around, other order": lambda: two((4, 4), (3, 3)),
    "clamped around, 1:2": lambda: two((4, 4), (2, 2)),
    "clamped on one side": lambda: two((3, 3), (4, 4), ("left",)),
    "held beside": lambda: on_support(2, 3),
    "first in two contacts": lambda: tee(4, 2, 3),
    "first and second": lambda: tee(3, 2, 4),
    "second in two contacts": lambda: tee(2, 3, 4),
    "beside an obstacle": lambda: beside_obstacle(3, 2),
    "beside an obstacle, finer below": lambda: beside_obstacle(2, 3),
    "four around an edge": lambda: around((2, 3, 3, 4)),
    "four, two of them glued": lambda: around((3, 2, 2, 4), tie=True),
}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", SCENES)
def test_uniform_pressure(name, degree):
    """It passes exactly, and so does the displacement."""
    scene = SCENES[name]()
    assert all(i in scene.pairing.nonmatching or one.obstacle for i, one in enumerate(scene.interfaces))
    step = next(adapt(scene, 0.9, degree=degree, solver=Solver(tolerance=1e-12)))
    assert np.abs(gathered(WORLD, step.contact.pressure) / PRESSURE - 1).max() < 1e-10
    prolongation = step.elasticity.prolongation
    exact = STRAIN * prolongation.injected(prolongation.space.positions())
    assert np.abs(gathered(WORLD, step.solution.displacement - exact)).max() < 1e-10 * -STRAIN


# ---------------------------------------------------------------------------------- several contacts on one surface


def stamps(*pairs, modulus=1.0, base=(12, 3, 3), at=((0, 1), (3, 4)), ties=(), friction=0.0):
    """Two stamps on a base, slices in plane strain, under `PRESSURE` and twice that; pairs of surfaces."""
    bodies = {"base": block((0, 0, 0), (4, 1, 1), base, 1)}
    bodies |= {name: block((a, 0, 1), (b, 1, 2), (4, 4, 4), 1) for name, (a, b) in zip(("one", "two"), at)}
    held = [Dirichlet(f"{body} {side}", y=0.0) for body in bodies for side in ("front", "back")]
    held += [Dirichlet(side, x=0.0) for side in ("base left", "base right", "one left", "two right")]
    return Scene(
        "stamps",
        root_mesh_from_shapes(bodies),
        {"base": Material(modulus, POISSON), "one": Material(1.0, POISSON), "two": Material(1.0, POISSON)},
        [*held, Dirichlet("base bottom", z=0.0)],
        [ContactPair(*pair, friction=friction) for pair in pairs],
        [Pressure("one top", PRESSURE), Pressure("two top", 2 * PRESSURE)],
        ties=ties,
    )


EACH = ("one bottom", "base top"), ("base top", "two bottom")
#: Rows on the stamps or on the base; one facet of the base faces both stamps, or a part of one.
PLACES = {}, {"modulus": 0.1}, {"base": (3, 3, 3), "at": ((0.4, 1.4), (1.6, 2.6))}
PLACES += ({"base": (3, 2, 2), "at": ((0.4, 1.4), (1.6, 2.6)), "modulus": 0.1},)


def vertical(step, kind="contact"):
    """Vertical forces of the resultants of a kind."""
    return [abs(one.force[2]) for one in step.record.resultants if one.kind == kind]


@pytest.mark.parametrize("place", PLACES, ids=["stamps", "base", "one facet", "one facet, base"])
@pytest.mark.parametrize("degree", [1, 2])
def test_two_stamps(degree, place):
    """One surface in two pairs, first or second: each has the load of its stamp; a union has the sum."""
    options = dict(tolerance=0.1, degree=degree, max_steps=2)
    step = adapt(stamps(*EACH, **place), **options).last_step()
    assert vertical(step) == pytest.approx([PRESSURE, 2 * PRESSURE], rel=1e-6)
    assert step.record.pair_areas == pytest.approx([1.0, 1.0], rel=0.06)  # a row at a rim may be open
    both = adapt(stamps((("one bottom", "two bottom"), "base top"), **place), **options).last_step()
    assert vertical(both) == pytest.approx([3 * PRESSURE], rel=1e-6)
    assert "one bottom + two bottom on base top" in str(both)


def test_a_contact_inside_another_one():
    """The first one acts where both join facets; one that would never act is an error."""
    one, both = ("one bottom", "base top"), (("one bottom", "two bottom"), "base top")
    step = adapt(stamps(one, both), 0.1, degree=1, max_steps=2).last_step()
    assert vertical(step) == pytest.approx([PRESSURE, 2 * PRESSURE], rel=1e-6)
    with pytest.raises(PairingError, match="joins all facets of 'one bottom' on 'base top': leave one of them out"):
        stamps(both, one)
    with pytest.raises(SceneError, match="twice in the union"):
        stamps((("one bottom", "one bottom"), "base top"))


def test_loads_beside_contact():
    """A load on the part of a surface that faces nothing is none on contact."""
    scene = stamps(*EACH)
    beside = replace(scene, tractions=(*scene.tractions, Pressure("base top", PRESSURE)))
    (doubt,) = adapt(beside, 0.1, degree=1, max_steps=1).last_step().record.doubts
    assert doubt.kind == "load on contact" and doubt.value == pytest.approx(0.5)


def test_a_tie_beside_contact():
    """A stamp is glued, the other one in contact with friction, on the same surface."""
    scene = stamps(EACH[1], ties=(Tie(*EACH[0]),), friction=0.3)
    step = adapt(scene, 0.1, degree=1, max_steps=2).last_step()
    assert vertical(step) == pytest.approx([2 * PRESSURE], rel=1e-6)
    assert vertical(step, "tie") == pytest.approx([PRESSURE], rel=1e-6) and step.record.active_pairs > 0


@pytest.mark.parametrize("modulus", [1.0, 0.3])
@pytest.mark.parametrize("cells", [2, 3])
@pytest.mark.parametrize("crack", ["right half", "bottom"])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_half_closed_crack(degree, crack, cells, modulus):
    """Half of a block glued, half in contact, on one surface, rows on either: exact, without an edge on the base.

    Contact of the whole surface does not act where it is glued.
    """
    upper = block((0, 0, 1), (1, 1, 2), (4, 4, 4), 1)
    upper = upper.named("left half", "bottom", where=lambda x: x[0] < 0.5 + 1e-9)
    upper = upper.named("right half", "bottom", where=lambda x: x[0] > 0.5 - 1e-9)
    scene = Scene(
        "crack",
        root_mesh_from_shapes({"upper": upper, "base": block((0, 0, 0), (1, 1, 1), (cells, 3, 3), 1)}),
        {"upper": Material(1.0, 0.0), "base": Material(modulus, 0.0)},
        [Dirichlet("base bottom", 0.0, 0.0, 0.0)],
        [ContactPair(f"upper {crack}", "base top")],
        [Pressure("upper top", PRESSURE)],
        ties=(Tie("upper left half", "base top"),),
    )
    step = adapt(scene, 0.9, degree=degree, max_steps=1).last_step()
    assert vertical(step) + vertical(step, "tie") == pytest.approx([PRESSURE / 2] * 2, rel=1e-6)
    assert step.record.max_pressure == pytest.approx(PRESSURE, rel=1e-5) and not step.record.doubts
