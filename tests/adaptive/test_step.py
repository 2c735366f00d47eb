"""What a user sees of a step: fields, tags and measures of dolfinx, contact, a report; and which steps a run keeps."""

import csv
import weakref
from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx import fem
from model_problems import pressed, roots, two_boxes
from mpi4py import MPI

from fx_contact import adapt, solve
from fx_contact.adaptive import adaptive_loop
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.solve_record import record_of_solve
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.parallel.errors import OutputError, SceneError, SolveError
from fx_contact.parallel.timing import Stages
from fx_contact.scenes import hertz, shrink_fit, stack

pytestmark = pytest.mark.ranks(1, 2)

#: Areas of surfaces of two boxes, 2 x 2 x 2 on 4 x 4 x 1; `lower contact` is a part of `lower z high`.
AREAS = {"upper z high": 4, "lower z low": 16, "lower z high": 16, "upper x low": 4, "lower contact": 4}
SURFACE = 6 * 4 + 2 * 16 + 4 * 4


@pytest.fixture(scope="module")
def step():
    """Two boxes in contact, on a mesh in which a sixth of the root cells is refined."""
    scene = pressed(two_boxes(margin=1))
    marked = (forest := Beginning.uniform(scene, 0).forest).cell % 6 == 0
    forest, values = forest.refined_with(marked.astype(np.int8), np.zeros((len(marked), 8, 3)))
    result = solve(scene, 0.01, beginning=Beginning(forest, values), max_steps=1)
    assert result.record.hanging_nodes > 20
    return result


def test_counts_of_all_ranks():
    """A record has the cells, unknowns and levels of the whole mesh: here two levels, of a rank each if there are more.

    Uniform but for one cube of eight: 2 x 2 x 2 + 2 x 2 cells, one of which is 8.
    """
    start = roots(pressed(two_boxes(), contact=False))
    forest, _ = start.refined(start.cell == start.mesh.cells.shape[0] - 1)
    forest, _ = forest.moved(np.where(forest.level > 0, 0, WORLD.size - 1))
    prolongation = Prolongation(Space(forest, 1))
    elasticity = SimpleNamespace(prolongation=prolongation, leaf_mesh=SimpleNamespace(order=1))
    solution, estimate = SimpleNamespace(krylov_iterations=[5]), SimpleNamespace(relative=0.05)
    record = record_of_solve("two boxes", 0, elasticity, solution, estimate, 0.1, Stages())
    positions = 27 + 18 + 19  # of two boxes, and what halving a cell in a corner of its box adds
    hanging = 12  # of these on faces and edges that it shares with others
    assert (record.cells, record.max_level, record.ratio) == (12 + 7, 1, 0.5)
    assert (record.hanging_nodes, record.dofs) == (hanging, 3 * (positions - hanging))


def integral(form):
    return WORLD.allreduce(fem.assemble_scalar(fem.form(form)), op=MPI.SUM)


def test_measure_of_a_surface(step):
    """ds(name) has the surface's area where facets hang; plain ds is over hanging facets too."""
    one = fem.Constant(step.mesh, 1.0)
    for name, area in AREAS.items():
        assert abs(integral(one * step.ds(name)) / area - 1) < 1e-12, name
    assert abs(integral(one * step.ds("upper z high") + 2 * one * step.ds("lower contact")) - 12) < 1e-12
    assert integral(one * ufl.Measure("ds", step.mesh)) > 1.1 * SURFACE
    with pytest.raises(SceneError, match="no surface"):
        step.ds("no surface")
    with pytest.raises(SceneError, match=r"unknown surface \['upper z top'\]; the root mesh has"):
        step.ds(["upper z top"])


def test_measure_of_a_curved_surface():
    """The Gauss rule follows the order of the geometry: quarters of a cylinder."""
    step = solve(
        shrink_fit(radii=(0.5, 1.0, 1.5), height=0.25, interference=0.01), 0.9, max_steps=1, geometry_order=3
    )
    for name, radius in (("bore", 0.5), ("shaft", 1.005), ("hub", 0.995)):
        area = integral(fem.Constant(step.mesh, 1.0) * step.ds(name))
        assert abs(area / (np.pi / 2 * radius * 0.25) - 1) < 1e-5, name


def test_gauss_rule_of_a_curved_surface():
    """It is exact for a constant pressure on spherical facets, for which that of flat ones is not enough."""
    step = solve(hertz(order=3, coarse=2, displacement=0.1), 0.9, max_steps=1, geometry_order=3)
    v, n, ds = ufl.TestFunction(step.displacement.function_space), ufl.FacetNormal(step.mesh), step.ds("upper pole")
    exact, own, rough = (
        fem.assemble_vector(fem.form(ufl.inner(n, v) * measure)).array
        for measure in (ds(degree=12), ds, ds(degree=3))
    )
    off = [WORLD.allreduce(np.abs(load - exact).max(initial=0.0), op=MPI.MAX) for load in (own, rough)]
    assert off[0] < 1e-14 and off[1] > 1e-6


def test_tags(step):
    """Facets have the tag of a surface that they are on, cells that of their body."""
    dx, ds = (
        ufl.Measure(kind, step.mesh, subdomain_data=tags)
        for kind, tags in (("dx", step.cell_tags), ("ds", step.facet_tags))
    )
    one = fem.Constant(step.mesh, 1.0)
    for name, volume in (("lower", 16), ("upper", 8)):
        assert abs(integral(one * dx(step.body_tags[name])) / volume - 1) < 1e-12
    for name, area in (AREAS | {"lower z high": 12}).items():
        assert abs(integral(one * ds(step.surface_tags[name])) / area - 1) < 1e-12, name
    assert step.facet_tags.name == "surfaces" and step.facet_tags is step.facet_tags


def test_fields():
    """Three blocks of 1 m under a uniform pressure: their stress, and how far the top sinks."""
    step = solve(stack(pressure=0.01), 0.2)
    axial = ufl.as_tensor([[0, 0, 0], [0, 0, 0], [0, 0, -0.01]])
    off = step.stress - axial
    assert integral(ufl.inner(off, off) * ufl.dx) < 1e-12 * 0.01**2
    assert abs(integral(step.displacement[2] * step.ds("top")) / (-0.01 * 3 * 0.25) - 1) < 1e-6
    assert step.stress.name == "stress" and step.mesh is step.displacement.function_space.mesh


def test_contact(step):
    """Forces at all pairs add up to the record's; pressure is force over area, closed gaps are closed."""
    contact, record = step.contact, step.record
    columns = [part for part in vars(contact).values() if isinstance(part, np.ndarray)]
    everywhere(len(columns) == 8 and all(len(c) == len(contact) for c in columns), "rows of other numbers")
    assert abs(WORLD.allreduce(contact.force.sum()) / record.force - 1) < 1e-12
    assert WORLD.allreduce(contact.pressure.max(initial=0.0), op=MPI.MAX) == record.max_pressure
    assert WORLD.allreduce(int(contact.active.sum())) == record.active_pairs == WORLD.allreduce(len(contact))
    everywhere(np.abs(contact.gap).max(initial=0.0) < 1e-12 and (contact.normal[:, 2] > 0.999).all(), "not closed")
    everywhere(np.abs(contact.points[:, 2]).max(initial=0.0) < 1e-12 and not contact.pair.any(), "elsewhere")


def test_contact_table(tmp_path):
    """One table on rank 0 with the node pairs of all ranks, in the same order on any number of them."""
    step = solve(stack(cells=(3, 2, 1)), 0.9, max_steps=1, degree=1)
    table = step.contact.gathered()
    assert (table is None) == (WORLD.rank > 0)
    if table is None:
        return
    alone = solve(stack(cells=(3, 2, 1)), 0.9, MPI.COMM_SELF, max_steps=1, degree=1).contact.gathered()
    assert len(table) == 24 and table.pair.tolist() == 12 * [0] + 12 * [1] and table.active.all()
    assert np.array_equal(table.points, alone.points) and np.allclose(table.force, alone.force, rtol=1e-6)
    assert abs(4 * table.force.sum() / step.record.force - 1) < 1e-12
    assert np.allclose(table.normal, [0, 0, 1]) and np.abs(table.gap).max() < 1e-9
    assert repr(table).startswith("contact: 24 contact nodes, 24 closed\n")
    head, *rows = csv.reader(open(table.to_csv(tmp_path / "new" / "contact.csv"), newline=""))
    assert head[:3] == ["x", "y", "z"] and head[6:] == ["pressure", "gap", "force", "closed", "pair"]
    numbers = np.array([row[:10] for row in rows], dtype=float)
    columns = table.points, table.normal, table.pressure, table.gap, table.force, table.active
    assert np.array_equal(numbers, np.column_stack(columns))
    assert [row[10] for row in rows] == [step.scene.contact[pair].name for pair in table.pair]
    with pytest.raises(OutputError, match="name of a table must end in .csv, got .*new"):
        table.to_csv(tmp_path / "new")
    with pytest.raises(OutputError, match="name another file"):
        table.to_csv(tmp_path / "new" / "contact.csv" / "below.csv")


def test_no_node_pairs():
    """Without contact pairs there are no rows, and the table is empty."""
    contact = solve(pressed(two_boxes(margin=1), contact=False), 0.9, max_steps=1).contact
    table = contact.gathered()
    assert len(contact) == 0 and contact.points.shape == (0, 3)
    assert WORLD.rank or (len(table) == 0 and table.points.shape == (0, 3) and "0 contact nodes" in repr(table))


def test_open_gap():
    """A box that is raised by 0.02 without strain is so far from the other one everywhere."""
    contact = solve(pressed(two_boxes(), approach=-0.02), 0.9, max_steps=1).contact
    everywhere(np.abs(contact.gap - 0.02).max(initial=0) < 1e-12 and not contact.active.any(), "another gap")


def test_reports(step):
    """Some lines that say what there is; no array is printed."""
    for thing in (step, step.scene, step.scene.mesh):
        lines = repr(thing).splitlines()
        assert 3 <= len(lines) <= 30 and max(map(len, lines)) < 120 and "array" not in repr(thing)
    assert "two boxes" in repr(step) and "49 contact nodes closed" in repr(step)
    ring = solve(shrink_fit(interference=1e-3), 0.9, max_steps=1, degree=1)
    *_, last = repr(ring).splitlines()
    how = "presses in many directions: its forces add up to (0, 0, 0), 0.0% of the sum of their magnitudes"
    assert last == f"  'shaft on hub' {how}"
    assert "many directions" not in repr(step) and "contact radius" not in repr(ring)
    contact = step.contact
    first, second = repr(contact).splitlines()
    alone = " on this rank alone" * (WORLD.size > 1)
    assert first == f"contact{alone}: {len(contact)} contact nodes, {len(contact)} closed"
    pressure = contact.pressure.max(initial=0.0)
    assert second == f"  force {contact.force.sum():.6g}, largest pressure {pressure:.5g}"


def test_solve_keeps_the_last_step_alone(monkeypatch):
    """While a step is being solved no other is there; `adapt` leaves it to its user."""
    there, most = weakref.WeakSet(), []
    solved = adaptive_loop.solve_step

    def watched(*arguments):
        most.append(len(there))
        step = solved(*arguments)
        there.add(step)
        return step

    monkeypatch.setattr(adaptive_loop, "solve_step", watched)
    step = solve(pressed(two_boxes(margin=1)), 0.12)
    assert len(most) > 1 and not any(most) and list(there) == [step]
    assert step.record.reached and step.record.step == len(most) - 1
    most.clear()
    steps = list(adapt(pressed(two_boxes(margin=1)), 0.12))
    assert most == [*range(1, len(steps) + 1)] and abs(steps[-1].record.force / step.record.force - 1) < 1e-9


def test_a_run_that_has_failed_is_over(monkeypatch):
    """It yields nothing more."""
    run = adapt(pressed(two_boxes(margin=1)), 0.08)
    next(run)
    with monkeypatch.context() as patch:
        patch.setattr(adaptive_loop, "solve_step", lambda *_: (_ for _ in ()).throw(SolveError("no")))
        with pytest.raises(SolveError) as caught:
            next(run)
    assert caught.value.record.step == 0 and list(run) == []


def test_each_step_begins_where_the_last_has_ended():
    """A run has as many steps as it may; the first guess of a step has the energy of the solution before."""
    steps = list(adapt(pressed(two_boxes()), 1e-3, max_steps=2))
    assert len(steps) == 2 and not steps[1].record.reached
    assert WORLD.allreduce(np.abs(steps[0].start).max(initial=0.0), MPI.MAX) == 0
    solved, start = steps[0].solution.displacement, steps[1].start
    norms = [step.elasticity.energy_norm(u) for step, u in zip(steps, (solved, start))]
    assert abs(norms[1] / norms[0] - 1) < 1e-5  # other Gauss points
