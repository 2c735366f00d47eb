"""Two elastic half-spheres pressed together, pole to pole, to a prescribed accuracy.

Shows the whole method: curved hexahedra refined where the estimated error is, facing cells refined together and kept
on one rank, contact found by an active set. A line is printed for every adaptive step; at the end the refined mesh is
drawn, and the contact pressure against Hertz's.

    mpirun -n 2 python3 demos/hertz.py --tolerance 0.01
"""

from common import main, parser

from fx_contact.results import REFERENCES, Hertz, contact_errors
from fx_contact.scenes import hertz

#: By degree, for a cell of degree 2 costs eight: tolerance, order of the root mesh, root cells along a block.
TOLERANCE, ORDER, COARSE = {1: 0.08, 2: 0.02}, {1: 3, 2: 6}, {1: 4, 2: 2}

options = parser(__doc__, tolerance=TOLERANCE, order=ORDER, coarse=COARSE, output="results/hertz", whole=True)
options.add_argument("--radius", type=float, default=1.0, help="of both spheres (%(default)s)")
options.add_argument("--displacement", type=float, default=0.01, help="approach of the flat faces (%(default)s)")
options.add_argument("--reference", choices=REFERENCES, help="record the deviations from these published values")


def scene(arguments, material, order=None):
    """The two half-spheres that the arguments describe, of another geometry order if one is given."""
    if arguments.reference:
        REFERENCES[arguments.reference]().check_problem(arguments.radius, arguments.displacement, material)
    order = order or arguments.order
    return hertz(arguments.radius, arguments.displacement, material, order, arguments.coarse, arguments.symmetry)


def best_scene(arguments, material):
    """The same root cells with the geometry closest to a sphere."""
    return scene(arguments, material, order=6)


def exact(arguments, material, force):
    """Hertz's solution through the computed force."""
    return Hertz.of_equal_spheres(arguments.radius, material, force)


def errors(arguments, step):
    """Deviations from the published values that were asked for."""
    return contact_errors(step, REFERENCES[arguments.reference]()) if arguments.reference else {}


if __name__ == "__main__":
    main(options, scene, exact, best_scene=best_scene, errors=errors)
