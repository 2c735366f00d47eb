"""Load paths: no more cells than needed, the slopes that theory has, the same after a restart."""

import csv
import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import everywhere
from model_problems import pressed as two_cubes
from model_problems import two_boxes

from fx_contact import CheckpointError, Material, SceneError, adapt, solve, sweep
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.state import State
from fx_contact.estimate.estimator import Estimate
from fx_contact.fem.space import Space
from fx_contact.path.starts import carried_over
from fx_contact.scenes import hertz

small = partial(hertz, order=3, coarse=2)


def pressed(approach):
    return small(displacement=approach)


@pytest.mark.parametrize("degree", [1, 2])
def test_displacement_at_the_nodes_of_merged_leaves(degree):
    """Nodes of merged leaves are nodes of their parts: their values are the same, to the last digit."""
    step = solve(small(), 0.3, degree=degree)
    space, rows = Space(step.forest, degree), np.array([[1.0, 2, 3], [0, 1, -1], [2, 0, 1]])
    state = State.of(step)
    state = replace(state, fields=state.fields.with_field("carried", (space.positions() @ rows)[space.cells]))
    begin = carried_over(state, 0.3, "contact-sfc")
    everywhere(begin.forest.size_global < step.forest.size_global, "leaves merge")
    after = Space(begin.forest, degree)
    expected = (after.positions() @ rows)[after.cells]
    everywhere(np.allclose(begin.fields["carried"], expected, rtol=0, atol=1e-12), "the same values")
    assert begin.effectivity == 1


@pytest.mark.parametrize("share, levels", [(0.99, 2), (1.01, 1)])
def test_a_coarse_forest_is_two_refinements_away(share, levels):
    """Cells that just meet criterion (2) are to be got by two refinements; halving a cell takes 1/32 of xi_T^2."""
    forest = Beginning.uniform(two_cubes(two_boxes(upper=(1, 1, 1))), 3).forest
    count, tolerance = forest.size_global, 0.1
    error = np.full(len(forest), share * tolerance / np.sqrt(count))
    estimate = Estimate(error, None, share * tolerance, 1.0, count, 1 / 32)
    state = replace(State.at_rest(forest, 1), estimate=estimate)
    begin = carried_over(state, tolerance, "contact-sfc")
    everywhere((begin.forest.level == 3 - levels).all(), "other levels")


def test_a_linear_load_path():
    """Twice the modulus is twice the force, on two meshes each, of which the last have hardly more cells."""
    path = sweep(lambda modulus: small(material=Material(modulus, 0.3)), (1.0, 2.0, 3.0), 0.25, degree=1)
    first, second, third = path
    with pytest.raises(SceneError, match="have been solved and handed out"):
        list(path)
    assert [p.record.begun for p in (first, second, third)] == ["anew", "coarse", "coarse"]
    assert second.record.solves == 2 and second.step.record.reached
    assert second.record.unknowns > second.step.record.dofs
    assert third.record.solves == 2 and third.step.record.cells < 1.2 * first.step.record.cells
    assert second.step.record.force == pytest.approx(
        2 * first.step.record.force, rel=0.25**2
    )  # of a force: about e^2


def test_force_over_approach_is_that_of_hertz():
    """F ~ delta^(3/2), on no more cells than a run alone ends with, or the point before had."""
    values = (1e-2, 1e-3)

    def round_ends(approach):
        return hertz(displacement=approach, order=6, coarse=2)

    points = [point.record for point in sweep(round_ends, values, 0.15)]
    assert all(point.record.reached for point in points)
    force = np.array([point.record.force for point in points])
    slopes = np.diff(np.log(force)) / np.diff(np.log(values))
    assert slopes == pytest.approx(1.5, abs=0.02)  # the bodies are no half-spaces
    alone = solve(round_ends(values[1]), 0.15).record
    assert points[1].record.force == pytest.approx(alone.force, rel=0.15**2)
    assert points[1].record.dofs <= alone.dofs
    assert [point.begun for point in points] == ["anew", "coarse"]


def test_restart_in_the_middle(folder):
    """The same points, of which those done are not solved again; files have them all."""
    values, options = (1e-2, 6e-3, 5e-3), dict(degree=1, folder=folder)
    whole = [point.record for point in sweep(pressed, values, 0.3, degree=1)]
    path = sweep(pressed, values, 0.3, **options)
    next(path), next(path)
    again = sweep(pressed, values, 0.3, restart=True, **options)
    assert len(again.records) == 2
    (point,) = again
    for one, other in zip(whole, again.records):
        assert (one.begun, one.solves, one.record.cells) == (other.begun, other.solves, other.record.cells)
        assert other.record.force == pytest.approx(one.record.force, rel=1e-7)
    lines = [json.loads(line) for line in (folder / "sweep.jsonl").read_text().splitlines()]
    forces = [line["record"]["force"] for line in lines]
    assert [line["value"] for line in lines] == list(values) and forces[2] == point.step.record.force
    rows = list(csv.DictReader((folder / "sweep.csv").open()))
    assert [float(row["force"]) for row in rows] == forces
    assert not list(sweep(pressed, values, 0.3, restart=True, **options))


def test_restart_of_something_else(folder):
    options = dict(degree=1, folder=folder)
    next(sweep(pressed, (1e-2, 5e-3), 0.6, **options))
    for values, scene_of, degree, words in (
        ((2e-2, 5e-3), pressed, 1, "load path over"),
        ((1e-2, 5e-3), partial(small, 1.5), 1, "root mesh"),
        ((1e-2, 5e-3), pressed, 2, "degree"),
    ):
        with pytest.raises(CheckpointError, match=words):
            sweep(scene_of, values, 0.6, degree=degree, folder=folder, restart=True)
    with pytest.raises(CheckpointError, match="cannot read"):
        sweep(pressed, (1e-2,), 0.6, folder=folder / "nowhere", restart=True)
    next(adapt(pressed(1e-2), 0.6, degree=1, checkpoint=folder / "single"))
    with pytest.raises(CheckpointError, match="single run"):
        sweep(pressed, (1e-2,), 0.6, folder=folder / "single", restart=True)


def test_another_root_mesh():
    """A point on another root mesh is begun anew, the next one on its forest again."""
    points = sweep(lambda radius: small(radius, 0.01 * radius), (1.0, 1.1, 1.1), 0.6, degree=1)
    assert [point.record.begun for point in points] == ["anew", "anew", "coarse"]


@pytest.mark.parametrize(
    "scene_of, values, options, words",
    [
        (pressed, (), {}, "one number at least"),
        (pressed, ("a",), {}, "a value of a load path must be a finite number"),
        (lambda _: None, (1,), {}, "must be a Scene"),
    ],
    ids=range(3),
)
def test_bad_arguments(scene_of, values, options, words):
    with pytest.raises(SceneError, match=words):
        next(sweep(scene_of, values, 0.3, **options))
