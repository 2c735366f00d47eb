"""What the constants of the contact solver are chosen by: PCG iterations of four scenes, for several values of each.

    python3 -m studies.cost.contact_constants    # six minutes

`CAP`: factor of the penalty in the matrix of rows that a projection constrains.  "penalty": one of some factor,
in the matrix, or its closed rows constrained.  `relaxation`: iterations with block Jacobi on the first
guess, not counted here, times updates of the active set by it.  The last column has the floating-point operations of
PETSc in all of them, with PETSc's own product, which counts its.
"""

from contextlib import ExitStack
from unittest import mock

from petsc4py import PETSc

from fx_contact import Enforcement, ErrorControl, adapt
from fx_contact.contact import constraint_rows, enforcement
from fx_contact.law import initial_guess
from fx_contact.linalg import matrix
from fx_contact.scenes import cylinders, hertz, indentation, shrink_fit
from studies.tables import options, tabulate

#: Scenes, and their tolerances at degree 1 and 2.
SCENES = {
    "hertz": (hertz, 0.08, 0.02),
    "shrink_fit": (shrink_fit, 0.15, 0.05),
    "cylinders": (cylinders, 0.15, 0.05),
    "indentation": (indentation, 0.12, 0.08),
}


def capped(factor):
    """Another `CAP`."""
    stack = ExitStack()
    for module in (enforcement, constraint_rows):
        stack.enter_context(mock.patch.object(module, "CAP", factor))
    return stack


def row(degree, constant, value, enforced=None):
    """A row of the table: iterations of each scene, and of all."""
    count, before = {}, PETSc.Log.getFlops()
    for name, (make, *tolerances) in SCENES.items():
        how = {"degree": degree, "enforcement": enforced or Enforcement(), "control": ErrorControl("energy")}
        with mock.patch.object(matrix, "replace_product"):
            steps = list(adapt(make(), tolerances[degree - 1], **how))  # that judges no penalty
        count[name] = sum(sum(step.record.krylov_iterations) for step in steps)
    total = {"all": sum(count.values()), "gflop": (PETSc.Log.getFlops() - before) / 1e9}
    return {"degree": degree, "constant": constant, "value": value, **count, **total}


def measured(degree):
    """Rows of the table."""
    for factor in (1.0, 3.0, 10.0, 30.0, 100.0):
        with capped(factor):
            yield row(degree, "CAP", f"{factor:g}")
    for factor in (30.0, 100.0, 200.0, 500.0):
        penalty = Enforcement("penalty", factor)
        with capped(1e9):
            yield row(degree, "penalty", f"{factor:g} in the matrix", penalty)
        yield row(degree, "penalty", f"{factor:g} constrained", penalty)
    for iterations, updates in ((0, 0), (3, 5), (5, 5), (8, 5), (15, 1), (15, 5), (45, 5)):
        with mock.patch.multiple(initial_guess, _RELAXATION={degree: iterations}, _UPDATES=updates):
            yield row(degree, "relaxation", f"{iterations} x {updates}")


def main():
    """Measure; print the table and keep it."""
    given = options(__doc__, "cost").parse_args()
    tabulate((row for degree in (2, 1) for row in measured(degree)), given.output / "contact_constants.csv")


if __name__ == "__main__":
    main()
