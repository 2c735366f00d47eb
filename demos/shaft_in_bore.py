"""A shaft in a bore with play, pulled down: conforming contact, against Persson's solution.

Half of a slice in plane strain is modelled. The meshes differ and have the radius of the bore; the play is a number.

    mpirun -n 2 python3 demos/shaft_in_bore.py --play 0.0005
"""

import argparse

import numpy as np
from common import COMM, Report, parse, parser, plain_errors, settings

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Material,
    Scene,
    SymmetryPlane,
    adapt,
    cylinder,
    ring,
    root_mesh_from_shapes,
)
from fx_contact.plot import draw_mesh, draw_stress
from fx_contact.results import true_error, write_fields
from fx_contact.results.analytic import Persson

BORE, HUB, LENGTH, MATERIAL = 1.0, 6.0, 0.25, Material(young=1.0, poisson=0.3)

options = parser(__doc__, tolerance=0.02, order=4, coarse=3, output="results/shaft_in_bore")
options.add_argument("--play", type=float, default=0.002, help="difference of the radii, bore 1 (%(default)s)")
options.add_argument("--load", type=float, default=0.002, help="on the shaft, per length (%(default)s)")


def shaft_in_bore(
    play: float = 0.002, load: float = 0.002, material: Material = MATERIAL, order: int = 4, n: int = 3
) -> Scene:
    """Half of both, x >= 0, about the y axis."""
    shaft = cylinder(BORE, LENGTH, (n, 1), order, quarters=2).turned("x", 90)
    hub = ring(BORE, HUB, LENGTH, (2 * n, 2 * n - 1, 1), order, quarters=2).turned("x", 90)
    cuts = [SymmetryPlane(f"{body} {side}") for body in ("shaft", "hub") for side in ("x = 0", "bottom", "top")]
    weight = load / (np.pi * BORE**2)
    return Scene(
        name="shaft in bore",
        mesh=root_mesh_from_shapes({"shaft": shaft, "hub": hub}),
        materials={"shaft": material, "hub": material},
        dirichlet=(Dirichlet("hub outside", x=0.0, z=0.0), *cuts),
        contact=(ContactPair("shaft outside", "hub inside", clearance=play),),
        body_forces=(BodyForce("shaft", (0.0, 0.0, -weight)),),
        symmetry=2,
    )


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare with Persson's largest pressure and with the load."""
    material = Material(young=given.young, poisson=given.poisson)
    scene = shaft_in_bore(given.play, given.load, material, given.order, given.coarse)
    asked = settings(given, scene)
    run = adapt(scene, **asked)  # checks its arguments before the report replaces an old one
    report = Report(given, asked["restart"])
    for step in run:
        report.add(step)

    if not given.records_only:
        with step.stages("output"):
            write_fields(step, given.output)
            draw_mesh(step, given.output / "mesh.png")
            draw_stress(step, given.output / "stress.png", across="z")
    known = Persson(BORE, material.plane_strain_modulus, given.play, given.load)
    (contact,) = (one for one in step.resultants if one.kind == "contact")
    errors = {
        "max_pressure": step.record.max_pressure / known.max_pressure - 1,
        "load": -contact.force[2] / (given.load * LENGTH) - 1,
    }
    true = true_error(step, given.true_error) if given.true_error else None
    report.end(step, "mesh.png, stress.png", errors=errors, true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
