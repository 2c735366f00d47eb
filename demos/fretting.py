"""Fretting of two like balls with friction, each with a mesh of its own, against Cattaneo and Mindlin's solution.

Half-balls are pressed together, then the upper one is moved along y: mpirun -n 2 python3 demos/fretting.py
"""

import argparse

from common import COMM, Report, parse, parser, path_settings, plain_errors
from mindlin_solution import Mindlin, compared, deviations, draw_traction, table_of

from fx_contact import (
    CheckpointError,
    ContactPair,
    Dirichlet,
    Material,
    Scene,
    SceneError,
    SymmetryPlane,
    ball,
    increments,
    root_mesh_from_shapes,
)
from fx_contact.plot import draw_contact
from fx_contact.results import write_fields

MATERIAL = Material(young=1.0, poisson=0.0)  # at which the solution is exact
#: Load steps: pressed up to 1, then moved up to 2.
TIMES = (0.5, 1.0, 1.25, 1.5, 1.75, 2.0)

options = parser(__doc__, tolerance=0.1, order=3, coarse=2, output="results/fretting")
options.set_defaults(poisson=MATERIAL.poisson)
options.add_argument("--friction", type=float, default=0.5, help="coefficient (%(default)s)")
options.add_argument("--approach", type=float, default=0.02, help="of the flat faces, radius 1 (%(default)s)")
options.add_argument("--displacement", type=float, default=0.01, help="tangential (%(default)s)")


def fretting(
    shift=0.01, approach=0.02, friction=0.5, material: Material = MATERIAL, order: int = 3, n: int = 2
) -> Scene:
    """The parts x >= 0 of two half-balls that touch at the origin."""
    upper = ball(1.0, n, order, octants=2).placed(lambda x: (x[0], -x[1], 1.0 - x[2]))
    lower = ball(1.0, n + 1, order, octants=2).shifted(z=-1.0)
    held = Dirichlet("upper z = 0", 0.0, shift, -approach), Dirichlet("lower z = 0", 0.0, 0.0, 0.0)
    return Scene(
        name="fretting",
        mesh=root_mesh_from_shapes({"upper": upper, "lower": lower}),
        materials={"upper": material, "lower": material},
        dirichlet=(*held, SymmetryPlane("upper x = 0"), SymmetryPlane("lower x = 0")),
        contact=ContactPair("upper outside", "lower outside", friction=friction),
        symmetry=2,
        contact_centre=(0.0, 0.0, 0.0),
    )


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare with Mindlin at the found forces."""
    material = Material(given.young, given.poisson)

    def moved(time: float) -> Scene:
        """The scene of a load step."""
        shift, approach = max(0.0, time - 1) * given.displacement, min(1.0, time) * given.approach
        return fretting(shift, approach, given.friction, material, given.order, given.coarse)

    if not given.friction > 0:
        raise SceneError(f"fretting needs a positive --friction, got {given.friction:g}")
    path = increments(moved, TIMES, **path_settings(given, moved(2.0)))
    report, rows = Report(given, path), []
    if len(path.records) == len(TIMES):
        raise CheckpointError("all load steps are solved: run without --restart")
    for point in path:
        report.add(point)
        if point.value > 1:
            rows.append(compared(path, point.step, given.displacement, given.friction, material))
    if not given.records_only:
        with point.step.stages("output"):
            write_fields(point.step, given.output)
            draw_contact(point.step, given.output / "status.png", "status")
            known = Mindlin.of(point.step.record, given.friction, material)
            draw_traction(point.step, known, given.output / "traction.png")
    report.end(point, "status.png, traction.png", errors=deviations(rows[-1]), lines=[*table_of(rows)])


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
