"""A shaft lies in a bore with some play and is pulled down: conforming contact, against Persson's solution.

Half of a slice in plane strain is modelled. Shaft and hub have as many cells around, so that their surfaces match.

    mpirun -n 2 python3 demos/shaft_in_bore.py --play 0.0005
"""

import numpy as np
from common import main, parser

from fx_contact import BodyForce, ContactPair, Dirichlet, Scene, SymmetryPlane
from fx_contact.problem import cylinder, ring, root_mesh_from_shapes
from fx_contact.results import Persson

BORE, HUB, LENGTH = 1.0, 6.0, 0.25

options = parser(__doc__, tolerance=0.02, order=4, coarse=3, output="results/shaft_in_bore")
options.add_argument("--play", type=float, default=0.002, help="difference of the radii, bore 1 (%(default)s)")
options.add_argument("--load", type=float, default=0.002, help="on the shaft, per length (%(default)s)")


def scene(arguments, material):
    """Half of both, x >= 0; the shaft touches the bore along its lowest line."""
    n, play, order = arguments.coarse, arguments.play, arguments.order
    shaft = cylinder(BORE - play, LENGTH, (n, 1), order, quarters=2).turned("x", 90).shifted(z=-play)
    hub = ring(BORE, HUB, LENGTH, (2 * n, 2 * n, 1), order, quarters=2).turned("x", 90)  # about the y axis
    cuts = [SymmetryPlane(f"{body} {side}") for body in ("shaft", "hub") for side in ("x = 0", "bottom", "top")]
    weight = arguments.load / (np.pi * (BORE - play) ** 2)
    return Scene(
        name="shaft in bore",
        mesh=root_mesh_from_shapes({"shaft": shaft, "hub": hub}),
        materials={"shaft": material, "hub": material},
        dirichlet=(Dirichlet("hub outside", x=0.0, z=0.0), *cuts),
        contact=(ContactPair("shaft outside", "hub inside"),),
        body_forces=(BodyForce("shaft", (0.0, 0.0, -weight)),),
        symmetry=2,
    )


def errors(arguments, step):
    """Deviations: of the largest pressure from Persson's, of the contact's vertical force from the load."""
    modulus = step.scene.materials["hub"].plane_strain_modulus
    known = Persson(BORE, modulus, arguments.play, arguments.load)
    (pressing,) = (one for one in step.resultants if one.kind == "contact")
    return {
        "max_pressure": step.record.max_pressure / known.max_pressure - 1,
        "load": -pressing.force[2] / (arguments.load * LENGTH) - 1,
    }


if __name__ == "__main__":
    main(options, scene, errors=errors, across="z")
