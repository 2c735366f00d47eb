"""Bad input: a typed error on every rank that says what, where and what to do; no hang, whatever rank finds it."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from fx_contact import (
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    Scene,
    Solver,
    Traction,
    adapt,
    reference,
    scenes,
)
from fx_contact._mpi import together
from fx_contact.errors import (
    FxContactError,
    GeometryError,
    OutputError,
    PairingError,
    PartitionError,
    SceneError,
    SolveError,
)
from fx_contact.forest import Forest
from fx_contact.gmsh_model import root_mesh_from_file, root_mesh_from_gmsh
from fx_contact.output import RecordWriter, write_fields
from fx_contact.partition import repartition
from fx_contact.plot import draw_pressure
from fx_contact.rootmesh import RootMesh

STEEL = Material(young=1.0, poisson=0.3)
COMM = MPI.COMM_WORLD


def grid(n=1, order=1, low=(0.0, 0.0, 0.0), size=1.0):
    """Points and cells of n cells along z, each a cube."""
    lattice = reference.lattice(order)
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
    points = reference.lattice(1).astype(float)
    small = points * [1, 1, 0.5] + [1, 0, 0]
    both = np.concatenate([points, small, small + [0, 0, 0.5]])
    _, first, inverse = np.unique(both, axis=0, return_index=True, return_inverse=True)
    return RootMesh(both[first], inverse.reshape(3, 8), ("a",), np.zeros(3, np.int32))


def gmsh_box(recombine=True, order=1, extra=False):
    """A root mesh of a box, by Gmsh."""

    def build():
        import gmsh

        gmsh.clear()
        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        if extra:
            gmsh.model.occ.addBox(2, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="box")
        if recombine:
            gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
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


def unheld():
    """Half-spheres drawn apart, the lower one held by contact alone."""
    scene = small_hertz()
    conditions = [c for c in scene.dirichlet if c.where not in ("bottom", "top")] + [Dirichlet("top", z=0.01)]
    return replace(scene, dirichlet=tuple(conditions))


def apart():
    """Points and cells of two cubes that do not touch."""
    points, cells = grid()
    return np.concatenate([points, points + [3, 0, 0]]), np.concatenate([cells, cells + 8])


def never_converges():
    solver = Solver(max_krylov=1, tolerance=1e-13, loose_tolerance=1e-12)
    list(adapt(scenes.hertz(order=1, coarse=4, comm=COMM), 0.5, COMM, solver=solver, max_steps=1))


def unwritable_fields():
    write_fields(next(adapt(small_hertz(), 0.5, COMM)), "/dev/null")


CASES = {
    "E = 0": (lambda: Material(0.0, 0.3), SceneError, "Young's modulus must be positive, got 0"),
    "E < 0": (lambda: Material(-1.0, 0.3), SceneError, "positive, got -1"),
    "E is NaN": (lambda: Material(np.nan, 0.3), SceneError, "finite"),
    "E is text": (lambda: Material("stiff", 0.3), SceneError, "'stiff'"),
    "nu = 0.5": (lambda: Material(1.0, 0.5), SceneError, "between -1 and 0.5"),
    "nu > 0.5": (lambda: Material(1.0, 0.7), SceneError, "0.7"),
    "negative penalty": (
        lambda: Enforcement("penalty", -1.0),
        SceneError,
        "penalty factor must be a positive number",
    ),
    "negative k_N": (lambda: Enforcement("penalty", node_stiffness=-2.0), SceneError, "node_stiffness"),
    "unknown enforcement": (lambda: Enforcement("mortar"), SceneError, "'augmented-lagrangian'"),
    "penalty where none is": (lambda: Enforcement(factor=10.0), SceneError, "takes no penalty factor"),
    "two penalties": (lambda: Enforcement("penalty", 10.0, 3.0), SceneError, "not both"),
    "gap tolerance 0": (lambda: Enforcement(gap_tolerance=0.0), SceneError, "gap_tolerance"),
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
    "unknown preconditioner": (lambda: Solver("boomer"), SceneError, "'boomeramg', 'ilu'"),
    "solver tolerance": (lambda: Solver(tolerance=2.0), SceneError, "between 0 and 1"),
    "order 7": (lambda: scenes.hertz(order=7, comm=COMM), GeometryError, "1 to 6, got 7"),
    "order 7 from Gmsh": (lambda: gmsh_box(order=7), GeometryError, "order 1 to 6"),
    "radius < 0": (lambda: scenes.hertz(radius=-1.0, comm=COMM), SceneError, "radius"),
    "unknown symmetry": (lambda: scenes.hertz(symmetry="half", comm=COMM), SceneError, "'quarter' and 'full'"),
    "no root cells": (lambda: scenes.hertz(coarse=0, comm=COMM), SceneError, "coarse"),
    "tetrahedra": (lambda: gmsh_box(recombine=False), GeometryError, "only hexahedra can be refined"),
    "inverted cell": (inverted, GeometryError, "root cell 0 of 1 is inverted"),
    "crack": (cracked, GeometryError, "does not hold together near"),
    "hanging root nodes": (hanging_roots, GeometryError, "does not hold together near"),
    "nodes of no order": (
        lambda: RootMesh(np.zeros((9, 3)), np.arange(9)[None], ("a",), np.zeros(1, np.int32)),
        GeometryError,
        "9 nodes",
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
    "cell without body": (lambda: RootMesh(*grid(), ("a",), np.array([1], np.int32)), SceneError, "no body"),
    "bodies that share nodes": (
        lambda: RootMesh(*grid(2), ("a", "b"), np.array([0, 1], np.int32)),
        SceneError,
        "shares nodes with another body",
    ),
    "missing file": (lambda: root_mesh_from_file(COMM, "no/such.msh"), SceneError, "no mesh file 'no/such.msh'"),
    "not a mesh file": (lambda: root_mesh_from_file(COMM, __file__), FxContactError, ""),
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
        "'s' names a face twice",
    ),
    "empty surface": (
        lambda: RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"s": np.zeros((0, 2), int)}),
        SceneError,
        "at least one row",
    ),
    "face 6": (
        lambda: RootMesh(*grid(), ("a",), np.zeros(1, np.int32), {"s": np.array([[0, 6]])}),
        SceneError,
        "does not have",
    ),
    "symmetry 0": (lambda: press(two_cubes(), symmetry=0), SceneError, "positive whole number of copies"),
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
    "loose tolerance too tight": (lambda: Solver(tolerance=0.1, loose_tolerance=1e-8), SceneError, "tighter"),
    "unknown PETSc type": (
        lambda: next(adapt(small_hertz(), 0.5, COMM, solver=Solver(options={"pc_type": "nonsense"}))),
        SolveError,
        "does not take",
    ),
    "volume without name": (lambda: gmsh_box(extra=True), SceneError, "in no physical group"),
    "picture that cannot be written": (
        lambda: draw_pressure(next(adapt(small_hertz(), 0.5, COMM)), "/dev/null/pressure.png"),
        OutputError,
        "cannot draw",
    ),
    "zero direction": (lambda: ContactPair("a", "b", (0, 0, 0)), SceneError, "zero"),
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
    "more ranks than leaves": (too_many_ranks, PartitionError, "run on fewer ranks"),
    "solver that does not converge": (never_converges, SolveError, "PCG with cholesky failed"),
    "folder that cannot be written": (
        lambda: RecordWriter("/dev/null/run", COMM),
        OutputError,
        "name another output",
    ),
    "fields that cannot be written": (unwritable_fields, OutputError, "name another output"),
}


def _with_surface(mesh):
    """The same mesh, the surface "under" one facet larger."""
    surfaces = dict(mesh.surfaces, under=np.array([[0, 5], [0, 1]]))
    return RootMesh(mesh.points, mesh.cells, mesh.bodies, mesh.body, surfaces)


def test_the_good_scene_passes():
    """What the bad cases spoil is right: two cubes pressed together have the force of two bars in series."""
    *_, step = adapt(press(two_cubes()), 0.9, MPI.COMM_SELF, max_steps=1)
    sliding, clamped = 1.0, (1 - 0.3) / (1.3 * 0.4)
    assert 0.005 * sliding < step.record["force"] < 0.005 * clamped


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


def test_error_of_one_rank_reaches_all():
    """Whichever rank fails alone, all raise its error."""
    for culprit in range(COMM.size):
        with pytest.raises(SceneError, match=f"rank {culprit}"):
            with together(COMM):
                if COMM.rank == culprit:
                    raise SceneError(f"rank {culprit}")
