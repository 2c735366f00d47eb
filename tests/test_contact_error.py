"""What contact itself asks of a mesh and of a penalty, whatever else loads its bodies."""

import numpy as np
import pytest
from test_stored import plates

from fx_contact import BodyForce, ContactPair, Dirichlet, Enforcement, Material, Pressure, Scene, adapt
from fx_contact.errors import SolveError
from fx_contact.scenes import punch
from fx_contact.scenes.boxes import DOWN, UP, Boxes

WIDTH, THICKNESS, LIGHT = 10.0, 0.05, 1e-4
FORCE = LIGHT / (2 * THICKNESS) * WIDTH**2  # of the light plate, that nothing else loads


def on_a_base(heavy=0.0, pressure=0.0):
    """A plate on one half of a base as thin, pressed by a light displacement.

    The other half carries another plate with a heavy one, or at its far end a pressure.
    """
    boxes, bodies = Boxes(1), ["base"]
    boxes.add("base", (0.0, 0.0, -THICKNESS), (2 * WIDTH, WIDTH, 0.0), (4, 2, 1))
    base, pairs, loads = boxes.facets(UP, 0.0, "base"), [], []
    column, surfaces, held = base[:, 0] % 4, {"bottom": boxes.facets(DOWN, -THICKNESS)}, {"bottom": 0.0}
    for body, left, depth in (("light", 0, LIGHT), ("heavy", 2, heavy)):
        if depth:
            start = left * WIDTH / 2
            bodies.append(body)
            boxes.add(body, (start, 0.0, 0.0), (start + WIDTH, WIDTH, THICKNESS), (2, 2, 1))
            surfaces |= {f"below {body}": base[(column >= left) & (column < left + 2)]}
            surfaces |= {
                f"{body} face": boxes.facets(DOWN, 0.0, body),
                f"{body} top": boxes.facets(UP, THICKNESS, body),
            }
            held[f"{body} top"] = -depth
            pairs.append(ContactPair(f"below {body}", f"{body} face", direction=(0, 0, 1)))
    if pressure:
        surfaces["end"] = base[column == 3]
        loads.append(Pressure("end", pressure))
    return Scene(
        "on a base",
        boxes.mesh(surfaces),
        dict.fromkeys(bodies, Material(1.0, 0.0)),
        tuple(Dirichlet(surface, 0.0, 0.0, z) for surface, z in held.items()),
        tuple(pairs),
        tuple(loads),
    )


def films(wave=0.0, order=6, pressure=0.0, weight=0.0):
    """Two thin films pressed into each other, the upper one with four waves on its face, the lower one loaded too."""
    boxes = Boxes(order)
    boxes.add("lower", (0.0, 0.0, -THICKNESS), (3.0, 1.0, 0.0), (6, 2, 1))
    boxes.add("upper", (0.0, 0.0, 0.0), (1.0, 1.0, THICKNESS), (2, 2, 1))

    def place(name, x):
        return x - np.outer(
            (1 - x[:, 2] / THICKNESS) * wave * np.cos(8 * np.pi * x[:, 0]) * (name == "upper"), [0, 0, 1]
        )

    face = boxes.facets(UP, 0.0, "lower")
    column = face[:, 0] % 6
    surfaces = {"bottom": boxes.facets(DOWN, -THICKNESS), "top": boxes.facets(UP, THICKNESS)}
    surfaces |= {"below": face[column < 2], "above": boxes.facets(DOWN, 0.0, "upper"), "end": face[column >= 4]}
    return Scene(
        "films",
        boxes.mesh(surfaces, place=place),
        dict.fromkeys(("lower", "upper"), Material(1.0, 0.0)),
        (Dirichlet("bottom", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, -LIGHT - weight * THICKNESS**2 / 2)),
        (ContactPair("below", "above", direction=(0, 0, 1)),),
        (Pressure("end", pressure),) if pressure else (),
        body_forces=(BodyForce("lower", (0.0, 0.0, -weight)),) if weight else (),
    )


def test_estimates_of_contact_pairs():
    """That of a contact pair is nothing where stresses are uniform, and about the whole one where it is alone."""
    *_, step = adapt(plates(pressed=True), 0.3)
    alone = step.record["pair_estimates"]
    assert len(alone) == 2 and max(alone) < 1e-6 and step.record["reached"]  # uniform stresses
    for step in adapt(punch(), 0.2):
        assert 0.3 < step.record["pair_estimates"][0] / step.record["estimate"] < 2
    assert step.record["pair_leaves"] == [0]


@pytest.mark.parametrize("load", ["heavy", "pressure"])
def test_a_light_plate_beside_a_heavier_load(load):
    """The tolerance is that of its force too; that of the whole energy would leave one up to 5 times too large."""
    scene, tolerance = (on_a_base(heavy=20 * LIGHT), 0.1) if load == "heavy" else (on_a_base(pressure=0.5), 0.3)
    records = [step.record for step in adapt(scene, tolerance)]
    first, last = records[0], records[-1]
    assert first["pair_leaves"][0] > 0 and abs(first["pair_forces"][0] / FORCE - 1) > tolerance
    assert last["reached"] and last["pair_leaves"][0] == 0
    assert abs(last["pair_forces"][0] / FORCE - 1) < tolerance


def test_a_very_light_plate():
    """Lighter than e^2 of the heaviest, it may be as wrong as the other one is; its estimate says so."""
    *_, last = (step.record for step in adapt(on_a_base(heavy=500 * LIGHT), 0.1))
    assert last["reached"] and FORCE < 0.1**2 * last["pair_forces"][1]
    assert 2 * FORCE < last["pair_forces"][0] < FORCE + 0.1**2 * last["pair_forces"][1]
    assert last["pair_estimates"][0] > 0.5 > 10 * last["pair_estimates"][1]


def test_forces_that_no_refinement_changes():
    """Under a weight that loads bodies 200 times as much, errors that do nothing to a contact are left alone."""
    steps = [step.record for step in adapt(films(order=1, weight=4.0), 0.2)]
    refined = [step["pair_leaves"][0] > 0 for step in steps]
    assert refined == [False, True, False] and steps[-1]["reached"] and steps[-1]["pair_estimates"][0] > 1
    assert abs(steps[-1]["force"] / (LIGHT / (2 * THICKNESS)) - 1) < 0.2**2


@pytest.mark.parametrize("tolerance, wave, force", [(0.3, 1e-4, 1.16e-3), (0.2, 6e-5, 1.14e-3)])
def test_waves_beside_a_pressure(tolerance, wave, force):
    """They are not flat, though what they take is little of what a pressure stores next to them, along the normal."""
    *_, last = (step.record for step in adapt(films(wave, pressure=0.1), tolerance))
    assert last["reached"] and abs(last["force"] / force - 1) < tolerance**2


@pytest.mark.parametrize("stretched", [0.0, 0.1])
@pytest.mark.parametrize("factor", [None, 10.0, 300.0])
def test_a_penalty_too_soft_for_thin_plates(factor, stretched):
    """It would lose a seventh to five sixths of the force, whatever other bodies or loads across the normal store."""
    with pytest.raises(SolveError, match="too soft"):
        list(adapt(plates(stretched=stretched), 0.1, enforcement=Enforcement("penalty", factor)))


@pytest.mark.parametrize("pressure", [0.02, 0.5])
@pytest.mark.parametrize("factor", [None, 300.0])
def test_a_penalty_too_soft_beside_a_pressure(factor, pressure):
    """Nor does what a load along the normal stores next to the plates count for them."""
    with pytest.raises(SolveError, match="too soft"):
        list(adapt(on_a_base(pressure=pressure), 0.1, enforcement=Enforcement("penalty", factor)))


@pytest.mark.parametrize("joined, taken", [(False, "16.67"), (True, "7.78")])
def test_each_contact_is_judged_by_its_own_energy(joined, taken):
    """A penalty that is stiff enough for a rod, which has most of the energy, is too soft for plates with its force."""
    with pytest.raises(SolveError, match=f"overlaps take {taken}%"):
        list(adapt(plates(pressed=True, joined=joined), 0.2, enforcement=Enforcement("penalty", 300.0)))
