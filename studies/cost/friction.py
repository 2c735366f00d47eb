"""Linear solves and iterations of load steps with friction, and by what its constants are chosen.

    ./with-dolfinx python3 -m studies.cost.friction    # ten minutes

Half of a ball is pressed on a rigid plane, then moved along it forth, further and back; columns have these four load
steps on their last mesh, "frictionless" the first one without friction.  "as it is" has the constants of the program:
_FALL, the factor of the tolerances, from the loose one on; _DEPTH of Anderson's method, 0: none; "kept": the
preconditioner changes in solves to the tight tolerance alone.
"""

from unittest import mock

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    RigidPlane,
    Scene,
    SymmetryPlane,
    adapt,
    ball,
    increments,
    root_mesh_from_shapes,
)
from fx_contact.contact.contact_system import ContactSystem
from fx_contact.law import active_set, friction
from studies.tables import options, tabulate

#: Coefficients of friction, Poisson's ratios, degrees, tolerances.
CASES = (0.3, 0.3, 2, 0.02), (1.0, 0.3, 2, 0.02), (0.3, 0.0, 2, 0.02), (1.0, 0.0, 2, 0.02), (0.6, 0.3, 1, 0.1)
#: Displacements along the plane [m].
SHIFTS = 0.0, 4e-4, 8e-4, -4e-4
MODEL = {"allow": ("large strain", "large rotation")}


def scene(shift, mu, poisson):
    """The ball, R = 1, E = 1, pressed by 0.01 R."""
    top = ball(1.0, 2, 3, 2).placed(lambda x: (x[0], -x[1], 1.0 - x[2]))
    held = Dirichlet("ball z = 0", 0.0, shift, -0.01), SymmetryPlane("ball x = 0")
    contact = ContactPair("ball outside", RigidPlane((0, 0, 0), (0, 0, 1)), friction=mu)
    return Scene("ball", root_mesh_from_shapes({"ball": top}), {"ball": Material(1.0, poisson)}, held, contact)


def variants():
    """Changes of the program by name."""
    disturbs, of = ContactSystem._disturbs, mock.patch.object
    solves = ContactSystem.solve

    def solve(system, springs, u, tolerance, anew=False):
        with of(ContactSystem, "_disturbs", lambda *given: tolerance <= 1e-8 and disturbs(*given)):
            return solves(system, springs, u, tolerance, anew)

    yield "as it is", of(friction, "_DEPTH", friction._DEPTH)
    for fall in (1e-5, 0.1, 0.03):
        yield f"_FALL = {fall:g}", of(active_set, "_FALL", fall)
    for depth in (0, 1, 3):
        yield f"_DEPTH = {depth}", of(friction, "_DEPTH", depth)
    yield "kept", of(ContactSystem, "solve", solve)


def row(mu, poisson, degree, variant, records):
    """A row of the table."""
    each = [record.krylov_iterations for record in records]
    about = {"mu": mu, "nu": poisson, "degree": degree, "variant": variant, "dofs": records[-1].dofs}
    return about | {
        "solves": " ".join(str(len(its)) for its in each),
        "iterations": " ".join(str(sum(its)) for its in each),
    }


def measured():
    """Rows of the table."""
    for mu, poisson, degree, tolerance in CASES:
        how = {"degree": degree, "max_steps": 5} | MODEL
        record = adapt(scene(0.0, 0.0, poisson), tolerance, **how).last_step().record
        yield row(mu, poisson, degree, "frictionless", [record])
        for name, change in variants():
            with change:
                path = increments(lambda shift: scene(shift, mu, poisson), SHIFTS, tolerance, **how)
                yield row(mu, poisson, degree, name, [point.record.record for point in path])


def main():
    """Measure; print the table and keep it."""
    given = options(__doc__, "cost").parse_args()
    tabulate(measured(), given.output / "friction.csv")


if __name__ == "__main__":
    main()
