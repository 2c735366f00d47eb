"""From a STEP file to a picture: an eye bolt, pulled by a hollow pin with 0.1 mm play (N, mm, MPa).

Tetrahedra of a quarter (x, y >= 0) are subdivided into hexahedra: mpirun -n 2 python3 demos/step_part.py
"""

from argparse import ArgumentParser
from pathlib import Path

import gmsh
import numpy as np
from mpi4py import MPI

from fx_contact import ContactPair, Dirichlet, Material, Scene, SymmetryPlane, Traction, adapt, root_mesh_from_gmsh
from fx_contact.plot import draw_stress

FOLDER, HOLE, PIN, BORE, PULL = Path("results/step_part"), 12.0, 11.9, 6.0, 20e3


def write_parts(path):
    """What a CAD program would export: the bolt along z, and the pin in its eye along y."""
    occ = gmsh.model.occ
    bolt, _ = occ.fuse([(3, occ.addCylinder(0, -10, 0, 0, 20, 0, 25))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 60, 9))])
    occ.cut(bolt, [(3, occ.addCylinder(0, -10, 0, 0, 20, 0, HOLE))])
    occ.cut([(3, occ.addCylinder(0, -10, 0, 0, 20, 0, PIN))], [(3, occ.addCylinder(0, -10, 0, 0, 20, 0, BORE))])
    occ.synchronize()
    gmsh.write(str(path))
    gmsh.clear()


def model():
    """Hexahedra of a quarter of the parts, with their nodes on the surfaces of the parts."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    write_parts(FOLDER / "parts.step")
    mesh, occ, sides = gmsh.model.mesh, gmsh.model.occ, {}
    parts = occ.importShapes(str(FOLDER / "parts.step"))
    quarters = [occ.intersect([part], [(3, occ.addBox(0, 0, -99, 99, 99, 198))])[0] for part in parts]
    occ.synchronize()
    for body, quarter in zip(("bolt", "pin"), quarters):
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in quarter], name=body)
        for _, face in gmsh.model.getBoundary(quarter, oriented=False):
            _, _, bottom, right, back, top = np.round(gmsh.model.getBoundingBox(2, face), 3)
            side = "x = 0" if right == 0 else "y = 0" if back == 0 else "end" if bottom == 60 else "free"
            side = f"radius {top:g}" if gmsh.model.getType(2, face) == "Cylinder" else side
            sides.setdefault(f"{body} {side}", []).append(face)
    for name, faces in sides.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    # The pin's surface has the triangles of the hole, scaled about the y axis.
    hole, outside = sides[f"bolt radius {HOLE:g}"], sides[f"pin radius {PIN:g}"]
    mesh.setPeriodic(2, outside, hole, np.diag([PIN / HOLE, 1, PIN / HOLE, 1]).ravel())
    # HXT makes fewer flat tetrahedra along curved surfaces, whose subdivisions would be inverted.
    for name, value in {"MeshSizeMax": 10, "Algorithm3D": 10, "OptimizeThreshold": 0.6}.items():
        gmsh.option.setNumber(f"Mesh.{name}", value)
    mesh.generate(3)
    gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
    mesh.refine()
    mesh.setPeriodic(2, outside, outside, np.eye(4).ravel())  # ends the relation: setOrder does not keep it
    mesh.setOrder(2)


ArgumentParser(description=__doc__).parse_args()  # there are no options
planes = tuple(SymmetryPlane(f"{body} {axis} = 0") for body in ("bolt", "pin") for axis in "xy")
scene = Scene(
    name="eye bolt",
    mesh=root_mesh_from_gmsh(MPI.COMM_WORLD, model),
    materials={"bolt": Material(young=70e3, poisson=0.33), "pin": Material(young=210e3, poisson=0.3)},
    dirichlet=(Dirichlet("bolt end", z=0.0), *planes),
    contact=(ContactPair(f"bolt radius {HOLE:g}", f"pin radius {PIN:g}"),),
    tractions=(Traction(f"pin radius {BORE:g}", (0.0, 0.0, -PULL / (2 * np.pi * BORE * 20))),),
    symmetry=4,
    units=("mm", "MPa"),
)
for step in adapt(scene, tolerance=0.1):
    r = step.record
    if MPI.COMM_WORLD.rank == 0:
        print(f"{r.cells} cells, {r.active_pairs} pairs closed, error {r.estimate:.1%}, {r.max_pressure:.4g} MPa")
draw_stress(step, FOLDER / "stress.png")
