"""Hertz contact of two half-spheres: the same run on any number of ranks, and the reference values."""

import json

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import leaves
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact import Solver, adapt
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.law import contact_solver
from fx_contact.linalg import ladder
from fx_contact.linalg.krylov import ConjugateGradients, Outcome
from fx_contact.linalg.linear_solver import LinearSolver
from fx_contact.parallel import memory
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.timing import STAGES
from fx_contact.scenes import hertz

KEYS = """scene, step, ranks, cells, dofs, degree, hanging_nodes, max_level, geometry_order, active_pairs,
contact_iterations, krylov_iterations, estimate, assumed_effectivity, tolerance, ratio, reached, force, pair_forces,
contact_radius, pair_errors, pair_leaves, max_pressure, max_penetration, partition, seconds, control,
cpu_seconds, memory_bytes, peak_memory_bytes, versions, enforcement, preconditioner, penetrated_leaves, penalty_share,
contact_centre, pair_alignments, pair_areas, resultants, doubts"""


@pytest.fixture(scope="module")
def scene():
    return hertz(order=3)


@pytest.fixture(scope="module")
def small():
    """The last record of a small run with the default settings."""
    *_, step = adapt(hertz(order=2, coarse=2), 0.25)
    return step.record


def summary(step):
    """What must not depend on the number of ranks, and what may to round-off and the Krylov tolerance."""
    record = step.record
    exact = "step cells dofs hanging_nodes max_level geometry_order active_pairs"
    close = "force estimate contact_radius max_pressure max_penetration"
    exact, close = ({name: getattr(record, name) for name in names.split()} for names in (exact, close))
    active = np.concatenate(step.forest.comm.allgather(step.rows.position[step.solution.active]))
    return exact, close, leaves(step.forest), active[np.lexsort(np.round(active, 9).T)], record


def runs(scene, **options):
    """Steps on this communicator and, on each rank by itself, in serial."""
    return [[summary(step) for step in adapt(scene, comm=comm, **options)] for comm in (WORLD, MPI.COMM_SELF)]


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("degree", [1, 2])
def test_same_run_in_serial(degree):
    """Cells, levels, dofs and active pairs of every step are those of a serial run; forces agree to 1e-7."""
    parallel, serial = runs(hertz(order=2, coarse=2), degree=degree, tolerance=0.16, geometry_order=2)
    everywhere(len(parallel) == len(serial) >= 3, "another number of steps")
    assert parallel[-1][0]["hanging_nodes"] > 100 and parallel[-1][0]["active_pairs"] > 10
    for here, alone in zip(parallel, serial):
        everywhere(here[0] == alone[0], f"{here[0]} in parallel, {alone[0]} in serial")
        everywhere(np.array_equal(here[2], alone[2]), f"step {here[0]['step']}: other leaves")
        everywhere(np.abs(here[3] - alone[3]).max() < 1e-12, f"step {here[0]['step']}: other active pairs")
        for name, value in here[1].items():
            other = alone[1][name]
            same = value == other if None in (value, other) else abs(value - other) <= 1e-7 * other + 1e-15
            everywhere(same, f"{name} {value} in parallel, {other} in serial")
        partition = here[4].partition
        assert partition.split_pairs == 0 and partition.imbalance < 1.1 and here[4].ranks == WORLD.size
    if WORLD.size > 1:
        assert parallel[-1][4].partition.cut_facets > 0


@pytest.mark.ranks(1)
def test_default_krylov_tolerance():
    """With the default solver the forces of all steps are those of a much tighter one, to 1e-7."""
    forces = [
        np.array([step.record.force for step in adapt(hertz(order=2, coarse=2), 0.25, solver=solver)])
        for solver in (Solver(), Solver(tolerance=1e-13))
    ]
    assert len(forces[0]) > 2
    assert np.abs(forces[0] / forces[1] - 1).max() < 1e-7, forces


def test_record(scene):
    """A step's record has the keys and types of the contract, the same on all ranks, and comes back from JSON."""
    step = next(iter(adapt(scene, 0.16, max_steps=1)))
    record = step.record
    entries = json.loads(json.dumps(record.as_json()))
    assert StepRecord.from_json(entries | {"entry of another version": 1}) == record
    assert set(entries) == {key.strip() for key in KEYS.split(",")}
    assert set(entries["partition"]) == {"kind", "imbalance", "cut_facets", "split_pairs"}
    assert set(record.versions) == {"dolfinx", "petsc", "hypre", "numpy"}
    stages = "partition mesh hanging assemble system setup solve estimate refine output total".split()
    assert {*stages} <= set(record.seconds) == {*STAGES, "total"}
    assert isinstance(record.krylov_iterations, list) and record.scene == "hertz"
    assert record.ratio == record.estimate / record.tolerance
    assert set(record.memory_bytes) == set(STAGES) and set(record.cpu_seconds) == {*STAGES, "total"}
    assert max(record.memory_bytes.values()) <= record.peak_memory_bytes
    everywhere(record == WORLD.bcast(record), "the ranks have different records")


def checked(step, force, pressure, radius):
    """The record of a step that is as close to the reference: axisymmetric P2, exact non-penetration."""
    record = step.record
    assert record.ratio <= 1
    assert abs(record.force / 5.37755e-4 - 1) < force
    assert abs(record.max_pressure / 0.0499817 - 1) < pressure
    assert abs(record.contact_radius / 0.0716222 - 1) < radius
    return record


def test_reference_values(scene):
    """HERTZ-A at 6 % with the default settings: force within 0.5 %, largest pressure and radius within 3 %."""
    *_, step = adapt(scene, 0.06)
    record = checked(step, 0.005, 0.03, 0.03)
    assert record.max_penetration < 1e-12 * 0.01, "the default leaves no penetration"
    assert record.partition.split_pairs == 0
    shear_free = find_shear_free(scene, step.forest, step.elasticity.prolongation)
    again = Estimator(step.elasticity, shear_free, step.stages).error(step.field).estimate
    assert abs(again.relative / record.estimate - 1) < 1e-12


@pytest.mark.ranks(1)
def test_reference_values_at_2_percent(scene):
    """HERTZ-A at 2 % with the default settings: force within 0.2 %, largest pressure 1.5 %, radius 2 %."""
    *_, step = adapt(scene, 0.02)
    assert checked(step, 0.002, 0.015, 0.02).reached


@pytest.mark.parametrize("displacement", [0.0, -0.01])
def test_bodies_that_do_not_touch(displacement):
    """Without load there is no force, no error, and nothing is refined for round-off."""
    (step,) = adapt(hertz(displacement=displacement, order=2, coarse=2), 0.1, allow=("no load",))
    assert step.record.force == 0 and step.record.estimate == 0 and step.record.ratio == 0


@pytest.mark.parametrize(
    "name, most, solver",
    [
        ("cholesky", 5, {"loose_tolerance": 1e-6}),
        ("cholesky", 8, {"options": {"pc_type": "jacobi"}}),
        ("boomeramg-robust", 22, {"options": {"pc_type": "jacobi"}}),
    ],
    ids=["p-multigrid to cholesky", "jacobi to cholesky", "jacobi to hypre"],
)
def test_fallback(monkeypatch, name, most, solver):
    """Where PCG fails a stronger preconditioner takes over: factors if there is memory for them, else BoomerAMG.

    Pairs that close later are added to the matrix in its new format.
    """
    monkeypatch.setattr(ladder, "shortage", lambda comm, needed: None if name == "cholesky" else (needed, 0))
    monkeypatch.setattr(contact_solver, "relax", lambda matrix, base, term, u, *_: u)
    monkeypatch.setattr(contact_solver, "move_bodies", lambda bodies, matrix, load, jump, stiffness, u: u)
    monkeypatch.setattr(LinearSolver, "is_slow", True)
    scene = hertz(order=2, coarse=2, displacement=0.03)
    solvers = Solver(), Solver(max_krylov=most, **solver)
    right, last = (list(adapt(scene, 0.25, solver=one))[-1].record for one in solvers)
    assert right.preconditioner == "p-multigrid" and last.preconditioner == name
    assert last.krylov_iterations[0] > most and last.contact_iterations > 1, "no pair changes after the failure"
    assert last.active_pairs == right.active_pairs
    assert abs(last.force / right.force - 1) < 1e-6


@pytest.mark.parametrize(
    "free, shown, leaf, what",
    [(8e5, "800.0 kB", 0, "the system of .* unknowns"), (2e5, "200.0 kB", 8100, "a forest of .* leaves")],
)
def test_memory_is_not_overdrawn(monkeypatch, free, shown, leaf, what):
    """What would not fit is refused before it is allocated, with what it needs and what there is; no step is lost."""
    scene, steps = hertz(order=2, coarse=2), []
    with pytest.raises(SolveError, match=rf"{what} needs .* [kM]B on a host that has {shown} left") as caught:
        for step in adapt(scene, 0.16):
            steps.append(step.record)
            monkeypatch.setattr(memory, "available", lambda: free)
            monkeypatch.setattr(memory, "_LEAF_BYTES", leaf)
    assert len(steps) == 1 and caught.value.record is steps[0] and caught.value.displacement is not None
    assert memory.shortage(WORLD, 0) is None, "nothing is always there"


@pytest.mark.parametrize(
    "solver", [Solver("cholesky"), Solver(options={"pc_type": "lu", "pc_factor_mat_solver_type": "mumps"})]
)
def test_memory_of_chosen_factors(monkeypatch, solver):
    """Factors that the user has chosen are refused too where they do not fit; they are not begun."""
    next(adapt(hertz(order=1, coarse=1), 0.5, solver=solver))
    monkeypatch.setattr(ladder, "_BYTES", 1e12)
    with pytest.raises(SolveError, match="unknowns needs .* GB on a host .* take 'boomeramg'"):
        next(adapt(hertz(order=1, coarse=1), 0.5, solver=solver))


def test_nothing_takes_over(monkeypatch):
    """Where PCG fails with the strongest preconditioner too, the error names it, PETSc's reason and what to do."""
    monkeypatch.setattr(ConjugateGradients, "solve", lambda self, equations, u, *_: Outcome(u, -11, 7, np.nan))
    with pytest.raises(SolveError, match=r"PCG failed with cholesky \(iterations: 7, PETSc reason -11\); allow more"):
        next(adapt(hertz(order=1, coarse=1), 0.5, solver=Solver("cholesky")))


def test_memory_of_control_groups(monkeypatch, tmp_path):
    """The tightest control group counts, of those around this process; what the page cache holds can be had back."""
    for group, texts in {".": "max 9 9", "a": "5000 4500 200", "a/b": "max 10 0", "other": "1 1 0"}.items():
        folder = tmp_path / group
        folder.mkdir(exist_ok=True)
        for name, text in zip(("memory.max", "memory.current", "memory.stat"), texts.split()):
            (folder / name).write_text(f"anon 3\ninactive_file {text}\n" if name == "memory.stat" else text)
    (tmp_path / "cgroup").write_text("9:cpu:/other\n0::/a/b\n")
    monkeypatch.setattr(memory, "_CGROUP", tmp_path)
    monkeypatch.setattr(memory, "_MEMBERSHIP", tmp_path / "cgroup")
    assert memory.available() == 700


@pytest.mark.parametrize(
    "solver", [Solver(options={"pc_type": "jacobi"}), Solver(options={"pc_type": "gamg"}), Solver("ilu")]
)
def test_preconditioner_does_not_matter(small, solver):
    """Matrices in PETSc's and in hypre's format give the same solution."""
    *_, other = adapt(hertz(order=2, coarse=2), 0.25, solver=solver)
    assert small.cells == other.record.cells
    assert abs(other.record.force / small.force - 1) < 1e-7


def test_root_mesh_is_a_ball():
    """The half-balls' polar surface leaves the sphere by an error of the order of the mesh, less so near the pole."""
    off, near = [], []
    for order in (2, 3, 6):
        mesh = hertz(order=order).mesh
        points = mesh.facet_points(mesh.surfaces["lower pole"], order=9).reshape(-1, 3)
        distance = np.abs(np.linalg.norm(points - [0, 0, -1], axis=1) - 1)
        off.append(distance.max())
        near.append(distance[np.hypot(points[:, 0], points[:, 1]) < 0.2].max())
        nodes = mesh.points
        mirrored = nodes[:, [1, 0, 2]]
        assert cKDTree(nodes).query(mirrored)[0].max() < 1e-9
    assert off[0] < 2e-4 and off[1] < 5e-6 and off[2] < 1e-9
    assert near[0] < 6e-6 and near[1] < 2e-6 and near[2] < 1e-12
