"""Two equal cylinders crossed at right angles: Hertz's contact of a sphere with a plane, on bodies of your own.

One rod is a quarter of a cylinder about z. The other, along y, is swept from the contact face of the first, from its
own round side to its flat back, so that the surfaces match facet by facet, whatever the radii.

    mpirun -n 2 python3 demos/crossed_cylinders.py --tolerance 0.02
"""

import numpy as np
from common import main, parser

from fx_contact import ContactPair, Dirichlet, Scene, SymmetryPlane
from fx_contact.problem import cylinder, root_mesh_from_shapes, sweep_side
from fx_contact.results import Hertz

options = parser(__doc__, tolerance=0.05, order=4, coarse=2, output="results/crossed_cylinders")
options.add_argument("--radius", type=float, default=1.0, help="of both cylinders (%(default)s)")
options.add_argument("--displacement", type=float, default=0.01, help="approach of the flat backs (%(default)s)")


def scene(arguments, material):
    """A quarter of both, y and z >= 0, that touch at x = radius."""
    radius, n = arguments.radius, arguments.coarse
    rod = cylinder(radius, radius / np.sqrt(2), (n, n), arguments.order, quarters=1)
    rod = rod.named("face", "outside", where=lambda x: x[0] > 0.999 * x[1])

    def path(x, t):
        """From the round side of the other rod, t = 0, to its flat back."""
        side, back = 2 * radius - np.sqrt(radius**2 - x[2] ** 2), 2 * radius
        return (1 - t) * side + t * back, x[1], x[2]

    mesh = root_mesh_from_shapes({"rod": rod, "other": sweep_side(rod, "face", path, layers=2 * n)})
    pressed = Dirichlet("rod x = 0", x=0.0), Dirichlet("other end", x=-arguments.displacement)
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


def exact(arguments, material, force):
    """Equal crossed cylinders are apart like a sphere of their radius and a plane."""
    return Hertz(arguments.radius, material.plane_strain_modulus / 2, force)


if __name__ == "__main__":
    main(options, scene, exact)
