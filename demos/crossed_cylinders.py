"""Two crossed steel cylinders, each with a mesh of its own: Hertz's contact on an ellipse (N, mm).

A quarter is modelled of both, complete around their axes and held at their ends:
mpirun -n 2 python3 demos/crossed_cylinders.py --radii 10 10
"""

import argparse

import numpy as np
from common import COMM, Report, parse, parser, plain_errors, settings

from fx_contact import ContactPair, Dirichlet, Material, Scene, SymmetryPlane, adapt, cylinder, root_mesh_from_shapes
from fx_contact.plot import draw_mesh, draw_stress
from fx_contact.results import true_error, write_fields
from fx_contact.results.analytic import HertzEllipse

RADII, STEEL = (10.0, 25.0), Material(young=210e3, poisson=0.3)

options = parser(__doc__, tolerance=0.02, order=6, coarse=2, output="results/crossed_cylinders")
options.set_defaults(young=STEEL.young)
options.add_argument("--radii", type=float, nargs=2, default=RADII, help="of the cylinders (10 25)")
options.add_argument("--displacement", type=float, default=0.02, help="of the first one's ends (%(default)s)")


def crossed_cylinders(
    radii: tuple = RADII, displacement: float = 0.02, material: Material = STEEL, order: int = 6, n: int = 2
) -> Scene:
    """Halves y >= 0 of one about z and z >= 0 of one about y, that touch at the origin."""
    first, second = (cylinder(radius, radius, (n, n), order, quarters=2) for radius in radii)
    bodies = {
        "first": first.placed(lambda x: (-x[1] - radii[0], x[0], x[2])),
        "second": second.placed(lambda x: (x[1] + radii[1], x[2], x[0])),
    }
    planes = (SymmetryPlane(f"{body} {side}") for body in bodies for side in ("x = 0", "bottom"))
    return Scene(
        name="crossed cylinders",
        mesh=root_mesh_from_shapes(bodies),
        materials=dict.fromkeys(bodies, material),
        dirichlet=(Dirichlet("first top", x=displacement), Dirichlet("second top", x=0.0), *planes),
        contact=(ContactPair("first outside", "second outside"),),
        symmetry=4,
        contact_centre=(0.0, 0.0, 0.0),
        units=("mm", "MPa"),
    )


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare with Hertz at the same force; the mean y^2 of its forces is a^2/5."""
    material = Material(given.young, given.poisson)
    scene = crossed_cylinders(tuple(given.radii), given.displacement, material, given.order, given.coarse)
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
    known = HertzEllipse(tuple(given.radii), material.plane_strain_modulus / 2, step.record.force)
    moments = COMM.allreduce(step.contact.force @ np.insert(step.contact.points[:, 1:] ** 2, 0, 1.0, axis=1))
    axes = np.sqrt(5 * moments[1:] / moments[0]) / known.semi_axes - 1
    errors = dict(zip(("semi-axis_y", "semi-axis_z"), map(float, axes)))
    errors["max_pressure"] = step.record.max_pressure / known.max_pressure - 1
    true = true_error(step, given.true_error) if given.true_error else None
    report.end(step, "mesh.png, stress.png", errors=errors, true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
