"""Effectivity of the error estimate on first meshes of degree 2, by which a run may end there.

Columns of one root cell a body between clamped ends, and scenes of the stress matrix: those whose first mesh
would be enough if the effectivity were 1, for energy and contact. The reference is the solution on this mesh with all
cells refined, with its own estimate added in squares. Left out are uniform stresses, which have no error.

    python3 -m studies.effectivity.first_mesh [--only WORD]    # a minute

It leaves first_mesh.csv in results/effectivity.
"""

import numpy as np
from mpi4py import MPI

from fx_contact import ErrorControl, Material, adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.results.accuracy import energy_distance
from fx_contact.scenes import stack
from studies.stability.scenes import cases
from studies.stability.shapes import all_held, clamped
from studies.tables import options, tabulate

#: Axes of the matrix with the lowest effectivities.
AXES = ("bodies",)
#: The least relative error that is one, far above rounding.
LEAST = 1e-5


def columns():
    """(name, scene, tolerance) of two blocks, one on the other, between clamped ends."""
    for poisson in (0.3, 0.39, 0.45, 0.49):
        for height in (0.1, 1.0, 5.0):
            bodies = [Material(1.0, poisson), Material(3.0, poisson)]
            scene = clamped(stack(bodies, cells=(1, 1, 1), height=height))
            name = f"column, height {height:g}, nu = {poisson:g}"
            yield name, scene, 0.5
            yield f"{name}, held sideways", all_held(scene), 0.5


def of_the_matrix():
    """The same of scenes of the stress matrix."""
    for name, case in cases().items():
        if case.axis in AXES:
            yield name, case.scene(), case.tolerance


def measured(name, scene, tolerance):
    """The row of a first mesh and its true error; None if the mesh is not enough or has no error."""
    how = {"degree": 2, "max_steps": 1, "control": ErrorControl(least_effectivity=1.0)}
    (step,) = adapt(scene, tolerance, MPI.COMM_SELF, **how)
    missed = step.record.ratio > 1 or step.contact_error.leaves
    if missed or step.record.estimate < LEAST:
        return None
    beginning = Beginning.after(step, np.ones(len(step.forest), dtype=bool))
    (finer,) = adapt(scene, tolerance, MPI.COMM_SELF, beginning=beginning, **how)
    true = float(np.hypot(energy_distance(finer, finer.carried), finer.record.estimate))
    poisson = max(material.poisson for material in scene.materials.values())
    row = {"scene": name, "poisson": poisson, "cells": step.record.cells, "tolerance": tolerance}
    estimate = step.record.estimate
    return row | {"estimate": estimate, "true_error": true, "effectivity": estimate / true}


def main():
    """Measure and write the table."""
    parser = options(__doc__, "effectivity")
    parser.add_argument("--only", default="", help="scenes with this word in their name")
    given = parser.parse_args()
    rows = (measured(*what) for what in (*columns(), *of_the_matrix()) if given.only in what[0])
    tabulate(filter(None, rows), given.output / "first_mesh.csv")


if __name__ == "__main__":
    main()
