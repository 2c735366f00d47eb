"""The pressure at the nodes, from the forces of rows."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import grown, pressed, prolongation_of, roots, side_by_side, two_boxes
from mpi4py import MPI

from fx_contact import (
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    RigidPlane,
    Scene,
    SymmetryPlane,
    block,
    join,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.contact.contact_facets import positions_across
from fx_contact.contact.pressure import leaves_of_rows, pressure_change
from fx_contact.contact.row_kinds import create_rows

pytestmark = pytest.mark.ranks(1, 2, 3)

SIZE = 0.5
"""Of the facets, squares, where nothing is refined at random [m]."""


def pairs_of(scene, degree, rounds=0):
    """NodePairs of a scene whose root cells are halved, and then so many times refined at random."""
    forest = roots(scene)
    forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
    prolongation = prolongation_of(scene, grown(forest, rounds), degree)
    return create_rows(scene, prolongation, Enforcement())


def forces(pairs, pressure):
    """Integrals of pressure(x, y) times the functions of the pairs' nodes, where no node hangs: (n,) float64 [N]."""
    prolongation, space = pairs.prolongation, pairs.prolongation.space
    weights, value, _, _ = space.facet_rule
    result = np.zeros(len(pairs))
    for kind in pairs.kinds:
        leaf, face = kind.facets(space.forest)
        here, _ = positions_across(space.forest, leaf, face, space.points[leaf[:, None], space.face_nodes[face]])
        x, y, _ = np.moveaxis(value @ here, 2, 0)
        sums, ours = np.zeros((len(space), 1)), pairs.contact == kind.index
        np.add.at(sums[:, 0], space.on_faces(leaf, face), (SIZE**2 * weights * pressure(x, y)) @ value)
        result[ours] = prolongation.ghosted(prolongation.restrict(sums))[pairs.first[ours], 0]
    return result


@pytest.mark.parametrize("scene", [pressed(two_boxes()), side_by_side()], ids=["one pair", "two pairs"])
def test_quadratic_pressure(scene):
    """It is exact; force over area is off by -h^2 p''/20 at vertices and by h^2 p''/40 at middles."""

    def pressure(x, y):
        return 1 + 0.3 * x * (2 - x) + 0.1 * x * y

    pairs = pairs_of(scene, 2)
    force, exact = forces(pairs, pressure), pressure(*pairs.position.T[:2])
    middle = np.abs(pairs.position[:, 0] / SIZE % 1 - 0.5) < 1e-9
    off = -0.6 * SIZE**2 * np.where(middle, 1 / 40, -1 / 20)
    everywhere(np.abs(force / pairs.area - exact - off).max(initial=0.0) < 1e-12, "off by something else")
    everywhere(np.abs(pairs.pressure(force) - exact).max(initial=0.0) < 1e-12, "not exact")
    everywhere(np.abs(pressure_change(pairs, exact) - off).max(initial=0.0) < 1e-12, "another change")


def test_change_of_a_pressure_at_degree_1():
    """It is h^2 p''/6 between facets, and 0 of a pressure that is constant in the other direction."""
    pairs = pairs_of(pressed(two_boxes()), 1)
    x = pairs.position[:, 0]
    inside = (x > x.min(initial=0.0) + 1e-9) & (x < WORLD.allreduce(x.max(initial=0.0), op=MPI.MAX) - 1e-9)
    change = pressure_change(pairs, 1 + 0.3 * x**2)
    assert WORLD.allreduce(inside.sum()) > 0
    everywhere(np.abs(change[inside] - SIZE**2 * 0.1).max(initial=0.0) < 1e-12, f"{change}")


@pytest.mark.parametrize("rounds", [0, 2])
def test_leaves_of_rows(rounds):
    """Leaves that touch the node of a row; with hanging nodes those too that have nodes hanging on it."""
    pairs = pairs_of(pressed(two_boxes()), 2, rounds)
    far = WORLD.allreduce(pairs.position.sum(axis=1).max(initial=-np.inf), op=MPI.MAX)
    corner = pairs.position.sum(axis=1) > far - 1e-9
    assert WORLD.allreduce(corner.sum()) == 1
    facets = [len(kind.facets(pairs.prolongation.space.forest)[0]) for kind in pairs.kinds]
    counts = [len(leaves_of_rows(pairs, some)) for some in (corner, corner | True, corner & False)]
    assert WORLD.allreduce(np.array(counts)).tolist() == [1, WORLD.allreduce(sum(facets)), 0]


@pytest.mark.parametrize("degree", [1, 2])
def test_uniform_pressure(degree):
    """It stays, on facets of several sizes too; their nodes have positive areas, that of the surface together."""
    pairs = pairs_of(pressed(two_boxes()), degree, rounds=2)
    prolongation = pairs.prolongation
    leaf, face = pairs.kinds[0].facets(prolongation.space.forest)
    hanging = prolongation.hanging[prolongation.space.on_faces(leaf, face)].any()
    assert WORLD.allreduce(int(hanging)), "no contact facet has a hanging node"
    assert abs(WORLD.allreduce(float(pairs.area.sum())) - 4) < 1e-12
    everywhere((pairs.area > 0).all(), "an area that is not positive")
    everywhere(np.abs(pairs.pressure(3 * pairs.area) - 3).max(initial=0.0) < 1e-12, "not uniform")


def test_degree_1():
    """The pressure is force over area, whatever the force."""
    pairs = pairs_of(pressed(two_boxes()), 1, rounds=2)
    force = np.sin(1e3 * pairs.position[:, 0])
    everywhere(np.array_equal(pairs.pressure(force), force / pairs.area), "another pressure")


def test_where_the_pressure_is_not_smooth():
    """No pressure changes by more than a tenth, and none on facets with an open node."""
    pairs = pairs_of(pressed(two_boxes()), 2)
    x, y, _ = pairs.position.T
    raw = 2 + np.sin(1e3 * x + 1e4 * y)
    change = np.abs(pairs.pressure(raw * pairs.area) / raw - 1)
    everywhere(change.max(initial=0.0) < 0.1 * (1 + 1e-12), "too large a change")
    assert WORLD.allreduce(float(change.max(initial=0.0)), MPI.MAX) > 0.05
    raw = np.where(np.minimum(x % SIZE, y % SIZE) < 1e-9, 0.0, raw)  # the middles of facets alone
    everywhere(np.array_equal(pairs.pressure(raw * pairs.area), raw * pairs.area / pairs.area), "a change")


@pytest.mark.parametrize("bonded", [True, False], ids=["parts", "bodies"])
def test_a_jump_of_the_pressure(bonded):
    """Bars of unlike modulus below a stiff lid: beside the jump exact, at it the mean if the bars are bonded."""
    shapes = {name: block((x, 0, 0), (x + 1, 1, 1), (2, 2, 2), 1) for x, name in enumerate(("soft", "hard"))}
    names = ("soft", "hard")
    if bonded:
        shapes, names = {"bars": join(*(shape.as_part(name) for name, shape in shapes.items()))}, (
            "bars soft",
            "bars hard",
        )
    lid = RigidPlane((0, 0, 1), (0, 0, -1))
    held = [Dirichlet(f"{name} bottom", z=0.0) for name in shapes] + [
        SymmetryPlane(f"{name} front") for name in shapes
    ]
    pairs = tuple(ContactPair(f"{name} top", lid, moved=(0, 0, -0.01)) for name in shapes)
    materials = dict(zip(names, (Material(1.0, 0.0), Material(3.0, 0.0))))
    step = solve(Scene("bars", root_mesh_from_shapes(shapes), materials, tuple(held), pairs), 0.5, max_steps=2)
    x = step.contact.points[:, 0]
    exact = np.where(x > 1 + 1e-9, 0.03, np.where(x < 1 - 1e-9, 0.01, 0.02 if bonded else step.contact.pressure))
    everywhere(np.abs(step.contact.pressure / exact - 1).max(initial=0.0) < 1e-6, "pressures")
