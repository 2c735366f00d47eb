"""Pressure and gap along a line on a contact surface."""

import gc
from functools import cache

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import pressed, two_boxes
from mpi4py import MPI

from fx_contact import SceneError, solve
from fx_contact.adaptive.contact_line import FacetValues, check_line, cut_line
from fx_contact.scenes import hertz, stack

pytestmark = pytest.mark.ranks(1, 2)


@cache
def last_step(degree=2):
    """Half-spheres with hanging contact nodes."""
    return solve(hertz(order=3, coarse=2), 0.2, WORLD, degree=degree)


def facets(points):
    """Facets (m, 9, 3) in the plane z = 0, with the pressure x + 2 y and the gap -x."""
    return FacetValues(points, points @ [1.0, 2, 0], -points[..., 0], np.tile([0.0, 0, 1], (len(points), 1)))


def test_linear_values():
    """Two facets, one on each rank: crossings of all lines between nodes, inside the line, each once, in order."""
    y, x = (axis.ravel() for axis in np.meshgrid(*[[0.0, 0.5, 1.0]] * 2, indexing="ij"))
    one = np.stack([x, y, 0 * x], axis=1)
    both = np.stack([one, one + [1, 0, 0]])
    mine = both if WORLD.size == 1 else both[WORLD.rank : WORLD.rank + 1]
    line = check_line((0.25, 0.25, 0.7), (1.75, 1.0, 0.7))
    found = cut_line(WORLD, facets(mine), line, np.array([0.0, 0, 1]))
    assert np.allclose(found.points[:, 0], [0.5, 0.75, 1.0, 1.5, 1.75])
    assert np.allclose(found.points[:, 1], 0.125 + found.points[:, 0] / 2) and (found.points[:, 2] == 0).all()
    assert np.allclose(found.distance, (found.points[:, 0] - 0.25) * np.sqrt(1.25))
    assert np.allclose(found.pressure, found.points @ [1, 2, 0]) and np.allclose(found.gap, -found.points[:, 0])
    along = cut_line(WORLD, facets(mine), check_line((0.0, 0.5, 0), (2, 0.5, 0)), np.array([0.0, 0, 1]))
    assert np.allclose(along.points[:, 0], [0, 0.5, 1, 1.5, 2]), "a line along lines between nodes"
    with pytest.raises(SceneError, match="does not meet the contact surface"):
        cut_line(WORLD, facets(mine), line, np.array([0.0, 0, -1]))


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_on_a_line(degree):
    """Along the edge of the quarter: the nodes of the table, hanging ones between them, on any number of ranks."""
    step = last_step(degree)
    line = step.contact.along((0, 0, 0), (0.4, 0, 0))
    table = WORLD.bcast(step.contact.gathered())
    on = np.flatnonzero((np.abs(table.points[:, 1]) < 1e-12) & (table.points[:, 0] < 0.4))
    assert len(on) > 5 and line.distance[0] == 0 and (np.diff(line.distance) > 0).all()
    at = np.abs(table.points[on, :1] - line.distance).argmin(axis=1)
    assert np.allclose(line.points[at], table.points[on], atol=1e-12)
    assert np.allclose(line.pressure[at], table.pressure[on], atol=1e-12)
    assert np.allclose(line.gap[at], table.gap[on], atol=1e-12)
    assert line.pressure[0] > 0.95 * step.record.max_pressure and line.pressure[-1] == 0 < line.gap[-1]
    everywhere(WORLD.bcast(line.pressure).tolist() == line.pressure.tolist(), "another line")


def test_line_of_the_nearest_contact():
    """Of several contacts the one at the middle of the line counts; a line beside the surface is moved onto it."""
    step = solve(stack(cells=(2, 2, 1)), 0.9, WORLD, max_steps=1, degree=1)
    for contact, place in enumerate(step.scene.contact):
        height = step.scene.mesh.facet_points(step.scene.mesh.surface(place.first), 1)[0, 0, 2]
        line = step.contact.along((0, 0.3, height + 0.1), (0.5, 0.1, height + 0.1))
        assert np.allclose(line.points[:, 2], height) and line.distance[0] == 0
        assert np.allclose(line.pressure, step.record.max_pressure) and np.abs(line.gap).max() < 1e-9
    assert contact == 1


def test_lines_that_are_none():
    """Perpendicular to the surface, beside it, without contact, and after the step."""
    step = last_step()
    with pytest.raises(SceneError, match="perpendicular to the contact surface"):
        step.contact.along((0, 0, 0), (0, 0, 1))
    with pytest.raises(SceneError, match="does not meet the contact surface"):
        step.contact.along((-2, 0, 0), (-1, 0, 0))
    alone = solve(pressed(two_boxes(margin=1), contact=False), 0.9, max_steps=1)
    with pytest.raises(SceneError, match="no contact pairs"):
        alone.contact.along((0, 0, 0), (1, 0, 0))
    contact = solve(stack(), 0.9, MPI.COMM_WORLD, max_steps=1, degree=1).contact
    gc.collect()
    with pytest.raises(SceneError, match="needs the step of the contact, which is gone"):
        contact.along((0, 0, 1), (0.5, 0, 1))
