"""Root meshes of a CAD part at degree 2: what subdivided tetrahedra cost against transfinite cells.

    python3 -m studies.cost.cad    # four minutes

A hollow pin with play in an eye, a quarter of both, from a STEP file.  "transfinite": the front faces have a grid of
quadrilaterals, and are extruded; "extruded": the faces have Gmsh's own quadrilaterals; "subdivided": tetrahedra, each
divided into four hexahedra.  Costs are those of a run to a tolerance of 5 %, and of its meshes up to the first one with
an estimate of 5 %.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import gmsh
import numpy as np
from mpi4py import MPI

from fx_contact import ContactPair, Dirichlet, Material, Scene, Solver, SymmetryPlane, adapt, root_mesh_from_gmsh
from studies.cost.distorted import subdivided
from studies.tables import options, tabulate

TOLERANCE, BODIES = 0.05, {"pin": (0.25, 0.499), "eye": (0.5, 1.0)}
#: Thickness [m] of the modelled half, and layers of extruded cells.
PARTS = {"plate": (0.2, 1), "block": (1.0, 3)}
#: Meshes: cells around a circle.
MESHES = (("transfinite", 24), ("extruded", 16), ("subdivided", 12), ("subdivided", 16))


def write_step(path, thick):
    """The quarter, x >= 0 and 0 <= y <= thick, of a ring for each body."""
    occ = gmsh.model.occ
    for inner, outer in BODIES.values():
        solid, hole = ([(3, occ.addCylinder(0, 0, 0, 0, thick, 0, r))] for r in (outer, inner))
        ring, _ = occ.cut(solid, hole)
        occ.intersect(ring, [(3, occ.addBox(0, -1, -2, 2, 4, 4))])
    occ.synchronize()
    gmsh.write(path)
    gmsh.clear()


def name_groups():
    """Physical groups of the bodies and of their sides."""
    named = {}
    for _, volume in gmsh.model.getEntities(3):
        body = min(BODIES, key=lambda one: abs(BODIES[one][1] - gmsh.model.getBoundingBox(3, volume)[3]))
        gmsh.model.addPhysicalGroup(3, [volume], name=body)
        for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
            _, front, _, right, back, _ = np.round(gmsh.model.getBoundingBox(2, face), 3)
            side = "cut" if right == 0 else "front" if back == 0 else "back"
            if right > 0 and front < back:
                side = "inside" if right == BODIES[body][0] else "outside"
            named.setdefault(f"{body} {side}", []).append(face)
    for name, faces in named.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    return named


def alike(dimension, copies, masters):
    """Mesh the pin's surface or curves as those of the eye, scaled about the y axis; `copies` alone end that."""
    scale = BODIES["pin"][1] / BODIES["eye"][0] if masters is not copies else 1.0
    gmsh.model.mesh.setPeriodic(dimension, copies, masters, np.diag([scale, 1, scale, 1]).ravel())


def subdivide(around):
    """Hexahedra of tetrahedra."""
    named = name_groups()
    copies, masters = named["pin outside"], named["eye inside"]
    alike(2, copies, masters)
    sizes = {"MeshSizeFromCurvature": around, "MeshSizeFromPoints": 0, "MeshSizeMax": 0.5}
    subdivided(**sizes, Algorithm3D=10, OptimizeThreshold=0.6)
    alike(2, copies, copies)


def extrude(around, thick, layers, transfinite):
    """Hexahedra of quadrilaterals on the front faces."""
    mesh, occ, arcs = gmsh.model.mesh, gmsh.model.occ, {}
    volumes = gmsh.model.getEntities(3)
    faces = gmsh.model.getBoundary(volumes, combined=False, oriented=False)
    fronts = occ.copy([face for face in faces if gmsh.model.getBoundingBox(*face)[4] < 1e-3])
    occ.remove(volumes, recursive=True)
    occ.extrude(fronts, 0, thick, 0, [layers], recombine=True)
    occ.synchronize()
    name_groups()
    for _, curve in gmsh.model.getBoundary(fronts, combined=False, oriented=False):
        right = round(gmsh.model.getBoundingBox(1, curve)[3], 3)
        if right > 0:
            arcs[right] = [curve]
        if transfinite:
            mesh.setTransfiniteCurve(curve, around // 2 + 1 if right else 3)
    for face in fronts:
        if transfinite:
            mesh.setTransfiniteSurface(face[1])
        mesh.setRecombine(*face)
    copies, masters = arcs[BODIES["pin"][1]], arcs[BODIES["eye"][0]]
    alike(1, copies, masters)
    for limit in ("Min", "Max"):
        gmsh.option.setNumber(f"Mesh.MeshSize{limit}", 4.8 / around)
    gmsh.option.setNumber("Mesh.Algorithm", 8)
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)
    mesh.generate(3)
    alike(1, copies, copies)


def scene(name, kind, around):
    """The pin pulled up by 3 mm; the outside of the eye is held."""
    thick, layers = PARTS[name]

    def model():
        with TemporaryDirectory() as folder:
            path = str(Path(folder) / "part.step")
            write_step(path, thick)
            gmsh.model.occ.importShapes(path)
        gmsh.model.occ.synchronize()
        if kind == "subdivided":
            subdivide(around)
        else:
            extrude(around, thick, layers, kind == "transfinite")
        gmsh.model.mesh.setOrder(2)

    planes = [SymmetryPlane(f"{body} {side}") for body in BODIES for side in ("front", "cut")]
    return Scene(
        f"{name} {kind}",
        root_mesh_from_gmsh(MPI.COMM_WORLD, model),
        {"pin": Material(210e9, 0.3), "eye": Material(70e9, 0.33)},
        (Dirichlet("pin inside", z=3e-3), Dirichlet("eye outside", x=0.0, z=0.0), *planes),
        (ContactPair("pin outside", "eye inside"),),
        symmetry=4,
    )


def measured(name, kind, around, preconditioner=None):
    """A row of the table."""
    problem = scene(name, kind, around)
    records = [step.record for step in adapt(problem, TOLERANCE, solver=Solver(preconditioner=preconditioner))]
    seconds, last = [record.cpu_seconds["total"] for record in records], records[-1]
    equal = next(i for i, record in enumerate(records) if record.estimate <= TOLERANCE)
    return {
        "part": name,
        "mesh": kind,
        "around": around,
        "solver": preconditioner or "default",
        "root_cells": len(problem.mesh.cells),
        "estimate": records[equal].estimate,
        "dofs": records[equal].dofs,
        "cpu_s": sum(seconds[: equal + 1]),
        "run_dofs": last.dofs,
        "run_estimate": last.estimate,
        "run_cpu_s": sum(seconds),
        "setup_s": sum(record.cpu_seconds["setup"] for record in records),
        "iterations": last.krylov_iterations[-1],
        "solves": sum(len(record.krylov_iterations) for record in records),
        "at_the_end": last.preconditioner,
        "force": last.force,
    }


def rows(parts):
    """Rows of parts; where p-multigrid is not the last preconditioner, also with it."""
    for part in parts:
        measured(part, *MESHES[0])  # libraries are loaded, forms compiled
        reference = None
        for mesh in MESHES:
            found = [measured(part, *mesh)]
            if found[0]["at_the_end"] != "p-multigrid":
                found.append(measured(part, *mesh, "p-multigrid"))
            reference = reference or found[0]
            for row in found:
                yield row | {f"{name}_ratio": row[name] / reference[name] for name in ("cpu_s", "run_cpu_s")}


def main():
    """Measure, print the table and keep it."""
    parser = options(__doc__, "cost")
    parser.add_argument("--part", choices=PARTS, nargs="+", default=list(PARTS), help="(all)")
    given = parser.parse_args()
    tabulate(rows(given.part), given.output / "cad.csv")


if __name__ == "__main__":
    main()
