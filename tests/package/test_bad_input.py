"""Bad input: a typed error on every rank that says what, where and what to do; no hang, whatever rank finds it."""

import gc
import json
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import everywhere, outside
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    Pressure,
    Scene,
    Solver,
    adapt,
    block,
    root_mesh_from_shapes,
    scenes,
)
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.geometry.gmsh_mesh import root_mesh_from_file, root_mesh_from_gmsh
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.agreement import differences
from fx_contact.parallel.errors import (
    FxContactError,
    GeometryError,
    OutputError,
    PairingError,
    PartitionError,
    SceneError,
    SolveError,
)
from fx_contact.plot import draw_bodies, draw_convergence, draw_mesh, draw_pressure, draw_stress, draw_sweep
from fx_contact.results.accuracy import true_error
from fx_contact.results.contact_surface import contact_grid
from fx_contact.results.output import RecordWriter, write_fields

STEEL, SOFT = Material(young=1.0, poisson=0.3), Material(young=2.0, poisson=0.3)
COMM = MPI.COMM_WORLD


def grid(n=1, order=1, low=(0.0, 0.0, 0.0), size=1.0):
    """Points and cells of n cells along z, each a cube."""
    shape = block(low, np.add(low, size * np.array([1, 1, n])), (1, 1, n), order)
    return shape.points, shape.cells


def two_cells(*shift):
    """Points and cells of a cube and its copy, shifted, which share no nodes."""
    points, cells = grid()
    return np.concatenate([points, points + shift]), np.concatenate([cells, cells + 8])


def two_cubes(shift=0.0, order=1, gap=0.0):
    """Two unit cubes, one above the other, the upper one moved sideways, or upwards."""
    cube = block((0, 0, 0), (1, 1, 1), (1, 1, 1), order)
    surfaces = {"base": "lower bottom", "under": "lower top", "over": "upper bottom", "top": "upper top"}
    return root_mesh_from_shapes({"lower": cube, "upper": cube.shifted(shift, 0, 1 + gap)}, surfaces)


def press(*extra, **changes):
    """The two cubes pressed together, with extra conditions; keyword arguments replace those of the scene."""
    arguments = dict(
        name="cubes",
        mesh=two_cubes(),
        materials={"lower": STEEL, "upper": STEEL},
        dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, -0.01), *extra),
        contact=(ContactPair("under", "over", (0, 0, 1)),),
    )
    return Scene(**(arguments | changes))


def leaning(*vertices, pressure=0.01, **changes):
    """The two cubes, the upper one pressed down and held by contact and at vertices of its base: (corner, x, y, z)."""
    mesh = two_cubes()
    return press(
        mesh=replace(mesh, vertices={str(corner): [8 + corner] for corner, *_ in vertices}),
        dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), *(Dirichlet(str(corner), *held) for corner, *held in vertices)),
        tractions=(Pressure("top", pressure),),
        **changes,
    )


def far_apart(ratio, *held):
    """A cube held below, and far from it one smaller by a ratio, held at corners: (corner, x, y, z)."""
    _, cells = two_cells(3, 0, 0)
    points = np.concatenate([grid()[0], grid(low=(3.0, 0.0, 0.0), size=ratio)[0]])
    vertices = {str(corner): [8 + corner] for corner, *_ in held}
    mesh = RootMesh(points, cells, ("large", "small"), [0, 1], {"base": [[0, 0]]}, vertices)
    conditions = Dirichlet("base", 0, 0, 0), *(Dirichlet(str(corner), *values) for corner, *values in held)
    return Scene("far apart", mesh, {"large": STEEL, "small": STEEL}, conditions)


def pressed_by(displacement):
    """The two cubes, the upper one moved by another displacement."""
    return press(dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, displacement)))


def of(lower, upper):
    """The two cubes of other materials."""
    return press(materials={"lower": lower, "upper": upper})


def one_name_twice():
    """A stack whose two contacts have one name, from four names of surfaces."""
    scene = scenes.stack()
    pairs = ("a", "b on c"), ("a on b", "c")
    old = [name for contact in scene.contact for name in contact.surfaces]
    surfaces = dict(zip(("a", "b on c", "a on b", "c"), (scene.mesh.surfaces[name] for name in old)))
    mesh = replace(scene.mesh, surfaces=scene.mesh.surfaces | surfaces)
    return replace(scene, mesh=mesh, contact=tuple(ContactPair(*names, (0, 0, 1)) for names in pairs))


def box(recombine=True, order=1, extra=False, twice=False, triangles=False):
    """A box in Gmsh; `triangles`: beside a surface that is not recombined."""
    import gmsh

    gmsh.clear()
    gmsh.model.add("box")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    if extra:
        gmsh.model.occ.addBox(2, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], name="box")
    if twice:
        gmsh.model.addPhysicalGroup(3, [1], name="again")
    if recombine:
        gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
    if triangles:
        surface = gmsh.model.occ.addRectangle(0, 0, 2, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [surface], name="apart")
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)


def gmsh_box(**how):
    """The root mesh of a box in Gmsh."""
    return root_mesh_from_gmsh(COMM, partial(box, **how))


def too_many_ranks():
    """One leaf for all ranks."""
    if COMM.size == 1:
        pytest.skip("one rank always has leaves")
    mesh = RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"base": np.array([[0, 0]])})
    scene = Scene("one", mesh, {"a": STEEL}, (Dirichlet("base", 0.0, 0.0, 0.0),))
    repartition(Forest.of_roots(COMM, mesh, scene.pairing, scene.contact_surfaces), None)


def small_hertz():
    return scenes.hertz(order=1, coarse=1)


def with_surface(name, rows, *conditions):
    """The two cubes pressed together, with another surface."""
    mesh = two_cubes()
    return press(*conditions, mesh=replace(mesh, surfaces={**mesh.surfaces, name: np.atleast_2d(rows)}))


#: A square in Gmsh's format.
SQUARE = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
1
1 3 2 1 1 1 2 3 4
$EndElements
"""

#: A cube in Gmsh's format.
CUBE = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 2 "base"
3 1 "cube"
$EndPhysicalNames
$Nodes
8
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
5 0 0 1
6 1 0 1
7 1 1 1
8 0 1 1
$EndNodes
$Elements
2
1 3 2 2 1 1 2 3 4
2 5 2 1 1 1 2 3 4 5 6 7 8
$EndElements
"""


@contextmanager
def shared_folder():
    """A folder for all ranks, for a while.  Collective."""
    path = Path(COMM.bcast(tempfile.mkdtemp() if COMM.rank == 0 else None))
    try:
        yield path
    finally:
        COMM.Barrier()
        if COMM.rank == 0:
            shutil.rmtree(path)


def from_file(data, name="cube.msh"):
    """The root mesh of a file with the given text or bytes."""
    with shared_folder() as folder:
        if COMM.rank == 0:
            (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
        return root_mesh_from_file(COMM, folder / name)


def with_units(length=1.0, shift=0.0):
    """The two cubes, of which the upper one is in another unit or elsewhere."""
    mesh = two_cubes()
    points = mesh.points.copy()
    points[8:] = points[8:] * length + [0, 0, shift]
    return press(mesh=replace(mesh, points=points))


def first(scene=None, tolerance=0.5, **options):
    """The first step of a run."""
    return next(adapt(scene or small_hertz(), tolerance, COMM, **options))


def with_options(preconditioner=None, **options):
    """The first step of a run with options of PETSc."""
    return first(solver=Solver(preconditioner, options=options))


def unpaired_and_pushed():
    """The two cubes without contact, the upper one free along x, and pushed."""
    return replace(
        unpaired(),
        dirichlet=(Dirichlet("base", 0, 0, 0), Dirichlet("top", None, 0, 0)),
        body_forces=BodyForce("upper", (1, 0, 0)),
    )


def unpaired():
    """The two cubes without contact, each held on a face."""
    return press(dirichlet=(Dirichlet("base", 0, 0, 0), Dirichlet("top", 0, 0, -0.01)), contact=())


def begin(change=lambda values: values, **others):
    """A run that begins on once refined root cells with other values there, or of another scene."""
    beginning = Beginning.uniform(small_hertz(), 1, COMM)
    return first(replace(small_hertz(), **others), beginning=replace(beginning, values=change(beginning.values)))


def on_last_rank(value, elsewhere):
    """One value on the last rank, another on the others, of which there must be some."""
    if COMM.size == 1:
        pytest.skip("one rank agrees with itself")
    return value if COMM.rank == COMM.size - 1 else elsewhere


def with_nan(values):
    """The same values, but for one on the last rank that is no number."""
    values = values.copy()
    values[-1, -1, -1] = np.nan if COMM.rank == COMM.size - 1 else 0.0
    return values


def refine(marked):
    """The beginning after a step of which leaves are marked by a function of their number."""
    step = first()
    return Beginning.after(step, marked(len(step.forest)))


class Unspeakable:
    """A value that fails where it is to be shown."""

    def __repr__(self):
        raise RuntimeError("not to be shown")


def finer():
    """Mesh of the same bodies with more root cells."""
    return scenes.hertz(order=1, coarse=2).mesh


def not_a_number():
    """A step whose displacement is spoilt on the last rank."""
    step = first(press())
    if COMM.rank == COMM.size - 1:
        step.displacement.x.array[:] = np.nan
    return step


#: Functions of no argument by the error that they must end with, and words of its message.
CASES = {
    SceneError: [
        (one_name_twice, "two contacts have the name 'a on b on c': name a surface anew"),
        (lambda: RootMesh(*grid(2), ("a",), [0, 0], {"inner": [[0, 5]]}), "'inner'"),
        (lambda: RootMesh(*grid(), ("a",), [1]), "for the numbers [1]"),
        (lambda: RootMesh(*grid(order=2), ("a",), [0], {}, {"mid": [13]}), "'mid' is not a corner"),
        (lambda: RootMesh(*grid(), ("a",), [0], {"s": [[0, 1], [0, 1]]}), "local face 0..5), none twice"),
        (lambda: gmsh_box(extra=True), "in no physical group"),
        (lambda: draw_pressure(first(unpaired()), "p.png"), "the scene 'cubes' has no contact pairs"),
        (lambda: draw_mesh(first(), "m.png", zoom="x"), "zoom of a picture must be"),
        (
            lambda: draw_bodies(first(), "b.png", factor="a"),
            "the factor of the displacements must be a finite number",
        ),
        (lambda: draw_bodies(first(), "b.png", apart=np.nan), "the distance apart must be a finite number, got nan"),
        (lambda: draw_pressure(first(), "p.png", 3), "exact solution must be a KnownPressure, got 3"),
        (lambda: draw_convergence([1], "c.png", COMM), "the records must be a list, each a StepRecord, got [1]"),
        (lambda: draw_sweep([1], "c.png", COMM), "the points must be a list, each a SweepRecord or SweepPoint, got"),
        (lambda: draw_stress(first(), "s.png", zoom=0), "zoom of a picture must be"),
        (lambda: true_error(first(), "x"), "got 'x'"),
        (lambda: RecordWriter("/tmp", None), "mpi4py"),
        (lambda: Material(Unspeakable(), 0.3), "Unspeakable object"),
        (lambda: from_file(""), "no mesh file of Gmsh"),
        (lambda: from_file(CUBE[:120]), "Gmsh cannot read"),
        (lambda: from_file(CUBE.replace("\n8\n", "\n9\n")), "cannot read"),
        (lambda: with_units(length=1e-09), "body 'upper' is 1e-09 large"),
        (lambda: with_units(shift=1e9), "the place of each body"),
        (
            lambda: with_options(pc_typ="jacobi"),
            "PETSc's solver does not read the option 'pc_typ' (on the command line -fx_pc_typ): it is misspelt",
        ),
        (lambda: with_options(pc_type="jacobi", pc_hypre_type="ilu"), "another solver or preconditioner"),
        (
            lambda: with_options(KSP_Convergence_Test="skip"),
            "'ksp_convergence_test' (on the command line -fx_ksp_convergence_test) is not the user's",
        ),
        (
            lambda: pressed_by(lambda x: np.ma.masked_greater(0 * x[0] - 0.01, -1.0)),
            "the displacement z on 'top' is nan",
        ),
        (lambda: begin(mesh=finer()), "another root mesh"),
        (
            lambda: begin(contact=(), dirichlet=(*small_hertz().dirichlet, Dirichlet("lower pole", z=0.0))),
            "other contact pairs",
        ),
        (lambda: begin(with_nan), "must be finite"),
        (lambda: begin(lambda values: values[1:]), "8 or 27, 3 or more"),
        (lambda: begin(lambda _: "rest"), "array of float64, got 'rest'"),
        (
            lambda: first(beginning=Beginning.uniform(small_hertz(), 0, on_last_rank(MPI.COMM_SELF, MPI.COMM_SELF))),
            "communicator of 1 rank",
        ),
        (lambda: Beginning.uniform(small_hertz(), on_last_rank(1, 0), COMM), "number of refinements (0 on rank 0"),
        (lambda: refine(lambda n: np.ones(max(n - 1, 0), bool)), "one for each of the"),
        (lambda: refine(lambda n: np.full(n, 0.5)), "bool or whole numbers"),
        (lambda: refine(lambda n: None if COMM.rank == COMM.size - 1 else np.ones(n, bool)), "got None"),
        (lambda: refine(lambda n: np.full(n, -1)), "got -1 to -1"),
    ],
    GeometryError: [
        (lambda: gmsh_box(recombine=False), "subdivide tetrahedra after it by the option Mesh.Subdiv"),
        (lambda: RootMesh(grid()[0], grid()[1][:, ::-1], ("a",), [0]), "root cell 0 of 1 is inverted"),
        (lambda: RootMesh(np.zeros((9, 3)), np.arange(9)[None], ("a",), [0]), "got shape (1, 9)"),
        (lambda: RootMesh(np.full((8, 3), np.nan), np.arange(8)[None], ("a",), [0]), "finite"),
        (lambda: from_file(SQUARE), "the mesh has no volumes, and surfaces of ['Quadrilateral 4']"),
        (lambda: gmsh_box(twice=True), "root cell 0 is there twice"),
        (lambda: gmsh_box(triangles=True), "group 'apart' of the Gmsh model needs"),
        (lambda: RootMesh(*grid(), ("a",), ()), "body must have one number"),
        (lambda: replace(two_cubes(), points=two_cubes().points * 1e-200), "units"),
        (lambda: RootMesh(grid()[0], grid()[1] + 0.5, ("a",), [0]), "cells and body of whole numbers"),
        (lambda: RootMesh(grid()[0], grid()[1] + 1, ("a",), [0]), "outside 0..7"),
        (lambda: RootMesh(*grid(), ("a",), [0], {"s": "base"}), "curves and parts dicts of"),
    ],
    PairingError: [
        (
            lambda: with_surface("over", [[1, 0], [0, 5]]),
            "1 facets are on both sides of 'under' on 'over', the first near",
        )
    ],
    SolveError: [
        (lambda: first(unpaired_and_pushed()), "nothing holds body 'upper' along x: a load drives this motion"),
        (lambda: first(leaning(body_forces=BodyForce("upper", (0.01, 0, 0)))), "nothing holds body 'upper' along x"),
        (
            lambda: first(leaning((0, 0.0, 0.0), body_forces=BodyForce("upper", (0.01, 0, 0)))),
            "'upper' along x and along y and about z",
        ),
        (
            lambda: with_options("boomeramg", pc_hypre_boomeramg_strong_threshold="much"),
            "PETSc cannot work with the solver's options, under the prefix fx_",
        ),
        (
            lambda: first(
                scenes.hertz(order=1, coarse=4), solver=Solver(max_krylov=1, tolerance=1e-13, loose_tolerance=1e-12)
            ),
            "PCG failed with p-multigrid (iterations: 1, PETSc reason -3), then with cholesky (",
        ),
        (lambda: not_a_number().stress, "projection of the stress has not converged in 200 iterations: its relative"),
    ],
    OutputError: [
        (lambda: draw_pressure(first(), "/dev/null/pressure.png"), "cannot draw"),
        (lambda: RecordWriter(5, COMM), "must be a path, got 5"),
        (lambda: RecordWriter("/dev/null/run", COMM), "name another folder"),
    ],
    PartitionError: [(too_many_ranks, "run on fewer ranks")],
}
CASES[SceneError] += [
    *(
        (partial(action, "step", 0.1), "a Step is needed")
        for action in (true_error, draw_pressure, draw_mesh, draw_stress, write_fields)
    ),
    (lambda: contact_grid("step"), "a Step is needed"),
    (
        lambda: first(beginning=replace(Beginning.uniform(small_hertz(), 0, COMM), adapted=0)),
        "`adapted` of a Beginning must be True or False",
    ),
    *(
        (
            lambda name=name, value=value: with_options(**{name: value}),
            f"'{name}' (on the command line -fx_{name}) is not the user's: set Solver.tolerance",
        )
        for name, value in {
            "ksp_rtol": 0.5,
            "ksp_atol": 1.0,
            "ksp_divtol": 2.0,
            "ksp_max_it": 3,
            "ksp_convergence_test": "skip",
            "ksp_converged_maxits": None,
            "ksp_initial_guess_nonzero": None,
            "ksp_error_if_not_converged": None,
            "ksp_norm_type": "preconditioned",
            "ksp_pc_side": "right",
        }.items()
    ),
]
CASES[SolveError] += [
    (lambda name=name, value=value: with_options(**{name: value}), words.format(value))
    for words, options in {
        "-fx_pc_type {} cannot be used: the method must": [
            ("pc_type", kind) for kind in ("none", "mat", "lmvm", "eisenstat")
        ],
        "PETSc cannot work with the solver's options": [
            (name, ":/no/such/file") for name in ("ksp_view", "ksp_monitor", "ksp_converged_reason")
        ],
    }.items()
    for name, value in options
]
CASES[GeometryError] += [
    (partial(action, length), f"is {length:.3g}, volumes of such")
    for length in (1e308, 1e160, 1e-200)
    for action in (
        lambda length: scenes.punch(length),
        lambda length: scenes.punch(length, force=1.0),
        lambda length: scenes.punch(side=length),
        scenes.hertz,
        lambda length: scenes.indentation(side=length),
        lambda length: scenes.cylinders((length, 1.0)),
        lambda length: scenes.shrink_fit((length, 1.0, 2.0)),
        lambda length: scenes.stack(height=length),
    )
]


#: Functions of what they are given; of a wrong type or value each must make a SceneError that shows it.
OF_ONE_VALUE = (
    lambda value: scenes.hertz(radius=value),
    lambda value: Material(1.0, value),
    lambda value: adapt(press(), value, COMM),
    lambda value: adapt(press(), 0.5, COMM, max_steps=value),
    lambda value: adapt(press(), 0.5, COMM, partition_kind=value),
    lambda value: press(contact=value),
    lambda value: adapt(press(), 0.5, value),
)
CASES[SceneError] += [
    (partial(action, given), spelt)
    for given, spelt in {
        "text": "'text'",
        None: "None",
        np.nan: "nan",
        -np.inf: "-inf",
        1j: "1j",
        True: "True",
        (1.0, 2.0): "(1.0, 2.0)",
        10**400: "1000000",
    }.items()
    for action in OF_ONE_VALUE
]


def test_the_good_scene_passes():
    """What the bad cases spoil is right: two cubes pressed together have the force of two bars in series."""
    *_, step = adapt(press(), 0.9, MPI.COMM_SELF, max_steps=1)
    sliding, clamped = 1.0, (1 - 0.3) / (1.3 * 0.4)
    assert 0.005 * sliding < step.record.force < 0.005 * clamped


@pytest.mark.parametrize(
    "kind, action, words",
    [pytest.param(kind, *case, id=f"{kind.__name__}: {case[1]}") for kind, cases in CASES.items() for case in cases],
)
def test_error(kind, action, words):
    """The right type, and a message that names the culprit, on every rank."""
    caught = None
    try:
        action()
    except FxContactError as error:
        caught = error
    told = COMM.allgather((type(caught).__name__, words in str(caught)))
    assert isinstance(caught, kind) and len(set(told)) == 1 and told[0][1], f"{told}: {caught}"


@pytest.mark.parametrize("direction", [None, (0, 0, 1)])
def test_what_contact_holds(direction):
    """A body on a single facet is held by all its corners, and needs no more than two vertices besides."""
    scene = leaning((0, 0.0, 0.0), (1, None, 0.0), contact=(ContactPair("under", "over", direction),))
    assert abs(first(scene).record.force / 0.01 - 1) < 1e-6


@pytest.mark.parametrize("ratio", [1.0, 1e-4, 1e-5])
def test_what_vertices_hold(ratio):
    """Three vertices hold a body, two do not, however small it is beside the others, and far from them."""
    two = (0, 0.0, 0.0, 0.0), (1, None, 0.0, 0.0)
    assert len(far_apart(ratio, *two).rigid_motions.free) == 1
    assert not len(far_apart(ratio, *two, (2, None, None, 0.0)).rigid_motions.free)


@pytest.mark.parametrize("kind", [np.float32, np.float64, Fraction])
def test_numbers_of_any_kind(kind):
    """What is a number is taken as one in double precision; the record can be written."""
    tolerance, stiff = kind(1) / 2, Material(kind(1), kind(1) / 4)
    enforcement = Enforcement("penalty", kind(2**10))
    solver = Solver(tolerance=kind(1) / 2**27, loose_tolerance=kind(1) / 2**10)
    scene = of(stiff, stiff)
    record = next(adapt(scene, tolerance, COMM, enforcement=enforcement, solver=solver)).record
    again = next(adapt(scene, 0.5, COMM, enforcement=enforcement, solver=solver)).record
    assert abs(json.loads(json.dumps(record.as_json()))["estimate"] / again.estimate - 1) < 1e-12
    assert type(stiff.young) is float


def test_a_solve_after_a_failed_one():
    """What hypre could not set up does not spoil what comes after it."""
    force = first().record.force
    for bad in ({"pc_hypre_boomeramg_strong_threshold": 5.0}, {"pc_hypre_type": "ams"}):
        with pytest.raises(SolveError, match="the solver's options"):
            first(solver=Solver("boomeramg", options=bad))
        assert first().record.force == force


def garbage(capfd):
    """Objects of PETSc that Python has dropped, and that on several ranks nobody has freed: int.  Collective."""
    gc.collect()
    capfd.readouterr()
    PETSc.garbage_view(COMM)
    entries = sum(map(int, re.findall(r"Total entries: (\d+)", capfd.readouterr().out)))
    return COMM.bcast(entries)  # rank 0 prints for all


@pytest.mark.parametrize(
    "options, words",
    [
        ({"solver": Solver(max_krylov=1)}, "PCG"),
        ({"solver": Solver(max_contact=1), "scene": scenes.punch(force=1e-3)}, "after 1 linear solves"),
        ({"solver": Solver(options={"pc_type": "none"})}, "jacobi is as simple"),
        ({"solver": Solver(options={"pc_typ": "jacobi"})}, "misspelt"),
        ({"scene": unpaired(), "solver": Solver(options={"pc_typ": "jacobi"})}, "misspelt"),
    ],
)
def test_failed_solve_leaves_nothing(capfd, options, words):
    """Its matrix and preconditioner would stay in the memory for ever."""
    before = garbage(capfd)
    (answer,) = set(told(lambda: first(**{"scene": scenes.hertz(order=1, coarse=2)} | options)))
    assert words in answer[1], answer
    assert garbage(capfd) == before


@pytest.mark.skipif(COMM.size == 1, reason="one rank agrees with itself")
def test_ranks_that_differ_in_options_of_petsc():
    """PETSc has options on each rank for itself: the error says which are not the same, and nothing is left of it."""
    typed = PETSc.Options("fx_")
    if COMM.rank == COMM.size - 1:
        typed["pc_type"] = "jacobi"
    try:
        answers = told(first)
    finally:
        typed.delValue("pc_type")
    words = 'differ in PETSc\'s option -fx_pc_type (null on rank 0, "jacobi" on rank'
    assert len(set(answers)) == 1 and answers[0][0] is SceneError and words in answers[0][1], answers
    assert first().record.preconditioner == "p-multigrid"


@pytest.mark.skipif(COMM.size == 1, reason="one rank has all of the solver inside")
def test_option_that_some_ranks_read():
    """What the ranks that have a solver inside read is no mistake; what none of them reads is one, on all."""
    inside = {"pc_type": "telescope", "pc_telescope_reduction_factor": COMM.size, "telescope_pc_type": "jacobi"}
    assert first(solver=Solver(options=inside)).record.preconditioner == "telescope"
    (answer,) = set(told(lambda: first(solver=Solver(options=inside | {"telescope_pc_typ": "jacobi"}))))
    assert answer[0] is SceneError and "does not read the option 'telescope_pc_typ'" in answer[1], answer


@pytest.mark.parametrize("called", ["krylov.ConjugateGradients._product", "krylov.KrylovMethod._precondition"])
@pytest.mark.parametrize(
    "failure, kind, words",
    [
        (KeyboardInterrupt(), KeyboardInterrupt, ""),
        (MemoryError("no room"), MemoryError, "no room"),
        (PETSc.Error(62), SolveError, "as they are: error code 62"),
    ],
)
def test_error_of_python_inside_of_petsc(monkeypatch, called, failure, kind, words):
    """What Python raises where PETSc calls it is raised as it is, not as a fault of PETSc's options."""

    def fail(*_):
        raise failure

    penalty = Enforcement("penalty", 1e5)
    monkeypatch.setattr(f"fx_contact.linalg.{called}", fail)
    with pytest.raises(BaseException) as caught:
        first(enforcement=penalty)
    everywhere(caught.type is kind and words in str(caught.value), f"{caught.value!r}")
    monkeypatch.undo()
    assert first(enforcement=penalty).record.active_pairs


def told(action):
    """Type and message of the error that an action ends in on each rank."""
    try:
        action()
    except FxContactError as error:
        return COMM.allgather((type(error), str(error)))
    return COMM.allgather((type(None), ""))


#: Arguments of `adapt` as rank 0 gives them, and as the last rank does; what the error says.
UNLIKE = [
    ({}, {"tolerance": 0.4}, "tolerance (0.5 on rank 0, 0.4 on rank"),
    ({}, {"degree": 1}, "degree (2 on rank 0, 1 on rank"),
    ({}, {"degree": 3}, "degree of displacements must be 1 or 2, got 3"),
    ({}, {"max_steps": 1}, "most steps (20 on rank 0, 1 on rank"),
    ({}, {"scene": None}, "must be a Scene, got None"),
    ({}, {"geometry_order": 1}, "geometry order (null on rank 0, 1 on"),
    ({}, {"enforcement": Enforcement("penalty")}, "enforcement ({"),
    ({}, {"solver": Solver("ilu")}, "solver's preconditioner"),
    ({}, {"solver": Solver(options={"pc_typ": 1})}, "solver's option pc_typ (null on rank 0"),
    ({}, {"partition_kind": "sfc"}, 'partition ("contact-sfc" on rank 0'),
    ({}, {"checkpoint": "/dev/null/a"}, "checkpoint (null on rank 0"),
    ({}, {"restart": "here"}, 'restart (null on rank 0, "here" on rank'),
    ({}, {"restart": 3}, "must be a Checkpoint, got 3"),
    ({}, {"scene": of(STEEL, SOFT)}, "materials ({"),
    ({}, {"scene": pressed_by(-0.02)}, "displacement conditions ([["),
    (
        {"scene": pressed_by(lambda x: 0 * x[0] - 0.01)},
        {"scene": pressed_by(lambda x: 0 * x[0] - 0.02)},
        "displacement conditions ([[",
    ),
    ({}, {"scene": press(mesh=two_cubes(order=2))}, "root mesh"),
    ({}, {"scene": press(name="others")}, 'scene ("cubes" on rank 0, "others"'),
]


@pytest.mark.skipif(COMM.size == 1, reason="one rank agrees with itself")
@pytest.mark.parametrize("others, last, words", UNLIKE)
def test_ranks_that_differ(others, last, words):
    """What ranks are asked for must be the same: the error says what is not, on all ranks."""
    arguments = dict(scene=press(), tolerance=0.5, comm=COMM) | (last if COMM.rank == COMM.size - 1 else others)
    answers = told(lambda: adapt(**arguments))
    assert len(set(answers)) == 1 and answers[0][0] is SceneError and words in answers[0][1], answers


def test_what_is_alike():
    """Of NaN too it is said that it is the same; numbers are equal whatever their type."""
    nan = {"a": float("nan"), "b": [1.0, float("nan")], "c": 1}
    assert differences(nan, nan | {"c": 1.0}, "here", "there") == ""
    assert differences(nan, nan | {"b": [1.0, 2.0]}, "here", "there") == "b ([1.0, NaN] here, [1.0, 2.0] there)"


#: What else all ranks do together: functions of what they are given, which the last rank is given otherwise.
UNLIKE_ELSEWHERE = [
    (lambda folder: Checkpoint(folder, press(), COMM), "a", "b", 'folder ("a" on rank 0, "b"'),
    (lambda folder: Checkpoint(folder, press(), COMM), "a", None, "a path, got None"),
    (lambda z: Checkpoint("a", press(contact_centre=(0, 0, z)), COMM), 1, 2, "symmetry ([1, 0.0, 0.0, 1.0]"),
    (lambda scene: Checkpoint("a", scene, COMM), press(), None, "got None"),
    (lambda folder: RecordWriter(folder, COMM), "/dev/null/a", "/dev/null/b", "output folder"),
    (lambda folder: RecordWriter(folder, COMM), "/dev/null", 5, "must be a path, got 5"),
    (lambda folder: write_fields(first(), folder), "/dev/null/a", "/dev/null/b", "output folder"),
    (lambda folder: write_fields(first(), folder), "/dev/null/a", None, "must be a path, got None"),
    (lambda path: draw_pressure(first(), path), "/dev/null/a", "/dev/null/b", "name of a picture"),
    (lambda path: root_mesh_from_file(COMM, path), "a.msh", "b.msh", "a mesh file ("),
    (lambda path: root_mesh_from_file(COMM, path), "a.msh", 5, "must be a path, got 5"),
]


@pytest.mark.skipif(COMM.size == 1, reason="one rank agrees with itself")
@pytest.mark.parametrize("action, others, last, words", UNLIKE_ELSEWHERE)
def test_ranks_that_differ_elsewhere(action, others, last, words):
    """Also before a run and after it."""
    answers = told(lambda: action(last if COMM.rank == COMM.size - 1 else others))
    assert len(set(answers)) == 1 and words in answers[0][1], answers


def test_function_that_fails_late(tmp_path):
    """A function of the user may fail on one rank whenever it is called: all raise.  Checkpoints do not call it."""
    left, last = np.inf, COMM.size - 1

    def moved(x):
        nonlocal left
        left -= 1
        return np.full(x.shape[1], np.nan if left < 0 and COMM.rank == last else -0.01)

    scene, folder = pressed_by(moved), COMM.bcast(tmp_path)
    left = 100
    first(scene)
    needed = COMM.bcast(100 - left, root=last)
    for calls in range(needed):
        left = calls
        (answer,) = set(told(lambda: first(scene, checkpoint=folder)))
        assert answer[0] is SceneError and "'top' is nan" in answer[1], answer
    left = needed
    assert needed > 1 and first(scene, checkpoint=folder).record.active_pairs


def test_function_that_ends_the_program():
    """A function of the user that calls sys.exit, on one rank, has failed: the others would wait for that rank."""
    calls = 0

    def moved(x):
        nonlocal calls
        calls += 1
        return np.full(x.shape[1], -0.01) if calls < 4 or COMM.rank < COMM.size - 1 else sys.exit("enough")

    with pytest.raises(SystemExit, match="enough"):
        first(pressed_by(moved))


def test_gmsh_model_of_rank_0():
    """Rank 0 builds a Gmsh model, so what the others give does not matter."""
    assert root_mesh_from_gmsh(COMM, box if COMM.rank == 0 else None).bodies == ("box",)
    with pytest.raises(GeometryError, match="must be a function without arguments"):
        root_mesh_from_gmsh(COMM, None if COMM.rank == 0 else box)


def test_what_the_bad_cases_spoil_is_good():
    """The file and the lists are taken where nothing is wrong with them; a script in a file is not run."""
    mesh = from_file(CUBE)
    assert mesh.bodies == ("cube",) and mesh.surfaces["base"].tolist() == [[0, 0]]
    points, cells = grid()
    mesh = RootMesh(
        points.tolist(), cells.tolist(), ["a"], [0], {"base": [[0, 0]]}, {"corner": [0]}, {"edge": [[0, 0]]}
    )
    scene = Scene("lists", mesh, {"a": STEEL}, [Dirichlet("base", 0, 0, 0), Dirichlet("corner", x=0)])
    assert scene.mesh.points.dtype == np.float64 and scene.mesh.body.dtype == np.int32
    with shared_folder() as folder:
        for name in ("a.geo", "a.msh", "a.txt"):
            with pytest.raises(SceneError, match="is no mesh file of Gmsh"):
                from_file(f'SystemCall "touch {folder}/run";\n', name)
        assert not list(folder.iterdir())


#: A program that fails on the last rank, before it calls anything that all ranks call together.
FAILS_ALONE = """
from mpi4py import MPI
from fx_contact import Material
from fx_contact.scenes import patch
comm = MPI.COMM_WORLD
material = Material(1.0, 0.3 if comm.rank < comm.size - 1 else 0.7)
comm.Barrier()
"""


#: A program whose last rank fails while the others wait for it inside of PETSc.
FAILS_IN_PETSC = """
from mpi4py import MPI
from petsc4py import PETSc
from fx_contact import adapt
from fx_contact.linalg import krylov, petsc_objects
from fx_contact.scenes import patch
petsc_objects._TIMEOUT = 0.1
comm, product, calls = MPI.COMM_WORLD, krylov.ConjugateGradients._product, []
def mult(self, *vectors):
    calls.append(1)
    if len(calls) == 3 and comm.rank == comm.size - 1:
        raise {}
    product(self, *vectors)
krylov.ConjugateGradients._product = mult
next(adapt(patch(cells=(2, 2, 2)), 0.1))
"""


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
@pytest.mark.parametrize(
    "program, error, runner, ranks",
    [
        (FAILS_ALONE, "SceneError: Poisson's ratio", ["-m", "fx_contact"], 2),
        (FAILS_IN_PETSC.format("MemoryError('no room')"), "MemoryError: no room", [], 3),
        (FAILS_IN_PETSC.format("PETSc.Error(55)"), "PETSc cannot work with the solver's options", [], 2),
    ],
    ids=["in the program", "Python, called by PETSc", "PETSc"],
)
def test_error_of_one_rank_ends_all(tmp_path, program, error, runner, ranks):
    """With its traceback: any error in a program that is run by the package, and one inside PETSc in any program."""
    path = tmp_path / "program.py"
    path.write_text(program)
    command = ["mpirun", "-n", str(ranks), sys.executable, *runner, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, env=outside(), timeout=30)
    assert done.returncode == 1 and "Traceback" in done.stderr, done.stderr
    assert error in done.stderr and "MPI_ABORT" in done.stderr, done.stderr


def test_import_changes_nothing():
    """Importing the package leaves hooks, handlers and environment of the process alone."""
    program = """
import atexit, os, signal, sys, threading
import dolfinx, scipy
hooks = lambda: (sys.excepthook, sys.displayhook, threading.excepthook, signal.getsignal(signal.SIGINT))
state = lambda: (hooks(), dict(os.environ), atexit._ncallbacks())
before = state()
import fx_contact
sys.exit(before != state())
"""
    assert subprocess.run([sys.executable, "-c", program], env=outside(), timeout=60).returncode == 0


#: A program that catches what PETSc cannot do on rank 0, then another error, and ends.
GOES_ON = """
from fx_contact import Solver, adapt
from fx_contact.parallel.errors import FxContactError
from fx_contact.scenes import patch
for options in ({"ksp_monitor": "ascii:/no/such/file"}, {"ksp_max_it": "1"}):
    try:
        next(adapt(patch(cells=(2, 2, 2)), 0.1, solver=Solver(options=options)))
    except FxContactError as error:
        print(error)
"""


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
def test_program_that_goes_on_after_errors_of_petsc():
    """It ends, though what PETSc has made is not the same on all ranks."""
    command = ["mpirun", "-n", "2", sys.executable, "-c", GOES_ON]
    done = subprocess.run(command, capture_output=True, text=True, env=outside(), timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("PETSc cannot work with") == done.stdout.count("is not the user's: set Solver") == 2


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
def test_options_file_of_the_environment():
    """On two ranks too, a file that PETSC_OPTIONS names and that is not there is one sentence and an exit code."""
    demo = Path(__file__).parents[2] / "demos" / "hertz.py"
    plain = outside() | {"PETSC_OPTIONS": "-fx_ksp_monitor -options_file no/such"}
    command = ["mpirun", "-n", "2", sys.executable, str(demo), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, env=plain, timeout=100)
    assert done.returncode == 2 and done.stderr.count("there is no file 'no/such' of PETSc options") == 1, done.stderr
    assert "PETSC ERROR" not in done.stderr


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
@pytest.mark.parametrize(
    "words, code, message",
    [
        ("--degree 5", 1, "SceneError: the degree of displacements must be 1 or 2, got 5"),
        ("--degree two", 2, "argument --degree: invalid int value: 'two'"),
        ("--tolerence 0.1", 2, "unknown option '--tolerence'; did you mean '--tolerance'?"),
        ("-FX_KSP_RTOL 0.5", 1, "is not the user's: set Solver.tolerance"),
        ("-fx_fallback_pc_type jacobi", 1, "does not read the option 'fallback_pc_type'"),
        ("-fx_ksp_monitor ascii tolerance 0.3", 2, "unknown option 'tolerance'"),
        ("-fx_ksp_view 0.3 --quiet yes", 2, "unknown option 'yes'"),
        ("--reference hertz-a --poisson 0.25", 1, "of another problem: Poisson's ratio 0.25 instead of 0.3"),
        ("--restart", 2, "--restart needs --checkpoint"),
        ("--restart --checkpoint no/such --uniform 1", 2, "--uniform begins anew: give one of them"),
        ("-options_file", 2, "there is no file '' of PETSc options"),
    ],
)
def test_command_line(tmp_path, words, code, message, capfd, monkeypatch):
    """A demo ends with one line that says what is wrong, and with an exit code."""
    demo = Path(__file__).parents[2] / "demos" / "hertz.py"
    command = [str(demo), *f"--order 1 --coarse 1 --tolerance 0.5 --output {tmp_path} {words}".split()]
    if words.startswith("-") and not words.startswith("--"):  # PETSc reads its options once in a process
        done = subprocess.run([sys.executable, *command], capture_output=True, text=True, env=outside(), timeout=100)
        status, said = done.returncode, done.stderr
    else:
        monkeypatch.setattr(sys, "argv", command)
        monkeypatch.syspath_prepend(demo.parent)
        monkeypatch.delitem(sys.modules, "common", raising=False)
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(demo), run_name="__main__")
        status, said = ended.value.code, capfd.readouterr().err
    assert status == code and message in said and "Traceback" not in said, said
