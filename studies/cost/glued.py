"""What contact costs: the contact problem of every step against a linear one on the same mesh.

In the linear problem the active node pairs are glued: tied in all directions with the stiffness of a penalty. It has
the same unknowns (degree 1) and tolerance, and no active set. Both are assembled and solved from the same first guess,
in turns, several times; shown are medians of CPU seconds of all ranks.

    mpirun -n 2 python3 -m studies.cost.glued    # a minute

It leaves glued.csv in results/cost.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from demos.common import RankZeroParser, plain_errors  # first: it gives PETSc its options
from fx_contact import Enforcement, Solver, adapt
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.external_forces import load
from fx_contact.forest.partition import KINDS
from fx_contact.law.contact_solver import solve_contact
from fx_contact.scenes import hertz, indentation
from studies.tables import plain, write

SCENES = {"hertz": hertz, "indentation": indentation}
#: The stages of assembly and solution; compilation is not among them.
STAGES = ("assemble", "system", "setup", "solve")


def with_contact(step, forces, supports):
    """Assemble and solve the contact problem of a step."""
    elasticity, stages = step.elasticity, step.stages
    with stages("assemble"):
        pairs = create_rows(step.scene, elasticity.prolongation, Enforcement())
        matrix = elasticity.stiffness(pairs, supports=supports)
    problem = ContactProblem(matrix, forces, supports, elasticity.energy_norm, pairs, step.scene)
    solve_contact(problem, step.start, SolveOptions(Solver()), stages)


def glued(step, forces, supports):
    """Assemble and solve the same with the closed pairs glued."""
    elasticity, stages = step.elasticity, step.stages
    pairs = create_rows(step.scene, elasticity.prolongation, Enforcement("penalty"))
    with stages("assemble"):
        matrix = elasticity.stiffness(pairs, supports=supports)
        reserve(matrix.mat, Jump(pairs, supports))  # hypre's format wants every entry that has room
        for axis in np.eye(3):
            tie = replace(pairs, normal=np.broadcast_to(axis, (len(pairs), 3)), gap=np.zeros(len(pairs)))
            PenaltyTerm(Jump(tie, supports), step.solution.active * tie.stiffness).add_to(matrix.mat)
    problem = ContactProblem(matrix, forces, supports, elasticity.energy_norm)
    solve_contact(problem, step.start, SolveOptions(Solver()), stages)


def seconds(step, solve, *arguments):
    """CPU seconds of assembly and solution on all ranks."""

    def so_far():
        costs = step.stages.costs(step.forest.comm)["cpu_seconds"]
        return sum(costs[name] for name in STAGES)

    before = so_far()
    solve(step, *arguments)
    return so_far() - before


def rows(name, arguments):
    """A row a step of a scene, and one for all of them: dicts."""
    total = np.zeros((arguments.repeats, 2))
    for step in adapt(SCENES[name](), arguments.tolerance, degree=1, partition_kind=arguments.partition):
        given = (
            load(step.scene, step.forest, step.elasticity),
            find_supports(step.scene, step.forest, step.elasticity.prolongation),
        )
        both = np.array([[seconds(step, f, *given) for f in (with_contact, glued)] for _ in range(arguments.repeats)])
        total += both
        yield _row(name, step.record.dofs, both)
    yield _row(name, "all steps", total)


def _row(name, dofs, both):
    """Medians of repeats, (n, 2) CPU seconds with contact and glued, and of their ratio."""
    (contact, tied), ratios = np.median(both, axis=0), both[:, 0] / both[:, 1]
    spread = {"ratio": np.median(ratios), "least": ratios.min(), "most": ratios.max()}
    return {"scene": name, "dofs": dofs, "contact_s": contact, "glued_s": tied, **spread}


def main():
    """Parse and run; errors of the package end in one line and exit code 1."""
    parser = RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES), help="(all)")
    parser.add_argument("--tolerance", type=float, default=0.06, help="error in the energy norm (%(default)s)")
    parser.add_argument("--partition", choices=KINDS, default="contact-sfc", help="kind of partition (%(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="of every solution (%(default)s)")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("--repeats must be at least 1")
    with plain_errors(MPI.COMM_WORLD):
        found = [row for name in arguments.scene for row in rows(name, arguments)]
        if MPI.COMM_WORLD.rank == 0:
            write(Path("results/cost/glued.csv"), found, "mpirun -n 2 python3 -m studies.cost.glued")
            print(plain(found))


if __name__ == "__main__":
    main()
