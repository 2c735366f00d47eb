"""A stiff cube (E = 100 Pa) pressed into a soft block (E = 1 Pa): affine cells, a singularity.

The mesh is refined along the edges of the cube's footprint, where the stress is singular. The standard
benchmark models all four quarters at a tolerance of 6 %:

    mpirun -n 2 python3 demos/indentation.py --symmetry full --tolerance 0.06
"""

import argparse

from common import COMM, Report, parse, parser, plain_errors, settings

from fx_contact import Material, adapt
from fx_contact.plot import draw_mesh, draw_stress
from fx_contact.results import true_error, write_fields
from fx_contact.scenes import indentation

options = parser(__doc__, tolerance=0.1, order=1, coarse=4, output="results/indentation", symmetric=True)
options.add_argument("--displacement", type=float, default=0.01, help="of the cube's top (%(default)s)")
options.add_argument("--ratio", type=float, default=100.0, help="of the cube's to the block's modulus (%(default)s)")


def main(given: argparse.Namespace) -> None:
    """Solve, write fields and pictures."""
    scene = indentation(
        displacement=given.displacement,
        block=Material(young=given.young, poisson=given.poisson),
        cube=Material(young=given.ratio * given.young, poisson=given.poisson),
        order=given.order,
        coarse=given.coarse,
        symmetry=given.symmetry,
    )
    asked = settings(given, scene)
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
    report.end(step, "mesh.png, stress.png", true=true)


if __name__ == "__main__":
    with plain_errors(COMM):
        main(parse(options))
