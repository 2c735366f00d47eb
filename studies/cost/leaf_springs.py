"""Leaf springs: linear solves for the active set, by the number of cells.

    python3 -m studies.cost.leaf_springs                # a quarter of an hour
    mpirun -n 2 python3 -m studies.cost.leaf_springs --cells 20

Plates 0.1 m long and 0.02 m wide lie on each other, clamped at one end.  A load or a displacement of the tip of the
uppermost bends them all.  The force of the first pair is compared with that of beams that touch at their tips.
"""

from itertools import product

from fx_contact import ContactPair, Dirichlet, Material, Scene, Traction, adapt, block, root_mesh_from_shapes
from studies.tables import options, tabulate

LENGTH, WIDTH, MODULUS = 0.1, 0.02, 210e9
CELLS = (10, 20, 40, 80, 160)


def leaf_springs(cells, plates=2, slenderness=50, loaded=True):
    """A scene of clamped plates, and the force of its first pair [N] by the theory of beams."""
    thick = LENGTH / slenderness
    tip = LENGTH / 100
    stiffness = MODULUS * WIDTH * (thick / LENGTH) ** 3 / 4
    load = plates * stiffness * tip
    names = [f"plate {number}" for number in range(plates)]
    bodies = {
        name: block((0, 0, -(i + 1) * thick), (LENGTH, WIDTH, -i * thick), (cells, 2, 1), 1)
        for i, name in enumerate(names)
    }
    conditions = tuple(Dirichlet(f"{name} left", 0.0, 0.0, 0.0) for name in names)
    moved = () if loaded else (Dirichlet("plate 0 right", z=-tip),)
    tractions = (Traction("plate 0 right", (0.0, 0.0, -load / (WIDTH * thick))),) if loaded else ()
    contact = tuple(ContactPair(f"{below} top", f"{above} bottom") for above, below in zip(names, names[1:]))
    materials = dict.fromkeys(names, Material(MODULUS, 0.0))
    mesh = root_mesh_from_shapes(bodies)
    return Scene("leaf springs", mesh, materials, conditions + moved, contact, tractions), load * (1 - 1 / plates)


def measured(cells, **options):
    """A row of the table."""
    scene, force = leaf_springs(cells, **options)
    (step,) = adapt(scene, 0.9, max_steps=1)
    record = step.record
    return {
        "plates": options["plates"],
        "slenderness": f"1:{options['slenderness']}",
        "bent_by": "load" if options["loaded"] else "displacement",
        "cells": cells,
        "dofs": record.dofs,
        "solves": len(record.krylov_iterations),
        "iterations": sum(record.krylov_iterations),
        "force": record.pair_forces[0] / force - 1,
        "cpu_s": record.cpu_seconds["solve"] + record.cpu_seconds["setup"],
    }


def main():
    """Measure; print the table, and keep that of one rank."""
    parser = options(__doc__, "cost")
    parser.add_argument("--cells", type=int, nargs="+", default=CELLS, help="along a plate (%(default)s)")
    given = parser.parse_args()
    cases = product((2, 5), (50, 200), (True, False), given.cells)
    rows = (measured(cells, plates=plates, slenderness=thin, loaded=loaded) for plates, thin, loaded, cells in cases)
    tabulate(rows, given.output / "leaf_springs.csv")


if __name__ == "__main__":
    main()
