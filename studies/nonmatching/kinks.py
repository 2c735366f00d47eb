"""Kinks between root facets: nodal pressures of a press fit, and the model warning.

    python3 -m studies.nonmatching.kinks    # a minute

Rings of unlike cells, in plane strain; pressures are compared with Lame's.  It leaves kinks.csv in results/nonmatching.
"""

from itertools import product

import numpy as np

from fx_contact import ContactPair, Material, Scene, SymmetryPlane, ring, root_mesh_from_shapes, solve
from studies.tables import options, tabulate

YOUNG, INTERFERENCE = 210e3, 0.01
INNER, BETWEEN, OUTER, HEIGHT = 10.0, 15.0, 20.0, 4.0
ORDERS, CELLS = (2, 3, 4, 6), ((9, 8), (5, 4), (3, 2))


def press_fit(order: int, cells: tuple[int, int]) -> Scene:
    """A quarter of two rings with so many root cells around, without lateral contraction."""
    shapes = {
        "inner": ring(INNER, BETWEEN, HEIGHT, (2, cells[0], 1), order, quarters=1),
        "outer": ring(BETWEEN, OUTER, HEIGHT, (2, cells[1], 1), order, quarters=1),
    }
    held = [SymmetryPlane(f"{name} {side}") for name in shapes for side in ("x = 0", "y = 0", "bottom", "top")]
    pair = ContactPair("inner outside", "outer inside", clearance=-INTERFERENCE)
    materials = dict.fromkeys(shapes, Material(YOUNG, 0.0))
    return Scene("press fit", root_mesh_from_shapes(shapes), materials, tuple(held), pair)


def exact() -> float:
    """Lame's pressure."""
    inside, between, outside = INNER**2, BETWEEN**2, OUTER**2
    soft = (outside + between) / (outside - between) + (between + inside) / (between - inside)
    return INTERFERENCE * YOUNG / BETWEEN / soft


def measured(order: int, cells: tuple[int, int]) -> dict[str, object]:
    """A row of the table."""
    step = solve(press_fit(order, cells), 0.03, max_steps=3)
    contact, record = step.contact, step.record
    pressure = contact.pressure[contact.active] / exact() - 1
    stated = [doubt.value for doubt in record.doubts if doubt.kind == "kinks"]
    row = {"order": order, "inner": cells[0], "outer": cells[1], "dofs": record.dofs, "estimate": record.estimate}
    row |= {"force": contact.force.sum() / (exact() * np.pi / 2 * BETWEEN * HEIGHT) - 1}
    return row | {"least": pressure.min(), "largest": pressure.max(), "stated": stated[0] if stated else None}


def main() -> None:
    """Measure; print the table and keep it."""
    rows = (measured(order, cells) for order, cells in product(ORDERS, CELLS))
    tabulate(rows, options(__doc__, "nonmatching").parse_args().output / "kinks.csv")


if __name__ == "__main__":
    main()
