"""Results of friction: tractions and slips in tables, files and pictures, goals, warnings, repeated paths."""

import csv
import json
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import WORLD, everywhere, outside
from test_friction import MU, check_law, contact_force, fretting, pushed

from fx_contact import Beginning, Dirichlet, FrictionForce, SceneError, Tresca, adapt, increments, sweep
from fx_contact.adaptive.step_solver import HISTORY
from fx_contact.estimate.contact_edge import cells_at_edge
from fx_contact.plot import draw_contact, draw_pressure
from fx_contact.results import contact_grid

pytestmark = pytest.mark.ranks(1, 2)


def path(second=None, shifts=(0.0, 2e-3), **options):
    """A ball pressed on a plane, or on a stiff block meshed apart, and moved along it."""
    second = fretting(MU, 0.0).contact[0].second if second is None else second
    options = {"degree": 1, "max_steps": 2} | options
    return increments(lambda shift: fretting(MU, shift, second), shifts, 0.2, **options)


def last(*arguments, **options):
    """The last step of a path."""
    for point in path(*arguments, **options):
        step = point.step
    return step


@pytest.mark.parametrize("degree", [1, 2])
def test_tractions(degree):
    """|t| = mu p where nodes slip, less where they stick; their integral is the force; slip is along the force."""
    step = last("base top" if degree == 1 else None, degree=degree)
    table, scale = step.contact, step.record.max_pressure
    size, slips = np.linalg.norm(table.traction, axis=1), table.slipping
    everywhere(np.abs(size - MU * table.pressure)[slips].max(initial=0.0) < 1e-6 * scale, "not the bound")
    everywhere((size <= MU * table.pressure + 1e-6 * scale).all(), "more than the bound")
    everywhere(np.abs(np.einsum("ni,ni->n", table.traction, table.normal)).max(initial=0.0) < 1e-12, "not tangential")
    everywhere(not table.slip[~slips].any() or np.abs(table.slip[~slips]).max() < 1e-9, "slip of nodes that stick")
    everywhere((np.einsum("ni,ni->n", table.traction, table.slip) >= -1e-9 * scale).all(), "against the force")
    assert WORLD.allreduce(int(slips.sum())) == step.record.slipping_pairs > 0
    over = np.divide(table.force, table.pressure, out=np.zeros(len(table)), where=table.pressure > 0)
    pushes = over[:, None] * table.traction + table.force[:, None] * table.normal
    _, y, z = 2 * WORLD.allreduce(pushes.sum(axis=0))
    _, along, down = contact_force(step)
    assert y / z == pytest.approx(along / down, rel=1e-8) and abs(z) == pytest.approx(abs(down), rel=1e-8)


def test_a_table_and_a_grid(folder):
    """Further columns with friction, none without; of a grid the fields have the values of the table."""
    step = last()
    table, grid = step.contact.gathered(), contact_grid(step)
    names = {"traction", "slip", "slips"}
    assert names <= {*grid.array_names}
    top = WORLD.allreduce(float(np.linalg.norm(grid["traction"], axis=1).max(initial=0.0)), op=max)
    if WORLD.rank == 0:
        assert top == pytest.approx(np.linalg.norm(table.traction, axis=1).max(), rel=1e-12)
        with open(table.to_csv(folder / "contact.csv")) as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == len(table) and sum(int(row["slips"]) for row in rows) == table.slipping.sum()
        assert [float(row["traction y"]) for row in rows] == pytest.approx(table.traction[:, 1].tolist())
    smooth = next(adapt(fretting(0.0, 0.0), 0.9, degree=1))
    assert smooth.contact.traction is None and not names & {*contact_grid(smooth).array_names}


def test_pictures(folder):
    """A map of each field, a curve; without friction there is nothing to show."""
    step = last()
    for field in ("pressure", "traction", "status"):
        assert draw_contact(step, folder / f"{field}.png", field).stat().st_size > 5000
    assert draw_pressure(step, folder / "curve.png").stat().st_size > 5000
    smooth = next(adapt(fretting(0.0, 0.0), 0.9, degree=1))
    assert draw_contact(smooth, folder / "smooth.png", zoom=None).stat().st_size > 5000
    with pytest.raises(SceneError, match="no friction"):
        draw_contact(smooth, folder / "none.png", "status")


def test_cells_at_the_edge_of_stick():
    """Cells with nodes that stick and that slip are at an edge, as those with open and closed ones."""
    step = last()
    alone = replace(step.solution, slipping=np.zeros_like(step.solution.slipping))
    without, found = cells_at_edge(replace(step, solution=alone)), cells_at_edge(step)
    everywhere((found >= without).all(), "an edge of contact is missing")
    assert WORLD.allreduce(int((found & ~without).sum())) > 0


@pytest.mark.parametrize("law", [MU, Tresca(2e-3)], ids=["Coulomb", "Tresca"])
def test_the_goal_is_the_resultant(law):
    """Of all nodes that slip, and in a direction; beyond the onset of sliding with the error of the normal force."""
    scene = pushed("mortar", law, (0.1, 0.0))
    goals = FrictionForce(scene.contact[0], (1, 0, 0), 0.5), FrictionForce("cube bottom on base top", (1, 0, -1), 0.5)
    allow = "large strain", "large rotation"
    step = adapt(scene, 0.6, degree=1, goals=goals, allow=allow, max_steps=3).last_step()
    along, oblique = step.record.goals
    x, _, z = contact_force(step)
    assert along.value == pytest.approx(x, rel=1e-9) and oblique.value == pytest.approx(x / np.sqrt(2), rel=1e-9)
    assert along.name == "friction force of cube bottom on base top along 1, 0, 0"
    if law == MU:
        assert along.value == pytest.approx(-MU * z, rel=1e-3) and along.error > 0
    else:
        assert along.error < 1e-6 * along.value  # the bound times the area


@pytest.mark.ranks(1)
def test_the_error_of_a_friction_force():
    """The estimated error is 0.8 to 10 times that against a mesh with leaves of half the size around the contact."""
    pair = fretting(MU, 0.0).contact[0]
    goal = FrictionForce(pair, (0, 1, 0), 0.01)
    found = []
    for meshes in (2, 3):
        record = list(path(None, (0.0, 1e-3), goals=goal, max_steps=meshes))[-1].record.record
        found.append(record.goals[0])
    coarse, fine = found
    assert 0.8 < coarse.error / abs(coarse.value - fine.value) < 10, (coarse, fine)


def test_what_has_no_friction_force():
    """A pair without friction, a direction that is none."""
    with pytest.raises(SceneError, match="has no friction"):
        adapt(fretting(0.0, 0.0), 0.5, goals=FrictionForce("ball outside on rigid plane", (1, 0, 0), 0.1))
    with pytest.raises(SceneError, match="direction"):
        FrictionForce("a on b", (0, 0, 0), 0.1)


def kinds(scene, **options):
    """Kinds of model warnings of a single solve."""
    step = adapt(scene, 0.2, degree=1, max_steps=2, allow=("large strain", "large rotation"), **options).last_step()
    return {doubt.kind: doubt for doubt in step.record.doubts}


def test_a_load_step_that_is_too_large():
    """Nodes that close far from where the step began, with tangential forces; not those that touch at first."""
    found = kinds(fretting(0.5, 4e-3))["load step"]
    assert 0.05 < found.value < 0.5 and found.place == "ball outside on rigid plane"
    assert "load step" not in kinds(pushed("pairs", 0.5, (1e-3, 0.0)))
    assert "load step" not in kinds(fretting(0.0, 4e-3))
    pressed, moved = path(None, (0.0, 1e-4))
    warned = [{doubt.kind for doubt in point.record.record.doubts} for point in (pressed, moved)]
    assert "load step" in warned[0] and "load step" not in warned[1]


def loaded(part):
    """A ball pressed by a part of the load, and moved by it."""
    whole = fretting(0.5, 0.0)
    return replace(whole, dirichlet=(Dirichlet("ball z = 0", 0.0, 2e-3 * part, -0.01 * part), *whole.dirichlet[1:]))


def test_a_path_again():
    """On one mesh the path is the same again; halved load steps change it, and as two steps do."""
    forest = adapt(loaded(1.0), 0.2, degree=1, max_steps=2).last_step().forest
    options = {"degree": 1, "max_steps": 1, "beginning": Beginning.at_rest(forest)}
    one = increments(loaded, [1.0], 0.9, **options)
    point = next(one)
    same, halved = one.repeated(), one.repeated(2, unloaded=0.0)
    assert same.displacement < 1e-6 and max(same.forces) < 1e-6 < 1e-3 < halved.displacement
    assert halved.values == [1.0] and halved.parts == 2 and "in 2 parts" in str(halved)
    (*_, two) = increments(loaded, [0.5, 1.0], 0.9, **options)
    force = two.step.resultants[0].force
    assert halved.records[0].resultants[0].force == pytest.approx(force, rel=1e-6)
    change = np.linalg.norm(np.subtract(force, point.step.resultants[0].force)) / np.linalg.norm(force)
    assert halved.forces == pytest.approx([change], rel=2e-2)
    check_law(two.step, 0.5)


def test_a_path_again_on_its_last_mesh():
    """The first point changes by its finer mesh; fields that go along stay with the path."""
    whole = path(None, (0.0, 2e-3), max_steps=3)
    cells = [point.step.record.cells for point in whole]
    again = whole.repeated()
    assert [record.cells for record in again.records] == [cells[-1]] * 2
    assert again.displacement < 0.2 and HISTORY not in str(again)
    dissipated = [record.dissipated_energy for record in whole.records]
    assert dissipated[1] - dissipated[0] == pytest.approx(whole.records[1].record.dissipated_energy)


def test_what_cannot_be_repeated():
    """A sweep, a path without a point, parts that are none."""
    with pytest.raises(SceneError, match="only solved points of `increments`"):
        path().repeated()
    with pytest.raises(SceneError, match="only solved points of `increments`"):
        sweep(loaded, [0.5, 1.0], 0.9, degree=1, max_steps=1).repeated()
    with pytest.raises(SceneError, match="the number of parts"):
        path().repeated(0)


def test_friction_that_changes_between_increments():
    """Assembled without friction, then pushed with it: the pair is the same, and the history goes on."""
    steps = {0.0: (0.0, (0.0, 0.0)), 1.0: (MU, (1e-4, 0.0))}
    points = list(increments(lambda value: pushed("mortar", *steps[value]), [0.0, 1.0], 0.9, degree=1, max_steps=1))
    assert points[0].record.dissipated_energy is None and points[1].record.dissipated_energy is not None
    assert points[1].step.record.sticking_pairs > 0


#: A path with friction, whose points go into a folder.
PROGRAM = """
import sys
from mpi4py import MPI
sys.path[:0] = sys.argv[1:3]
from test_friction_results import path
list(path(shifts=(0.0, 1e-3, 2e-3, 1e-3, 0.0), folder=sys.argv[3], restart=len(sys.argv) > 4, comm=MPI.COMM_SELF))
"""


@pytest.mark.skipif(WORLD.size > 1, reason="starts runs of its own")
def test_a_path_killed_at_random_moments(tmp_path):
    """kill -9, then restarts: no point is lost, and the path ends with the same forces and work of friction."""
    here, rng = Path(__file__).parent, random.Random(5)

    def life(folder, wanted):
        """Run to the end, or to a kill soon after a number of points; all points that are in the file."""
        file = folder / "sweep.jsonl"
        program = [sys.executable, "-c", PROGRAM, str(here), str(here.parent), str(folder)]
        process = subprocess.Popen(program + ["restart"] * file.exists(), env=outside())

        def points():
            return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []

        while process.poll() is None:
            if len(points()) >= wanted:
                time.sleep(rng.uniform(0, 0.5))
                process.kill()
            time.sleep(0.01)
        assert process.returncode in (0, -signal.SIGKILL)
        return points()

    whole = life(tmp_path / "whole", 9)
    assert len(whole) == 5
    for wanted in (1, 2, 4, 9):
        points = life(tmp_path / "killed", wanted)
        assert len(points) >= min(wanted, 5), "a point was lost"
    for one, other in zip(points, whole, strict=True):
        assert one["record"]["force"] == pytest.approx(other["record"]["force"], rel=1e-7)
        assert one["dissipated_energy"] == pytest.approx(other["dissipated_energy"], rel=1e-5, abs=1e-15)
    rows = list(csv.DictReader((tmp_path / "killed" / "sweep.csv").open()))
    assert [float(row["dissipated_energy"]) for row in rows] == [point["dissipated_energy"] for point in points]
