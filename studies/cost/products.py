"""Products of the stiffness at degree 2 with a vector: assembled, and cell by cell.

    python3 -m studies.cost.products

Curved cells, those of Hertz, and cells with an affine map, those of the indentation, on one rank.  CPU seconds are
medians, the products in turn.
"""

import time

import numpy as np

from fx_contact import solve
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.sum_factorisation import matrix_free
from fx_contact.scenes import hertz, indentation
from studies.tables import options, tabulate

REPETITIONS = 40
#: Name -> scene and tolerance.
CASES = {"curved": (hertz(displacement=0.005), 0.007), "affine": (indentation(), 0.02)}
KINDS = {"assembled": Elasticity.stiffness, "cell by cell": matrix_free}


def seconds(mat, x, y):
    """CPU seconds of one product y = A x."""
    start = time.process_time()
    mat.mult(x, y)
    return time.process_time() - start


def measured():
    """Rows of the table."""
    for name, (scene, tolerance) in CASES.items():
        step = solve(scene, tolerance)
        supports = find_supports(scene, step.forest, step.elasticity.prolongation)
        mats = {kind: make(step.elasticity, step.rows, supports=supports).mat for kind, make in KINDS.items()}
        for mat in mats.values():
            mat.assemble()
        vectors = {kind: mat.createVecs() for kind, mat in mats.items()}
        for x, _ in vectors.values():
            x.array[:] = np.sin(np.arange(x.getLocalSize()))
        spent = [[seconds(mat, *vectors[kind]) for kind, mat in mats.items()] for _ in range(REPETITIONS)]
        for kind, median in zip(mats, np.median(spent, axis=0)):
            yield {
                "cells": name,
                "dofs": step.record.dofs,
                "product": kind,
                "ns_a_dof": 1e9 * median / step.record.dofs,
            }


def main():
    """Measure; print the table and keep it."""
    tabulate(measured(), options(__doc__, "cost").parse_args().output / "products.csv")


if __name__ == "__main__":
    main()
