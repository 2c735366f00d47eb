"""Largest pressure and contact radius by mesh: its growth, and its ratio to Hertz's pressure of that radius.

    python3 -m studies.goals.pressures    # three minutes

Behind `model_warning.GROWTH` and `contact_figures.PEAK`: round contact, a ball on a thin layer, and a stamp with sharp
edges, at degrees 1 and 2.  It leaves pressures.csv in results/goals; the radius is that of the second moments of the
pressure also where the records have none.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    RigidSphere,
    Scene,
    Step,
    SymmetryPlane,
    adapt,
    block,
    root_mesh_from_shapes,
    scenes,
)
from studies.tables import options, tabulate

PLAIN = Material(young=1.0, poisson=0.3)
#: Tolerances by degree, and largest number of unknowns.
TOLERANCES, MOST = {1: 0.1, 2: 0.03}, 50_000


def ball_on(thickness: float, size: float, cells: tuple[int, int, int], radius: float, approach: float) -> Scene:
    """A quarter of a block below a rigid ball."""
    shape = block((0.0, 0.0, -thickness), (size, size, 0.0), cells)
    held = Dirichlet("block bottom", 0.0, 0.0, 0.0), SymmetryPlane("block left"), SymmetryPlane("block front")
    ball = RigidSphere((0.0, 0.0, radius), radius)
    pair = ContactPair("block top", ball, moved=(0.0, 0.0, -approach))
    return Scene("ball", root_mesh_from_shapes({"block": shape}), {"block": PLAIN}, held, (pair,), symmetry=4)


def stamp() -> Scene:
    """A quarter of a cube pressed on a block."""
    bodies = {
        "base": block((0.0, 0.0, -1.0), (2.0, 2.0, 0.0), (4, 4, 2)),
        "stamp": block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2, 2)),
    }
    planes = (SymmetryPlane(f"{name} {side}") for name in bodies for side in ("left", "front"))
    held = Dirichlet("base bottom", z=0.0), Dirichlet("stamp top", z=-0.01), *planes
    pair = ContactPair("base top", "stamp bottom")
    return Scene("stamp", root_mesh_from_shapes(bodies), dict.fromkeys(bodies, PLAIN), held, (pair,), symmetry=4)


SCENES: dict[str, Callable[[], Scene]] = {
    "half-spheres": lambda: scenes.hertz(coarse=2),
    "spheres": scenes.spheres,
    "punch": lambda: scenes.punch(force=1e-3),
    "ball on a block": lambda: ball_on(1.0, 1.0, (3, 3, 3), 5.0, 0.02),
    "ball on a thin layer": lambda: ball_on(0.1, 2.0, (8, 8, 1), 5.0, 0.01),
    "cylinders": scenes.cylinders,
    "stamp": stamp,
    "cube": scenes.indentation,
}


def radius_of(step: Step) -> float:
    """Radius of Hertz's contact with the second moments of the forces about the centre of the contact [m]."""
    assert step.record.contact_centre is not None
    arm = step.contact.points - np.array(step.record.contact_centre)
    along = np.einsum("ni,ni->n", arm, step.contact.normal)
    square = (arm**2).sum(axis=1) - along**2
    total = float(step.contact.force.sum())
    return float(np.sqrt(2.5 * square @ step.contact.force / total)) if total else 0.0


def rows() -> Iterator[dict[str, object]]:
    """All meshes of all scenes, on one rank."""
    for (name, make), (degree, tolerance) in product(SCENES.items(), TOLERANCES.items()):
        before = 0.0
        for step in adapt(replace(make(), name=name), tolerance, degree=degree, max_steps=8):
            record, radius = step.record, radius_of(step)
            hertz = 1.5 * record.force / (np.pi * radius**2) if radius else np.nan
            row = {"scene": name, "degree": degree, "step": record.step, "dofs": record.dofs}
            row |= {"closed": record.active_pairs, "pressure": record.max_pressure}
            row |= {"growth": record.max_pressure / before - 1 if before else np.nan}
            yield row | {"radius": radius, "over Hertz's": record.max_pressure / hertz}
            before = record.max_pressure
            if record.dofs > MOST:
                break


def main() -> None:
    """Run all scenes; print the table and keep it."""
    tabulate(rows(), options(__doc__, "goals").parse_args().output / "pressures.csv")


if __name__ == "__main__":
    main()
