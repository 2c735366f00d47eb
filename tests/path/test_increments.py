"""Load paths of increments: each from the state before, with its fields."""

from functools import cache, partial

import numpy as np
import pytest
from conftest import WORLD
from model_problems import some
from mpi4py import MPI

from fx_contact import Beginning, CheckpointError, SceneError, increments, sweep
from fx_contact.adaptive.step_solver import HISTORY
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.scenes import hertz
from fx_contact.surfaces.facet_pairing import leaf_code

VALUES, TOLERANCE = (1e-2, 5e-3, 2e-3), 0.3
small = partial(hertz, order=1, coarse=2)


def pressed(approach):
    return small(displacement=approach)


def field(forest, degree):
    """A polynomial of the degree at the nodes: (n, (degree+1)^3, 1)."""
    return (leaf_positions(forest, slice(None), degree) @ [[1.0], [2.0], [-3.0]]) ** degree


def start(degree, comm=WORLD):
    """A Beginning on the root cells that carries the polynomial."""
    forest = Beginning.uniform(pressed(VALUES[0]), 0, comm).forest
    values = np.concatenate([np.zeros((len(forest), (degree + 1) ** 3, 3)), field(forest, degree)], axis=2)
    return Beginning(forest, values)


def path(degree, comm=WORLD, **options):
    """Increments that refine in each point."""
    return increments(pressed, VALUES, TOLERANCE, comm, degree=degree, beginning=start(degree, comm), **options)


def by_leaf(comm, step, values):
    """Values of all ranks' leaves by their names."""
    names = zip(leaf_code(step.forest.cell, step.forest.anchor).tolist(), step.forest.level.tolist())
    return {name: row for part in comm.allgather(list(zip(names, values))) for name, row in part}


def check_fields(comm, step, degree, before):
    """The polynomial is exact; on leaves that were there the history is the displacement of the point before."""
    off = np.abs(step.carried - field(step.forest, degree)).max(initial=0.0)
    assert comm.allreduce(off, op=MPI.MAX) < 1e-12, "the polynomial is off"
    if before is None:
        assert HISTORY not in step.fields
        return
    found = by_leaf(comm, step, step.fields[HISTORY])
    both = found.keys() & before.keys()
    size = max(np.abs(row).max() for row in before.values())
    assert len(both) > len(before) / 2 and size > 0 and len(found) > len(both)
    assert max(np.abs(found[name] - before[name]).max() for name in both) <= 1e-15 * size


@cache
def whole(degree):
    """Records of a path that nothing stops; its fields are checked."""
    before, points = None, path(degree)
    for point in points:
        check_fields(WORLD, point.step, degree, before)
        before = by_leaf(WORLD, point.step, point.step.nodal_displacement)
    return points.records


@pytest.mark.parametrize("degree", [1, 2])
def test_fields_go_through_a_path(degree):
    """Each point refines the forest of the one before, which is never coarsened."""
    records = whole(degree)
    assert [point.begun for point in records] == ["anew", "before", "before"]
    cells = [point.record.cells for point in records]
    assert cells[0] < cells[1] < cells[2] and all(point.record.reached for point in records)


def test_points_are_those_of_a_sweep():
    """Without friction there is no history: forces are those of a sweep, to the tolerance."""
    alone = [point.record.record.force for point in sweep(pressed, VALUES, TOLERANCE)]
    assert [point.record.force for point in whole(2)] == pytest.approx(alone, rel=TOLERANCE**2)


@pytest.mark.parametrize("writers, readers", {(WORLD.size, 1), (1, WORLD.size)})
@pytest.mark.parametrize("degree", [1, 2])
def test_restart_in_the_middle(folder, degree, writers, readers):
    """A path goes on with all its fields, on any number of ranks."""
    with some(writers) as comm:
        if comm:
            points = path(degree, comm, folder=folder)
            next(points), next(points)
    with some(readers) as comm:
        if comm:
            points = path(degree, comm, folder=folder, restart=True)
            before = points._last
            before = by_leaf(comm, before, before.fields["displacement"])
            (point,) = points
            check_fields(comm, point.step, degree, before)
            expected = points.records[-1].record.force, points.records[-1].record.cells
    told = WORLD.bcast(expected if WORLD.rank == 0 else None)
    last = whole(degree)[-1].record
    assert told[1] == last.cells and told[0] == pytest.approx(last.force, rel=1e-7)


def test_history_of_a_start():
    """A first guess of a solve has it at the conforming nodes; at the first point it is zero."""
    from fx_contact.adaptive import adaptive_loop

    asked, solved = [], adaptive_loop.solve_step

    def watched(settings, number, begin, *more):
        history = begin.history_displacement
        before = np.zeros_like(begin.displacement) if history is None else history
        asked.append(WORLD.allreduce(float(np.abs(before - begin.displacement).max(initial=0.0)), MPI.MAX))
        assert before.shape == begin.displacement.shape
        return solved(settings, number, begin, *more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(adaptive_loop, "solve_step", watched)
        for _ in increments(pressed, VALUES[:2], TOLERANCE):
            asked.append(None)
    first, second = asked[: asked.index(None)], asked[asked.index(None) + 1 : -1]
    assert first[0] == 0 and len(first) > 1 and all(first[1:])  # the history is zero, the guess is not
    assert second[0] == 0 and len(second) > 1 and all(second[1:])  # the solution before is the first guess


def test_what_cannot_go_on(folder):
    """Another root mesh, and the folder of a sweep, are refused."""
    with pytest.raises(SceneError, match="change between two increments"):
        list(increments(lambda radius: small(radius, 0.01 * radius), (1.0, 1.1), 0.6, degree=1))
    next(sweep(pressed, VALUES, 0.6, degree=1, folder=folder))
    with pytest.raises(CheckpointError, match="is of sweep, not of increments"):
        increments(pressed, VALUES, 0.6, degree=1, folder=folder, restart=True)
