"""Distorted cells at degree 2: tetrahedra of a CAD model that Gmsh subdivides into hexahedra, four each.

    python3 -m studies.cost.distorted                                    # a few minutes
    python3 -m studies.cost.distorted --scene bracket --size 10 --with "by default"    # one row, on any number of ranks

"bracket" is an angle with a hole, clamped below and pulled at the hole: it bends.  "cube" is held below, loaded above.
Each row is a process of its own: CPU seconds of set-up and solve, and the largest memory.
"""

import json
from itertools import product

import gmsh
from mpi4py import MPI

from fx_contact import Dirichlet, Material, Scene, Solver, Traction, adapt, root_mesh_from_gmsh
from studies.runs import by_itself
from studies.tables import options, tabulate

#: Solvers that are compared; BoomerAMG below p-multigrid is where factors of the coarse level are dear.
SOLVERS = {
    "by default": Solver(),
    "p-multigrid on BoomerAMG": Solver("p-multigrid", options={"mg_coarse_pc_hypre_boomeramg_max_iter": 1}),
    "cholesky": Solver("cholesky"),
}
#: Scenes and the lengths of their tetrahedra [mm].
CASES = (("bracket", 10.0), ("bracket", 7.0), ("cube", 12.0))


def subdivided(**settings):
    """Mesh the current model of OpenCASCADE with hexahedra: four of each tetrahedron, by settings of Gmsh's mesh."""
    for name, value in settings.items():
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
    gmsh.model.mesh.refine()


def named(held, loaded):
    """Physical groups of the only volume and of its surfaces in two boxes."""
    gmsh.model.occ.synchronize()
    (volume,) = gmsh.model.getEntities(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume[1]]), "part")
    for name, box in (("held", held), ("loaded", loaded)):
        found = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*box, dim=2)]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, found), name)


def bracket(size):
    """An angle of two legs of 80 x 60 x 10 mm, rounded inside, with a hole in the upright one."""
    cad, eps = gmsh.model.occ, 1e-3
    legs = [(3, cad.addBox(0, 0, 0, 80, 60, 10)), (3, cad.addBox(0, 0, 0, 10, 60, 80))]
    fillet = cad.cut([(3, cad.addBox(10, 0, 10, 10, 60, 10))], [(3, cad.addCylinder(20, 0, 20, 0, 60, 0, 10))])[0]
    part = cad.fuse(legs[:1], [*legs[1:], *fillet])[0]
    cad.cut(part, [(3, cad.addCylinder(-5, 30, 50, 20, 0, 0, 10))])
    named((-eps, -eps, -eps, 80 + eps, 60 + eps, eps), (-eps, 20 - eps, 40 - eps, 10 + eps, 40 + eps, 60 + eps))
    subdivided(MeshSizeMin=size, MeshSizeMax=size)


def cube(size):
    """A cube of 60 mm, held below."""
    eps = 1e-3
    gmsh.model.occ.addBox(0, 0, 0, 60, 60, 60)
    named((-eps, -eps, -eps, 60 + eps, 60 + eps, eps), (-eps, -eps, 60 - eps, 60 + eps, 60 + eps, 60 + eps))
    subdivided(MeshSizeMin=size, MeshSizeMax=size)


SCENES = {"bracket": bracket, "cube": cube}


def scene(name, size, poisson=0.3):
    """A part of steel, held on one side and loaded on another [mm, MPa]."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: SCENES[name](size))
    conditions, loads = (Dirichlet("held", 0.0, 0.0, 0.0),), (Traction("loaded", (1.0, 0.0, -1.0)),)
    return Scene(name, mesh, {"part": Material(210e3, poisson)}, conditions, (), loads)


def row(name, size, solver):
    """Costs of the step on the root cells."""
    (step,) = adapt(scene(name, size), 0.9, degree=2, max_steps=1, solver=SOLVERS[solver])
    record = step.record
    found = {"scene": name, "dofs": record.dofs, "solver": solver, "at_the_end": record.preconditioner}
    found["iterations"] = record.krylov_iterations[-1]
    found["cpu_s"] = record.cpu_seconds["setup"] + record.cpu_seconds["solve"]
    return found | {"kB": record.peak_memory_bytes / record.dofs / 1e3}


def main():
    """Measure in processes of their own; print the table and keep it."""
    parser = options(__doc__, "cost")
    parser.add_argument("--scene", choices=SCENES, help="one row, of this scene")
    parser.add_argument("--size", type=float, default=10.0, help="of its tetrahedra [mm] (%(default)s)")
    parser.add_argument("--with", dest="solver", choices=SOLVERS, default="by default", help="(%(default)s)")
    given = parser.parse_args()
    if given.scene:
        found = row(given.scene, given.size, given.solver)
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found))
        return
    words = (
        ("--scene", name, "--size", str(size), "--with", solver) for (name, size), solver in product(CASES, SOLVERS)
    )
    tabulate((by_itself("studies.cost.distorted", *each) for each in words), given.output / "distorted.csv")


if __name__ == "__main__":
    main()
