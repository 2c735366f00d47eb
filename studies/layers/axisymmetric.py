"""A rigid sphere on a coated cylinder by another discretisation: force and contact radius for `studies.layers.run`.

    python3 -m studies.layers.axisymmetric

Quadratic quadrilaterals in the half plane (r, z), graded towards the contact, the surface and the interface; nodes of
the surface against the sphere.  No part of it is the package's.
"""

from itertools import product

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI
from scipy.sparse import identity

from studies.axisymmetric import lame, pressed, stiffness
from studies.tables import options, tabulate

#: Of the cylinder, its radius and height; modulus and Poisson's ratio of the substrate, Poisson's ratio of the coating.
SIZE, YOUNG, POISSON, COATING_POISSON = 1.0, 1.0, 0.3, 0.3
#: Thickness of the coating, its modulus over that of the substrate, radius of the contact over the thickness, about.
THICKNESS, RATIOS, WIDTHS = 1e-3, (1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3), (1.0, 10.0)
#: Factor from one cell to the next outside the contact.
GROWTH = 1.15


def sphere(width: float) -> tuple[float, float]:
    """Radius R and displacement d of a sphere that meets a plane in a circle of the radius a = width thickness.

    Hertz's d = a^2 / R on a half-space, with R = 100 a: strains are small.
    """
    radius = 100 * width * THICKNESS
    return radius, width * THICKNESS / 100


def graded(first: float, even: float, end: float) -> np.ndarray:
    """Places from 0 to the end: cells of one size up to a place, then larger ones."""
    steps = [first] * max(1, int(np.ceil(even / first)))
    while sum(steps) < end:
        steps.append(steps[-1] * GROWTH)
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * end / places[-1]


def section(width: float, cells: int):
    """Half of the section of the cylinder, in `cells` cells along the contact's radius; the surface is z = 0."""
    size = width * THICKNESS / cells
    r = graded(size, 2 * width * THICKNESS, SIZE)
    layer = graded(min(size, THICKNESS / 8), 0.0, THICKNESS / 2)
    layer = np.concatenate([layer, THICKNESS - layer[-2::-1]])
    depths = np.concatenate([layer, THICKNESS + graded(layer[1], 0.0, SIZE - THICKNESS)[1:]])
    counts = len(r) - 1, len(depths) - 1
    mesh = create_rectangle(MPI.COMM_SELF, np.array([[0, 0], counts], dtype=float), counts, CellType.quadrilateral)
    x = mesh.geometry.x
    x[:, 0], x[:, 1] = np.interp(x[:, 0], range(len(r)), r), -np.interp(x[:, 1], range(len(depths)), depths)
    return mesh


def solved(ratio: float, width: float, cells: int) -> tuple[float, float]:
    """The force, and the radius of the last closed node."""
    mesh = section(width, cells)
    space = fem.functionspace(mesh, ("Lagrange", 2, (2,)))

    def coefficient(coating, substrate):
        """Constant in the coating and in the substrate."""
        function = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        function.interpolate(lambda x: np.where(x[1] > -THICKNESS, coating, substrate))
        return function

    matrix = stiffness(space, *lame(coefficient(ratio * YOUNG, YOUNG), coefficient(COATING_POISSON, POISSON)))
    place = space.tabulate_dof_coordinates()[:, :2]
    held = np.stack([place[:, 0] < 1e-12, place[:, 1] < 1e-9 - SIZE], axis=1).ravel()
    radius, depth = sphere(width)
    near = np.flatnonzero((place[:, 1] > -1e-12) & (place[:, 0] < 2 * width * THICKNESS))
    gap = radius - np.sqrt(radius**2 - place[near, 0] ** 2) - depth
    _, force = pressed(matrix, held, identity(len(held), format="csr")[2 * near + 1], gap, gap < 0)
    return force.sum(), place[near, 0][force > 0].max()


def main():
    """Forces on meshes, each twice as fine."""
    parser = options(__doc__, "layers")
    parser.add_argument("--cells", type=int, nargs="+", default=[10, 20, 40], help="along the contact's radius")
    given = parser.parse_args()

    def rows():
        for width, ratio, cells in product(WIDTHS, RATIOS, given.cells):
            force, radius = solved(ratio, width, cells)
            yield {"width": width, "ratio": ratio, "cells": cells, "force": force, "radius": radius}

    tabulate(rows(), given.output / "axisymmetric.csv")


if __name__ == "__main__":
    main()
