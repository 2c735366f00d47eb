"""Bodies on springs: in runs, under contact, as stiff as a clamp, with goals and restarts."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import ALONG, EXACT, PLANES, STEEL, of_kind, wedge
from mpi4py import MPI

from fx_contact import (
    ContactPair,
    Dirichlet,
    Displacement,
    Elastic,
    ErrorControl,
    Material,
    Pressure,
    Reaction,
    Scene,
    Solver,
    SymmetryPlane,
    Traction,
    block,
    cylinder,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.adaptive import step_solver
from fx_contact.fem.external_forces import load

pytestmark = pytest.mark.ranks(1, 2, 3)

YOUNG = 2.0


def blocks(stiffness, down=0.01, gap=0.0):
    """A plate presses a block onto another one on springs: unit cubes, quarters of the whole; nu = 0."""
    bodies = {"lower": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1), "upper": block((0, 0, 1), (1, 1, 2), (2, 2, 2), 1)}
    mesh = root_mesh_from_shapes(bodies)
    held = (*(SymmetryPlane(f"{body} {side}") for body in bodies for side in ("left", "front")),)
    return Scene(
        "blocks",
        mesh,
        dict.fromkeys(bodies, Material(YOUNG, 0.0)),
        (*held, Dirichlet("upper top", z=-down)),
        ContactPair("lower top", "upper bottom", direction=(0, 0, 1), clearance=gap),
        springs=Elastic("lower bottom", stiffness),
        symmetry=4,
    )


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e6])
def test_springs_in_series(stiffness, degree):
    """The pressure of two blocks and springs in series; the force of all four parts in resultants; balance."""
    down, gap = 0.01, 0.002
    scene = blocks(stiffness, down, gap)
    record = solve(scene, 0.5, degree=degree, max_steps=1, solver=EXACT).record
    pressure = (down - gap) / (2 / YOUNG + 1 / stiffness)
    assert abs(record.force / (4 * pressure) - 1) < 1e-7
    springs, reaction = of_kind(record, "spring")["lower bottom"], of_kind(record, "reaction")["upper top"]
    for one, sign in ((springs, 1), (reaction, -1)):
        assert np.abs(one.force - np.array([0, 0, 4 * sign * pressure])).max() < 1e-7 * pressure and one.parts == 4
    for body in of_kind(record, "balance").values():
        assert np.abs([*body.force, *body.moment]).max() < 1e-9 * pressure


@pytest.mark.parametrize("degree", [1, 2])
def test_springs_on_a_contact_surface(degree):
    """They take their share of the pressure that comes through the contact: exact, at the same nodes."""
    down, below, between = 0.01, 1.0, 3.0
    scene = blocks(below, down)
    scene = replace(scene, springs=(*scene.springs, Elastic("lower top", z=between)))
    record = solve(scene, 0.5, degree=degree, max_steps=1, solver=EXACT).record
    onward = 1 / (1 / YOUNG + 1 / below)
    moved = YOUNG * down / (YOUNG + between + onward)
    assert abs(record.force / (4 * YOUNG * (down - moved)) - 1) < 1e-7
    forces = [one.force[2] / 4 for one in record.resultants if one.kind == "spring"]
    assert np.allclose(forces, [onward * moved, between * moved], rtol=1e-7)


@pytest.mark.parametrize("degree", [1, 2])
def test_springs_balance_an_eccentric_load(degree):
    """A cube on springs alone under a load beside its middle: forces and moments about any point balance."""
    mesh = root_mesh_from_shapes({"cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    k = np.array([1.0, 2.0, 3.0])
    scene = Scene(
        "cube",
        mesh,
        {"cube": Material(YOUNG, 0.3)},
        springs=(Elastic("cube bottom", x=k[0], y=k[1], z=0.5 * k[2]), Elastic("cube bottom", normal=0.5 * k[2])),
        tractions=Traction("cube right", (0.001, 0.002, -0.003)),
        contact_centre=(1.0, 2.0, 3.0),
    )
    step = solve(scene, 0.9, degree=degree, max_steps=1, solver=EXACT)
    record = step.record
    acting = [one for one in record.resultants if one.kind != "balance"]
    assert [one.kind for one in acting] == ["traction", "spring", "spring"]
    for what in ("force", "moment"):
        assert np.abs(np.sum([getattr(one, what) for one in acting], axis=0)).max() < 1e-12
    (balance,) = of_kind(record, "balance").values()
    assert np.abs([*balance.force, *balance.moment]).max() < 1e-12
    assert abs(acting[1].force[2] - acting[2].force[2]) < 1e-12 and abs(acting[2].force[0]) < 1e-12
    assert "elastic supports" in repr(scene)


@pytest.mark.parametrize("ratio", [1e-3, 1e-1, 1.0, 1e2, 1e4, 1e6])
def test_multigrid_on_springs(ratio):
    """p-multigrid takes no more iterations than with a clamp, and stiff springs are a clamp."""
    mesh = root_mesh_from_shapes({"rod": block((0, 0, 0), (1, 1, 1), (4, 4, 4), 1)})
    load, material = Traction("rod top", (0.0, 1e-6, 1e-6)), {"rod": Material(YOUNG, 0.3)}
    clamped = Scene("rod", mesh, material, Dirichlet("rod bottom", 0.0, 0.0, 0.0), tractions=load)
    k = ratio * YOUNG
    on_springs = Scene("rod", mesh, material, tractions=load, springs=Elastic("rod bottom", x=k, y=k, z=k))
    solver = Solver(preconditioner="p-multigrid")
    one, other = (solve(scene, 0.9, degree=2, max_steps=1, solver=solver) for scene in (clamped, on_springs))
    assert other.record.preconditioner == "p-multigrid"
    assert sum(other.record.krylov_iterations) <= sum(one.record.krylov_iterations)
    if ratio == 1e6:
        u, v = (step.displacement.x.array for step in (one, other))
        everywhere(np.abs(u - v).max(initial=0.0) < 1e-4 * WORLD.allreduce(np.abs(u).max(), MPI.MAX), "they differ")


@pytest.mark.parametrize("degree", [1, 2])
def test_rubber_on_springs(degree):
    """A nearly incompressible wedge between oblique planes: springs are beside the volume term of its mixed form."""
    normal, rubber = ALONG[:, 2], Material(YOUNG, 0.4999)
    scene = wedge(rubber, PLANES[:2], springs=Elastic("bottom", 0.5), tractions=Traction("top", 0.01 * normal))
    points = (0.0, 0.0, 0.0), tuple(normal.tolist())
    goals = tuple(Displacement(point, points[1], 0.5) for point in points)
    values = [
        goal.value for goal in solve(scene, 0.9, degree=degree, max_steps=1, goals=goals, solver=EXACT).record.goals
    ]
    assert np.abs(np.array(values) / [0.01 / 0.5, 0.01 / 0.5 + 0.01 / YOUNG] - 1).max() < 1e-6


def held_aside():
    """A cube on springs, held at a side that shares an edge with them, under a pressure."""
    mesh = root_mesh_from_shapes({"cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    return Scene(
        "cube",
        mesh,
        {"cube": Material(YOUNG, 0.3)},
        Dirichlet("cube right", 0.0, 0.0, 0.0),
        tractions=Pressure("cube top", 0.01),
        springs=Elastic("cube bottom", x=5.0, y=5.0, z=5.0),
    )


@pytest.mark.parametrize("degree", [1, 2])
def test_adjoint_of_a_reaction(degree, monkeypatch):
    """With z the adjoint solution, 1 on the held surface, the reaction is -z . L: springs are part of its problem."""
    found, judge = [], step_solver.judge_goals

    def spy(goals, duals, state, residual, *others):
        """Keep the first goal and the load."""
        functional = goals[0].functional(state, residual)
        goal = duals.of(functional, 0.0)
        found.append((functional.value, goal.adjoint, load(state.scene, state.forest, state.elasticity)))
        return judge(goals, duals, state, residual, *others)

    monkeypatch.setattr(step_solver, "judge_goals", spy)
    goal, options = Reaction("cube right", 0.9, (0, 0, 1)), {"control": ErrorControl("energy"), "solver": EXACT}
    solve(held_aside(), 0.95, degree=degree, goals=goal, max_steps=1, **options)
    value, z, forces = found[0]
    assert value > 1e-4 and abs(WORLD.allreduce(-float((z * forces).sum())) / value - 1) < 1e-5


def test_goals_on_springs():
    """Displacement and reaction beside springs, against those on a finer mesh: estimated errors are not smaller."""
    goals = Displacement((0.0, 0.0, 1.0), (0, 0, 1), 0.05), Reaction("cube right", 0.05, (0, 0, 1))
    coarse, fine = (
        solve(held_aside(), tolerance, goals=tuple(replace(goal, tolerance=tolerance / 2) for goal in goals)).record
        for tolerance in (0.1, 0.02)
    )
    ratios = [one.error / abs(one.value - other.value) for one, other in zip(coarse.goals, fine.goals)]
    assert min(ratios) > 0.5 and ratios[1] < 2, ratios  # errors of the displacement cancel between cells


def test_what_springs_hold():
    """A normal spring below a plane leaves three motions free; a round surface all but the turn about its axis."""
    mesh = root_mesh_from_shapes({"pin": cylinder(1.0, 1.0, (2, 2), 3)})
    material, corner = {"pin": STEEL}, Elastic("pin bottom", 1.0)
    for springs, ways in (
        (corner, "along x and along y and about z"),
        ((corner, Elastic("pin outside", 1.0)), "about z"),
        (Elastic("pin outside", x=1.0, y=1.0), "along z"),
    ):
        motions = Scene("pin", mesh, material, springs=springs).rigid_motions
        assert motions.named(motions.free) == {"pin": ways}
    held = Scene("pin", mesh, material, springs=(corner, Elastic("pin outside", x=1.0, y=1.0)))
    assert not len(held.rigid_motions.free)
    assert not len(Scene("pin", mesh, material, springs=Elastic("pin outside", x=1, y=1, z=1)).rigid_motions.free)


def test_shear_on_a_plane_of_symmetry():
    """Springs along a plane make shear there: it is not taken out of the stress."""
    mesh = root_mesh_from_shapes({"cube": block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)})
    plane, k = SymmetryPlane("cube bottom"), 0.5
    scene = Scene(
        "sheared",
        mesh,
        {"cube": Material(YOUNG, 0.3)},
        (plane, SymmetryPlane("cube top")),
        tractions=tuple(Traction(f"cube {side}", force) for side, force in SHEAR.items()),
        springs=Elastic("cube bottom", x=k, y=k),
    )
    step = solve(scene, 0.9, degree=1, max_steps=1, solver=EXACT)
    stress = step.nodal_stress
    everywhere(np.abs(stress[..., 4] - 1e-3).max(initial=0.0) < 1e-9, stress)


#: Tractions of a uniform shear stress of 0.001 in the plane x, z, without that on the bottom.
SHEAR = {"top": (1e-3, 0, 0), "right": (0, 0, 1e-3), "left": (0, 0, -1e-3)}
