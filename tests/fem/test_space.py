"""Nodes of a degree: polynomials of that degree pass through children and hanging nodes exactly."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, gathered, grown, pressed, roots, two_boxes

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space, child_error
from fx_contact.geometry import hexahedron

pytestmark = pytest.mark.ranks(1, 2, 3)


def polynomial(points, degree):
    """A function of a degree in each coordinate, at points (..., 3)."""
    x, y, z = np.moveaxis(points, -1, 0)
    return (1 + x) ** degree * (2 - y) ** degree * (0.5 + z) ** degree


def affine_forest(distribution="contact-sfc"):
    """A refined forest of unit cells, on which leaves differ in level."""
    scene = pressed(two_boxes(upper=(2, 2, 2), depth=1, distortion=0.0), contact=True)
    return DISTRIBUTIONS[distribution](grown(roots(scene), 3))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_polynomials_through_hanging_nodes(degree, distribution):
    """P gives a polynomial of the degree at all nodes from its values at the conforming ones; weights sum to one."""
    space = Space(affine_forest(distribution), degree)
    prolongation = Prolongation(space)
    assert prolongation.hanging_global > 50
    exact = polynomial(space.positions(), degree)[:, None]
    found = prolongation.prolong(prolongation.injected(exact))
    everywhere(np.abs(found - exact).max(initial=0) < 1e-12 * 100, "a polynomial is not reproduced")
    everywhere(np.abs(prolongation.matrix.sum(axis=1) - 1).max() < 1e-14, "a row of P does not sum to one")


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_are_shared(degree):
    """The nodes of a box of n cells an edge without hanging ones are (p n + 1)^3 of it, counted once."""
    scene = pressed(two_boxes(upper=(2, 2, 2), depth=2, distortion=0.0), contact=False)
    forest, _ = roots(scene).refined(np.ones(len(roots(scene)), dtype=bool))
    prolongation = Prolongation(Space(forest, degree))
    assert prolongation.hanging_global == 0
    assert prolongation.index_map.size_global == 2 * (4 * degree + 1) ** 3


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_that_hang(degree):
    """Of a leaf beside eight children all nodes of their face hang but its own: (2p+1)^2 - (p+1)^2."""
    forest = roots(pressed(two_boxes(upper=(2, 1, 1), distortion=0.0), contact=False))
    upper = forest.mesh.body[forest.cell] == forest.mesh.bodies.index("upper")
    numbers = WORLD.allgather(forest.cell[upper].tolist())
    forest, _ = forest.refined(forest.cell == min(sum(numbers, [])))
    assert Prolongation(Space(forest, degree)).hanging_global == (2 * degree + 1) ** 2 - (degree + 1) ** 2


def test_facing_nodes_are_owned_together():
    """A rank that owns a node of a contact surface owns the one that faces it, middles too."""
    space = Space(affine_forest(), 2)
    prolongation, forest = Prolongation(space), space.forest
    leaf, face = forest.contact_faces()
    mine, facing = space.on_faces(leaf, face).ravel(), space.find(space.facing(leaf, face).ravel())
    known = facing >= 0
    conforming = prolongation.conforming[mine[known]], prolongation.conforming[facing[known]]
    assert WORLD.allreduce(int(known.sum())) > 0
    everywhere(((conforming[0] < 0) == (conforming[1] < 0)).all(), "a node hangs, and not the one that faces it")
    together = [(place < prolongation.owned) for place in conforming]
    everywhere((together[0] == together[1]).all(), "facing nodes have two owners")


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_children_take_the_function_of_their_parent(degree):
    """Local: the values of a polynomial at the nodes of a child, from those of the cell."""
    nodes = hexahedron.grid_points(degree) / degree
    for child, table in enumerate(hexahedron.child_interpolation(degree)):
        inside = (hexahedron.CORNERS[child] + nodes) / 2
        assert np.abs(table @ polynomial(nodes, degree) - polynomial(inside, degree)).max() < 1e-12


@pytest.mark.parametrize("degree, shares", [(1, [1 / 2, 1 / 2]), (2, [1 / 6, 2 / 3, 1 / 6])])
def test_gauss_rule_of_a_facet(degree, shares):
    """It gives the nodes of a flat facet their shares by the trapezoidal rule or Simpson's, and slopes.

    It is exact for polynomials of degree 2 p + 1 along each axis, and not for the next even one.
    """
    space = Space(affine_forest(), degree)
    weights, value, along_u, along_v = space.facet_rule
    assert np.abs(weights @ value - np.outer(shares, shares).ravel()).max() < 1e-15
    v, u = (x.ravel() / degree for x in np.mgrid[: degree + 1, : degree + 1])
    assert np.abs(along_u @ u - 1).max() < 1e-14 and np.abs(along_u @ v).max() < 1e-14
    assert np.abs(along_v @ v - 1).max() < 1e-14 and np.abs(along_v @ u).max() < 1e-14
    x, y = value @ u, value @ v
    for power, other in np.ndindex(2 * degree + 2, 2 * degree + 2):
        assert abs(weights @ (x**power * y**other) - 1 / ((power + 1) * (other + 1))) < 1e-15
    assert abs(weights @ x ** (2 * degree + 2) - 1 / (2 * degree + 3)) > 1e-4


def test_names_do_not_depend_on_the_ranks():
    """All ranks together have the same nodes, however the leaves are dealt out."""
    keys = [np.unique(gathered(WORLD, Space(affine_forest(name), 2).keys)) for name in DISTRIBUTIONS]
    assert all(np.array_equal(keys[0], other) for other in keys[1:])


@pytest.mark.parametrize("degree", [1, 2])
def test_error_of_a_child(degree):
    """Local: of x^(p+1), interpolated, the energy of the error in a cell of half the size is the stated part."""
    x, w = np.polynomial.legendre.leggauss(8)
    x, w = (x + 1) / 2, w / 2
    nodes = np.linspace(0, 1, degree + 1)

    def error2(size):
        slope = (degree + 1) * (size * x) ** degree
        interpolated = hexahedron.lagrange_derivative(degree, x) @ (size * nodes) ** (degree + 1) / size
        return size**3 * w @ (slope - interpolated) ** 2

    assert abs(child_error(degree) / (error2(0.5) / error2(1.0)) - 1) < 1e-12
