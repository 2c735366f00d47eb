"""The dolfinx mesh of the leaves: nodes, volume, boundary, and the geometry order that suffices."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx.fem import Constant, assemble_scalar, form
from dolfinx.mesh import exterior_facet_indices
from model_problems import (
    DISTRIBUTIONS,
    gathered,
    grown,
    pressed,
    roots,
    shortest,
    two_boxes,
    vertex_positions,
    whole,
)
from mpi4py import MPI

from fx_contact.fem.leaf_mesh import create_leaf_mesh, sufficient_order
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import SIDE
from fx_contact.parallel.compat import geometry_nodes

pytestmark = pytest.mark.ranks(1, 2, 3)

ORDERS = [1, 2, 3, 4, 6]


def volume(mesh, order):
    """Volume of a mesh; the determinant of a map of order q has degree 3 q - 1 along each axis."""
    comm = MPI.COMM_SELF if mesh.comm.size == 1 else WORLD
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": max(3 * order - 1, 2)})
    return comm.allreduce(assemble_scalar(form(Constant(mesh, 1.0) * dx)))


def area(cells, forest, name, order):
    """Area of a named surface on a leaf mesh, by a rule as fine as the square root asks for."""
    facets = cells.facets(forest, forest.mesh.surface(name))
    cells.mesh.topology.create_connectivity(2, 3)
    rule = {"quadrature_degree": 4 * order + 4}
    ds = ufl.Measure("ds", cells.mesh, subdomain_data=[(1, facets.ravel())], metadata=rule)
    return forest.comm.allreduce(assemble_scalar(form(Constant(cells.mesh, 1.0) * ds(1)))), len(facets)


def bent(order, comm=WORLD, **options):
    """An unrefined forest of bent cells of an order, of bounded size for the high ones."""
    options = dict(upper=(1, 1, 1), margin=0, distortion=0.1) | options
    return roots(pressed(two_boxes(order=order, bend=0.2 if order > 1 else 0.0, **options)), comm)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("distribution", ["strewn", "contact-sfc"])
def test_cells_nodes_and_volume(order, distribution):
    """With q = p cells, node count and volume of a bent hanging mesh are right on any partition."""
    start = bent(order, upper=(2, 1, 1))
    exact = volume(create_leaf_mesh(bent(order, MPI.COMM_SELF, upper=(2, 1, 1)), order).mesh, order)
    forest = DISTRIBUTIONS[distribution](grown(start, 3, share=0.2))
    assert Prolongation(Space(forest, 1)).hanging_global > 20
    cells = create_leaf_mesh(forest, order)
    imap = cells.mesh.topology.index_map(3)
    everywhere(imap.size_local == len(forest) and imap.num_ghosts == 0, "cells are not this rank's leaves")
    assert imap.size_global == forest.size_global
    everywhere(np.array_equal(np.sort(cells.leaf), np.arange(len(forest))), "a leaf without a cell")
    alone = create_leaf_mesh(whole(forest), order).mesh
    for dimension in range(3):
        cells.mesh.topology.create_entities(dimension)
        alone.topology.create_entities(dimension)
    counts = [
        [
            *(mesh.topology.index_map(dimension).size_global for dimension in range(3)),
            mesh.geometry.index_map().size_global,
        ]
        for mesh in (cells.mesh, alone)
    ]
    everywhere(counts[0] == counts[1], f"{counts[0]} entities and geometry nodes, in serial {counts[1]}")
    vertices = len(np.unique(gathered(WORLD, forest.vertices.keys)))
    assert cells.mesh.topology.index_map(0).size_global == vertices
    assert abs(volume(cells.mesh, order) / exact - 1) < 1e-12
    if order == 3:
        assert abs(volume(create_leaf_mesh(forest, 1).mesh, 1) / exact - 1) > 1e-4, "q < p loses the geometry"


@pytest.mark.parametrize("order", ORDERS)
def test_leaf_maps_are_the_root_maps(order):
    """With q = p each node of each cell is where the root cell's map puts it; with q < p the corners still are."""
    forest = DISTRIBUTIONS["strewn"](grown(bent(order), 2))
    for q in {order, max(order - 1, 1)}:
        cells = create_leaf_mesh(forest, q)
        x = cells.mesh.geometry.x[geometry_nodes(cells.mesh)]
        corners = vertex_positions(forest)[forest.vertices.cells[cells.leaf]]
        everywhere(np.abs(x[:, :8] - corners).max(initial=0) < 1e-14, "a corner is not where its vertex is")
    cells = create_leaf_mesh(forest, order)
    low, side = forest.anchor[cells.leaf] / SIDE, 0.5 ** forest.level[cells.leaf].astype(float)
    line = np.linspace(0, 1, order + 1)
    expected = forest.mesh.evaluate(forest.cell[cells.leaf], low[:, :, None] + side[:, None, None] * line)
    x = cells.mesh.geometry.x[geometry_nodes(cells.mesh)]
    distance = np.abs(np.sort(x, axis=1) - np.sort(expected, axis=1)).max(initial=0)
    everywhere(distance < 1e-13, "nodes are not where the root map puts them")


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("distribution", ["strewn", "contact-sfc"])
def test_boundary(order, distribution):
    """The facets of each surface have its area, however refined; hanging facets are not among them."""
    options = dict(upper=(2, 1, 1), margin=int(order == 1))
    start = bent(order, MPI.COMM_SELF, **options)
    forest = DISTRIBUTIONS[distribution](grown(bent(order, **options), 2))
    fine, coarse = create_leaf_mesh(forest, order), create_leaf_mesh(start, order)
    fine.mesh.topology.create_connectivity(2, 3)
    fine.mesh.topology.create_connectivity(3, 2)
    facet = fine.mesh.topology.connectivity(3, 2).array.reshape(-1, 6)
    found, more = [], 0
    for name in forest.mesh.surfaces:
        expected, count = area(coarse, start, name, order)
        refined, now = area(fine, forest, name, order)
        assert abs(refined / expected - 1) < (1e-13 if order == 1 else 1e-5), name
        more += WORLD.allreduce(now) - count
        rows = fine.facets(forest, forest.mesh.surface(name))
        found.append(facet[rows[:, 0], rows[:, 1]])
    assert more > 20, "the boundary is not refined"
    found = np.unique(np.concatenate(found))
    outside = exterior_facet_indices(fine.mesh.topology)
    everywhere(np.isin(found, outside).all(), "an inner facet on a surface")
    assert WORLD.allreduce(len(outside)) > WORLD.allreduce(len(found)), "no hanging facets"
    true = forest.boundary_faces(np.argwhere(forest.mesh.face_neighbours == 1))
    everywhere(len(true[0]) == len(found), "surfaces miss a part of the boundary")


def test_sufficient_order():
    """Order 1 suffices for straight cells; the order falls as curved cells are refined, and grows with the demand."""
    for comm in (MPI.COMM_SELF, WORLD):
        assert sufficient_order(roots(pressed(two_boxes(distortion=0.2)), comm), 1e-12) == 1
        mesh = two_boxes(upper=(1, 1, 1), order=6, distortion=0.0)
        assert sufficient_order(roots(pressed(mesh), comm), 1e-12) == 1, "affine cells of order 6"
        forest = bent(6, comm)
        orders = [sufficient_order(forest, tolerance) for tolerance in (1.0, 1e-2, 1e-3, 1e-5, 1e-15)]
        assert orders == sorted(orders) and orders[0] == 1 and orders[-1] == 6 and len(set(orders)) > 3
        falling = [sufficient_order(forest, 1e-3)]
        for _ in range(3):
            forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
            falling.append(sufficient_order(forest, 1e-3))
        assert falling == sorted(falling, reverse=True) and falling[-1] < falling[0]


def test_sufficient_order_of_a_graded_forest():
    """Judged by ancestors, the order is the lowest with which every leaf itself is close enough to its root's map."""
    forest = bent(6)
    forest = DISTRIBUTIONS["strewn"](grown(forest.refined(np.ones(len(forest), dtype=bool))[0], 3, share=0.2))
    assert WORLD.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX) > 2
    low, side = forest.anchor / SIDE, 0.5 ** forest.level.astype(float)

    def positions(line):
        return forest.mesh.evaluate(forest.cell, low[:, :, None] + side[:, None, None] * line)

    line = np.linspace(0, 1, 13)
    exact = positions(line)
    size, chosen, deviation = shortest(exact), set(), np.zeros(7)
    for order in range(1, 6):
        functions = (hexahedron.lagrange(order, line),) * 3
        error = hexahedron.tensor_evaluate(functions, positions(np.linspace(0, 1, order + 1))) - exact
        largest = (np.linalg.norm(error, axis=2).max(axis=1) / size).max(initial=0)
        deviation[order] = WORLD.allreduce(float(largest), op=MPI.MAX)
    for order in range(1, 6):
        q = sufficient_order(forest, 1.05 * deviation[order])
        assert q <= order and deviation[q] <= 1.1 * deviation[order], (q, order, deviation)
        chosen.add(q)
    assert len(chosen) > 2


@pytest.mark.parametrize("order", [1, 3, 6])
def test_evaluate(order):
    """Lattices that share coordinates in a root cell are where the sum over all nodes puts them, in any order."""
    mesh, random = bent(order, MPI.COMM_SELF).mesh, np.random.default_rng(order)
    cells = random.integers(len(mesh.cells), size=200)
    coordinates = random.choice(np.linspace(0, 1, 5), size=(200, 3, 2))
    fx, fy, fz = (hexahedron.lagrange(order, coordinates[:, axis]) for axis in range(3))
    nodal = mesh.points[mesh.cells[cells]].reshape(200, *[order + 1] * 3, 3)
    expected = np.einsum("nck,nbj,nai,nkjid->ncbad", fz, fy, fx, nodal, optimize=True).reshape(200, 8, 3)
    assert np.abs(mesh.evaluate(cells, coordinates) - expected).max() < 1e-13
    assert mesh.evaluate(cells[:0], coordinates[:0]).shape == (0, 8, 3)


def test_deep_leaves():
    """Leaves eleven levels deep keep exact corners; the mesh of the forest is valid."""
    forest = bent(2)
    for _ in range(11):
        forest, _ = forest.refined((forest.anchor == 0).all(axis=1) & (forest.cell == 0))
    exact = volume(create_leaf_mesh(bent(2, MPI.COMM_SELF), 2).mesh, 2)
    cells = create_leaf_mesh(DISTRIBUTIONS["contact-sfc"](forest), 2)
    assert abs(volume(cells.mesh, 2) / exact - 1) < 1e-12
    assert WORLD.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX) == 11


@pytest.mark.parametrize("where", [0, -1])
def test_one_curved_cell_decides_for_all_ranks(where):
    """The order is the same on all ranks, whichever of them has the cell that needs it."""
    mesh = two_boxes(order=2, distortion=0.0)
    cell, face = np.argwhere(mesh.face_neighbours == 1)[where]
    middle = hexahedron.face_nodes(2)[face][4]
    points = mesh.points.copy()
    points[mesh.cells[cell, middle]] += 0.05
    scene = pressed(two_boxes(order=2, distortion=0.0), contact=False)
    forest = roots(replace(scene, mesh=replace(mesh, points=points)))
    assert WORLD.allgather(sufficient_order(forest, 1e-3)) == [2] * WORLD.size
    assert WORLD.allgather(sufficient_order(forest, 0.5)) == [1] * WORLD.size
