"""A steel roller on a block of aluminium, NAFEMS' contact benchmark 1, each with a mesh of its own (N, mm).

Half of a slice in plane strain; of the roller the lower half, with the load on its middle plane.  Source: A. W. A.
Konter, Advanced Finite Element Contact Benchmarks, NAFEMS, 2006: mpirun -n 2 python3 demos/roller_on_block.py
"""

import argparse

import numpy as np
from common import COMM, Report, parse, parser, plain_errors, settings

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Scene,
    SymmetryPlane,
    Traction,
    adapt,
    block,
    cylinder,
    root_mesh_from_shapes,
)
from fx_contact.plot import draw_mesh, draw_stress
from fx_contact.results import true_error, write_fields
from fx_contact.results.analytic import HertzLine

RADIUS, SIDE, LENGTH = 50.0, 200.0, 10.0
STEEL, ALUMINIUM = Material(young=210e3, poisson=0.3), Material(young=70e3, poisson=0.3)

options = parser(__doc__, tolerance=0.01, order=6, coarse=4, output="results/roller_on_block")
options.set_defaults(young=ALUMINIUM.young)
options.add_argument("--load", type=float, default=35e3, help="on the roller, per length (%(default)s)")


def roller_on_block(load: float = 35e3, material: Material = ALUMINIUM, order: int = 6, n: int = 4) -> Scene:
    """x >= 0 of both, which touch along the y axis."""
    roller = cylinder(RADIUS, LENGTH, (n, 1), order, quarters=1).mirrored("y").shifted(y=RADIUS).turned("x", 90)
    below = block((0.0, -SIDE, 0.0), (SIDE / 2, 0.0, LENGTH), (2 * n, 4 * n, 1), order).turned("x", 90)
    planes = {"roller": ("x = 0", "bottom", "top"), "block": ("left", "bottom", "top")}
    return Scene(
        name="roller on block",
        mesh=root_mesh_from_shapes({"roller": roller, "block": below}),
        materials={"roller": STEEL, "block": material},
        dirichlet=(
            Dirichlet("block front", x=0.0, z=0.0),
            *(SymmetryPlane(f"{body} {side}") for body, sides in planes.items() for side in sides),
        ),
        contact=(ContactPair("roller outside", "block back"),),
        tractions=(Traction("roller y = 0", (0.0, 0.0, -load / (2 * RADIUS))),),
        symmetry=2,
        units=("mm", "MPa"),
    )


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare with Hertz at the same force; the mean x^2 of its forces is a^2/4."""
    material = Material(given.young, given.poisson)
    scene = roller_on_block(given.load, material, given.order, given.coarse)
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
    modulus = 1 / (1 / STEEL.plane_strain_modulus + 1 / material.plane_strain_modulus)
    known = HertzLine(RADIUS, modulus, given.load)
    here = step.contact
    force, x2 = COMM.allreduce(here.force @ np.stack([here.force**0, here.points[:, 0] ** 2], axis=1))
    (contact,) = (one for one in step.resultants if one.kind == "contact")
    errors = {
        "max_pressure": step.record.max_pressure / known.max_pressure - 1,
        "half-width": float(2 * np.sqrt(x2 / force) / known.half_width - 1),
        "load": -contact.force[2] / (given.load * LENGTH) - 1,
    }
    true = true_error(step, given.true_error) if given.true_error else None
    report.end(step, "mesh.png, stress.png", errors=errors, true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
