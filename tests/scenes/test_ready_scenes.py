"""The ready scenes: uniform compression of stacks, a punch against Hertz, and twins that must give the same answer."""

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import WORLD, outside

from fx_contact import BodyForce, Material, adapt, solve
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.results.analytic import Hertz, HertzLine, ShrinkFit
from fx_contact.scenes import cylinders, hertz, indentation, patch, punch, shrink_fit, spheres, stack
from studies.stability.twins import scaled, swapped, turned

SOFT, STIFF = Material(1.0, 0.3), Material(1e3, 0.0)
CYCLE = np.roll(np.eye(3), 1, axis=0)


def last(scene, tolerance=0.2):
    """The record of the last step."""
    *_, step = adapt(scene, tolerance)
    return step.record


@pytest.mark.parametrize("materials", [(SOFT, STIFF), (SOFT, STIFF, SOFT, SOFT)])
@pytest.mark.parametrize("gap", [0.0, 0.3, -0.005])
def test_stack_is_in_uniform_compression(materials, gap):
    """Each contact carries (approach) / sum(h/E), less what the penalty gives way: at most 2 % in all."""
    pairs = len(materials) - 1
    record = last(stack(materials, displacement=0.01 + pairs * gap, gap=gap, side=2.0, height=0.7))
    exact = 4 * 0.01 / sum(0.7 / m.young for m in materials)
    assert len(record.pair_forces) == pairs and abs(sum(record.pair_forces) / record.force - 1) < 1e-12
    for force in record.pair_forces:
        assert -0.02 < force / exact - 1 <= 1e-7
    assert record.estimate < 1e-6 and record.active_pairs == 25 * pairs


def test_weights_add_up_downward():
    """Each contact of a stack carries what lies on it, and the record says which carries what."""
    scene = stack((SOFT, STIFF, SOFT, SOFT), pressure=0.001, cells=(1, 1, 1))
    weights = zip(scene.mesh.bodies, (1e-3, 2e-3, 3e-3, 4e-3))
    weights = tuple(BodyForce(body, (0.0, 0.0, -weight)) for body, weight in weights)
    forces = np.array(last(replace(scene, body_forces=weights)).pair_forces)
    expected = 0.001 + np.array([9e-3, 7e-3, 4e-3])  # of blocks of 1 m^3 [N]
    assert np.abs(forces / expected - 1).max() < 1e-6


def test_stack_under_pressure():
    """Blocks that contact alone holds pass the load on; they may have many root cells along one axis."""
    assert abs(last(stack((SOFT, STIFF), pressure=0.01)).force / 0.01 - 1) < 1e-7
    assert len(stack(cells=(1, 1, 200)).mesh.cells) == 600


def test_stack_that_does_not_touch():
    """A gap wider than the displacement leaves no force, and a block between two others is free."""
    assert last(stack((SOFT, STIFF), displacement=0.1, gap=0.2)).force == 0
    record = last(stack((SOFT, STIFF, SOFT), displacement=0.1, gap=0.2))
    assert record.force == 0 and record.free_motions == {"block 1": "along z"}
    assert [doubt.kind for doubt in record.doubts] == ["no contact"]


def test_punch_is_hertz():
    """Pressed in little the punch is a sphere on a half-space: force to 3 %, pressure through the force to 5 %."""
    record = last(punch(displacement=1e-3, order=4), 0.15)
    modulus = SOFT.plane_strain_modulus / 2
    assert abs(record.force / (4 / 3 * modulus * 1e-3**1.5) - 1) < 0.03
    highest = (6 * record.force * modulus**2 / np.pi**3) ** (1 / 3)
    assert abs(record.max_pressure / highest - 1) < 0.05


def test_punch_by_force():
    """Force and displacement are two ways to the same state."""
    pressed = last(punch(), 0.1)
    held = last(punch(force=pressed.force), 0.1)
    assert abs(held.force / pressed.force - 1) < 1e-7
    assert abs(held.contact_radius / pressed.contact_radius - 1) < 0.05


@pytest.mark.parametrize("symmetry, parts", [("quarter", 4), ("full", 1)])
def test_loads_are_of_the_whole(symmetry, parts):
    """The force of a punch, and the pressure on a stack times its area, on tops that have not the area 1."""
    pressed = punch(radius=2.0, force=3e-3, side=0.5, symmetry=symmetry)
    for scene, whole in ((pressed, 3e-3), (stack(pressure=0.02, side=3.0, height=0.5), 0.02 * 9)):
        (load,), top = scene.tractions, scene.mesh.facet_points(scene.mesh.surface("top"), 1)
        area = np.linalg.norm(np.cross(top[:, 3] - top[:, 0], top[:, 2] - top[:, 1]), axis=1).sum() / 2
        each = load.at(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))[0]
        assert np.allclose(each * area * scene.symmetry, [0.0, 0.0, -whole], rtol=1e-12)
    assert pressed.symmetry == parts


@pytest.mark.parametrize(
    "radii", [(1.0, 2.0), (np.inf, 1.0), (-2.0, 1.0)], ids=["unequal", "on a block", "in a socket"]
)
def test_spheres_are_hertz(radii):
    """Pressed in little, spheres of any radii have Hertz's pressure and radius through the force, to 5 % and 3 %."""
    record = last(spheres(radii, displacement=1e-3, upper=STIFF, order=4), 0.15)
    modulus = 1 / (1 / SOFT.plane_strain_modulus + 1 / STIFF.plane_strain_modulus)
    exact = Hertz(1 / sum(1 / r for r in radii), modulus, record.force)
    assert abs(record.max_pressure / exact.max_pressure - 1) < 0.05
    assert abs(record.contact_radius / exact.contact_radius - 1) < 0.03
    assert abs(exact.approach / 1e-3 - 1) < 0.1


def test_cylinders_are_hertz():
    """The largest pressure along the line is Hertz's through the force, to 5 %, in a slice of any length."""
    scene = cylinders((1.0, 2.0), displacement=5e-3, upper=STIFF)
    record = last(scene, 0.08)
    modulus = 1 / (1 / SOFT.plane_strain_modulus + 1 / STIFF.plane_strain_modulus)
    exact = HertzLine(2 / 3, modulus, record.force / 0.125)
    assert abs(record.max_pressure / exact.max_pressure - 1) < 0.05
    again = last(cylinders((1.0, 2.0), displacement=5e-3, upper=STIFF, length=0.0625), 0.08)
    assert abs(2 * again.force / record.force - 1) < 0.02


def test_shrink_fit_is_lame():
    """The force is pressure times surface, to 1 %, for an interference of a thousandth."""
    scene = shrink_fit(interference=1e-3, inner=STIFF, outer=SOFT)
    record = last(scene, 0.1)
    exact = ShrinkFit((0.5, 1.0, 1.5), 1e-3, STIFF, SOFT).pressure
    assert abs(record.force / (exact * 2 * np.pi * 2 * 0.25) - 1) < 0.01
    assert abs(record.max_pressure / exact - 1) < 0.03


#: Each ready scene, coarse.
READY = {
    "hertz": lambda: hertz(order=3, coarse=2),
    "punch": punch,
    "spheres": spheres,
    "cylinders": cylinders,
    "rings": shrink_fit,
    "indentation": lambda: indentation(coarse=2),
    "patch": patch,
    "stack": stack,
}


@pytest.mark.parametrize("name", READY)
def test_both_degrees(name):
    """Displacements of degree 1 and 2 give one force, up to twice what the square of their errors allows."""
    steps = [solve(READY[name](), tolerance, degree=degree) for degree, tolerance in ((1, 0.2), (2, 0.12))]
    records = [step.record for step in steps]
    assert all(r.reached and r.active_pairs and r.krylov_iterations[-1] <= 25 for r in records)
    allowed = 2 * sum((r.estimate / min(r.assumed_effectivity, 1)) ** 2 for r in records) + 1e-7
    assert abs(records[0].force / records[1].force - 1) < allowed


@cache
def _first_twin(scene):
    """The last record of the scene that all twins are compared with."""
    return last(scene(), 0.3)


@pytest.mark.parametrize(
    "twin, factor",
    [
        (lambda scene: scaled(scene, 1e-6, 1e9), 1e-3),
        (lambda scene: turned(scene, CYCLE), 1.0),
        (lambda scene: turned(scene, [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]), 1.0),
        (swapped, 1.0),
    ],
    ids=["scaled", "turned", "upside down", "swapped"],
)
@pytest.mark.parametrize(
    "scene", [lambda: hertz(order=2, coarse=2), lambda: punch(force=1e-3, block=STIFF), stack], ids="abc"
)
def test_twins(scene, twin, factor):
    """Twins have the same cells, error and contact force, whatever holds or loads the bodies."""
    one = _first_twin(scene)
    other = last(twin(scene()), 0.3)
    assert one.cells == other.cells and one.force > 0
    # Tributary areas are those of the first surface: exchanged, a curved one differs from a flat one by its slope.
    close = 1e-4 if twin is swapped else 1e-6
    assert abs(other.force / one.force / factor - 1) < close
    assert abs(other.estimate - one.estimate) < close


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: punch(side=1.5), "sqrt"),
        (lambda: punch(coarse=3), "even"),
        (lambda: punch(force=np.nan), "force"),
        (lambda: stack([SOFT]), "two blocks"),
        (lambda: spheres((1.0, -0.5)), "one point"),
        (lambda: spheres((1.0, 0.0)), "two numbers"),
        (lambda: spheres(side=2.0), "smaller side"),
        (lambda: cylinders(radii=(1.0, -1.0)), "radius of the upper"),
        (lambda: cylinders(order=1), "2 to 6"),
        (lambda: shrink_fit((1.0, 0.5, 2.0)), "no ring"),
        (lambda: shrink_fit(interference=3.0), "no ring"),
        (lambda: stack(cells=(2, 0, 2)), "root cells"),
        (lambda: stack(height=0.0), "height"),
        (lambda: shrink_fit(height=0.0), "^height must"),
        (lambda: punch(radius=0.0), "^radius must"),
        (lambda: punch(displacement=np.inf), "^displacement must"),
    ],
)
def test_arguments(make, message):
    """What cannot be built is refused."""
    with pytest.raises((SceneError, GeometryError), match=message):
        make()


@pytest.mark.parametrize(
    "make, order",
    [
        (lambda order: hertz(order=order, displacement=1e-6), 3),
        (lambda order: punch(order=order, displacement=1e-6), 3),
        (lambda order: punch(order=order, force=1e-9), 3),
        (lambda order: punch(1e-6, 1e-8, gap=9.999e-9, order=order, symmetry="full"), 3),
    ],
    ids=["spheres", "punch", "punch by force", "small gap"],
)
def test_not_round_enough(make, order):
    """Spheres that polynomials follow too loosely for so small a contact are refused, those of order 6 are not."""
    with pytest.raises(GeometryError, match="leaves the sphere"):
        make(order)
    assert make(6).mesh.order == 6


def test_roundness_decides_the_force():
    """What is refused would be wrong: the computed force is off by about half of what the surfaces are."""
    force = last(hertz(order=3, displacement=1e-4), 0.1).force
    exact = 4 / 3 * SOFT.plane_strain_modulus / 2 * np.sqrt(0.5) * 1e-6
    assert 0.005 < force / exact - 1 < 0.02


def test_own_gmsh_model(tmp_path):
    """The demo of an own model is short, and ends with a picture."""
    path = Path(__file__).parents[2] / "demos" / "own_gmsh_model.py"
    assert len(path.read_text().splitlines()) < 60
    if WORLD.rank == 0:
        done = subprocess.run([sys.executable, path], cwd=tmp_path, env=outside(), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert "pairs closed" in done.stdout and (tmp_path / "results" / "eye.png").stat().st_size > 10_000
