"""Prescribed displacements: which conforming vertices a named surface, curve or vertex has."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, conforming_positions, grown, pressed, roots, two_boxes

from fx_contact import Dirichlet, Traction
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.parallel.errors import SceneError
from fx_contact.scenes import hertz, indentation

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("make", [hertz, indentation])
def test_curves(make, distribution):
    """Sideways conditions along the axis and a side hold all conforming vertices there, and no others."""
    scene = make(order=2, coarse=2, symmetry="full")
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2))
    prolongation = Prolongation(Space(forest, 1))
    assert prolongation.hanging_global > 0
    prescribed = find_supports(scene, forest, prolongation).prescribed
    position, _ = conforming_positions(forest, prolongation)
    on_axis = np.abs(position[:, :2]).max(axis=1) < 1e-9
    everywhere(((~np.isnan(prescribed[:, 0])) == on_axis).all(), "x is not held just along the axis")
    held = WORLD.allreduce(int((~np.isnan(prescribed[:, 1])).sum()))
    assert held > WORLD.allreduce(int(on_axis.sum())) > 5, "y is held along a side too"
    everywhere((np.abs(position[~np.isnan(prescribed[:, 1]), 1]) < 1e-9).all(), "y is held off the plane y = 0")


@pytest.mark.parametrize("turned", [False, True], ids=["as it is", "turned round"])
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_conditions_that_differ_between_root_nodes(distribution, turned):
    """Two functions that meet along an edge must agree at all its vertices, whichever ranks have its faces."""
    scene = pressed(two_boxes(distortion=0.0), approach=0.01)

    def values(bump, levels):
        side = Dirichlet("upper y low", z=lambda x: -0.005 * x[2] + bump * np.sin(np.pi * x[0]) ** 2)
        order = slice(None, None, -1 if turned else 1)
        bumpy = replace(scene, dirichlet=(*scene.dirichlet, side)[order])
        forest = DISTRIBUTIONS[distribution](grown(roots(bumpy), levels))
        prolongation = Prolongation(Space(forest, 1))
        prescribed = find_supports(bumpy, forest, prolongation).prescribed
        position, _ = conforming_positions(forest, prolongation)
        top = position[:, 2] > 2 - 1e-9
        everywhere(np.abs(prescribed[top, 2] + 0.01).max(initial=0.0) < 1e-12, "not what is prescribed")
        side = (position[:, 2] > 1e-9) & (np.abs(position[:, 1]) < 1e-9)
        everywhere(np.abs(prescribed[side, 2] + 0.005 * position[side, 2]).max(initial=0.0) < 1e-12, "nor there")

    values(bump=0.0, levels=3)
    values(bump=1e-3, levels=0)
    said = ("-0.01", "upper z high"), (r"-0.00\d+", "upper y low")
    (first, here), (second, _) = said[:: 1 if turned else -1]
    message = rf"component z on '{here}' is prescribed as {first} where .* says {second}, at \["
    with pytest.raises(SceneError, match=message + r" *[01]\.\d+.* (-?0\.|.*e-\d+) +2\..*\]"):
        values(bump=1e-3, levels=3)


def held_above(*held, order=1):
    """Two boxes with conditions on the top, and one side of the upper box clamped."""
    scene = pressed(two_boxes(order=order, distortion=0.0), approach=0.01)
    others = [condition for condition in scene.dirichlet if condition.where != "upper z high"]
    above = [Dirichlet("upper z high", **values) for values in held]
    return replace(scene, dirichlet=(*others, Dirichlet("upper y low", 0.0, 0.0, -0.01), *above))


@pytest.mark.parametrize(
    "held, free",
    [
        ([{"z": -0.01}], True),
        ([{"x": 0.0, "y": 0.0, "z": -0.01}], False),
        ([{"z": -0.01}, {"x": 0.0}], False),
        ([{"x": 0.0}, {"z": -0.01}], False),
        ([{"x": 0.0}], False),
    ],
    ids=["across", "clamped", "two conditions", "two, in another order", "along"],
)
def test_planes_without_shear_stress(held, free):
    """A plane that is held across alone has none, whatever else is prescribed elsewhere."""
    scene = held_above(*held)
    forest = grown(roots(scene), 1)
    prolongation = Prolongation(Space(forest, 1))
    along_z = find_shear_free(scene, forest, prolongation).across[:, 2]
    height = conforming_positions(forest, prolongation)[0][:, 2]
    everywhere((along_z[height > 2 - 1e-9] == free).all(), "at the top")
    everywhere(not along_z[np.abs(height - 1.5) < 0.4].any(), "between")


def bulged(scene):
    """The scene with a curved top, whose mean normal lies along an axis, as at the pole of a sphere."""
    points = scene.mesh.points.copy()
    points[:, 2] += np.where(points[:, 2] > 1.5, 0.1 * np.sin(np.pi * points[:, 0]) ** 2, 0.0)
    return replace(scene, mesh=replace(scene.mesh, points=points))


@pytest.mark.parametrize(
    "scene",
    [
        replace(held_above({"z": -0.01}), tractions=(Traction("upper z high", (1e-3, 0.0, 0.0)),)),
        bulged(held_above({"z": -0.01}, order=2)),
    ],
    ids=["under a traction", "curved"],
)
def test_planes_with_shear_stress(scene):
    """Though held across alone."""
    forest = grown(roots(scene), 1)
    across = find_shear_free(scene, forest, Prolongation(Space(forest, 1))).across
    everywhere(not across[:, 2].any(), "no shear stress")
