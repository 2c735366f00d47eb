"""A half-ball on a rigid ball, and on one 1e6 times as stiff that node pairs hold.

    python3 -m studies.goals.rigid_twins    # two minutes

Node pairs neglect that the surface slides over the stiff ball.  A rigid surface with the gap along z and the normal z,
as the pairs have them, has their force; a rigid ball has the change of its own gap.  It leaves rigid_twins.csv in
results/goals.
"""

from dataclasses import replace

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    RigidSphere,
    RigidSurface,
    Scene,
    SymmetryPlane,
    ball,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.parallel.arrays import FloatArray
from studies.tables import options, tabulate

#: Poisson's ratio and approach [m]; the balls have radius 1.
CASES = (0.3, 0.01), (0.45, 0.01), (0.3, 0.0025)
TOLERANCE, DEGREE = 0.01, 2
ALONG = 0.0, 0.0, -1.0


def height(x: FloatArray) -> FloatArray:
    """Height of points (3, n) over the lower ball: (n,) [m]."""
    return np.asarray(x[2] + 1 - np.sqrt(1 - np.minimum(x[0] ** 2 + x[1] ** 2, 1.0)))


def upward(x: FloatArray) -> FloatArray:
    """The z axis at points (3, n): (3, n)."""
    return np.stack([0 * x[0], 0 * x[0], 1 + 0 * x[0]])


def twins(poisson: float, approach: float, coarse: int = 3) -> dict[str, Scene]:
    """A quarter of the half-ball, pressed by its flat face: on the stiff ball, and on two obstacles."""
    octant = ball(1.0, coarse, 6, octants=1).named("pole", "outside", where=lambda x: x[2] > 0.6)
    bodies = {
        "upper": octant.turned("x", 180).shifted(z=1.0),
        "lower": octant.turned("z", -90).shifted(z=-1.0),  # also at y <= 0
    }
    material = Material(1.0, poisson)

    def scene(*names: str, contact: ContactPair) -> Scene:
        """Of bodies that are held."""
        planes = (SymmetryPlane(f"{name} {side} = 0") for name in names for side in "xy")
        flat = Dirichlet("upper z = 0", z=-approach), Dirichlet("lower z = 0", z=0.0)
        return Scene(
            name="twins",
            mesh=root_mesh_from_shapes({name: bodies[name] for name in names}),
            materials={name: material if name == "upper" else Material(1e6, 0.3) for name in names},
            dirichlet=(*flat[: len(names)], *planes),
            contact=(contact,),
            symmetry=4,
            contact_centre=(0.0, 0.0, 0.0),
        )

    on = ContactPair("upper pole", RigidSphere((0.0, 0.0, -1.0), 1.0), ALONG)
    return {
        "stiff": scene("upper", "lower", contact=ContactPair("upper pole", "lower pole", ALONG)),
        "rigid ball": scene("upper", contact=on),
        "rigid surface": scene("upper", contact=replace(on, second=RigidSurface(height, upward))),
    }


def measured(poisson: float, approach: float) -> dict[str, float]:
    """A row of the table."""
    scenes = twins(poisson, approach)
    records = {name: solve(scene, TOLERANCE, degree=DEGREE).record for name, scene in scenes.items()}
    force = {name: record.force / records["stiff"].force - 1 for name, record in records.items()}
    row = {"poisson": poisson, "approach": approach, "radius": records["rigid ball"].contact_radius}
    return row | {"ball": force["rigid ball"], "surface": force["rigid surface"]}


def main() -> None:
    """All cases; print the table and keep it."""
    given = options(__doc__, "goals").parse_args()
    tabulate((measured(*case) for case in CASES), given.output / "rigid_twins.csv")


if __name__ == "__main__":
    main()
