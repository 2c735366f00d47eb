"""True energy errors of HERTZ-A by an axisymmetric solution, and the unknowns that an error takes.

The reference is that of `studies.incompressible.axisymmetric`, Taylor and Hood's triangles, graded towards the edge of
the contact; no part of it is the package's. Its own error is 0.01 %, by meshes of twice its sizes. Its strain is
compared with that of the hexahedra at (p + 2)^3 Gauss points of each. "constant" is e N^(2/3), with the true error e in
per cent and N in thousands: the same for all meshes at the optimal rate of degree 2. "edge" are the leaves where closed
and open nodes meet.

    python3 -m studies.effectivity.hertz_truth [--only WORD]    # a quarter of an hour

It leaves hertz_truth.csv in results/effectivity. `studies.work_precision.run` takes its true errors from the kept one.
"""

from functools import partial

import basix
import numpy as np
import ufl
from basix.ufl import element
from dolfinx import fem, geometry
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact import solve
from fx_contact.adaptive.beginning import Beginning
from fx_contact.scenes import hertz
from studies.incompressible.axisymmetric import MOVED, half_disc, solved
from studies.tables import options, tabulate

#: By degree; the last one of degree 2 is for a true error of 0.1 %.
TOLERANCES = {2: (0.08, 0.04, 0.028, 0.02, 0.014, 0.01, 0.007, 0.005, 0.003, 0.0014), 1: (0.16, 0.08, 0.04, 0.028)}
#: Root cells along a block, as in `demos/hertz.py`; those of uniform meshes and straight cells.
COARSE, UNIFORM = {1: 4, 2: 2}, 4
POISSON = 0.3
SHEAR, FIRST = 1 / (2 * (1 + POISSON)), POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
#: Points at once.
CHUNK = 1 << 17


class Truth:
    """Strain of the axisymmetric solution."""

    def __init__(self, cells, far=0.1, edge=None):
        self.mesh = half_disc(cells, far, edge)
        found, self.force, _ = solved(POISSON, self.mesh)
        displacement = found.sub(0).collapse()
        points = element("DG", "triangle", 2).basix_element.points
        slopes = fem.functionspace(self.mesh, ("DG", 2, (4,)))
        gradient, self.slopes = ufl.grad(displacement), fem.Function(slopes)
        columns = ufl.as_vector([gradient[i, j] for i, j in ((0, 0), (0, 1), (1, 0), (1, 1))])
        self.slopes.interpolate(fem.Expression(columns, points))
        self.displacement, self.tree = displacement, geometry.bb_tree(self.mesh, 2)
        count = self.mesh.topology.index_map(2).size_local
        self.middles = geometry.create_midpoint_tree(self.mesh, 2, np.arange(count, dtype=np.int32))

    def at(self, points):
        """Strain (n, 3, 3) at points (n, 3) of both half-spheres."""
        radius, side = np.hypot(points[:, 0], points[:, 1]), np.where(points[:, 2] < 0, -1.0, 1.0)
        plane = np.column_stack([radius, np.abs(points[:, 2]), np.zeros(len(points))])
        near = geometry.compute_colliding_cells(
            self.mesh, geometry.compute_collisions_points(self.tree, plane), plane
        )
        cells = np.full(len(points), -1, dtype=np.int32)
        some = np.diff(near.offsets) > 0
        cells[some] = near.array[near.offsets[:-1][some]]
        lost = np.flatnonzero(~some)  # between the arc and its chords
        cells[lost] = geometry.compute_closest_entity(self.tree, self.middles, self.mesh, plane[lost])
        (rr, rz, zr, zz), outward = self.slopes.eval(plane, cells).T, self.displacement.eval(plane, cells)[:, 0]
        along = np.column_stack([points[:, 0] / radius, points[:, 1] / radius, np.zeros(len(points))])
        up = np.column_stack([np.zeros((len(points), 2)), side])
        around = np.cross(up, along)
        parts = (rr, along, along), (zz, up, up), (outward / radius, around, around)
        parts += ((rz + zr) / 2, along, up), ((rz + zr) / 2, up, along)
        return sum(np.einsum("n,ni,nj->nij", value, one, other) for value, one, other in parts)


def errors(step, truth):
    """Squared energy errors of the cells (n,), and the squared energy norm, of the modelled quarter."""
    mesh = step.mesh
    points, weights = basix.make_quadrature(basix.CellType.hexahedron, 2 * step.record.degree + 2)
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    strain = ufl.sym(ufl.grad(step.displacement))
    columns = [ufl.SpatialCoordinate(mesh)[i] for i in range(3)] + [strain[i, j] for i in range(3) for j in range(3)]
    values = fem.Expression(ufl.as_vector([*columns, abs(ufl.JacobianDeterminant(mesh))]), points)
    squared, total, each = np.zeros(len(cells)), 0.0, max(CHUNK // len(points), 1)
    for start in range(0, len(cells), each):
        part = cells[start : start + each]
        found = values.eval(mesh, part).reshape(len(part) * len(points), 13)
        exact = truth.at(found[:, :3])
        volume = found[:, 12] * np.tile(weights, len(part))
        squared[part] = (
            (_energy(found[:, 3:12].reshape(-1, 3, 3) - exact) * volume).reshape(len(part), -1).sum(axis=1)
        )
        total += _energy(exact) @ volume
    return squared, total


def _energy(strain):
    """Twice the density of strain energy (n,) of strains (n, 3, 3)."""
    return 2 * SHEAR * np.einsum("nij,nij->n", strain, strain) + FIRST * np.trace(strain, axis1=1, axis2=2) ** 2


def at_edge(step):
    """Leaves (n,), in the order of the mesh, with closed and open nodes."""
    rows, space = step.rows, step.rows.prolongation.space
    result = np.zeros(len(step.forest), dtype=bool)
    leaf, face = rows.kinds[0].facets(step.forest)
    closed = rows.at_nodes(0, step.solution.active[:, None].astype(float))[:, 0][space.on_faces(leaf, face)] > 0.5
    first = closed.any(axis=1) & ~closed.all(axis=1)
    centres = step.forest.centres
    mirrored = centres[leaf[first]] * [1, 1, -1]  # the lower half-sphere has the rows
    result[leaf[first]] = True
    result |= cKDTree(mirrored).query(centres)[0] < 1e-9
    return result[step.leaf_mesh.leaf]


def cases():
    """Line of the plots, degree, tolerance or levels -> function that gives the last step."""
    for degree, tolerances in TOLERANCES.items():
        scene = hertz(displacement=2 * MOVED, order=6, coarse=COARSE[degree])
        for tolerance in tolerances:
            yield f"degree {degree}", degree, tolerance, partial(
                solve, scene, tolerance, MPI.COMM_SELF, degree=degree
            )
    scene = hertz(displacement=2 * MOVED, order=6, coarse=UNIFORM)
    for degree, levels in ((2, 0), (2, 1), (2, 2), (1, 1), (1, 2)):
        yield f"uniform, degree {degree}", degree, levels, partial(uniform, scene, levels, degree)
    scene = hertz(displacement=2 * MOVED, order=1, coarse=UNIFORM)
    for tolerance in (0.16, 0.04):
        yield "straight cells, degree 2", 2, tolerance, partial(solve, scene, tolerance, MPI.COMM_SELF)


def uniform(scene, levels, degree):
    """The solution on root cells that are refined so many times."""
    beginning = Beginning.uniform(scene, levels, MPI.COMM_SELF)
    return solve(scene, 0.04, MPI.COMM_SELF, degree=degree, beginning=beginning, max_steps=1)


def figures(step, truth):
    """Columns of a step."""
    squared, total = errors(step, truth)
    edge, estimated, record = at_edge(step), step.estimate.error**2, step.record
    true = float(np.sqrt(squared.sum() / total))
    return {
        "cells": record.cells,
        "dofs": record.dofs,
        "estimate": record.estimate,
        "true_error": true,
        "effectivity": record.estimate / true,
        "constant": 100 * true * (record.dofs / 1000) ** (2 / 3),
        "edge_cells": int(edge.sum()),
        "edge_share": float(squared[edge].sum() / squared.sum()),
        "edge_effectivity": float(np.sqrt(estimated[edge].sum() / squared[edge].sum())),
    }


def main():
    """Solve and write the table."""
    parser = options(__doc__, "effectivity")
    parser.add_argument("--only", default="", help="lines with this word in their name")
    parser.add_argument("--cells", type=int, default=120, help="of the reference along the contact's radius")
    parser.add_argument("--far", type=float, default=0.0125, help="size of its cells far away")
    parser.add_argument("--edge", type=float, default=2e-5, help="size of its cells at the edge of the contact")
    given = parser.parse_args()
    truth = Truth(given.cells, given.far, given.edge)
    print(f"reference: force {truth.force:.6e}", flush=True)
    rows = (
        {"line": line, "degree": degree, "tolerance": tolerance} | figures(solved_case(), truth)
        for line, degree, tolerance, solved_case in cases()
        if given.only in line
    )
    tabulate(rows, given.output / "hertz_truth.csv")


if __name__ == "__main__":
    main()
