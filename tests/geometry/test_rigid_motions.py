"""Rigid motions of bodies of any size, against those put in."""

import numpy as np
import pytest
from model_problems import ALONG, PLANES, wedge

from fx_contact import Dirichlet
from fx_contact.geometry.rigid_motions import RigidMotions
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.solids import block


def brick(size):
    """A root mesh of one brick, longer than wide, off the origin."""
    shape = block((1.0, 2.0, 3.0), (2.0, 4.0, 6.0), (1, 2, 1))
    return RootMesh(size * shape.points, shape.cells, ("brick",), np.zeros(len(shape.cells), np.int32))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("held, free", [((), 6), ((0,), 3), ((0, 1), 1), ((0, 1, -1), 0)])
def test_what_held_vertices_leave_free(size, held, free):
    """A point leaves three rotations, two leave one, three none, and the motion that they prescribe is found."""
    mesh = brick(size)
    x = mesh.points / size
    motion = size * (np.array([0.1, 0.2, -0.3]) + np.cross([0.02, -0.01, 0.03], x))
    prescribed = np.full(x.shape, np.nan)
    prescribed[list(held)] = motion[list(held)]
    motions, body = RigidMotions(mesh, prescribed), np.zeros(len(x), dtype=int)
    assert motions.free.shape == (free, 1, 6)
    modes = motions.modes(mesh.points, body)
    found = np.einsum("nmi,m->ni", modes, motions.prescribed[0])
    assert np.allclose(found[list(held)], motion[list(held)], atol=1e-9 * size, rtol=0)
    assert free or np.allclose(found, motion, atol=1e-9 * size, rtol=0)
    # Free motions leave the held points where they are, and all distances.
    for mode in motions.free[:, 0]:
        moved = np.einsum("nmi,m->ni", modes, mode)
        assert np.abs(moved[list(held)]).max(initial=0.0) < 1e-9 < 0.1 < np.abs(moved).max()
        apart, going = x[:, None] - x, moved[:, None] - moved
        assert np.abs((apart * going).sum(axis=2)).max() < 1e-9


def test_what_oblique_planes_leave_free():
    """A plane leaves two translations and a rotation, two leave the translation along their line, three none."""
    scene = wedge()
    planes, nothing = scene.oblique_planes, np.full(scene.mesh.points.shape, np.nan)
    for count, free in enumerate((6, 3, 1, 0)):
        given = [(scene.mesh.nodes_of(plane.where), np.array(plane.normal)) for plane in planes[:count]]
        motions = RigidMotions(scene.mesh, nothing, given)
        assert motions.free.shape == (free, 1, 6)
        if free == 1:
            assert np.allclose(np.abs(motions.free[0, 0]), np.abs([*ALONG[:, 2], 0, 0, 0]))
    assert len(wedge(held=PLANES[:2]).rigid_motions.free) == 1
    assert not len(wedge(held=(*PLANES[:2], Dirichlet("top", z=0.0))).rigid_motions.free)
