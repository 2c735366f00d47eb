"""A rigid round stamp, flat with a rounded edge, pressed into a block: an obstacle by two functions.

A quarter is modelled; Sneddon's force is that on a half-space: mpirun -n 2 python3 demos/rigid_stamp.py --rounding 0.5
"""

import argparse

import numpy as np
from common import COMM, Report, parse, parser, plain_errors, settings
from scipy.integrate import quad
from scipy.optimize import brentq

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    RigidSurface,
    Scene,
    SymmetryPlane,
    adapt,
    block,
    root_mesh_from_shapes,
)
from fx_contact.plot import draw_mesh, draw_stress
from fx_contact.results import true_error, write_fields

FLAT, SIZE, MATERIAL = 1.0, 30.0, Material(young=1.0, poisson=0.3)

options = parser(__doc__, tolerance=0.1, order=1, coarse=4, output="results/rigid_stamp")
options.add_argument("--depth", type=float, default=0.01, help="of the stamp in the block (%(default)s)")
options.add_argument("--rounding", type=float, default=1.0, help="radius of its edge; flat part 1 (%(default)s)")


def stamp(rounding: float) -> RigidSurface:
    """Its lower side z = f(r): 0 up to the radius 1, then (r - 1)^2 / (2 rounding); the gap is along z."""
    return RigidSurface(
        gap=lambda x: np.maximum(np.hypot(x[0], x[1]) - FLAT, 0.0) ** 2 / (2 * rounding) - x[2],
        normal=lambda x: np.stack([0 * x[0], 0 * x[0], 0 * x[0] - 1]),
    )


def rigid_stamp(depth: float, rounding: float, material: Material = MATERIAL, order: int = 1, n: int = 4) -> Scene:
    """A quarter of a block below z = 0, held at its lower side."""
    return Scene(
        name="rigid stamp",
        mesh=root_mesh_from_shapes({"block": block((0.0, 0.0, -SIZE), (SIZE, SIZE, 0.0), (n, n, n), order)}),
        materials={"block": material},
        dirichlet=(Dirichlet("block bottom", z=0.0), SymmetryPlane("block left"), SymmetryPlane("block front")),
        contact=(ContactPair("block top", stamp(rounding), (0.0, 0.0, 1.0), moved=(0.0, 0.0, -depth)),),
        symmetry=4,
    )


def sneddon(depth: float, rounding: float, modulus: float) -> float:
    """Force on a half-space, 2 E* int_0^a (d - g) dx with g(x) = x int_0^x f'(r) (x^2 - r^2)^(-1/2) dr, g(a) = d."""
    b, g = FLAT, lambda x: x / rounding * (np.sqrt(x**2 - FLAT**2) - FLAT * np.arccos(FLAT / x))
    a = brentq(lambda x: g(x) - depth, b, b + 2 * np.sqrt(rounding * depth) + depth)
    return 2 * modulus * (depth * a - quad(g, b, a)[0])


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare the force."""
    material = Material(young=given.young, poisson=given.poisson)
    scene = rigid_stamp(given.depth, given.rounding, material, given.order, given.coarse)
    asked = settings(given, scene)
    run = adapt(scene, **asked)  # checks its arguments before the report replaces an old one
    report = Report(given, asked["restart"])
    for step in run:
        report.add(step)

    if not given.records_only:
        with step.stages("output"):
            write_fields(step, given.output)
            draw_mesh(step, given.output / "mesh.png")
            draw_stress(step, given.output / "stress.png")
    errors = {"force": step.record.force / sneddon(given.depth, given.rounding, material.plane_strain_modulus) - 1}
    true = true_error(step, given.true_error) if given.true_error else None
    report.end(step, "mesh.png, stress.png", errors=errors, true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
