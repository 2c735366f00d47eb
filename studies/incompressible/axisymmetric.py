"""The force between two half-spheres for any Poisson's ratio by another discretisation: HERTZ-A's reference.

    python3 -m studies.incompressible.axisymmetric

Taylor and Hood's pair P2/P1 of displacement and pressure on curved triangles in the half plane (r, z), nodes of one
sphere against the plane of symmetry.  No part of it is the package's.
"""

import gmsh
import numpy as np
import ufl
from basix.ufl import element, mixed_element
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.sparse import identity

from studies.axisymmetric import assembled, lame, pressed, strain, triangles
from studies.tables import options, tabulate

RATIOS = (0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999)
#: Radius, modulus, displacement of the flat face.
RADIUS, YOUNG, MOVED = 1.0, 1.0, 0.005
#: Contact radius, about; the mesh is finest up to its double.
CONTACT = 0.0716


def half_disc(cells, far=0.1, at_edge=None):
    """A quarter of a disc, the section of the half-sphere, in curved triangles: so many along the contact's radius.

    They grow to the size `far`; with `at_edge`, also from this size at the edge of the contact.
    """

    def plane():
        geo = gmsh.model.geo
        pole, centre, rim = (geo.addPoint(r, z, 0) for r, z in ((0, 0), (0, RADIUS), (RADIUS, RADIUS)))
        edge = [] if at_edge is None else [geo.addPoint(CONTACT, RADIUS - np.sqrt(RADIUS**2 - CONTACT**2), 0)]
        points = [pole, *edge, rim]
        arcs = [geo.addCircleArc(one, centre, two) for one, two in zip(points, points[1:])]
        surface = geo.addPlaneSurface(
            [geo.addCurveLoop([*arcs, geo.addLine(rim, centre), geo.addLine(centre, pole)])]
        )
        geo.synchronize()
        near = {"InField": _field("Distance", PointsList=[pole]), "DistMin": 1.5 * CONTACT, "DistMax": 1.0}
        sizes = [_field("Threshold", SizeMin=CONTACT / cells, SizeMax=far, **near)]
        if edge:
            grown = f"{at_edge} + 0.1 * F{_field('Distance', PointsList=edge)}"
            sizes = [_field("Min", FieldsList=[*sizes, _field("MathEval", F=grown)])]
        gmsh.model.mesh.field.setAsBackgroundMesh(*sizes)
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        return surface

    return triangles(plane, 2)


def _field(kind, **options):
    """A new field of sizes."""
    field = gmsh.model.mesh.field
    tag = field.add(kind)
    for name, value in options.items():
        store = {list: field.setNumbers, str: field.setString}.get(type(value), field.setNumber)
        store(tag, name, value)
    return tag


def solved(poisson: float, mesh: Mesh) -> tuple[fem.Function, float, float]:
    """Displacement and pressure when the flat face has moved by `MOVED`; the force; the last closed node's radius."""
    shear, first = lame(YOUNG, poisson)
    pair = mixed_element([element("Lagrange", "triangle", 2, shape=(2,)), element("Lagrange", "triangle", 1)])
    space, r = fem.functionspace(mesh, pair), ufl.SpatialCoordinate(mesh)[0]
    (u, p), (v, q) = ufl.TrialFunctions(space), ufl.TestFunctions(space)
    one, other = strain(u, r), strain(v, r)
    work = 2 * shear * ufl.inner(one, other) - p * ufl.tr(other) - q * ufl.tr(one) - p * q / first
    (radial, at_r), (vertical, at_z) = (space.sub(0).sub(axis).collapse() for axis in (0, 1))
    place, at_z = vertical.tabulate_dof_coordinates(), np.ravel(at_z)
    on_axis = np.ravel(at_r)[np.abs(radial.tabulate_dof_coordinates()[:, 0]) < 1e-12]
    found = fem.Function(space)
    held, values = np.zeros((2, len(found.x.array)))
    held[on_axis] = 1
    top = at_z[place[:, 1] > RADIUS - 1e-12]
    held[top], values[top] = 1, -MOVED
    arc = (np.abs(np.hypot(place[:, 0], place[:, 1] - RADIUS) - RADIUS) < 1e-6) & (place[:, 0] < 3 * CONTACT)
    radius, height, closing = place[arc, 0], place[arc, 1], -identity(len(held), format="csr")[at_z[arc]]
    found.x.array[:], force = pressed(assembled(work, r), held > 0, closing, height, radius < CONTACT, values)
    return found, force.sum(), radius[force > 0].max()


def main():
    """Forces on three meshes."""
    parser = options(__doc__, "incompressible")
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40, 80], help="along the contact's radius")
    given = parser.parse_args()
    meshes = ((cells, half_disc(cells)) for cells in given.cells)
    rows = ({"nu": nu, "cells": cells, "force": solved(nu, mesh)[1]} for cells, mesh in meshes for nu in RATIOS)
    tabulate(rows, given.output / "axisymmetric.csv")


if __name__ == "__main__":
    main()
