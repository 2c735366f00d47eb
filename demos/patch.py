"""The patch test of contact: two columns of different materials end to end, on a mesh with hanging nodes.

The exact pressure p is uniform. Exact enforcement reproduces it; a penalty k_A = c E*/h gives a penetration p/k_A,
which is larger on larger facets, so that the pressure is not uniform.

    mpirun -n 2 python3 demos/patch.py --penalty 1e4
"""

import numpy as np
from common import main, parser
from mpi4py import MPI

from fx_contact import Beginning, Material
from fx_contact.scenes import patch

LOWER, UPPER = Material(young=1.0, poisson=0.3), Material(young=3.0, poisson=0.2)
DISPLACEMENT = 0.01
PRESSURE = DISPLACEMENT / (1 / LOWER.young + 1 / UPPER.young)

options = parser(__doc__, tolerance=0.04, order=1, coarse=2, output="results/patch")


def scene(arguments, _material):
    """The two columns; their materials are fixed."""
    half = arguments.coarse
    return patch(LOWER, UPPER, DISPLACEMENT, order=arguments.order, cells=(half, half, 2 * half))


def beginning(_arguments, scene, comm):
    """The leaves around the axis refined where the columns meet, twice."""
    forest = Beginning.uniform(scene, 0, comm).forest
    for reach in (0.4, 0.2):
        forest, _ = forest.refined(np.linalg.norm(forest.centres - [0, 0, 1], axis=1) < reach)
    return Beginning.at_rest(forest)


def errors(_arguments, step):
    """Deviations from the exact solution: of the force, and of the pressure in the L2 norm over the surface."""
    pairs = step.pairs
    off = step.contact.pressure - PRESSURE
    total, area = step.forest.comm.allreduce(np.array([pairs.area @ off**2, pairs.area.sum()]), op=MPI.SUM)
    return {"force": step.record.force / PRESSURE - 1, "pressure": float(np.sqrt(total / area) / PRESSURE)}


if __name__ == "__main__":
    main(options, scene, errors=errors, beginning=beginning)
