"""The force between two half-spheres for any Poisson's ratio by another discretisation: HERTZ-A's reference.

    python3 -m studies.incompressible.axisymmetric

Taylor and Hood's pair P2/P1 of displacement and pressure on curved triangles in the half plane (r, z), nodes of one
sphere against the plane of symmetry, an active set around a direct solver.  No part of it is the package's.
"""

import argparse
from pathlib import Path

import gmsh
import numpy as np
import ufl
from basix.ufl import element, mixed_element
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.mesh import Mesh
from mpi4py import MPI
from petsc4py import PETSc

from studies.tables import write

try:
    from dolfinx.io import gmshio as gmsh_models
except ImportError:  # since 0.10
    from dolfinx.io import gmsh as gmsh_models

RATIOS = (0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999)
#: Radius, modulus, displacement of the flat face.
RADIUS, YOUNG, MOVED = 1.0, 1.0, 0.005
#: Contact radius, about; the mesh is finest up to its double.
CONTACT = 0.0716


def half_disc(cells, far=0.1, at_edge=None):
    """A quarter of a disc, the section of the half-sphere, in curved triangles: so many along the contact's radius.

    They grow to the size `far`; with `at_edge`, also from this size at the edge of the contact.
    """
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        geo, fine = gmsh.model.geo, CONTACT / cells
        pole, centre, rim = (geo.addPoint(r, z, 0) for r, z in ((0, 0), (0, RADIUS), (RADIUS, RADIUS)))
        edge = [] if at_edge is None else [geo.addPoint(CONTACT, RADIUS - np.sqrt(RADIUS**2 - CONTACT**2), 0)]
        points = [pole, *edge, rim]
        arcs = [geo.addCircleArc(one, centre, two) for one, two in zip(points, points[1:])]
        loop = geo.addCurveLoop([*arcs, geo.addLine(rim, centre), geo.addLine(centre, pole)])
        surface = geo.addPlaneSurface([loop])
        geo.synchronize()
        gmsh.model.addPhysicalGroup(2, [surface], 1)
        distance, size = gmsh.model.mesh.field.add("Distance"), gmsh.model.mesh.field.add("Threshold")
        gmsh.model.mesh.field.setNumbers(distance, "PointsList", [pole])
        for name, value in {
            "InField": distance,
            "SizeMin": fine,
            "SizeMax": far,
            "DistMin": 1.5 * CONTACT,
            "DistMax": 1.0,
        }.items():
            gmsh.model.mesh.field.setNumber(size, name, value)
        size = size if at_edge is None else _graded(size, edge, at_edge)
        gmsh.model.mesh.field.setAsBackgroundMesh(size)
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        return gmsh_models.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=2)[0]
    finally:
        gmsh.finalize()


def _graded(size, edge, least):
    """The least of a field of sizes and one that grows from points."""
    field = gmsh.model.mesh.field
    distance, grown, both = field.add("Distance"), field.add("MathEval"), field.add("Min")
    field.setNumbers(distance, "PointsList", edge)
    field.setString(grown, "F", f"{least} + 0.1 * F{distance}")
    field.setNumbers(both, "FieldsList", [size, grown])
    return both


def solved(poisson: float, mesh: Mesh) -> tuple[fem.Function, float, float]:
    """Displacement and pressure when the flat face has moved by `MOVED`; the force; the last closed node's radius."""
    shear, first = YOUNG / (2 * (1 + poisson)), YOUNG * poisson / ((1 + poisson) * (1 - 2 * poisson))
    pair = mixed_element([element("Lagrange", "triangle", 2, shape=(2,)), element("Lagrange", "triangle", 1)])
    space = fem.functionspace(mesh, pair)
    (u, p), (v, q) = ufl.TrialFunctions(space), ufl.TestFunctions(space)
    r = ufl.SpatialCoordinate(mesh)[0]
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 6})

    def strain(w):
        """That of an axisymmetric displacement."""
        g = ufl.grad(w)
        shear_strain = (g[0, 1] + g[1, 0]) / 2
        return ufl.as_matrix([[g[0, 0], shear_strain, 0], [shear_strain, g[1, 1], 0], [0, 0, w[0] / r]])

    work = 2 * shear * ufl.inner(strain(u), strain(v)) - p * ufl.tr(strain(v)) - q * ufl.tr(strain(u)) - p * q / first
    form = fem.form(2 * np.pi * r * work * dx)
    matrix = assemble_matrix(form)
    matrix.assemble()

    vertical, of_vertical = space.sub(0).sub(1).collapse()
    place, of_vertical = vertical.tabulate_dof_coordinates(), np.ravel(of_vertical)
    radial, of_radial = space.sub(0).sub(0).collapse()
    on_axis = np.ravel(of_radial)[np.abs(radial.tabulate_dof_coordinates()[:, 0]) < 1e-12]
    top = of_vertical[place[:, 1] > RADIUS - 1e-12]
    distance = np.hypot(place[:, 0], place[:, 1] - RADIUS)
    arc = (np.abs(distance - RADIUS) < 1e-6) & (place[:, 0] < 3 * CONTACT)
    dofs, height, radius = of_vertical[arc], place[arc, 1], place[arc, 0]
    closed = radius < CONTACT
    for _ in range(50):
        held = np.concatenate([on_axis, top, dofs[closed]]).astype(np.int32)
        values = np.concatenate([np.zeros(len(on_axis)), np.full(len(top), -MOVED), -height[closed]])
        solution = _solved(matrix, held, values)
        forces = (matrix * solution).array[dofs]
        wanted = np.where(closed, forces > 0, solution.array[dofs] < -height)
        if (wanted == closed).all():
            found = fem.Function(space)
            found.x.array[:] = solution.array
            return found, forces[closed].sum(), radius[closed].max()
        closed = wanted
    raise RuntimeError("the active set does not settle")


def _solved(matrix, held, values):
    """The solution with prescribed values, by a direct solver."""
    system, (x, b) = matrix.copy(), matrix.createVecs()
    x.array[held] = values
    system.zeroRowsColumns(held, diag=1.0, x=x, b=b)
    ksp = PETSc.KSP().create(MPI.COMM_SELF)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setOperators(system)
    ksp.solve(b, x)
    return x


def main():
    """Forces on three meshes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40, 80], help="along the contact's radius")
    parser.add_argument("--output", type=Path, default=Path("results/incompressible"))
    arguments = parser.parse_args()
    rows = []
    for cells in arguments.cells:
        mesh = half_disc(cells)
        for poisson in RATIOS:
            _, found, radius = solved(poisson, mesh)
            print(f"nu = {poisson}, {cells} cells to the rim: force {found:.5e}, last node {radius:.5f}", flush=True)
            rows.append({"nu": poisson, "cells": cells, "force": found})
    write(arguments.output / "axisymmetric.csv", rows)


if __name__ == "__main__":
    main()
