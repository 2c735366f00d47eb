"""Largest pressure below the rounded punch, by other means than this program.

Quadratic triangles in a plane through the axis, node to node: 917.0. Half-spaces, by the method of dimensionality
reduction (V. L. Popov, M. Hess, 2015), for a punch of this profile: 950.4, 4 % more, since neither body is one.

    python3 -m studies.goals.axisymmetric_punch              # two minutes
    python3 -m studies.goals.axisymmetric_punch --size 0.04
"""

import argparse

import basix.ufl
import gmsh
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix, assemble_vector
from mpi4py import MPI
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.sparse import block_diag, bmat, coo_matrix, csr_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from studies.goals.rounded_punch import APPLIED, BLOCK, EDGE, FLAT, HEIGHT, MATERIALS

#: With triangles of 0.005 at the edge; 917.4 with 0.02.
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


def triangles(outline, sizes, foot):
    """A mesh of a polygon (n, 2) whose first edges, `foot` of them, are not divided: (m, 2) points, (k, 3) cells."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    points = [gmsh.model.geo.addPoint(x, y, 0, size) for (x, y), size in zip(outline, sizes)]
    lines = [gmsh.model.geo.addLine(*ends) for ends in zip(points, points[1:] + points[:1])]
    gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    gmsh.model.geo.synchronize()
    for edge in lines[:foot]:
        gmsh.model.mesh.setTransfiniteCurve(edge, 2)
    gmsh.model.mesh.generate(2)
    tags, place, _ = gmsh.model.mesh.getNodes()
    nodes = gmsh.model.mesh.getElements(2)[2][0]
    gmsh.finalize()
    number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    number[tags] = np.arange(len(tags))
    return place.reshape(-1, 3)[:, :2].copy(), number[nodes.reshape(-1, 3)]


def body(points, cells, material, pressure):
    """Stiffness, load of a pressure on z = HEIGHT, over 2 pi, and nodes (n, 2) of a body of revolution."""
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    domain = mesh.create_mesh(MPI.COMM_SELF, cells=cells, e=element, x=points)
    space, r = fem.functionspace(domain, ("Lagrange", 2, (2,))), ufl.SpatialCoordinate(domain)[0]
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    shear = material.young / (2 * (1 + material.poisson))
    first = 2 * shear * material.poisson / (1 - 2 * material.poisson)

    def strain(u):
        plane = ufl.sym(ufl.grad(u))
        return ufl.as_tensor([[plane[0, 0], plane[0, 1], 0], [plane[1, 0], plane[1, 1], 0], [0, 0, u[0] / r]])

    stress = first * ufl.tr(strain(u)) * ufl.Identity(3) + 2 * shear * strain(u)
    matrix = assemble_matrix(fem.form(ufl.inner(stress, strain(v)) * r * ufl.dx(degree=6)))
    matrix.assemble()
    rows, columns, values = matrix.getValuesCSR()
    top = mesh.locate_entities_boundary(domain, 1, lambda x: x[1] > HEIGHT - 1e-6)
    tags = mesh.meshtags(domain, 1, np.sort(top), np.ones(len(top), dtype=np.int32))
    load = assemble_vector(
        fem.form(-fem.Constant(domain, pressure) * v[1] * r * ufl.Measure("ds", domain, subdomain_data=tags)(1))
    )
    return csr_matrix((values, columns, rows)), load.array.copy(), space.tabulate_dof_coordinates()[:, :2]


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
        body(*triangles(outline, some, len(r) - 1), MATERIALS[name], pressure)
        for outline, some, name, pressure in zip((punch, block), around, ("punch", "block"), (APPLIED, 0.0))
    ]
    (upper, load, above), (lower, _, below) = parts
    nodes = np.sort(np.concatenate([r, (r[1:] + r[:-1]) / 2]))
    first = cKDTree(above).query(np.stack([nodes, np.interp(nodes, r, gap(r))], axis=1))[1]
    second = cKDTree(below).query(np.stack([nodes, 0 * nodes], axis=1))[1] + len(above)
    positions, count = np.concatenate([above, below]), len(nodes)
    matrix = block_diag([upper, lower]).tocsr()
    load = np.concatenate([load, np.zeros(lower.shape[0])])
    held = np.stack([positions[:, 0] < 1e-9, positions[:, 1] < 1e-9 - BLOCK], axis=1).ravel()
    free, entries = np.flatnonzero(~held), np.concatenate([np.ones(count), -np.ones(count)])
    place = np.tile(np.arange(count), 2), 2 * np.concatenate([second, first]) + 1
    closing = coo_matrix((entries, place), shape=(count, len(load))).tocsr()
    active, before = nodes < FLAT + 0.4, None
    while before is None or (active != before).any():
        rows = closing[active][:, free]
        system = bmat([[matrix[free][:, free], rows.T], [rows, None]]).tocsc()
        solution = splu(system).solve(np.concatenate([load[free], gap(nodes)[active]]))
        u, force = np.zeros(len(load)), np.zeros(count)
        u[free], force[active] = np.split(solution, [len(free)])
        before, active = active, np.where(active, force > 0, closing @ u > gap(nodes) + 1e-12)
    return of_forces(r, nodes, force)


def of_forces(r, nodes, force):
    """Largest pressure and its radius, by the mass matrix of the closed nodes."""
    place, weight = np.polynomial.legendre.leggauss(5)
    x = (place + 1) / 2
    shape = np.stack([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)], axis=1)
    size = np.diff(r)[:, None]
    mass = np.einsum("eq,qi,qj->eij", weight / 2 * size * (r[:-1, None] + x * size), shape, shape)
    index = 2 * np.arange(len(size))[:, None] + np.arange(3)
    pairs = np.repeat(index, 3, axis=1).ravel(), np.tile(index, 3).ravel()
    closed = np.flatnonzero(force > 0)
    mass = coo_matrix((mass.ravel(), pairs)).tocsc()[closed][:, closed]
    pressure = splu(mass).solve(force[closed])
    return pressure.max(), nodes[closed[pressure.argmax()]]


def half_spaces(count=1000):
    """Largest pressure, its radius and the radius of contact between a rounded punch and a half-space."""
    modulus = 1 / sum((1 - m.poisson**2) / m.young for m in MATERIALS.values())
    force = np.pi * (FLAT + EDGE) ** 2 * APPLIED

    def profile(x):
        """The profile in one dimension, x int f'(r) / sqrt(x^2 - r^2) dr."""

        def slope(t):
            return (x * np.sin(t) - FLAT) / np.sqrt(EDGE**2 - (x * np.sin(t) - FLAT) ** 2)

        return x * quad(slope, np.arcsin(min(FLAT / x, 1.0)), np.pi / 2)[0]

    def excess(a):
        return 2 * modulus * (a * profile(a) - quad(profile, FLAT, a)[0]) - force

    radius = brentq(excess, FLAT + 1e-3, FLAT + 0.9 * EDGE)
    x = FLAT + (radius - FLAT) * np.linspace(0, 1, count) ** 1.5
    slopes = np.diff([profile(place) for place in x]) / np.diff(x)

    def pressure(r):
        """E* / pi int g'(x) / sqrt(x^2 - r^2) dx, with g linear between the places."""
        ends = np.maximum(x, r)
        return modulus / np.pi * slopes @ np.diff(np.log(ends + np.sqrt(ends**2 - r**2)))

    places = np.linspace(FLAT, radius, 400)
    values = [pressure(r) for r in places]
    return max(values), places[np.argmax(values)], radius


def main():
    """Print largest pressures and where they are."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument(
        "--size", type=float, nargs="+", default=(0.02, 0.01, 0.005), help="of triangles (%(default)s)"
    )
    for size in options.parse_args().size:
        print("triangles of {}: {:.1f} at {:.3f}".format(size, *largest_pressure(size)), flush=True)
    print("half-spaces: {:.1f} at {:.3f}, contact radius {:.3f}".format(*half_spaces()))


if __name__ == "__main__":
    main()
