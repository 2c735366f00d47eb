"""The patch test of contact: two columns of different materials end to end, on a mesh with hanging nodes.

The exact pressure p is uniform. Exact enforcement reproduces it; a penalty k_A = c E*/h gives a penetration p/k_A,
which is larger on larger facets, so that the pressure is not uniform.

    mpirun -n 2 python3 demos/patch.py --penalty 1e4
"""

import argparse

import numpy as np
from common import COMM, Report, parse, parser, plain_errors, settings
from mpi4py import MPI

from fx_contact import Beginning, Material, Scene, Step, adapt
from fx_contact.plot import draw_mesh, draw_stress
from fx_contact.results import true_error, write_fields
from fx_contact.scenes import patch

LOWER, UPPER = Material(young=1.0, poisson=0.3), Material(young=3.0, poisson=0.2)
DISPLACEMENT = 0.01
PRESSURE = DISPLACEMENT / (1 / LOWER.young + 1 / UPPER.young)

options = parser(__doc__, tolerance=0.04, order=1, coarse=2, output="results/patch")


def refined_around_axis(scene: Scene) -> Beginning:
    """The leaves around the axis refined where the columns meet, twice."""
    forest = Beginning.uniform(scene, 0, COMM).forest
    for reach in (0.4, 0.2):
        forest, _ = forest.refined(np.linalg.norm(forest.centres - [0, 0, 1], axis=1) < reach)
    return Beginning.at_rest(forest)


def deviations(step: Step) -> dict[str, float]:
    """Deviations from the exact solution: of the force, and of the pressure in the L2 norm over the surface."""
    off, area = step.contact.pressure - PRESSURE, step.rows.area
    total, whole = COMM.allreduce(np.array([area @ off**2, area.sum()]), op=MPI.SUM)
    return {"force": step.record.force / PRESSURE - 1, "pressure": float(np.sqrt(total / whole) / PRESSURE)}


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures, compare with the exact solution; `--young` and `--poisson` have no effect."""
    half = given.coarse
    scene = patch(LOWER, UPPER, DISPLACEMENT, given.order, (half, half, 2 * half))
    asked = settings(given, scene)
    if not given.restart:
        asked["beginning"] = refined_around_axis(scene)
    run = adapt(scene, **asked)  # checks its arguments before the report replaces an old one
    report = Report(given, asked["restart"])
    for step in run:
        report.add(step)

    if not given.records_only:
        with step.stages("output"):
            write_fields(step, given.output)
            draw_mesh(step, given.output / "mesh.png")
            draw_stress(step, given.output / "stress.png")
    true = true_error(step, given.true_error) if given.true_error else None
    report.end(step, "mesh.png, stress.png", errors=deviations(step), true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
