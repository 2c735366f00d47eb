"""Flat cells and thin bodies at degree 2: iterations of the last solve by the aspect of the cells.

    python3 -m studies.cost.flat               # a few minutes
    python3 -m studies.cost.flat --factors     # what Cholesky's factors take, of plates and of cubes
    mpirun -n 3 python3 -m studies.cost.flat --scene slab layers    # on several ranks

"slab": three layers of cells on a rigid base; "layers": a cube of cells that get flatter towards its face; both pressed
in the middle.  "plate": one layer of cells between clamped rims, "thick plate": three, both under pressure: they bend.
"point blocks" are iterations with a smoother that knows nothing of flat cells, on one rank.  CPU microseconds an
unknown are those of set-up and solves.
"""

from unittest import mock

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact import Dirichlet, Material, Scene, SolveError, Solver, Traction, adapt, block, root_mesh_from_shapes
from fx_contact.fem import coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.parallel.timing import Stages
from studies.tables import options, tabulate

ASPECTS, POISSON = (1.0, 2.0, 4.0, 16.0, 100.0, 1000.0), (0.3, 0.49, 0.4999)
#: Layers of cells of the scenes.
LAYERS = {"slab": 3, "layers": 6, "plate": 1, "thick plate": 3}
#: Most iterations with point blocks.
MOST = 2000


def scene(name, aspect, poisson=0.3, side=12):
    """A body of cells as wide as 1, `side` of them along x and y."""
    layers, bends = LAYERS[name], "plate" in name
    thickness = np.geomspace(1, 1 / aspect, layers) if name == "layers" else np.full(layers, 1 / aspect)
    height = np.concatenate([[0], np.cumsum(thickness)])
    body = block((-side / 2, -side / 2, 0), (side / 2, side / 2, layers), (side, side, layers), 1)
    body = body.named("held", *(("left", "right", "front", "back") if bends else ("bottom",)))
    body = body.named("loaded", "top", where=lambda x: (np.abs(x[:2]) < (np.inf if bends else 2.1)).all(axis=0))
    body = body.placed(lambda x: (x[0], x[1], np.interp(x[2], np.arange(layers + 1), height)))
    conditions = (Dirichlet("body held", 0.0, 0.0, 0.0),)
    # The load does not matter to the solver: small strains are not looked at.
    loads = (Traction("body loaded", (0.0, 0.0, -1e-6)),)
    return Scene(name, root_mesh_from_shapes({"body": body}), {"body": Material(1.0, poisson)}, conditions, (), loads)


def solved(problem, **solver):
    """The step on the root cells, and CPU microseconds an unknown of set-up and solves."""
    allow = ("large strain", "large rotation")
    (step,) = adapt(problem, 0.9, degree=2, max_steps=1, geometry_order=1, allow=allow, solver=Solver(**solver))
    costs = step.stages.costs(MPI.COMM_WORLD)["cpu_seconds"]
    return step, 1e6 * (costs["setup"] + costs["solve"]) / step.record.dofs


def by_aspect(name, aspect, poisson):
    """A row of the table."""
    problem = scene(name, aspect, poisson)
    row = {"scene": name, "aspect": f"1:{aspect:g}", "nu": poisson}
    if MPI.COMM_WORLD.size == 1:
        with mock.patch.object(coarse_level, "strong_blocks", lambda elasticity: None):
            row["point_blocks"] = outcome(problem, preconditioner="p-multigrid", max_krylov=MOST)["iterations"]
    return row | outcome(problem)


def outcome(problem, **solver):
    """Unknowns, iterations of the last solve, or that it fails, the last preconditioner, and microseconds."""
    try:
        step, micro = solved(problem, **solver)
    except SolveError:
        return {"iterations": "fails"}
    record = step.record
    stays = not solver or record.preconditioner == solver["preconditioner"]
    iterations = record.krylov_iterations[-1] if stays else f"> {MOST}"
    return {"iterations": iterations, "at_the_end": record.preconditioner, "us": micro}


def factors(name, aspect, side):
    """What Cholesky's factors of a matrix take.  On one rank."""
    step, _ = solved(scene(name, aspect, side=side), preconditioner="p-multigrid")
    elasticity, iterations = step.elasticity, step.record.krylov_iterations[-1]
    iteration = 1e6 * step.record.cpu_seconds["solve"] / step.record.dofs / iterations
    supports = find_supports(step.scene, step.forest, elasticity.prolongation)
    matrix = elasticity.stiffness(supports=supports).mat
    matrix.assemble()
    matrix = matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    pc, stages = PETSc.PC().create(matrix.comm), Stages()
    pc.setOperators(matrix)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("mumps")
    with stages("setup"):
        pc.setUp()
    dofs, found = step.record.dofs, pc.getFactorMatrix()
    entries, memory = found.getMumpsInfog(29), 1e6 * found.getMumpsInfog(22)
    spent = 1e6 * stages.costs(MPI.COMM_WORLD)["cpu_seconds"]["setup"] / dofs
    kilobytes = {"kB": 8 * entries / dofs / 1e3, "kB_of_memory": memory / dofs / 1e3}
    counts = {"iterations": iterations, "price": spent / iteration}
    return {"scene": name, "side": side, "dofs": dofs} | kilobytes | {"us": spent, "us_iteration": iteration} | counts


def main():
    """Measure; print the table, and keep that of one rank."""
    parser = options(__doc__, "cost")
    parser.add_argument("--scene", choices=LAYERS, nargs="+", default=list(LAYERS), help="(all)")
    parser.add_argument("--poisson", type=float, nargs="+", default=POISSON, help="(%(default)s)")
    parser.add_argument("--factors", action="store_true", help="what factors take")
    given = parser.parse_args()
    cases = [("plate", 16.0, side) for side in (16, 32, 48)]
    cases += [("thick plate", 16.0, side) for side in (12, 24)] + [("layers", 1.0, side) for side in (6, 12)]
    if not given.factors:
        cases = [(name, aspect, nu) for name in given.scene for nu in given.poisson for aspect in ASPECTS]
    measured, name = (factors, "factors") if given.factors else (by_aspect, "flat")
    tabulate((measured(*case) for case in cases), given.output / f"{name}.csv")


if __name__ == "__main__":
    main()
