"""Iterations of PCG and of the Gram system of mortar rows, by the weight of the second surface in the projection.

    python3 -m studies.nonmatching.weights    # four minutes

Two cubes with n x n and m x m facets at their contact are pressed together.  The lower one has the rows, as the finer
one, or in spite of being the stiffer one.  Matching meshes have pairs of nodes, whatever the weight.  It leaves
weights.csv in results/nonmatching.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from fx_contact import ContactPair, Dirichlet, Material, Pressure, Scene, Solver, adapt, block, root_mesh_from_shapes
from fx_contact.contact.mortar_rows import MortarRows
from fx_contact.contact.projection import Projection
from fx_contact.parallel.arrays import FloatArray
from fx_contact.surfaces import nonmatching
from studies.tables import plain, write

MESHES = (4, 4), (3, 4), (8, 8), (6, 8), (2, 8)
#: Modulus of the lower body over that of the upper one.
MODULI = 1e-6, 0.1, 0.5, 1.0, 2.0, 10.0
WEIGHTS = 1.0, 4.0, 8.0, 16.0, 64.0


def cubes(upper: int, lower: int, modulus: float) -> Scene:
    """Two unit cubes below a pressure, free sideways."""
    bodies = {
        "upper": block((0, 0, 1), (1, 1, 2), (upper, upper, 2), 1),
        "lower": block((0, 0, 0), (1, 1, 1), (lower, lower, 1), 1),
    }
    held = (
        Dirichlet(f"{body} {side}", **{axis: 0.0})
        for body in bodies
        for side, axis in (("left", "x"), ("front", "y"))
    )
    return Scene(
        name="cubes",
        mesh=root_mesh_from_shapes(bodies),
        materials={"upper": Material(1.0, 0.3), "lower": Material(modulus, 0.3)},
        dirichlet=(Dirichlet("lower bottom", z=0.0), *held),
        contact=(ContactPair("lower top", "upper bottom"),),
        tractions=(Pressure("upper top", 0.01 * min(1.0, modulus)),),
    )


def counted(scene: Scene, weight: float) -> tuple[int, int]:
    """Iterations of the last linear solve, and the most of a Gram system."""
    counts, product = [0], Projection._gram_times

    def times(self: Projection, values: FloatArray) -> FloatArray:
        counts[-1] += 1
        return product(self, values)

    solve_gram = Projection._solve_gram

    def solve(self: Projection, values: FloatArray) -> FloatArray:
        counts.append(0)
        return solve_gram(self, values)

    # Rows are on the lower surface, whatever the moduli are.
    with patch.object(Projection, "_gram_times", times), patch.object(Projection, "_solve_gram", solve):
        with patch.object(MortarRows, "FOLLOWED", weight), patch.object(nonmatching, "_ALIKE", np.inf):
            step = next(adapt(replace(scene, name="cubes"), 0.9, solver=Solver(tolerance=1e-8)))
    return step.record.krylov_iterations[-1], max(counts)


def main() -> None:
    """All cases; print the table and keep it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("results/nonmatching"))
    arguments, rows = parser.parse_args(), []
    for upper, lower in MESHES:
        for modulus in MODULI:
            for weight in WEIGHTS if upper != lower else WEIGHTS[:1]:
                krylov, gram = counted(cubes(upper, lower, modulus), weight)
                row = {"upper": upper, "lower": lower, "modulus": modulus, "weight": weight}
                rows.append(row | {"krylov": krylov, "gram": gram})
    write(arguments.output / "weights.csv", rows)
    print(plain(rows))


if __name__ == "__main__":
    main()
