"""Preconditioners at degree 2: PCG iterations to 1e-8, CPU microseconds an unknown of one set-up and one solve.

    python3 -m studies.cost.preconditioners                              # every scene and preconditioner
    python3 -m studies.cost.preconditioners --scene hertz --tune   # other options of p-multigrid

"by default" is what a run takes: on flat cells factors may replace p-multigrid after 30 or 200 iterations, elsewhere
in this study after 2000.  "low-order refined" is BoomerAMG on the matrix of degree 1 of the leaves refined once, whose
nodes are those of degree 2 (S. A. Orszag, J. Comput. Phys. 37(1), 1980).  The contact is that of the last step, closed
pairs held; PCG starts from the displacement carried from the mesh before, on root cells from zero.  CPU seconds are the
least of three repetitions on one rank.
"""

from functools import partial

import numpy as np
from scipy.sparse import csr_matrix

from fx_contact import (
    ContactPair,
    Dirichlet,
    ErrorControl,
    Material,
    Scene,
    Solver,
    Traction,
    adapt,
    block,
    root_mesh_from_shapes,
)
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.contact_system import ContactSystem, Springs
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.external_forces import load
from fx_contact.fem.leaf_mesh import create_leaf_mesh
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.law.contact_solver import _impose
from fx_contact.linalg.matrix import distributed
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.timing import Stages
from fx_contact.scenes import hertz, indentation
from studies.tables import options, tabulate

#: Cells of a plate along its sides and through it.
SIDE, THROUGH = 12, 3
#: Most iterations of a solve.
MOST = 2000
#: Options of p-multigrid, one changed at a time.
TUNED = {
    "1 step of Chebyshev": {"mg_levels_ksp_max_it": 1},
    "3 steps of Chebyshev": {"mg_levels_ksp_max_it": 3},
    "4 steps of Chebyshev": {"mg_levels_ksp_max_it": 4},
    "Jacobi": {"mg_levels_pc_type": "jacobi"},
    "bounds 0.2 to 1.1": {"mg_levels_ksp_chebyshev_esteig": "0,0.2,0,1.1"},
    "bounds 0.05 to 1.1": {"mg_levels_ksp_chebyshev_esteig": "0,0.05,0,1.1"},
    "5 steps for the bounds": {"mg_levels_ksp_chebyshev_esteig_steps": 5},
    "threshold 0.25 below": {"mg_coarse_pc_hypre_boomeramg_strong_threshold": 0.25},
    "threshold 0.7 below": {"mg_coarse_pc_hypre_boomeramg_strong_threshold": 0.7},
    "two cycles below": {"mg_coarse_pc_hypre_boomeramg_max_iter": 2},
}
#: The coarse level alone, without smoothing above.
ALONE = {
    "mg_coarse_pc_hypre_boomeramg_max_iter": 1,
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 0,
    "mg_levels_pc_type": "none",
}


def plates(aspect):
    """Two plates of flat cells on each other, the lower one on a rigid base, pressed in the middle."""
    height = THROUGH / SIDE / aspect
    lower = block((0, 0, -height), (1, 1, 0), (SIDE, SIDE, THROUGH), 1)
    upper = block((0, 0, 0), (1, 1, height), (SIDE, SIDE, THROUGH), 1)
    upper = upper.named("pressed", "top", where=lambda x: (x[:2] < 0.5 + 1e-9).all(axis=0))
    return Scene(
        "plates",
        root_mesh_from_shapes({"lower": lower, "upper": upper}),
        dict.fromkeys(("lower", "upper"), Material(1.0, 0.3)),
        (Dirichlet("lower bottom", 0.0, 0.0, 0.0), Dirichlet("upper pressed", x=0.0, y=0.0)),
        (ContactPair("lower top", "upper bottom", direction=(0, 0, 1)),),
        (Traction("upper pressed", (0.0, 0.0, -1e-3)),),
    )


#: Scenes and their tolerances; plates are solved on their root cells.
SCENES = {"indentation": (indentation, 0.08), "hertz": (partial(hertz, order=6), 0.02)}
SCENES |= {f"plates 1:{aspect}": (lambda aspect=aspect: plates(aspect), 0.9) for aspect in (1, 4, 16, 100)}


def steps(name):
    """The steps of a scene: the last two of an adaptive run, the first of plates."""
    make, tolerance = SCENES[name]
    how = {"max_steps": 1, "solver": Solver("cholesky")} if "plates" in name else {}  # where PCG may not converge
    return list(adapt(make(), tolerance, degree=2, control=ErrorControl("energy"), **how))[-2:]


def low_order_refined(step, elasticity, supports):
    """The matrix of degree 1 on the leaves refined once, in the place of a coarse level: CoarseLevel.  On one rank."""
    fine, stages = elasticity.prolongation, Stages()
    forest, _ = step.forest.refined(np.ones(len(step.forest), dtype=bool))
    refined, leaf_mesh = Prolongation(Space(forest, 1)), create_leaf_mesh(forest, step.record.geometry_order)
    body = step.scene.mesh.body[forest.cell[leaf_mesh.leaf]]
    materials = [step.scene.materials[body] for body in step.scene.mesh.bodies]
    matrix = Elasticity(leaf_mesh, materials, body, refined, stages).stiffness().mat
    matrix.assemble()
    place = refined.injected(fine.find(refined.space.keys))
    fixed = ~supports.free[place].ravel()
    matrix.zeroRowsColumns(np.flatnonzero(fixed).astype(np.int32), diag=matrix.getDiagonal().sum() / len(fixed))
    entries = (~fixed).astype(float), (3 * place[:, None] + np.arange(3)).ravel(), np.arange(len(fixed) + 1)
    interpolation = csr_matrix(entries, shape=(len(fixed), len(fixed))).T.tocsr()
    matrix.convert("aij")
    return CoarseLevel(matrix, distributed(fine.comm, interpolation, refined.index_map))


def cost(step, solver, below=create_coarse_level):
    """Iterations, and CPU microseconds an unknown, of one set-up and one solve."""
    elasticity, rows, prolongation = step.elasticity, step.rows, step.elasticity.prolongation
    supports = find_supports(step.scene, step.forest, prolongation)
    multigrid = solver.preconditioner in (None, "p-multigrid")
    coarse = below(elasticity, supports) if multigrid else None
    forces = load(step.scene, step.forest, elasticity)
    matrix = elasticity.stiffness(rows, multigrid, supports=supports)
    problem = ContactProblem(matrix, forces, supports, elasticity.energy_norm, rows, step.scene, coarse=coarse)
    stages, active = Stages(), step.solution.active
    with PetscObjects(matrix.mat, *([coarse] if multigrid else [])) as objects:
        jump = Jump(rows, supports)
        reserve(matrix.mat, jump)
        matrix.mat.assemble()
        base, _ = _impose(problem)
        PenaltyTerm(jump, active * rows.capped_stiffness).add_to(matrix.mat)
        system = ContactSystem(problem, base, jump, active, SolveOptions(solver), stages, objects)
        start = supports.admissible(step.start)
        system.solve(Springs(np.where(active, np.inf, 0.0)), start, solver.tolerance)
    seconds = stages.costs(step.forest.comm)["cpu_seconds"]
    micro = {f"{name}_us": 1e6 * seconds[name] / step.record.dofs for name in ("setup", "solve")}
    return {"at_the_end": system.solver.preconditioner, "iterations": sum(system.solver.iterations), **micro}


def least(step, repetitions, *args):
    """The same with the least CPU seconds of some repetitions."""
    found = [cost(step, *args) for _ in range(repetitions)]
    return found[0] | {name: min(one[name] for one in found) for name in ("setup_us", "solve_us")}


def measured(names, tune, repetitions):
    """Rows of the table."""
    solver = partial(Solver, max_krylov=MOST)
    multigrid = {"p-multigrid": (solver("p-multigrid"),)}
    tuned = {name: (solver("p-multigrid", options=options),) for name, options in TUNED.items()}
    for name in names:
        for step in steps(name):
            refined = solver("p-multigrid", options=ALONE), partial(low_order_refined, step)
            others = {"by default": (solver(),), "boomeramg": (solver("boomeramg"),), "low-order refined": refined}
            for label, how in (multigrid | (tuned if tune else others)).items():
                row = {"scene": name, "dofs": step.record.dofs, "preconditioner": label}
                yield row | least(step, repetitions, *how)


def main():
    """Measure; print the table and keep it."""
    parser = options(__doc__, "cost")
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES), help="(all)")
    parser.add_argument("--tune", action="store_true", help="other options of p-multigrid")
    parser.add_argument("--repetitions", type=int, default=3, help="(%(default)s)")
    given = parser.parse_args()
    path = given.output / f"preconditioners{'_tuned' * given.tune}.csv"
    tabulate(measured(given.scene, given.tune, given.repetitions), path)


if __name__ == "__main__":
    main()
