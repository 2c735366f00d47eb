"""Thin rings in a stack below a bolt's head: time of surfaces meshed apart over that of meshes alike.

    python3 -m studies.cost.chains           # two minutes
    python3 -m studies.cost.chains --gram    # factors of the Gram matrix of rows, in iterations that they replace

The second table has plates on each other, all of whose rows are closed, and median times.
"""

from statistics import median
from time import process_time

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    Scene,
    SymmetryPlane,
    adapt,
    block,
    ring,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.contact import gram, projection
from studies.tables import options, tabulate

STEEL, FORCE = Material(210e3, 0.3), 1000.0
COUNTS, CELLS = (3, 5, 10, 20), (8, 16, 32, 64)


def chain(count, cells=(4, 3, 5), head=False):
    """A quarter of rings of 1 by 7, with numbers of cells around that repeat, below a pressure or a head."""
    shapes = {
        f"ring {number}": ring(5, 12, 1, (2, cells[number % len(cells)], 1), quarters=1).shifted(z=number)
        for number in range(count)
    }
    names, radius = list(shapes), 8.5 if head else 12
    if head:
        shapes["head"] = ring(5, radius, 5, (1, 4, 1), quarters=1).shifted(z=count)
        names.append("head")
    held = [SymmetryPlane(f"{name} {side}") for name in shapes for side in ("x = 0", "y = 0")]
    contacts = tuple(ContactPair(f"{below} top", f"{above} bottom") for below, above in zip(names, names[1:]))
    load = Pressure(f"{names[-1]} top", FORCE / (np.pi * (radius**2 - 5**2) / 4))
    conditions = (Dirichlet("ring 0 bottom", z=0.0), *held)
    materials = dict.fromkeys(shapes, STEEL)
    return Scene("chain", root_mesh_from_shapes(shapes), materials, conditions, contacts, load)


def measured(count, apart, tolerance=0.15):
    """A row of the table."""
    start = process_time()
    records = [step.record for step in adapt(chain(count, (4, 3, 5) if apart else (4,), head=True), tolerance)]
    seconds = process_time() - start
    return {
        "rings": count,
        "meshes": "apart" if apart else "alike",
        "steps": len(records),
        "dofs": records[-1].dofs,
        "solves": sum(len(record.krylov_iterations) for record in records),
        "iterations": sum(sum(record.krylov_iterations) for record in records),
        "off": max(abs(force / FORCE - 1) for force in records[-1].pair_forces),
        "cpu_s": seconds,
        "us_a_dof": 1e6 * seconds / sum(record.dofs for record in records),
    }


def factors(cells):
    """Time of factors of the Gram matrix, and of its iterations."""
    shapes = {"lower": block((0, 0, 0), (1, 1, 0.1), (cells, cells, 1), 1)}
    shapes["upper"] = block((0, 0, 0.1), (1, 1, 0.2), (3 * cells // 4, 3 * cells // 4, 1), 1)
    held = [SymmetryPlane(f"{name} {side}") for name in shapes for side in ("left", "front")]
    conditions = (Dirichlet("lower bottom", z=0.0), *held)
    contact, load = ContactPair("lower top", "upper bottom"), Pressure("upper top", 0.01)
    materials = dict.fromkeys(shapes, Material(1.0, 0.3))
    scene = Scene("plates", root_mesh_from_shapes(shapes), materials, conditions, contact, load)
    found = []

    class Measured(gram.Gram):
        """Gram matrices that tell their times."""

        def solve(self, values):
            """As `Gram.solve`."""
            if self.closed.any() and len(found) < 5:
                spent, start = self._spent, process_time()
                super().solve(values)
                middle = process_time()
                one = (middle - start) / max(self._spent - spent, 1)
                self._factorise()
                found.append((int(self.closed.sum()), one, process_time() - middle))
                self._close(self.closed)
            return super().solve(values)

    kept = gram.Gram
    projection.Gram = Measured
    try:
        solve(scene, 0.9, max_steps=1)
    finally:
        projection.Gram = kept
    one, made = (median(row[column] for row in found) for column in (1, 2))
    return {"rows": found[0][0], "iteration_ms": 1e3 * one, "factors_ms": 1e3 * made, "ratio": made / one}


def main():
    """Measure; print the table, and keep that of one rank."""
    parser = options(__doc__, "cost")
    parser.add_argument("--gram", action="store_true", help="factors of the Gram matrix instead")
    given = parser.parse_args()
    if given.gram:
        tabulate(map(factors, CELLS), given.output / "gram.csv")
        return
    rows = (measured(count, apart) for count in COUNTS for apart in (False, True))
    tabulate(rows, given.output / "chains.csv")


if __name__ == "__main__":
    main()
