"""Products of the stiffness at degree 2 with a vector: storage of blocks, and PETSc's loop against ours.

    python3 -m studies.cost.products

Curved cells, those of Hertz at 1 %, on one rank.  CPU seconds are medians, the loops in turn.
"""

import time
from unittest import mock

import numpy as np

from fx_contact import solve
from fx_contact.fem.dirichlet import find_supports
from fx_contact.linalg import matrix
from fx_contact.scenes import hertz
from studies.tables import options, tabulate

REPETITIONS = 40


def stiffness(step, symmetric):
    """The matrix of a step, assembled."""
    elasticity = step.elasticity
    supports = find_supports(step.scene, step.forest, elasticity.prolongation)
    mat = elasticity.stiffness(step.rows, symmetric, supports=supports).mat
    mat.assemble()
    return mat


def seconds(mat, x, y):
    """CPU seconds of one product y = A x."""
    start = time.process_time()
    mat.mult(x, y)
    return time.process_time() - start


def measured():
    """Rows of the table."""
    step = solve(hertz(displacement=0.005), 0.01)
    mats = {("BAIJ", "PETSc"): stiffness(step, False), ("SBAIJ", "ours"): stiffness(step, True)}
    with mock.patch.object(matrix, "replace_product"):
        mats["SBAIJ", "PETSc"] = stiffness(step, True)
    vectors = {loop: mat.createVecs() for loop, mat in mats.items()}
    for x, _ in vectors.values():
        x.array[:] = np.sin(np.arange(x.getLocalSize()))
    spent = [[seconds(mat, *vectors[loop]) for loop, mat in mats.items()] for _ in range(REPETITIONS)]
    for (storage, loop), mat, median in zip(mats, mats.values(), np.median(spent, axis=0)):
        blocks = mat.getInfo()["nz_used"] / 9
        product = {"product_ms": 1e3 * median, "ns_a_stored_block": 1e9 * median / blocks}
        yield {"dofs": step.record.dofs, "storage": storage, "loop": loop, "stored_blocks": int(blocks)} | product


def main():
    """Measure; print the table and keep it."""
    tabulate(measured(), options(__doc__, "cost").parse_args().output / "products.csv")


if __name__ == "__main__":
    main()
