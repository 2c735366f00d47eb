"""Largest pressure below the rounded punch, by other means than this program.

Quadratic triangles in a plane through the axis, node to node.

    python3 -m studies.goals.axisymmetric_punch              # half a minute
    python3 -m studies.goals.axisymmetric_punch --size 0.04
"""

import argparse

import gmsh
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_vector
from scipy.sparse import block_diag, coo_matrix, identity
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from studies.axisymmetric import lame, pressed, stiffness, triangles
from studies.goals.rounded_punch import APPLIED, BLOCK, EDGE, FLAT, HEIGHT, MATERIALS

#: To three digits: 916.9 with triangles of 0.005 at the edge, 917.4 with 0.02.
LARGEST_PRESSURE = 917.0
#: Radii between which the triangles are smallest, and the factor from one edge to the next outside.
FINE, GROWTH = (39.9, 40.6), 1.05


def gap(r):
    """Height of the edge above the flat part at radii (n,)."""
    return np.where(r > FLAT, EDGE - np.sqrt(EDGE**2 - np.maximum(r - FLAT, 0.0) ** 2), 0.0)


def radii(size):
    """Radii of the vertices of the foot, from the axis outwards: (n,)."""

    def graded(length):
        steps = np.cumsum(np.minimum(size * GROWTH ** np.arange(1000), 1.0))
        steps = steps[: np.searchsorted(steps, length) + 1]
        return steps * length / steps[-1]

    low, high = FINE
    middle = np.linspace(low, high, int(np.rint((high - low) / size)) + 1)
    outer = high + graded(FLAT + EDGE * np.sqrt(0.5) - high)
    return np.concatenate([[0.0], (low - graded(low))[::-1][1:], middle, outer])


def body(outline, sizes, foot, material, pressure):
    """Stiffness, load of a pressure on z = HEIGHT and nodes (n, 2) of a body of revolution.

    Args:
        outline: (n, 2) polygon, whose first edges, `foot` of them, are not divided; `sizes` (n,) of cells there.
    """

    def plane():
        geo = gmsh.model.geo
        points = [geo.addPoint(x, y, 0, size) for (x, y), size in zip(outline, sizes)]
        lines = [geo.addLine(*ends) for ends in zip(points, points[1:] + points[:1])]
        surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        geo.synchronize()
        for edge in lines[:foot]:
            gmsh.model.mesh.setTransfiniteCurve(edge, 2)
        return surface

    domain = triangles(plane, 1)
    space, r = fem.functionspace(domain, ("Lagrange", 2, (2,))), ufl.SpatialCoordinate(domain)[0]
    top = mesh.locate_entities_boundary(domain, 1, lambda x: x[1] > HEIGHT - 1e-6)
    tags = mesh.meshtags(domain, 1, np.sort(top), np.ones(len(top), dtype=np.int32))
    down = -2 * np.pi * r * ufl.TestFunction(space)[1]
    load = assemble_vector(fem.form(down * ufl.Measure("ds", domain, subdomain_data=tags)(1)))
    matrix = stiffness(space, *lame(material.young, material.poisson))
    return matrix, pressure * load.array, space.tabulate_dof_coordinates()[:, :2]


def largest_pressure(size):
    """Largest nodal pressure and its radius, with triangles of a size at the edge."""
    r = radii(size)
    sizes, arc = np.gradient(r), np.linspace(np.pi / 4, np.pi / 2, 13)[1:]
    arc = np.stack([FLAT + EDGE * np.sin(arc), EDGE - EDGE * np.cos(arc)], axis=1)
    foot, flat = np.stack([r, gap(r)], axis=1), np.stack([r, 0 * r], axis=1)
    punch = np.concatenate([foot, arc, [[FLAT + EDGE, HEIGHT], [0, HEIGHT]]])
    block = np.concatenate([flat, [[BLOCK, 0], [BLOCK, -BLOCK], [0, -BLOCK]]])
    around = np.concatenate([sizes, np.ones(len(arc)), [5, 5]]), np.concatenate([sizes, [15, 15, 15]])
    parts = [
        body(outline, some, len(r) - 1, MATERIALS[name], pressure)
        for outline, some, name, pressure in zip((punch, block), around, ("punch", "block"), (APPLIED, 0.0))
    ]
    (upper, load, above), (lower, other, below) = parts
    nodes = np.sort(np.concatenate([r, (r[1:] + r[:-1]) / 2]))
    first = cKDTree(above).query(np.stack([nodes, np.interp(nodes, r, gap(r))], axis=1))[1]
    second = cKDTree(below).query(np.stack([nodes, 0 * nodes], axis=1))[1] + len(above)
    positions, load = np.concatenate([above, below]), np.concatenate([load, other])
    held = np.stack([positions[:, 0] < 1e-9, positions[:, 1] < 1e-9 - BLOCK], axis=1).ravel()
    unit = identity(len(held), format="csr")
    closing = unit[2 * second + 1] - unit[2 * first + 1]
    matrix, closed = block_diag([upper, lower]).tocsr(), nodes < FLAT + 0.4
    _, force = pressed(matrix, held, closing, gap(nodes), closed, load=load)
    return of_forces(r, nodes, force)


def of_forces(r, nodes, force):
    """Largest pressure and its radius, by the mass matrix of the closed nodes."""
    place, weight = np.polynomial.legendre.leggauss(5)
    x = (place + 1) / 2
    shape = np.stack([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)], axis=1)
    size = np.diff(r)[:, None]
    mass = np.einsum("eq,qi,qj->eij", np.pi * weight * size * (r[:-1, None] + x * size), shape, shape)
    index = 2 * np.arange(len(size))[:, None] + np.arange(3)
    pairs = np.repeat(index, 3, axis=1).ravel(), np.tile(index, 3).ravel()
    closed = np.flatnonzero(force > 0)
    mass = coo_matrix((mass.ravel(), pairs)).tocsc()[closed][:, closed]
    pressure = splu(mass).solve(force[closed])
    return pressure.max(), nodes[closed[pressure.argmax()]]


def main():
    """Print largest pressures and where they are."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument(
        "--size", type=float, nargs="+", default=(0.02, 0.01, 0.005), help="of triangles (%(default)s)"
    )
    for size in options.parse_args().size:
        print("triangles of {}: {:.1f} at {:.3f}".format(size, *largest_pressure(size)), flush=True)


if __name__ == "__main__":
    main()
