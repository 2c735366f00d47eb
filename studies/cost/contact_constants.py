"""What the constants of the contact solver are chosen by: PCG iterations of four scenes, for several values of each.

    python3 -m studies.cost.contact_constants    # three minutes

Displacements have degree 1.  `HELD`: factor of the springs in the matrix across rows that a projection constrains.
`STIFF`: a penalty of some factor, its springs in the matrix (STIFF above it) or its closed rows constrained (below).
`relaxation`: iterations with block Jacobi on the first guess, not counted here, times updates of the active set by it.
"""

import argparse
from contextlib import contextmanager
from pathlib import Path

from fx_contact import Enforcement, adapt
from fx_contact.contact import constraint_rows, enforcement, initial_guess
from fx_contact.scenes import cylinders, hertz, indentation, shrink_fit
from studies.tables import plain, write

#: Scenes and their tolerances.
SCENES = {"hertz": (hertz, 0.08), "shrink_fit": (shrink_fit, 0.15), "cylinders": (cylinders, 0.15)}
SCENES |= {"indentation": (indentation, 0.12)}


@contextmanager
def replaced(module, **values):
    """A module with other values of some of its names."""
    before = {name: getattr(module, name) for name in values}
    vars(module).update(values)
    try:
        yield
    finally:
        vars(module).update(before)


def row(constant, value, enforced=None):
    """A row of the table: iterations of each scene, and of all."""
    count = {}
    for name, (make, tolerance) in SCENES.items():
        steps = adapt(make(), tolerance, degree=1, enforcement=enforced or Enforcement())
        count[name] = sum(sum(step.record.krylov_iterations) for step in steps)
    return {"constant": constant, "value": value, **count, "all": sum(count.values())}


def measured():
    """Rows of the table."""
    for factor in (1.0, 3.0, 10.0, 30.0, 100.0):
        with replaced(enforcement, HELD=factor):
            yield row("HELD", f"{factor:g}")
    for factor in (30.0, 100.0, 200.0, 500.0):
        for stiff, where in ((1e9, "in the matrix"), (1e-9, "constrained")):
            with replaced(constraint_rows, STIFF=stiff):
                yield row("STIFF", f"penalty {factor:g} {where}", Enforcement("penalty", factor))
    for iterations, updates in ((0, 0), (5, 5), (15, 1), (15, 5), (45, 5)):
        with replaced(initial_guess, _RELAXATION=iterations, _LOOKS=updates):
            yield row("relaxation", f"{iterations} x {updates}")


def main():
    """Measure; print the table and keep it."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rows = list(measured())
    write(Path("results/cost/contact_constants.csv"), rows, "python3 -m studies.cost.contact_constants")
    print(plain(rows))


if __name__ == "__main__":
    main()
