"""Two equal cylinders crossed at right angles: Hertz's contact of a sphere with a plane, on own bodies.

One rod is a quarter of a cylinder about z. The other, along y, is swept from the contact face of the first, between its
round side and its flat back, so that the surfaces have the same facets for any radius.

    mpirun -n 2 python3 demos/crossed_cylinders.py --tolerance 0.02
"""

import argparse

import numpy as np
from common import COMM, Report, parse, parser, plain_errors, settings

from fx_contact import ContactPair, Dirichlet, Material, Scene, SymmetryPlane, adapt
from fx_contact.plot import draw_mesh, draw_pressure
from fx_contact.problem import cylinder, root_mesh_from_shapes, sweep_side
from fx_contact.results import Hertz, true_error, write_fields

MATERIAL = Material(young=1.0, poisson=0.3)

options = parser(__doc__, tolerance=0.05, order=4, coarse=2, output="results/crossed_cylinders")
options.add_argument("--radius", type=float, default=1.0, help="of both cylinders (%(default)s)")
options.add_argument("--displacement", type=float, default=0.01, help="approach of the flat backs (%(default)s)")


def crossed_cylinders(
    radius: float = 1.0, displacement: float = 0.01, material: Material = MATERIAL, order: int = 4, coarse: int = 2
) -> Scene:
    """A quarter of both, y and z >= 0, that touch at x = radius."""
    rod = cylinder(radius, radius / np.sqrt(2), (coarse, coarse), order, quarters=1)
    rod = rod.named("face", "outside", where=lambda x: x[0] > 0.999 * x[1])

    def path(x: np.ndarray, t: float) -> tuple[np.ndarray, ...]:
        """From the round side of the other rod, t = 0, to its flat back."""
        side, back = 2 * radius - np.sqrt(radius**2 - x[2] ** 2), 2 * radius
        return (1 - t) * side + t * back, x[1], x[2]

    mesh = root_mesh_from_shapes({"rod": rod, "other": sweep_side(rod, "face", path, layers=2 * coarse)})
    pressed = Dirichlet("rod x = 0", x=0.0), Dirichlet("other end", x=-displacement)
    planes = [SymmetryPlane(f"{body} {side}") for body in ("rod", "other") for side in ("y = 0", "bottom")]
    return Scene(
        name="crossed cylinders",
        mesh=mesh,
        materials={"rod": material, "other": material},
        dirichlet=(*pressed, *planes),
        contact=(ContactPair("rod face", "other start", direction=(1.0, 0.0, 0.0)),),
        symmetry=4,
        contact_centre=(radius, 0.0, 0.0),
    )


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures; the gap is that of a sphere of the cylinders' radius and a plane."""
    material = Material(given.young, given.poisson)
    scene = crossed_cylinders(given.radius, given.displacement, material, given.order, given.coarse)
    asked = settings(given, scene)
    run = adapt(scene, **asked)  # checks its arguments before the report replaces an old one
    report = Report(given, asked["restart"])
    for step in run:
        report.add(step)
    modulus, force = material.plane_strain_modulus / 2, step.record.force
    exact = Hertz(given.radius, modulus, force) if force > 0 else None
    if not given.records_only:
        with step.stages("output"):
            write_fields(step, given.output)
            draw_mesh(step, given.output / "mesh.png")
            draw_pressure(step, given.output / "pressure.png", exact)
    true = true_error(step, given.true_error) if given.true_error else None
    report.end(step, "mesh.png, pressure.png", hertz=exact, true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
