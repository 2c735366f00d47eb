"""A strip of two bonded metals, heated: its curvature against Timoshenko's, and against a uniformly refined mesh."""

import pytest

from fx_contact import (
    Beginning,
    Dirichlet,
    Displacement,
    Material,
    Scene,
    SymmetryPlane,
    ThermalStrain,
    adapt,
    block,
    join,
    root_mesh_from_shapes,
    solve,
)

#: Half length, thicknesses, and where deflections are taken: away from the free end, and at it.
LENGTH, THIN, THICK = 24.0, 1.0, 2.0
HALFWAY, END = ((x, 0.0, THIN) for x in (LENGTH / 2, LENGTH))
STEEL, BRASS = Material(210e3, 0.3), Material(105e3, 0.34)
EXPANSION, HEAT = {"steel": 12e-6, "brass": 19e-6}, 100.0
DEGREES = pytest.mark.parametrize("degree", (1, 2))
PARALLEL = pytest.mark.ranks(1, 2, 3)


def strip(cells=12):
    """Half of a strip in plane strain, whose middle is held at the interface."""
    heights = {"steel": (0.0, THIN), "brass": (THIN, THIN + THICK)}
    layers = [
        block((0, 0, low), (LENGTH, 1, high), (cells, 1, 1), 1).as_part(name) for name, (low, high) in heights.items()
    ]
    middle = ("strip", lambda x: abs(x[0]) + abs(x[1]) + abs(x[2] - THIN) < 1e-9)
    return Scene(
        "bimetal strip",
        root_mesh_from_shapes({"strip": join(layers)}, vertices={"middle": middle}),
        {"strip steel": STEEL, "strip brass": BRASS},
        (*(SymmetryPlane(f"strip {side}") for side in ("left", "front", "back")), Dirichlet("middle", z=0.0)),
        strains=[ThermalStrain(f"strip {name}", value, HEAT) for name, value in EXPANSION.items()],
    )


def timoshenko():
    """Curvature of a bimetal strip (J. Opt. Soc. Am. 11, 1925, 233) in plane strain: E / (1 - nu^2), (1 + nu) alpha."""
    free = [HEAT * EXPANSION[name] * (1 + metal.poisson) for name, metal in (("steel", STEEL), ("brass", BRASS))]
    m, n = THIN / THICK, STEEL.plane_strain_modulus / BRASS.plane_strain_modulus
    height = (THIN + THICK) * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n)))
    return 6 * (free[1] - free[0]) * (1 + m) ** 2 / height


def goals(tolerance):
    """Deflections at half of the length and at the end."""
    return [Displacement(point, (0, 0, 1), tolerance) for point in (HALFWAY, END)]


def curvatures(record):
    """Curvatures from the two deflections, and their estimated errors."""
    return [
        (-2 * goal.value / point[0] ** 2, 2 * goal.error / point[0] ** 2)
        for goal, point in zip(record.goals, (HALFWAY, END))
    ]


@PARALLEL
@DEGREES
def test_curvature_is_timoshenkos(degree):
    """Halfway within the estimated error of the goal; at the end, where beam theory fails over h, within (h / l)^2."""
    step = solve(strip(), 0.3, degree=degree, goals=goals(0.02))
    (halfway, error), (end, end_error) = curvatures(step.record)
    known = timoshenko()
    assert step.record.reached
    assert abs(halfway - known) < 1.5 * error + 1e-4 * known
    assert abs(end - known) < end_error + ((THIN + THICK) / LENGTH) ** 2 * known


@PARALLEL
def test_uniform_mesh_agrees():
    """Curvatures of an adapted mesh and of the root cells refined once differ by less than their estimated errors."""
    scene = strip()
    adapted = solve(scene, 0.1, goals=goals(1e-4)).record
    (uniform,) = adapt(scene, 0.1, goals=goals(0.01), max_steps=1, beginning=Beginning.uniform(scene, 1))
    for (one, first), (other, second) in zip(curvatures(adapted), curvatures(uniform.record)):
        assert abs(one - other) < first + second + 1e-6 * one
