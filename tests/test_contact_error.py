"""What contact itself asks of a mesh and of a penalty, whatever else loads its bodies."""

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import WORLD, leaves
from test_stored import plates

from fx_contact import Enforcement, adapt
from fx_contact.checkpoint import Checkpoint
from fx_contact.errors import SolveError
from fx_contact.scenes import punch

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))

from stability_shapes import beam, films, on_a_base, sinking  # noqa: E402

LIGHT = 1e-4
FORCE = LIGHT / (2 * 0.05) * 10.0**2  # of the light plate on a base, that nothing else loads


def test_estimates_of_contact_pairs():
    """That of a contact pair is nothing where stresses are uniform, and about the whole one where it is alone."""
    *_, step = adapt(plates(pressed=True), 0.3)
    alone = step.record["pair_estimates"]
    assert len(alone) == 2 and max(alone) < 1e-6 and step.record["reached"]  # uniform stresses
    for step in adapt(punch(), 0.2):
        assert 0.3 < step.record["pair_estimates"][0] / step.record["estimate"] < 2
    assert step.record["pair_leaves"] == [0]


def test_errors_of_forces():
    """They are what refinement still changes; at first nothing is known."""
    first, second, last = (step.record for step in adapt(punch(), 0.12))
    assert first["pair_errors"] == [None]
    for record in (second, last):  # 7.676e-4 N: on a mesh of 705,000 unknowns
        assert 0.5 < record["pair_errors"][0] / abs(record["force"] / 7.676e-4 - 1) < 2


@pytest.mark.parametrize("tolerance", [0.2, 0.1])
def test_a_beam_bent_towards_a_block(tolerance):
    """Its deflection takes away most of a gap: a small error of that is a large one of the force."""
    records = [step.record for step in adapt(beam(0.9), tolerance)]
    assert records[0]["force"] == 0 and records[1]["pair_errors"] == [1.0]
    assert records[-1]["reached"] and abs(records[-1]["force"] / 4.01e-6 - 1) < tolerance
    assert 0.5 < records[-1]["pair_errors"][0] / abs(records[-1]["force"] / 4.01e-6 - 1) < 2


def test_a_contact_that_closes_late():
    """A force that was not there before is not right, though the energy is: half of it was lacking."""
    steps = [step.record for step in adapt(beam(0.98), 0.2)]
    new = [step["force"] > 0 for step in steps].index(True)
    assert steps[new]["estimate"] < 0.2 and not steps[new]["reached"]
    assert steps[-1]["reached"] and abs(steps[-1]["force"] / 1.04e-6 - 1) < 0.2


def test_contact_with_a_block_that_sinks():
    """What a coarse mesh sinks too much opens a contact: its gap is not known to a half of it, and the run goes on."""
    steps = [step.record for step in adapt(sinking(5e-4), 0.3, max_steps=3)]
    assert steps[1]["force"] == 0 and steps[1]["pair_gaps"][0] > 0 and steps[1]["estimate"] < 0.3
    assert steps[1]["pair_errors"][0] > 0.5 and not steps[1]["reached"] and steps[2]["force"] > 0
    *_, last = (step.record for step in adapt(sinking(1e-3), 0.3))
    assert last["reached"] and abs(last["force"] / 5.3e-6 - 1) < 0.3  # uniformly fine: 5.3e-6 N


def test_a_gap_that_is_known():
    """It needs nothing, however little force there is."""
    steps = [step.record for step in adapt(beam(1.2), 0.3)]
    assert steps[-1]["reached"] and steps[-1]["force"] == 0 and 0 < steps[-1]["pair_errors"][0] < 0.5
    assert all(step["pair_leaves"] == [0] and step["unseen_contact"] == 0 for step in steps)


def test_restart(tmp_path):
    """What forces need is known after a restart."""
    folder, scene = WORLD.bcast(tmp_path), beam(0.9)
    through = list(adapt(scene, 0.2, max_steps=3))
    list(adapt(scene, 0.2, max_steps=2, checkpoint=folder))
    *_, again = adapt(scene, 0.2, max_steps=3, restart=Checkpoint(folder, scene, WORLD))
    assert np.array_equal(leaves(again.forest), leaves(through[2].forest))
    assert abs(again.record["pair_errors"][0] - through[2].record["pair_errors"][0]) < 1e-6


@pytest.mark.parametrize("load", ["heavy", "pressure"])
def test_a_light_plate_beside_a_heavier_load(load):
    """The tolerance is that of its force too; that of the whole energy would leave one up to 5 times too large."""
    scene, tolerance = (on_a_base(heavy=20 * LIGHT), 0.1) if load == "heavy" else (on_a_base(pressure=0.5), 0.3)
    records = [step.record for step in adapt(scene, tolerance)]
    first, last = records[0], records[-1]
    assert abs(first["pair_forces"][0] / FORCE - 1) > tolerance
    assert load == "heavy" or any(record["pair_leaves"][0] > 0 for record in records)
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
    assert all(step["pair_leaves"] == [0] for step in steps[1:])
    assert steps[-1]["reached"] and steps[-1]["pair_estimates"][0] > 1 and steps[-1]["pair_errors"][0] < 0.01
    assert abs(steps[-1]["force"] / (LIGHT / (2 * 0.05)) - 1) < 0.2**2


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
