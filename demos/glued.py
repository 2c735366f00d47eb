"""What contact costs: every step's contact problem beside the same mesh glued where it is in contact.

The glued problem ties the closed node pairs in all directions with the same stiffness: one linear system with the same
unknowns and the same accuracy, without active set and without first guess of one.  Both are assembled and solved from
the same start; CPU seconds are those of all ranks.

    mpirun -n 2 python3 demos/glued.py
"""

import argparse
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fx_contact import Solver, adapt
from fx_contact.conditions import load, prescribed_displacements
from fx_contact.enforcement import Jump, PenaltyTerm
from fx_contact.partition import KINDS
from fx_contact.scenes import hertz, indentation
from fx_contact.solve import solve_contact
from fx_contact.stages import Stages

SCENES = {"hertz": hertz, "indentation": indentation}


def contact_seconds(step):
    """CPU seconds of assembly and solution in a step with contact."""
    return sum(step.record["cpu_seconds"][name] for name in ("assemble", "system", "setup", "solve"))


def glued_seconds(step, start):
    """CPU seconds of the same with the closed pairs glued."""
    stages, pairs, prolongation = Stages(), step.pairs, step.elasticity.prolongation
    prescribed = prescribed_displacements(step.scene, step.forest, prolongation)
    forces = load(step.scene, step.forest, step.elasticity)
    none = np.zeros(len(pairs), dtype=bool)
    with stages("assemble"):
        matrix = step.elasticity.stiffness(pairs)
        PenaltyTerm(Jump(pairs, prescribed)).reserve(matrix.mat)  # hypre's format wants every entry that has room
        for axis in np.eye(3):
            tie = replace(pairs, normal=np.broadcast_to(axis, (len(pairs), 3)), gap=np.zeros(len(pairs)))
            PenaltyTerm(Jump(tie, prescribed)).change(matrix.mat, none, step.contact.active)
    solve_contact(matrix, forces, None, prescribed, start, step.elasticity.energy_norm, Solver(), stages)
    costs = stages.costs(step.forest.comm)["cpu_seconds"]
    return sum(costs[name] for name in ("assemble", "system", "setup", "solve"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=SCENES, default="hertz", help="(%(default)s)")
    parser.add_argument("--tolerance", type=float, default=0.06, help="error in the energy norm (%(default)s)")
    parser.add_argument("--partition", choices=KINDS, default="contact-sfc", help="kind of partition (%(default)s)")
    arguments = parser.parse_args()
    show = print if MPI.COMM_WORLD.rank == 0 else lambda *_, **__: None
    show("     dofs  contact [CPU s]  glued [CPU s]  ratio")
    both = np.zeros(2)
    for step in adapt(SCENES[arguments.scene](), arguments.tolerance, partition_kind=arguments.partition):
        seconds = contact_seconds(step), glued_seconds(step, step.start)
        both += seconds
        show("{:9,}  {:15.2f}  {:13.2f}  {:5.2f}".format(step.record["dofs"], *seconds, seconds[0] / seconds[1]))
    show("      all  {:15.2f}  {:13.2f}  {:5.2f}".format(*both, both[0] / both[1]))
