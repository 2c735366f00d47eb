"""Two elastic half-spheres pressed together, pole to pole, to a prescribed accuracy.

Curved hexahedra are refined by the estimated error, facing cells together and on one rank; an active set determines
the contact. The demo prints a line for each adaptive step, and draws the refined mesh and the contact pressure against
Hertz's.

    mpirun -n 2 python3 demos/hertz.py --tolerance 0.01
"""

import argparse

from common import COMM, Report, parse, parser, plain_errors, settings
from hertz_reference import REFERENCES, contact_errors

from fx_contact import Material, adapt
from fx_contact.plot import draw_mesh, draw_pressure
from fx_contact.results import true_error, write_fields
from fx_contact.results.analytic import Hertz
from fx_contact.scenes import hertz

#: By degree, for a cell of degree 2 costs eight: tolerance, order of the root mesh, root cells along a block.
TOLERANCE, ORDER, COARSE = {1: 0.08, 2: 0.02}, {1: 3, 2: 6}, {1: 4, 2: 2}

options = parser(__doc__, tolerance=TOLERANCE, order=ORDER, coarse=COARSE, output="results/hertz", symmetric=True)
options.add_argument("--radius", type=float, default=1.0, help="of both spheres (%(default)s)")
options.add_argument("--displacement", type=float, default=0.01, help="approach of the flat faces (%(default)s)")
options.add_argument("--reference", choices=REFERENCES, help="record the deviations from these published values")


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare with known solutions."""
    material = Material(young=given.young, poisson=given.poisson)
    reference = REFERENCES[given.reference]() if given.reference else None
    if reference:
        reference.check_problem(given.radius, given.displacement, material)
    bodies = dict(radius=given.radius, displacement=given.displacement, material=material)
    bodies |= dict(coarse=given.coarse, symmetry=given.symmetry)
    scene = hertz(order=given.order, **bodies)

    asked = settings(given, scene)
    run = adapt(scene, **asked)  # checks its arguments before the report replaces an old one
    report = Report(given, asked["restart"])
    for step in run:
        report.add(step)

    force = step.record.force
    exact = Hertz.of_equal_spheres(given.radius, material, force) if force > 0 else None
    if not given.records_only:
        with step.stages("output"):
            write_fields(step, given.output)
            draw_mesh(step, given.output / "mesh.png")
            draw_pressure(step, given.output / "pressure.png", exact)
    errors = contact_errors(step, reference) if reference else {}
    true = None
    if given.true_error:  # on the same root cells, with the geometry closest to a sphere
        true = true_error(step, given.true_error, hertz(order=6, **bodies))
    report.end(step, "mesh.png, pressure.png", hertz=exact, errors=errors, true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
