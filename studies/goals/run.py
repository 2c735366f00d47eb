"""Goals against known values: estimated over true error of forces, reactions, pressures, displacements and gaps.

Each scene is solved to several tolerances of the energy error, the goals are evaluated on the last mesh of each run.
Known are the force and the largest pressure of Hertz's contact, the largest pressure below a rounded punch
(`studies.goals.axisymmetric_punch`), and the displacement below a square under pressure (Boussinesq's solution,
summed). All others are compared with those of a finer solution of degree 2.

    python3 -m studies.goals.run                           # six minutes
    python3 -m studies.goals.run --only hertz --degree 2

Then the gap at the rim of the receding layers and largest pressures are asked for to tolerances of their own, at
degree 2. It leaves table.csv and asked.csv in results/goals.
"""

from dataclasses import replace

import numpy as np

from demos.hertz_reference import REFERENCES
from fx_contact import (
    ContactForce,
    ContactPair,
    Dirichlet,
    Displacement,
    Gap,
    Material,
    MaxPressure,
    Pressure,
    Reaction,
    Scene,
    SymmetryPlane,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.scenes import cylinders, hertz
from studies.goals.axisymmetric_punch import LARGEST_PRESSURE
from studies.goals.rounded_punch import rounded_punch
from studies.tables import options, tabulate

#: Tolerances of the energy error, and that of the finer solution.
TOLERANCES, FINER = (0.2, 0.1, 0.05), 0.01
#: Scene and goal, tolerance of the energy error, and relative errors that are asked for.
ASKED = (
    ("receding layers", "gap at the rim", 0.2, (0.02, 0.005, 0.002)),
    ("hertz", "largest pressure", 0.1, (0.05, 0.01)),
    ("line contact", "largest pressure", 0.1, (0.05, 0.01)),
    ("rounded punch", "largest pressure", 0.1, (0.2, 0.05)),
)
#: Scenes that take millions of unknowns at degree 1.
QUADRATIC = ("rounded punch",)
#: Tolerance of a goal that says nothing: its error alone is wanted.
ANY = 0.999
PLAIN = Material(young=1.0, poisson=0.3)


def spheres():
    """A scene, and name -> goal and known value (None: of a finer solution) of a quarter of two half spheres."""
    known, poles = REFERENCES["hertz-a"](), "lower pole on upper pole"
    return hertz(order=6, coarse=2), {
        "force": (ContactForce(poles, ANY), known.force),
        "reaction": (Reaction("top", ANY), -known.force),
        "largest pressure": (MaxPressure(poles, ANY), known.max_pressure),
        "gap beside the contact": (Gap(poles, (0.2, 0.0, 0.0), ANY), None),
        "displacement inside": (Displacement((0.0, 0.0, 0.5), (0, 0, -1), ANY), None),
    }


def below_a_square(points, count=16):
    """Displacement of a half-space z < 0 under a pressure of 1e-3 on the square |x|, |y| < 1, away from it.

    Boussinesq's solution of a point force, summed over the square by Gauss's rule.

    Args:
        points: (3, n) float64 [m].
        count: points of the rule along a side.

    Returns:
        (3, n) float64 [m].
    """
    place, weight = np.polynomial.legendre.leggauss(count)
    force = 1e-3 * np.outer(weight, weight).ravel()
    at = np.stack(np.meshgrid(place, place)).reshape(2, -1)
    across, depth = points[:2, :, None] - at[:, None], -points[2][:, None]
    r = np.sqrt((across**2).sum(axis=0) + depth**2)
    nu, factor = PLAIN.poisson, (1 + PLAIN.poisson) / (2 * np.pi * PLAIN.young)
    sideways = across * (depth / r**3 - (1 - 2 * nu) / (r * (r + depth)))
    down = 2 * (1 - nu) / r + depth**2 / r**3
    return factor * np.stack([*(sideways @ force), -down @ force])


def square():
    """The same of a quarter of a half-space under a pressure on a square, moved as it is on the faces of a block."""
    size = 4
    cube = block((0, 0, -size), (size, size, 0), (size, size, size), 1)
    cube = cube.named("pressed", "top", where=lambda x: (x[:2] < 1 + 1e-9).all(axis=0))
    moved = [lambda points, k=k: below_a_square(points)[k] for k in range(3)]
    outside = [Dirichlet(f"block {side}", *moved) for side in ("right", "back", "bottom")]
    scene = Scene(
        name="square",
        mesh=root_mesh_from_shapes({"block": cube}),
        materials={"block": PLAIN},
        dirichlet=(*outside, SymmetryPlane("block left"), SymmetryPlane("block front")),
        tractions=(Pressure("block pressed", 1e-3),),
    )
    aside = np.array([2.0, 1.0, -0.5])
    middle = 8 / np.pi * np.log(1 + np.sqrt(2)) * 1e-3 * (1 - PLAIN.poisson**2) / PLAIN.young
    return scene, {
        "displacement in the middle": (Displacement((0, 0, 0), (0, 0, -1), ANY), middle),
        "displacement aside": (Displacement(tuple(aside), (0, 0, -1), ANY), -below_a_square(aside[:, None])[2, 0]),
    }


def layers():
    """The same of two layers in plane strain, pressed in the middle: the upper one recedes to there."""
    upper = block((0, 0, 0), (6, 1, 1), (6, 1, 1), 1).named("pressed", "top", where=lambda x: x[0] < 1 + 1e-9)
    bodies = {"lower": block((0, 0, -2), (6, 1, 0), (6, 1, 2), 1), "upper": upper}
    planes = [SymmetryPlane(f"{body} {side}") for body in bodies for side in ("left", "front")]
    scene = Scene(
        name="receding layers",
        mesh=root_mesh_from_shapes(bodies),
        materials=dict.fromkeys(bodies, PLAIN),
        dirichlet=(Dirichlet("lower bottom", z=0.0), *(Dirichlet(f"{body} back", y=0.0) for body in bodies), *planes),
        tractions=(Pressure("upper pressed", 1e-3),),
        contact=(ContactPair("lower top", "upper bottom", direction=(0, 0, 1)),),
    )
    pair = scene.contact[0].name
    return scene, {
        "gap at the rim": (Gap(pair, (6, 0, 0), ANY), None),
        "gap half way": (Gap(pair, (3, 0, 0), ANY), None),
        "largest pressure": (MaxPressure(pair, ANY), None),
    }


def line():
    """The same of two parallel cylinders."""
    scene = cylinders(order=6)
    return scene, {"largest pressure": (MaxPressure(scene.contact[0].name, ANY), None)}


def punch():
    """The same of a punch with a rounded edge."""
    scene = rounded_punch()
    return scene, {"largest pressure": (MaxPressure(scene.contact[0].name, ANY), LARGEST_PRESSURE)}


SCENES = {"hertz": spheres, "square": square, "receding layers": layers, "line contact": line, "rounded punch": punch}


def known_values(scene, goals, known):
    """Known values, those that are None of a finer solution."""
    if None not in known:
        return known
    finer = solve(scene, FINER, goals=goals).record.goals
    return [goal.value if value is None else value for goal, value in zip(finer, known)]


def figures(scene_name, degree):
    """Rows of a scene: each mesh, each goal."""
    scene, goals = SCENES[scene_name]()
    asked = tuple(goal for goal, _ in goals.values())
    known = [value for _, value in goals.values()]
    known = known_values(scene, asked, known)
    for tolerance in TOLERANCES:
        record = solve(scene, tolerance, degree=degree, goals=asked).record
        for name, goal, value in zip(goals, record.goals, known):
            true = abs(goal.value - value)
            yield {
                "scene": scene_name,
                "goal": name,
                "degree": degree,
                "cells": record.cells,
                "dofs": record.dofs,
                "closed": record.active_pairs,
                "value": goal.value,
                "known": value,
                "estimated": goal.error,
                "true": true,
                "effectivity": None if goal.error is None else goal.error / true,
            }


def asked(name, what, energy, tolerances):
    """Rows of a goal held to tolerances of its own."""
    scene, goals = SCENES[name]()
    goal, known = goals[what]
    (known,) = known_values(scene, (goal,), [known])
    for tolerance in tolerances:
        record = solve(scene, energy, goals=(replace(goal, tolerance=tolerance),)).record
        value, error = record.goals[0].value, record.goals[0].error
        yield {
            "scene": name,
            "goal": what,
            "asked": tolerance,
            "steps": record.step + 1,
            "dofs": record.dofs,
            "estimated": error / value,
            "true": abs(value / known - 1),
        }


def main():
    """Run the scenes and write the tables."""
    parser = options(__doc__, "goals")
    parser.add_argument("--only", default="", help="scenes with this word in their name")
    parser.add_argument(
        "--degree", type=int, choices=(1, 2), nargs=1, default=(2, 1), help="of the displacements (both)"
    )
    given = parser.parse_args()
    cases = [(name, degree) for name in SCENES for degree in given.degree if given.only in name]
    cases = [(name, degree) for name, degree in cases if degree == 2 or name not in QUADRATIC]
    tabulate((row for case in cases for row in figures(*case)), given.output / "table.csv")
    if 2 in given.degree:
        goals = [case for case in ASKED if given.only in case[0]]
        tabulate((row for case in goals for row in asked(*case)), given.output / "asked.csv")


if __name__ == "__main__":
    main()
