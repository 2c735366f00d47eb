"""Own Gmsh model: the eye of a rod, pulled up by a hollow pin in it, with 1 mm play.

Half of both bodies (x >= 0) and of their thickness are modelled: mpirun -n 2 python3 demos/own_gmsh_model.py
"""

from argparse import ArgumentParser

import gmsh
import numpy as np
from mpi4py import MPI

from fx_contact import ContactPair, Dirichlet, Material, Scene, SymmetryPlane, adapt, root_mesh_from_gmsh
from fx_contact.plot import draw_stress


def ring(name, inner, outer, around):
    """Two hexahedral blocks around the y axis, of `around` cells each; physical groups name body and sides."""
    geo, angles = gmsh.model.geo, np.pi / 2 * np.array([-1, 0, 1])
    centre = geo.addPoint(0, 0, 0)
    points = [[geo.addPoint(r * np.cos(a), 0, r * np.sin(a)) for a in angles] for r in (inner, outer)]
    arcs = [[geo.addCircleArc(a, centre, b) for a, b in zip(row, row[1:])] for row in points]
    spokes, blocks = [geo.addLine(a, b) for a, b in zip(*points)], []
    for i in range(2):
        loop = [arcs[0][i], spokes[i], arcs[1][i], spokes[i + 1]]
        face = geo.addPlaneSurface([geo.addCurveLoop(loop, reorient=True)])
        for curve, cells in zip(loop, (around, 4, around, 4)):
            geo.mesh.setTransfiniteCurve(curve, cells + 1)
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
        extruded = geo.extrude([(2, face)], 0, 0.2, 0, numElements=[2], recombine=True)
        blocks.append([face, *(tag for _, tag in extruded)])
    geo.synchronize()
    fronts, _, volumes, insides, _, outsides, _ = zip(*blocks)
    gmsh.model.addPhysicalGroup(3, volumes, name=name)
    sides = {"front": fronts, "cut": (blocks[0][6], blocks[1][4]), "inside": insides, "outside": outsides}
    for side, tags in sides.items():
        gmsh.model.addPhysicalGroup(2, tags, name=f"{name} {side}")
    gmsh.model.addPhysicalGroup(2, outsides[:1], name=f"{name} foot")


def model():
    """A pin with 1 mm play in an eye of half a metre, meshed apart, quadratic cells."""
    ring("pin", 0.25, 0.499, 10)
    ring("eye", 0.5, 1.0, 12)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)


ArgumentParser(description=__doc__).parse_args()  # there are no options
held = Dirichlet("pin inside", z=3e-3), Dirichlet("eye foot", x=0.0, z=0.0)
planes = tuple(SymmetryPlane(f"{body} {side}") for body in ("pin", "eye") for side in ("front", "cut"))
mesh, contact = root_mesh_from_gmsh(MPI.COMM_WORLD, model), (ContactPair("pin outside", "eye inside"),)
materials = {"pin": Material(young=210e9, poisson=0.3), "eye": Material(young=70e9, poisson=0.33)}
scene = Scene("eye", mesh, materials, dirichlet=held + planes, contact=contact, symmetry=4)
for step in adapt(scene, tolerance=0.1):
    r = step.record
    if MPI.COMM_WORLD.rank == 0:
        print(f"{r.cells} cells, {r.active_pairs} pairs closed, error {r.estimate:.1%}, {r.force:.4g} N")
draw_stress(step, "results/eye.png")
