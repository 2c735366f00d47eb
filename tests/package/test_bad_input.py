"""Bad input: a typed error on every rank that says what, where and what to do; no hang, whatever rank finds it."""

import gc
import json
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import everywhere, outside
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact import ContactPair, Dirichlet, Enforcement, Material, Pressure, Scene, Solver, Traction, adapt, scenes
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.parallel.agreement import differences
from fx_contact.parallel.errors import (
    CheckpointError,
    FxContactError,
    GeometryError,
    OutputError,
    PairingError,
    PartitionError,
    SceneError,
    SolveError,
)
from fx_contact.parallel.mpi import together
from fx_contact.plot import draw_mesh, draw_partition, draw_pressure, draw_stress
from fx_contact.problem import hexahedron
from fx_contact.problem.gmsh_mesh import root_mesh_from_file, root_mesh_from_gmsh
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.results.accuracy import contact_errors
from fx_contact.results.manufactured import adapt_manufactured
from fx_contact.results.output import RecordWriter, write_fields
from fx_contact.results.overrefined_solution import true_error
from fx_contact.results.reference_values import hertz_a

STEEL = Material(young=1.0, poisson=0.3)
COMM = MPI.COMM_WORLD


def grid(n=1, order=1, low=(0.0, 0.0, 0.0), size=1.0):
    """Points and cells of n cells along z, each a cube."""
    lattice = hexahedron.grid_points(order)
    points = np.concatenate([lattice / order + [0, 0, k] for k in range(n)]) * size + low
    keys = np.rint(points * 1e6).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return points[first], inverse.reshape(n, -1)


def two_cubes(shift=0.0, order=1):
    """Two unit cubes, one above the other, the upper one moved sideways."""
    lower, cells = grid(order=order)
    upper = lower + [shift, 0, 1]
    return RootMesh(
        np.concatenate([lower, upper]),
        np.concatenate([cells, cells + len(lower)]),
        ("lower", "upper"),
        np.array([0, 1], dtype=np.int32),
        {
            "base": np.array([[0, 0]]),
            "under": np.array([[0, 5]]),
            "over": np.array([[1, 0]]),
            "top": np.array([[1, 5]]),
        },
    )


def press(mesh, *extra, **changes):
    """The two cubes pressed together; keyword arguments replace those of the scene."""
    arguments = dict(
        name="cubes",
        mesh=mesh,
        materials={"lower": STEEL, "upper": STEEL},
        dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, -0.01), *extra),
        contact=(ContactPair("under", "over", (0, 0, 1)),),
    )
    return Scene(**(arguments | changes))


def leaning(*vertices, pressure=0.01, **changes):
    """The two cubes, the upper one pressed down and held by contact and at vertices of its base: (corner, x, y, z)."""
    mesh = two_cubes()
    return press(
        replace(mesh, vertices={str(corner): [8 + corner] for corner, *_ in vertices}),
        dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), *(Dirichlet(str(corner), *held) for corner, *held in vertices)),
        tractions=(Pressure("top", pressure),),
        **changes,
    )


def far_apart(ratio, *held):
    """A cube held below, and far from it one smaller by a ratio, held at corners: (corner, x, y, z)."""
    (points, cells), (small, _) = grid(), grid(low=(3.0, 0.0, 0.0), size=ratio)
    mesh = RootMesh(
        np.concatenate([points, small]),
        np.concatenate([cells, cells + 8]),
        ("large", "small"),
        [0, 1],
        {"base": [[0, 0]]},
        {str(corner): [8 + corner] for corner, *_ in held},
    )
    conditions = Dirichlet("base", 0, 0, 0), *(Dirichlet(str(corner), *values) for corner, *values in held)
    return Scene("far apart", mesh, {"large": STEEL, "small": STEEL}, conditions)


def pressed_by(displacement):
    """The two cubes, the upper one moved by another displacement."""
    return press(two_cubes(), dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, displacement)))


def inverted():
    points, cells = grid()
    return RootMesh(points, cells[:, ::-1], ("a",), np.zeros(1, np.int32))


def cracked():
    """Two cells that touch without sharing their nodes."""
    points, cells = grid()
    return RootMesh(
        np.concatenate([points, points + [0, 0, 1]]),
        np.concatenate([cells, cells + 8]),
        ("a",),
        np.zeros(2, np.int32),
    )


def hanging_roots():
    """A cell beside two half as high: a root mesh may not have hanging nodes."""
    points = hexahedron.grid_points(1).astype(float)
    small = points * [1, 1, 0.5] + [1, 0, 0]
    both = np.concatenate([points, small, small + [0, 0, 0.5]])
    _, first, inverse = np.unique(both, axis=0, return_index=True, return_inverse=True)
    return RootMesh(both[first], inverse.reshape(3, 8), ("a",), np.zeros(3, np.int32))


def gmsh_box(recombine=True, order=1, extra=False, twice=False, triangles=False):
    """A root mesh of a box, by Gmsh; `triangles`: beside a surface that is not recombined."""

    def build():
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

    return root_mesh_from_gmsh(COMM, build)


def too_many_ranks():
    """One leaf for all ranks."""
    if COMM.size == 1:
        pytest.skip("one rank always has leaves")
    mesh = RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"base": np.array([[0, 0]])})
    scene = Scene("one", mesh, {"a": STEEL}, (Dirichlet("base", 0.0, 0.0, 0.0),))
    repartition(Forest.of_roots(COMM, mesh, scene.pairing), None)


def small_hertz():
    return scenes.hertz(order=1, coarse=1, comm=COMM)


def with_side(mesh):
    """The same mesh with a name for a side of the lower cube, which shares an edge with its base."""
    return replace(mesh, surfaces={**mesh.surfaces, "side": [[0, 1]]})


def unheld():
    """Half-spheres drawn apart, the lower one held by contact alone."""
    scene = small_hertz()
    conditions = [c for c in scene.dirichlet if c.where not in ("bottom", "top")] + [Dirichlet("top", z=0.01)]
    return replace(scene, dirichlet=tuple(conditions))


def apart():
    """Points and cells of two cubes that do not touch."""
    points, cells = grid()
    return np.concatenate([points, points + [3, 0, 0]]), np.concatenate([cells, cells + 8])


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


def from_file(data, name="cube.msh"):
    """The root mesh of a file with the given text or bytes."""
    folder = COMM.bcast(tempfile.mkdtemp() if COMM.rank == 0 else None)
    path = Path(folder) / name
    try:
        if COMM.rank == 0:
            path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return root_mesh_from_file(COMM, path)
    finally:
        COMM.Barrier()
        if COMM.rank == 0:
            shutil.rmtree(folder)


def with_units(length=1.0, shift=0.0):
    """The two cubes, of which the upper one is in another unit or elsewhere."""
    mesh = two_cubes()
    points = mesh.points.copy()
    points[8:] = points[8:] * length + [0, 0, shift]
    return press(replace(mesh, points=points))


def first(scene=None, tolerance=0.5, **options):
    """The first step of a run."""
    return next(adapt(scene or small_hertz(), tolerance, COMM, **options))


def unpaired():
    """The two cubes without contact, each held on a face."""
    return press(two_cubes(), dirichlet=(Dirichlet("base", 0, 0, 0), Dirichlet("top", 0, 0, -0.01)), contact=())


def begin(change=lambda values: values, **others):
    """A run that begins on once refined root cells with other values there, or of another scene."""
    beginning = Beginning.uniform(small_hertz(), 1, COMM)
    return first(replace(small_hertz(), **others), beginning=replace(beginning, values=change(beginning.values)))


def nan_on_last_rank(values):
    """The same values, but for one that is no number."""
    values = values.copy()
    values[-1, -1, -1] = np.nan if COMM.rank == COMM.size - 1 else 0.0
    return values


def of_one_rank():
    """A beginning that each rank has for itself."""
    if COMM.size == 1:
        pytest.skip("one rank has no other communicator")
    return Beginning.uniform(small_hertz(), 0, MPI.COMM_SELF)


def unlike_levels():
    """Root cells that only the last rank refines."""
    if COMM.size == 1:
        pytest.skip("one rank agrees with itself")
    return Beginning.uniform(small_hertz(), int(COMM.rank == COMM.size - 1), COMM)


def refine(marked):
    """The beginning after a step of which leaves are marked by a function of their number."""
    step = first()
    return Beginning.after(step, marked(len(step.forest)))


def go_on(**others):
    """A run of another scene that goes on from a checkpoint."""
    scene = small_hertz()
    folder = COMM.bcast(tempfile.mkdtemp() if COMM.rank == 0 else None)
    try:
        first(scene, checkpoint=folder)
        return first(replace(scene, **others), restart=Checkpoint(folder, scene, COMM))
    finally:
        COMM.Barrier()
        shutil.rmtree(folder, ignore_errors=True)


class Unspeakable:
    """A value that fails where it is to be shown."""

    def __repr__(self):
        raise RuntimeError("not to be shown")


def finer():
    """Mesh of the same bodies with more root cells."""
    return scenes.hertz(order=1, coarse=2, comm=COMM).mesh


def never_converges():
    solver = Solver(max_krylov=1, tolerance=1e-13, loose_tolerance=1e-12)
    list(adapt(scenes.hertz(order=1, coarse=4, comm=COMM), 0.5, COMM, solver=solver, max_steps=1))


def unwritable_fields():
    write_fields(next(adapt(small_hertz(), 0.5, COMM)), "/dev/null")


CASES = {
    "E = 0": (lambda: Material(0.0, 0.3), SceneError, "Young's modulus must be a positive number, got 0"),
    "E < 0": (lambda: Material(-1.0, 0.3), SceneError, "positive number, got -1"),
    "E is NaN": (lambda: Material(np.nan, 0.3), SceneError, "got nan"),
    "E is text": (lambda: Material("stiff", 0.3), SceneError, "'stiff'"),
    "nu = 0.5": (lambda: Material(1.0, 0.5), SceneError, "between -1 and 0.5"),
    "nu > 0.5": (lambda: Material(1.0, 0.7), SceneError, "0.7"),
    "negative penalty": (
        lambda: Enforcement("penalty", -1.0),
        SceneError,
        "penalty factor must be a positive number",
    ),
    "negative k_N": (lambda: Enforcement("penalty", node_stiffness=-2.0), SceneError, "node_stiffness"),
    "unknown enforcement": (lambda: Enforcement("mortar"), SceneError, "'exact', 'penalty'"),
    "an enforcement of the past": (lambda: Enforcement("augmented-lagrangian"), SceneError, "'exact', which has no"),
    "penalty where none is": (lambda: Enforcement(factor=10.0), SceneError, "takes no penalty factor"),
    "two penalties": (lambda: Enforcement("penalty", 10.0, 3.0), SceneError, "not both"),
    "tolerance 0": (lambda: next(adapt(press(two_cubes()), 0.0, COMM)), SceneError, "tolerance must be a positive"),
    "tolerance < 0": (lambda: next(adapt(press(two_cubes()), -0.1, COMM)), SceneError, "-0.1"),
    "no steps": (lambda: next(adapt(press(two_cubes()), 0.1, COMM, max_steps=0)), SceneError, "max_steps"),
    "geometry order above the root's": (
        lambda: next(adapt(press(two_cubes()), 0.1, COMM, geometry_order=2)),
        SceneError,
        "1 to 1",
    ),
    "unknown partition": (
        lambda: next(adapt(press(two_cubes()), 0.1, COMM, partition_kind="sfx")),
        SceneError,
        "'contact-sfc'",
    ),
    "unknown preconditioner": (lambda: Solver("boomer"), SceneError, "'boomeramg', 'p-multigrid', 'ilu'"),
    "solver tolerance": (lambda: Solver(tolerance=2.0), SceneError, "0.001 at most"),
    "order 7": (lambda: scenes.hertz(order=7, comm=COMM), GeometryError, "1 to 6, got 7"),
    "order 7 from Gmsh": (lambda: gmsh_box(order=7), GeometryError, "order 1 to 6"),
    "radius < 0": (lambda: scenes.hertz(radius=-1.0, comm=COMM), SceneError, "radius"),
    "unknown symmetry": (lambda: scenes.hertz(symmetry="half", comm=COMM), SceneError, "there are 'quarter', 'full'"),
    "no root cells": (lambda: scenes.hertz(coarse=0, comm=COMM), SceneError, "coarse"),
    "tetrahedra": (lambda: gmsh_box(recombine=False), GeometryError, "only hexahedra can be refined"),
    "inverted cell": (inverted, GeometryError, "root cell 0 of 1 is inverted"),
    "crack": (cracked, GeometryError, "does not hold together near"),
    "hanging root nodes": (hanging_roots, GeometryError, "does not hold together near"),
    "nodes of no order": (
        lambda: RootMesh(np.zeros((9, 3)), np.arange(9)[None], ("a",), np.zeros(1, np.int32)),
        GeometryError,
        "got shape (1, 9)",
    ),
    "NaN in points": (
        lambda: RootMesh(np.full((8, 3), np.nan), np.arange(8)[None], ("a",), np.zeros(1, np.int32)),
        GeometryError,
        "finite",
    ),
    "surface inside": (
        lambda: RootMesh(*grid(2), ("a",), np.zeros(2, np.int32), {"inner": np.array([[0, 5]])}),
        SceneError,
        "'inner'",
    ),
    "cell without body": (
        lambda: RootMesh(*grid(), ("a",), np.array([1], np.int32)),
        SceneError,
        "for the numbers [1]",
    ),
    "bodies that share nodes": (
        lambda: RootMesh(*grid(2), ("a", "b"), np.array([0, 1], np.int32)),
        SceneError,
        "share the node at",
    ),
    "missing file": (
        lambda: root_mesh_from_file(COMM, "no/such.msh"),
        SceneError,
        "No such file or directory: 'no/such.msh'",
    ),
    "not a mesh file": (lambda: root_mesh_from_file(COMM, __file__), FxContactError, ""),
    "body for a surface": (
        lambda: press(two_cubes(), tractions=(Pressure("upper", 1.0),)),
        SceneError,
        "unknown surface 'upper'; the root mesh has 'base'",
    ),
    "unknown surface": (lambda: press(two_cubes(), Dirichlet("side", x=0.0)), SceneError, "'base', 'under', 'over'"),
    "unknown contact surface": (
        lambda: press(two_cubes(), contact=(ContactPair("under", "ofer"),)),
        SceneError,
        "unknown surface 'ofer'",
    ),
    "unknown traction surface": (
        lambda: press(two_cubes(), tractions=(Traction("side", (0, 0, 1)),)),
        SceneError,
        "'side'",
    ),
    "unknown body": (
        lambda: press(two_cubes(), materials={"lower": STEEL, "upper": STEEL, "third": STEEL}),
        SceneError,
        "'third'",
    ),
    "body without material": (lambda: press(two_cubes(), materials={"lower": STEEL}), SceneError, "'upper'"),
    "nothing prescribed": (lambda: Dirichlet("base"), SceneError, "prescribes nothing"),
    "contradictory conditions": (
        lambda: press(two_cubes(), Dirichlet("base", z=1.0)),
        SceneError,
        "component z on 'base'",
    ),
    "traction of two components": (lambda: Traction("top", (0, 1)), SceneError, "three components"),
    "contact with itself": (lambda: ContactPair("top", "top"), SceneError, "itself"),
    "direction turned round": (
        lambda: press(two_cubes(), contact=(ContactPair("under", "over", (0, 0, -1)),)),
        PairingError,
        "looks away from the other surface",
    ),
    "surfaces exchanged": (
        lambda: press(two_cubes(), contact=(ContactPair("over", "under", (0, 0, 1)),)),
        PairingError,
        "exchange them",
    ),
    "contact that opens with nothing else to hold": (
        lambda: list(adapt(unheld(), 0.5, COMM)),
        SolveError,
        "nothing holds body 'lower' once the contact opens",
    ),
    "body in two parts": (
        lambda: RootMesh(*apart(), ("a",), np.zeros(2, np.int32)),
        SceneError,
        "falls into separate parts",
    ),
    "two bodies of one name": (
        lambda: RootMesh(*apart(), ("a", "a"), np.array([0, 1], np.int32)),
        SceneError,
        "different names",
    ),
    "vertex that is no corner": (
        lambda: RootMesh(*grid(order=2), ("a",), np.zeros(1, np.int32), {}, {"mid": np.array([13])}),
        SceneError,
        "'mid' is not a corner",
    ),
    "facet named twice": (
        lambda: RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"s": np.array([[0, 1], [0, 1]])}),
        SceneError,
        "local face 0..5), none twice",
    ),
    "empty surface": (
        lambda: RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"s": np.zeros((0, 2), int)}),
        SceneError,
        "at least one row",
    ),
    "face 6": (
        lambda: RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"s": np.array([[0, 6]])}),
        SceneError,
        "'s' must have at least one row",
    ),
    "symmetry 0": (
        lambda: press(two_cubes(), symmetry=0),
        SceneError,
        "the number of copies, must be a whole number",
    ),
    "contact centre NaN": (lambda: press(two_cubes(), contact_centre=(np.nan, 0, 0)), SceneError, "contact_centre"),
    "a condition, not a tuple": (
        lambda: press(two_cubes(), dirichlet=Dirichlet("base", x=0.0)),
        SceneError,
        "tuple of Dirichlet",
    ),
    "tolerance as text": (lambda: next(adapt(press(two_cubes()), "0.1", COMM)), SceneError, "'0.1'"),
    "half a step": (lambda: next(adapt(press(two_cubes()), 0.1, COMM, max_steps=2.5)), SceneError, "2.5"),
    "enforcement as text": (
        lambda: next(adapt(press(two_cubes()), 0.1, COMM, enforcement="penalty")),
        SceneError,
        "Enforcement",
    ),
    "solver as text": (lambda: next(adapt(press(two_cubes()), 0.1, COMM, solver="ilu")), SceneError, "Solver"),
    "no Krylov iterations": (lambda: Solver(max_krylov=0), SceneError, "max_krylov"),
    "solver tolerance of the mesh": (
        lambda: Solver(tolerance=0.01, loose_tolerance=0.1),
        SceneError,
        "0.001 at most",
    ),
    "loose tolerance too tight": (
        lambda: Solver(tolerance=1e-4, loose_tolerance=1e-8),
        SceneError,
        "must lie between tolerance 0.0001 and 1",
    ),
    "unknown PETSc type": (
        lambda: next(adapt(small_hertz(), 0.5, COMM, solver=Solver(options={"pc_type": "nonsense"}))),
        SolveError,
        "cannot work with",
    ),
    "volume with two names": (lambda: gmsh_box(twice=True), GeometryError, "root cell 0 is there twice"),
    "surface of triangles": (
        lambda: gmsh_box(triangles=True),
        GeometryError,
        "group 'apart' of the Gmsh model needs",
    ),
    "volume without name": (lambda: gmsh_box(extra=True), SceneError, "in no physical group"),
    "picture that cannot be written": (
        lambda: draw_pressure(next(adapt(small_hertz(), 0.5, COMM)), "/dev/null/pressure.png"),
        OutputError,
        "cannot draw",
    ),
    "picture for a folder": (lambda: draw_pressure(first(), "/tmp"), OutputError, "must end in .png, got '/tmp'"),
    "picture of the mesh for a folder": (
        lambda: draw_mesh(first(), "/tmp"),
        OutputError,
        "must end in .png, got '/tmp'",
    ),
    "picture of a contact that is none": (
        lambda: draw_pressure(first(unpaired()), "p.png"),
        SceneError,
        "the scene 'cubes' has no contact pairs",
    ),
    "zoom of text": (lambda: draw_mesh(first(), "m.png", zoom="x"), SceneError, "zoom of a picture must be"),
    "zoom of nothing": (lambda: draw_stress(first(), "s.png", zoom=0), SceneError, "zoom of a picture must be"),
    "zoom at a contact that is none": (
        lambda: draw_stress(first(unpaired()), "s.png", zoom=2),
        SceneError,
        "has no contact pairs",
    ),
    "true error for a tolerance of text": (lambda: true_error(first(), "x"), SceneError, "got 'x'"),
    "true error for no tolerance": (
        lambda: true_error(first(), 5e-324),
        SceneError,
        "at least 1e-09, got 4.94066e-324",
    ),
    "tolerance below rounding": (lambda: first(press(two_cubes()), tolerance=5e-324), SceneError, "at least 1e-09"),
    "true error with another scene": (lambda: true_error(first(), 0.2, "x"), SceneError, "must be a Scene, got 'x'"),
    "checkpoint for no scene": (lambda: Checkpoint("no/such", None, COMM), SceneError, "must be a Scene, got None"),
    **{
        f"history of a beginning that is {value!r}": (
            lambda value=value: first(beginning=replace(Beginning.uniform(small_hertz(), 0, COMM), history=value)),
            SceneError,
            "history of a Beginning must be a RefinementHistory",
        )
        for value in (np.zeros((2, 2)), 0, "much")
    },
    "root cells refined by half": (lambda: Beginning.uniform(small_hertz(), 0.5, COMM), SceneError, "got 0.5"),
    "records for no communicator": (lambda: RecordWriter("/tmp", None), SceneError, "mpi4py"),
    **{
        f"no step: {action.__name__}": (partial(action, "step", 0.1), SceneError, "a Step is needed")
        for action in (true_error, draw_pressure, draw_mesh, draw_partition, draw_stress, write_fields)
    },
    "errors of no step": (lambda: contact_errors("step", hertz_a()), SceneError, "a Step is needed"),
    "vector without axes": (lambda: Traction("top", np.array(1.0)), SceneError, "three components, got array(1.)"),
    "cells of no body": (lambda: RootMesh(*grid(), ("a",), ()), GeometryError, "body must have one number"),
    "body of too many cells": (lambda: RootMesh(*grid(), ("a",), [0, 0]), GeometryError, "of shape (2,)"),
    "bodies without axes": (lambda: RootMesh(*grid(), np.array("a"), [0]), GeometryError, "a tuple of names"),
    "value that cannot be shown": (lambda: Material(Unspeakable(), 0.3), SceneError, "Unspeakable object"),
    "file that is empty": (lambda: from_file(""), SceneError, "no mesh file of Gmsh"),
    "file cut in the nodes": (lambda: from_file(CUBE[:120]), SceneError, "Gmsh cannot read"),
    "file cut in the cells": (lambda: from_file(CUBE[:-40]), SceneError, "Gmsh cannot read"),
    "file of noise": (lambda: from_file(np.random.default_rng(1).bytes(999)), SceneError, "no mesh file of Gmsh"),
    "file of zeros": (lambda: from_file(b"\0" * 999), SceneError, "no mesh file of Gmsh"),
    "file that is a script": (
        lambda: from_file('SystemCall "exit";', "cube.geo"),
        SceneError,
        "no mesh file of Gmsh",
    ),
    "script in a mesh file": (lambda: from_file("Exit;\n"), SceneError, "no mesh file of Gmsh"),
    "file with NaN": (lambda: from_file(CUBE.replace("1 1 1\n", "1 1 nan\n")), FxContactError, ""),
    "file with a number out of range": (
        lambda: from_file(CUBE.replace("1 1 1\n", "1 1 1e999\n")),
        FxContactError,
        "",
    ),
    "file with more nodes than there are": (
        lambda: from_file(CUBE.replace("\n8\n", "\n9\n")),
        SceneError,
        "cannot read",
    ),
    "file with an absurd count": (lambda: from_file(CUBE.replace("\n8\n", "\n99999999999\n")), FxContactError, ""),
    "file with an inverted cell": (
        lambda: from_file(CUBE.replace("1 2 3 4 5 6 7 8", "5 6 7 8 1 2 3 4")),
        GeometryError,
        "inverted",
    ),
    "file with a cell twice": (
        lambda: from_file(CUBE.replace("\n2\n1 3", "\n3\n3 5 2 1 1 1 2 3 4 5 6 7 8\n1 3")),
        GeometryError,
        "root cell 0 is there twice",
    ),
    "file without cells": (
        lambda: from_file(CUBE[: CUBE.index("2 5 2")].replace("\n2\n1 3", "\n1\n1 3")),
        FxContactError,
        "",
    ),
    "file that is a folder": (lambda: root_mesh_from_file(COMM, "/tmp"), SceneError, "Is a directory: '/tmp'"),
    "file name of a number": (lambda: root_mesh_from_file(COMM, 5), SceneError, "must be a path, got 5"),
    "file name that is too long": (
        lambda: root_mesh_from_file(COMM, "a" * 300 + ".msh"),
        SceneError,
        "File name too long",
    ),
    "output into a number": (lambda: RecordWriter(5, COMM), OutputError, "must be a path, got 5"),
    "checkpoint into a number": (lambda: first(checkpoint=3), OutputError, "must be a path, got 3"),
    "checkpoint that cannot be made": (lambda: first(checkpoint="/dev/null/a"), OutputError, "name another folder"),
    "checkpoint that is not there": (
        lambda: Checkpoint("no/such", small_hertz(), COMM),
        CheckpointError,
        "No such file",
    ),
    "moduli in other units": (
        lambda: press(two_cubes(), materials={"lower": Material(1e9, 0.3), "upper": Material(1e-9, 0.3)}),
        SceneError,
        "check the units of the moduli",
    ),
    "modulus and Poisson's ratio exchanged": (lambda: Material(0.3, 210e9), SceneError, "210000000000.0"),
    "body in nanometres": (lambda: with_units(length=1e-9), SceneError, "body 'upper' is 1e-09 large"),
    "body in gigametres": (lambda: with_units(length=1e9), SceneError, "body 'lower' is 1 large"),
    "body elsewhere": (lambda: with_units(shift=1e9), SceneError, "the place of each body"),
    "mesh of no size": (lambda: replace(two_cubes(), points=two_cubes().points * 1e-200), GeometryError, "units"),
    "displacement in nanometres": (
        lambda: press(two_cubes(), dirichlet=(Dirichlet("base", 0, 0, 0), Dirichlet("top", 0, 0, -0.01e9))),
        SceneError,
        "along z differ by 1e+07",
    ),
    "penalty lost in rounding": (lambda: Enforcement("penalty", 1e13), SceneError, "'exact' needs none"),
    "penalty of nothing": (lambda: Enforcement("penalty", 1e-300), SceneError, "softer ones let bodies through"),
    "approach of more than both spheres": (
        lambda: scenes.hertz(displacement=5.0, comm=COMM),
        SceneError,
        "along z differ by 5",
    ),
    "approach in nanometres": (lambda: scenes.hertz(displacement=0.01e9, comm=COMM), SceneError, "check the units"),
    "contradiction at an edge": (
        lambda: press(with_side(two_cubes()), Dirichlet("side", z=0.5)),
        SceneError,
        "component z on 'side' is prescribed as 0.5",
    ),
    "pair given twice": (
        lambda: press(two_cubes(), contact=(ContactPair("under", "over", (0, 0, 1)),) * 2),
        PairingError,
        "two contact pairs",
    ),
    "tolerance in percent": (lambda: adapt(press(two_cubes()), 4, COMM), SceneError, "4 % are 0.04"),
    "root cells without end": (lambda: scenes.hertz(coarse=10**6, comm=COMM), SceneError, "50 at most"),
    **{
        f"degree {degree!r}": (
            lambda degree=degree: adapt(press(two_cubes()), 0.1, COMM, degree=degree),
            SceneError,
            f"the degree of displacements must be 1 or 2, got {degree!r}",
        )
        for degree in (0, 3, 1.0, True, "2", None)
    },
    "manufactured degree": (
        lambda: next(adapt_manufactured(0.1, COMM, degree=3)),
        SceneError,
        "degree 1 or 2, got 3",
    ),
    "manufactured control": (
        lambda: next(adapt_manufactured(0.1, COMM, control="energy")),
        SceneError,
        "control must be an ErrorControl, got 'energy'",
    ),
    "partition misspelt": (
        lambda: adapt(press(two_cubes()), 0.1, COMM, partition_kind="contact_sfc"),
        SceneError,
        "did you mean 'contact-sfc'?",
    ),
    "preconditioner misspelt": (lambda: Solver("boomermag"), SceneError, "did you mean 'boomeramg'?"),
    "enforcement misspelt": (lambda: Enforcement("penality"), SceneError, "did you mean 'penalty'?"),
    "symmetry misspelt": (lambda: scenes.hertz(symmetry="ful", comm=COMM), SceneError, "did you mean 'full'?"),
    "surface misspelt": (lambda: press(two_cubes(), Dirichlet("bsae", x=0.0)), SceneError, "did you mean 'base'?"),
    "contact surface misspelt": (
        lambda: press(two_cubes(), contact=(ContactPair("undr", "over"),)),
        SceneError,
        "did you mean 'under'?",
    ),
    "PETSc option misspelt": (
        lambda: first(solver=Solver(options={"pc_typ": "jacobi"})),
        SceneError,
        "PETSc's solver does not read the option 'pc_typ' (on the command line -fx_pc_typ): it is misspelt",
    ),
    "option of hypre misspelt": (
        lambda: first(solver=Solver(options={"pc_hypre_boomeramg_strong_treshold": 0.5})),
        SceneError,
        "does not read the option 'pc_hypre_boomeramg_strong_treshold'",
    ),
    "option that the solver does not have": (
        lambda: first(solver=Solver(options={"pc_type": "jacobi", "pc_hypre_type": "ilu"})),
        SceneError,
        "another solver or preconditioner",
    ),
    "option of hypre with a wrong value": (
        lambda: first(solver=Solver("boomeramg", options={"pc_hypre_boomeramg_strong_threshold": "much"})),
        SolveError,
        "PETSc cannot work with the solver's options, under the prefix fx_",
    ),
    "another Krylov method": (
        lambda: first(solver=Solver(options={"ksp_type": "minres"})),
        SolveError,
        "must be one of cg, fcg",
    ),
    **{
        f"{name} among PETSc's options": (
            partial(lambda name, value: first(solver=Solver(options={name: value})), name, value),
            SceneError,
            f"'{name}' (on the command line -fx_{name}) is not the user's: set Solver.tolerance",
        )
        for name, value in (
            ("ksp_rtol", 0.5),
            ("ksp_atol", 1.0),
            ("ksp_divtol", 2.0),
            ("ksp_max_it", 3),
            ("ksp_convergence_test", "skip"),
            ("ksp_converged_maxits", None),
            ("ksp_initial_guess_nonzero", None),
            ("ksp_error_if_not_converged", None),
            ("ksp_norm_type", "preconditioned"),
            ("ksp_pc_side", "right"),
        )
    },
    "capitals among PETSc's options": (
        lambda: first(solver=Solver(options={"KSP_Convergence_Test": "skip"})),
        SceneError,
        "'ksp_convergence_test' (on the command line -fx_ksp_convergence_test) is not the user's",
    ),
    **{
        f"{kind} for a preconditioner": (
            partial(lambda kind: first(solver=Solver(options={"pc_type": kind})), kind),
            SolveError,
            f"-fx_pc_type {kind} cannot be used: the method must",
        )
        for kind in ("none", "mat", "lmvm", "eisenstat")
    },
    "preconditioner that cannot be set up": (
        lambda: first(solver=Solver(options={"pc_type": "bddc"})),
        SolveError,
        "PETSc cannot work with the solver's options",
    ),
    **{
        f"file of {name} in no folder": (
            lambda name=name: first(solver=Solver(options={name: ":/no/such/file"})),
            SolveError,
            "PETSc cannot work with the solver's options",
        )
        for name in ("ksp_view", "ksp_monitor", "ksp_converged_reason")
    },
    "points of text": (
        lambda: RootMesh("points", [list(range(8))], ("a",), [0]),
        GeometryError,
        "points must be an array of numbers",
    ),
    "rows of unequal length": (
        lambda: RootMesh([[0, 0, 0], [1, 0]], [list(range(8))], ("a",), [0]),
        GeometryError,
        "points must be an array of numbers",
    ),
    "cells that are no whole numbers": (
        lambda: RootMesh(grid()[0], grid()[1] + 0.5, ("a",), [0]),
        GeometryError,
        "cells and body of whole numbers",
    ),
    "complex points": (lambda: RootMesh(grid()[0] * 1j, grid()[1], ("a",), [0]), GeometryError, "numbers"),
    "node beyond the last": (lambda: RootMesh(grid()[0], grid()[1] + 1, ("a",), [0]), GeometryError, "outside 0..7"),
    "nothing but None": (lambda: RootMesh(None, None, None, None), GeometryError, "points must be an array"),
    "body in rows": (lambda: RootMesh(*grid(), ("a",), [[0]]), GeometryError, "one number for each cell"),
    "tolerance in an array": (lambda: adapt(press(two_cubes()), np.array(0.5), COMM), SceneError, "array(0.5)"),
    "body without cells": (lambda: RootMesh(*grid(), ("a", "b"), [0]), SceneError, "for the numbers [0]"),
    "body without name": (lambda: RootMesh(*grid(), ("",), [0]), SceneError, "must be a name, got ''"),
    "surface of text": (lambda: RootMesh(*grid(), ("a",), [0], {"s": "base"}), GeometryError, "curves dicts of"),
    "zero direction": (lambda: ContactPair("a", "b", (0, 0, 0)), SceneError, "zero"),
    "displacement with masked values": (
        lambda: pressed_by(lambda x: np.ma.masked_greater(0 * x[0] - 0.01, -1.0)),
        SceneError,
        "the displacement z on 'top' is nan",
    ),
    "surfaces out of line": (lambda: press(two_cubes(shift=0.1)), PairingError, "face 5 of root cell 0"),
    "surfaces paired twice": (
        lambda: press(two_cubes(), contact=(ContactPair("under", "over"), ContactPair("over", "under"))),
        PairingError,
        "two contact pairs",
    ),
    "surfaces of unequal number": (lambda: press(_with_surface(two_cubes())), PairingError, "2 facets face 1"),
    "a body that nothing holds": (
        lambda: press(two_cubes(), dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0),)),
        SceneError,
        "nothing holds body 'upper'",
    ),
    "a cube that may slide on another": (lambda: leaning((0, 0.0, None)), SceneError, "nothing holds body 'upper'"),
    "a cube that may turn on another": (lambda: leaning((0, 0.0, 0.0)), SceneError, "nothing holds body 'upper'"),
    "a small cube that may turn": (
        lambda: far_apart(1e-5, (0, 0.0, 0.0, 0.0), (4, None, 0.0, 0.0)),
        SceneError,
        "nothing holds body 'small'",
    ),
    "a shaft that may turn in its bore": (
        lambda: replace(scenes.shrink_fit(), dirichlet=(Dirichlet("z = 0", z=0.0), Dirichlet("rim", 0.0, 0.0, 0.0))),
        SceneError,
        "nothing holds body 'inner'",
    ),
    "rings of a wrong order": (
        lambda: scenes.shrink_fit((1.0, 0.5, 2.0)),
        SceneError,
        "leaves no ring between the radii (1.0, 0.5, 2.0)",
    ),
    **{
        f"length of {length:g} m: {place}": (
            partial(action, length),
            GeometryError,
            f"is {length:.3g}, volumes of such",
        )
        for length in (1e308, 1e160, 1e-200)
        for place, action in {
            "radius of a punch": lambda length: scenes.punch(length),
            "radius of a punch with a force": lambda length: scenes.punch(length, force=1.0),
            "side of a punch": lambda length: scenes.punch(side=length),
            "radius": lambda length: scenes.hertz(length, comm=COMM),
            "side of the cube": lambda length: scenes.indentation(side=length),
            "radius of cylinders": lambda length: scenes.cylinders((length, 1.0)),
            "radius of rings": lambda length: scenes.shrink_fit((length, 1.0, 2.0)),
            "height of a stack": lambda length: scenes.stack(height=length),
        }.items()
    },
    "more ranks than leaves": (too_many_ranks, PartitionError, "run on fewer ranks"),
    "beginning of another mesh": (lambda: begin(mesh=finer()), SceneError, "another root mesh"),
    "beginning with other pairs": (
        lambda: begin(contact=(), dirichlet=(*small_hertz().dirichlet, Dirichlet("lower pole", z=0.0))),
        SceneError,
        "other contact pairs",
    ),
    "beginning that is no number": (lambda: begin(nan_on_last_rank), SceneError, "must be finite"),
    "beginning of other leaves": (lambda: begin(lambda values: values[1:]), SceneError, "8 or 27, 3 or more"),
    "beginning of two components": (lambda: begin(lambda values: values[..., :2]), SceneError, "3 or more"),
    "beginning of text": (lambda: begin(lambda _: "rest"), SceneError, "array of float64, got 'rest'"),
    "beginning of one rank": (lambda: first(beginning=of_one_rank()), SceneError, "communicator of 1 rank"),
    "30 uniform refinements": (
        lambda: Beginning.uniform(small_hertz(), 30, COMM),
        SceneError,
        "can be refined 14 times, got 30",
    ),
    "12 uniform refinements": (
        lambda: Beginning.uniform(small_hertz(), 12, COMM),
        SolveError,
        "a forest of 549,755,813,888 leaves needs",
    ),
    "half a refinement": (lambda: Beginning.uniform(small_hertz(), 0.5, COMM), SceneError, "got 0.5"),
    "less than no refinement": (
        lambda: Beginning.uniform(small_hertz(), -1, COMM),
        SceneError,
        "at least 0 and below 2^31, got -1",
    ),
    "refinements that differ": (unlike_levels, SceneError, "number of refinements (0 on rank 0"),
    "refinement of no scene": (lambda: Beginning.uniform(None, 1, COMM), SceneError, "must be a Scene, got None"),
    "too few marked": (lambda: refine(lambda n: np.ones(max(n - 1, 0), bool)), SceneError, "one for each of the"),
    "all marked": (lambda: refine(lambda n: True), SceneError, "got True"),
    "marked by halves": (lambda: refine(lambda n: np.full(n, 0.5)), SceneError, "bool or whole numbers"),
    "marked on one rank": (
        lambda: refine(lambda n: None if COMM.rank == COMM.size - 1 else np.ones(n, bool)),
        SceneError,
        "got None",
    ),
    "marked by less than nothing": (lambda: refine(lambda n: np.full(n, -1)), SceneError, "got -1 to -1"),
    "marked too often": (lambda: refine(lambda n: np.full(n, 256)), SceneError, "0 to 14 times, got 256"),
    "checkpoint of another mesh": (lambda: go_on(mesh=finer()), CheckpointError, "root mesh"),
    "checkpoint of other materials": (
        lambda: go_on(materials={"lower": STEEL, "upper": Material(2.0, 0.3)}),
        CheckpointError,
        "materials",
    ),
    "solver that does not converge": (
        never_converges,
        SolveError,
        "PCG failed with p-multigrid (iterations: 1, PETSc reason -3), then with cholesky (",
    ),
    "folder that cannot be written": (
        lambda: RecordWriter("/dev/null/run", COMM),
        OutputError,
        "name another folder",
    ),
    "fields that cannot be written": (unwritable_fields, OutputError, "name another folder"),
}


#: Wrong types and values, by what is given and where: each must be a SceneError that shows them.
for given, spelt in {
    "text": "'text'",
    None: "None",
    np.nan: "nan",
    -np.inf: "-inf",
    1j: "1j",
    True: "True",
    (1.0, 2.0): "(1.0, 2.0)",
    10**400: "1000000",
}.items():
    CASES |= {
        f"{place} is {given!r}": (partial(action, given), SceneError, spelt)
        for place, action in {
            "radius": lambda value: scenes.hertz(radius=value, comm=COMM),
            "approach": lambda value: scenes.hertz(displacement=value, comm=COMM),
            "side of the cube": lambda value: scenes.indentation(side=value),
            "E": lambda value: Material(value, 0.3),
            "nu": lambda value: Material(1.0, value),
            "traction": lambda value: Traction("top", (0.0, value, 0.0)),
            "tolerance": lambda value: adapt(press(two_cubes()), value, COMM),
            "tolerance of the solver": lambda value: Solver(tolerance=value),
            "most iterations": lambda value: Solver(max_krylov=value),
            "most steps": lambda value: adapt(press(two_cubes()), 0.5, COMM, max_steps=value),
            "coarse": lambda value: scenes.hertz(coarse=value, comm=COMM),
            "symmetry of a scene": lambda value: press(two_cubes(), symmetry=value),
            "symmetry": lambda value: scenes.hertz(symmetry=value, comm=COMM),
            "partition": lambda value: adapt(press(two_cubes()), 0.5, COMM, partition_kind=value),
            "preconditioner": lambda value: Solver(value),
            "enforcement": lambda value: Enforcement(value),
            "mesh": lambda value: press(value),
            "materials": lambda value: press(two_cubes(), materials=value),
            "contact": lambda value: press(two_cubes(), contact=value),
            "one radius of cylinders": lambda value: scenes.cylinders((value, 1.0)),
            "one radius of rings": lambda value: scenes.shrink_fit((0.5, 1.0, value)),
            "communicator": lambda value: adapt(press(two_cubes()), 0.5, value),
        }.items()
    }
del CASES["preconditioner is None"]  # the best one of the degree


def _with_surface(mesh):
    """The same mesh, the surface "under" one facet larger."""
    surfaces = dict(mesh.surfaces, under=np.array([[0, 5], [0, 1]]))
    return RootMesh(mesh.points, mesh.cells, mesh.bodies, mesh.body, surfaces)


def test_the_good_scene_passes():
    """What the bad cases spoil is right: two cubes pressed together have the force of two bars in series."""
    *_, step = adapt(press(two_cubes()), 0.9, MPI.COMM_SELF, max_steps=1)
    sliding, clamped = 1.0, (1 - 0.3) / (1.3 * 0.4)
    assert 0.005 * sliding < step.record.force < 0.005 * clamped


@pytest.mark.parametrize("case", CASES)
def test_error(case):
    """The right type, and a message that names the culprit, on every rank."""
    action, kind, words = CASES[case]
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
    scene = leaning((0, 0.0, 0.0), (4, None, 0.0), contact=(ContactPair("under", "over", direction),))
    assert abs(first(scene).record.force / 0.01 - 1) < 1e-6


@pytest.mark.parametrize("ratio", [1.0, 1e-4, 1e-5])
def test_what_vertices_hold(ratio):
    """Three vertices hold a body, however small it is beside the others, and far from them."""
    assert not len(far_apart(ratio, (0, 0.0, 0.0, 0.0), (4, None, 0.0, 0.0), (2, None, None, 0.0)).rigid_motions.free)


@pytest.mark.parametrize("kind", [np.float32, np.float64, Fraction])
def test_numbers_of_any_kind(kind):
    """What is a number is taken as one in double precision; the record can be written."""
    tolerance, stiff = kind(1) / 2, Material(kind(1), kind(1) / 4)
    enforcement = Enforcement("penalty", kind(2**10))
    solver = Solver(tolerance=kind(1) / 2**27, loose_tolerance=kind(1) / 2**10)
    scene = press(two_cubes(), materials={"lower": stiff, "upper": stiff})
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
        ({"solver": Solver(max_contact=1), "scene": scenes.punch(force=1e-3)}, "after 1 updates"),
        ({"solver": Solver(options={"pc_type": "none"})}, "jacobi is as simple"),
        ({"solver": Solver(options={"pc_typ": "jacobi"})}, "misspelt"),
        ({"scene": unpaired(), "solver": Solver(options={"pc_typ": "jacobi"})}, "misspelt"),
    ],
)
def test_failed_solve_leaves_nothing(capfd, options, words):
    """Its matrix and preconditioner would stay in the memory for ever."""
    before = garbage(capfd)
    (answer,) = set(told(lambda: first(**{"scene": scenes.hertz(order=1, coarse=2, comm=COMM)} | options)))
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


@pytest.mark.parametrize("called", ["krylov._Shell.mult", "krylov._Shell.apply"])
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
UNLIKE = {
    "tolerance": ({}, {"tolerance": 0.4}, "tolerance (0.5 on rank 0, 0.4 on rank"),
    "no tolerance": ({}, {"tolerance": -1.0}, "positive number, got -1.0"),
    "degree": ({}, {"degree": 1}, "degree (2 on rank 0, 1 on rank"),
    "no degree": ({}, {"degree": 3}, "degree of displacements must be 1 or 2, got 3"),
    "most steps": ({}, {"max_steps": 1}, "most steps (20 on rank 0, 1 on rank"),
    "no scene": ({}, {"scene": None}, "must be a Scene, got None"),
    "geometry order": ({}, {"geometry_order": 1}, "geometry order (null on rank 0, 1 on"),
    "enforcement": ({}, {"enforcement": Enforcement("penalty")}, "enforcement ({"),
    "control as text": (
        {},
        {"control": "energy"},
        "must be an ErrorControl, got 'energy': write ErrorControl('energy')",
    ),
    "enforcement as text": ({}, {"enforcement": "penalty"}, "must be an Enforcement, got 'penalty'"),
    "solver": ({}, {"solver": Solver("ilu")}, "solver's preconditioner"),
    "option of the solver": ({}, {"solver": Solver(options={"pc_typ": 1})}, "solver's option pc_typ (null on rank 0"),
    "partition": ({}, {"partition_kind": "sfc"}, 'partition ("contact-sfc" on rank 0'),
    "misspelt partition": ({}, {"partition_kind": "sfx"}, "unknown partition 'sfx'"),
    "folder": ({}, {"checkpoint": "/dev/null/a"}, "checkpoint (null on rank 0"),
    "progress": ({}, {"progress": 3}, "must be a function"),
    "restart": ({}, {"restart": "here"}, "must be a Checkpoint, got 'here'"),
    "material": (
        {},
        {"scene": press(two_cubes(), materials={"lower": STEEL, "upper": Material(2.0, 0.3)})},
        "materials ({",
    ),
    "displacement": ({}, {"scene": pressed_by(-0.02)}, "displacement conditions ([["),
    "displacement that is a function": (
        {"scene": pressed_by(lambda x: 0 * x[0] - 0.01)},
        {"scene": pressed_by(lambda x: 0 * x[0] - 0.02)},
        "displacement conditions ([[",
    ),
    "mesh": ({}, {"scene": press(two_cubes(order=2))}, "root mesh"),
    "name": ({}, {"scene": press(two_cubes(), name="others")}, 'scene ("cubes" on rank 0, "others"'),
}


@pytest.mark.skipif(COMM.size == 1, reason="one rank agrees with itself")
@pytest.mark.parametrize("case", UNLIKE)
def test_ranks_that_differ(case):
    """What ranks are asked for must be the same: the error says what is not, on all ranks."""
    *given, words = UNLIKE[case]
    arguments = dict(scene=press(two_cubes()), tolerance=0.5, comm=COMM) | given[COMM.rank == COMM.size - 1]
    answers = told(lambda: adapt(**arguments))
    assert len(set(answers)) == 1 and answers[0][0] is SceneError and words in answers[0][1], answers


def test_what_is_alike():
    """Of NaN too it is said that it is the same; numbers are equal whatever their type."""
    nan = {"a": float("nan"), "b": [1.0, float("nan")], "c": 1}
    assert differences(nan, nan | {"c": 1.0}, "here", "there") == ""
    assert differences(nan, nan | {"b": [1.0, 2.0]}, "here", "there") == "b ([1.0, NaN] here, [1.0, 2.0] there)"


#: What else all ranks do together: functions of what they are given, which the last rank is given otherwise.
UNLIKE_ELSEWHERE = {
    "checkpoint": (
        lambda folder: Checkpoint(folder, press(two_cubes()), COMM),
        "a",
        "b",
        'folder ("a" on rank 0, "b"',
    ),
    "no checkpoint": (lambda folder: Checkpoint(folder, press(two_cubes()), COMM), "a", None, "a path, got None"),
    "scene of a checkpoint": (
        lambda copies: Checkpoint("a", press(two_cubes(), symmetry=copies), COMM),
        1,
        2,
        "symmetry ([1",
    ),
    "no scene of a checkpoint": (lambda scene: Checkpoint("a", scene, COMM), press(two_cubes()), None, "got None"),
    "records": (lambda folder: RecordWriter(folder, COMM), "/dev/null/a", "/dev/null/b", "output folder"),
    "no records": (lambda folder: RecordWriter(folder, COMM), "/dev/null", 5, "must be a path, got 5"),
    "fields": (lambda folder: write_fields(first(), folder), "/dev/null/a", "/dev/null/b", "output folder"),
    "no fields": (lambda folder: write_fields(first(), folder), "/dev/null/a", None, "must be a path, got None"),
    "picture": (lambda path: draw_pressure(first(), path), "/dev/null/a", "/dev/null/b", "name of a picture"),
    "mesh file": (lambda path: root_mesh_from_file(COMM, path), "a.msh", "b.msh", "a mesh file ("),
    "no mesh file": (lambda path: root_mesh_from_file(COMM, path), "a.msh", 5, "must be a path, got 5"),
    "radius": (lambda radius: scenes.hertz(radius, comm=COMM), 1.0, 2.0, "radius (1.0 on rank 0, 2.0 on rank"),
    "no radius": (lambda radius: scenes.hertz(radius, comm=COMM), 1.0, -1.0, "positive number, got -1.0"),
    "no material": (lambda it: scenes.hertz(material=it, coarse=2, comm=COMM), STEEL, None, "a Material for each"),
}


@pytest.mark.skipif(COMM.size == 1, reason="one rank agrees with itself")
@pytest.mark.parametrize("case", UNLIKE_ELSEWHERE)
def test_ranks_that_differ_elsewhere(case):
    """Also before a run and after it."""
    action, others, last, words = UNLIKE_ELSEWHERE[case]
    answers = told(lambda: action(last if COMM.rank == COMM.size - 1 else others))
    assert len(set(answers)) == 1 and words in answers[0][1], answers


def test_error_of_one_rank_reaches_all():
    """Whichever rank fails alone, all raise its error."""
    for culprit in range(COMM.size):
        with pytest.raises(SceneError, match=f"rank {culprit}"):
            with together(COMM):
                if COMM.rank == culprit:
                    raise SceneError(f"rank {culprit}")


def test_error_that_cannot_be_sent():
    """Where the error itself cannot go to other ranks, what it says does."""

    class Odd(Exception):
        def __reduce__(self):
            raise TypeError("not to be sent")

    for culprit in range(COMM.size):
        with pytest.raises((Odd, RuntimeError), match="odd"):
            with together(COMM):
                if COMM.rank == culprit:
                    raise Odd("odd")


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

    def build():
        import gmsh

        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="box")
        gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
        gmsh.model.mesh.generate(3)

    assert root_mesh_from_gmsh(COMM, build if COMM.rank == 0 else None).bodies == ("box",)
    with pytest.raises(TypeError, match="not callable"):
        root_mesh_from_gmsh(COMM, None if COMM.rank == 0 else build)


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
    folder = COMM.bcast(tempfile.mkdtemp() if COMM.rank == 0 else None)
    for name in ("a.geo", "a.msh", "a.txt"):
        with pytest.raises(SceneError, match="is no mesh file of Gmsh"):
            from_file(f'SystemCall "touch {folder}/run";\n', name)
    assert not list(Path(folder).iterdir())
    COMM.Barrier()
    if COMM.rank == 0:
        Path(folder).rmdir()


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
comm, product, calls = MPI.COMM_WORLD, krylov._Shell.mult, []
def mult(self, *vectors):
    calls.append(1)
    if len(calls) == 3 and comm.rank == comm.size - 1:
        raise {}
    product(self, *vectors)
krylov._Shell.mult = mult
next(adapt(patch(cells=(2, 2, 2)), 0.1))
"""


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
@pytest.mark.parametrize(
    "words, code, message",
    [
        ("--degree 5", 1, "SceneError: the degree of displacements must be 1 or 2, got 5"),
        ("--degree two", 2, "argument --degree: invalid int value: 'two'"),
        ("--tolerence 0.1", 2, "unknown option '--tolerence'; did you mean '--tolerance'?"),
        ("--partition contact_sfc", 1, "SceneError: unknown partition 'contact_sfc'; there are"),
        ("-FX_KSP_RTOL 0.5", 1, "is not the user's: set Solver.tolerance"),
        ("-FX_pc_typ jacobi", 1, "SceneError: PETSc's solver does not read the option 'pc_typ'"),
        ("-fx_fallback_pc_type jacobi", 1, "does not read the option 'fallback_pc_type'"),
        ("tolerance 0.3", 2, "unknown option 'tolerance'; did you mean '--tolerance'?"),
        ("-fx_ksp_monitor ascii tolerance 0.3", 2, "unknown option 'tolerance'"),
        ("-fx_ksp_view 0.3 --quiet yes", 2, "unknown option 'yes'"),
        ("--reference ssnv104", 1, "the reference SSNV104 is of another problem: radius 1 instead of 50"),
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
