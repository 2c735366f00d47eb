"""Bars whose ends are prescribed to move as rigid bodies: forces and moments of bending, torsion and stretch."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import everywhere
from model_problems import DISTRIBUTIONS, EXACT, conforming_positions, discrete, grown, roots, solved

from fx_contact import Dirichlet, Material, RigidMotion, Scene, block, root_mesh_from_shapes, solve
from fx_contact.fem.dirichlet import find_supports

pytestmark = pytest.mark.ranks(1, 2, 3)

LENGTH, ANGLE = 4.0, 1e-3
#: Torsion constant of a square over the fourth power of its side (S. Timoshenko, J. N. Goodier, Theory of Elasticity).
SQUARE = 0.140577


def bar(*held, material=Material(2.0, 0.0), length=LENGTH, cells=(2, 2, 4), middle=(0.0, 0.0, 0.0)):
    """A bar of the unit square about the z axis, moved by `middle`."""
    low = np.array([-0.5, -0.5, 0.0])
    shape = block(low + middle, low + [1.0, 1.0, length] + middle, cells, 1)
    sides, foot = {side: f"bar {side}" for side in ("bottom", "top")}, ("bar", lambda x: np.abs(x).max(axis=0) < 1e-9)
    mesh = root_mesh_from_shapes({"bar": shape}, sides, vertices={} if any(middle) else {"foot": foot})
    return Scene("bar", mesh, {"bar": material}, held, contact_centre=tuple(map(float, middle)))


def once(scene, degree=2):
    """Resultants on the root mesh, by name and kind."""
    record = solve(scene, 0.9, degree=degree, max_steps=1, solver=EXACT).record
    return {(one.name, one.kind): one for one in record.resultants}


def test_components():
    """It is a Dirichlet condition with t + r x (x - c) at any point, as numbers where it is constant."""
    motion = RigidMotion("top", (1, 2, 3), (0.1, -0.2, 0.3), (4, 5, 6))
    x = np.random.default_rng(1).normal(size=(7, 3))
    assert np.allclose(motion.at(x), [1, 2, 3] + np.cross([0.1, -0.2, 0.3], x - [4, 5, 6]), atol=1e-14, rtol=0)
    assert isinstance(motion, Dirichlet) and motion.held.all() and motion.components == "xyz"
    about = RigidMotion("top", (1.0, 2.0, 3.0), (0.0, 0.0, 0.1))
    assert about.z == 3.0 and callable(about.x) and RigidMotion("top", (1, 2, 3)).x == 1.0
    assert about == RigidMotion("top", [1, 2, 3], np.array([0, 0, 0.1])) != replace(about, rotation=(0, 0, 0.2))
    assert hash(about) == hash(replace(about)) and "rotation=(0.0, 0.0, 0.1)" in repr(about)


@pytest.mark.parametrize("distribute", DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)
def test_pure_bending_is_exact(distribute):
    """u = kappa (-z^2 / 2, 0, x z) without a Poisson's ratio: both ends stay plane, and degree 2 has it."""
    kappa = ANGLE / LENGTH
    end = RigidMotion("top", (-kappa * LENGTH**2 / 2, 0, 0), (0, -ANGLE, 0), (0, 0, LENGTH))
    scene = bar(RigidMotion("bottom"), end)
    forest = distribute(grown(roots(scene), 2))
    elasticity = discrete(scene, forest, degree=2)
    supports = find_supports(scene, forest, elasticity.prolongation)
    u = solved(elasticity, None, supports).displacement
    x, _, z = conforming_positions(forest, elasticity.prolongation)[0].T
    exact = kappa * np.column_stack([-(z**2) / 2, 0 * z, x * z])
    everywhere(np.abs(u - exact).max(initial=0.0) < 1e-11 * kappa * LENGTH**2, "another displacement")


@pytest.mark.parametrize("middle", [(0.0, 0.0, 0.0), (3.0, -2.0, 7.0)])
def test_moments_of_bending(middle):
    """E I kappa at both ends, without force; a rotation about another centre has a translation more."""
    kappa, place = ANGLE / LENGTH, np.array(middle)
    shift = np.array([-kappa * LENGTH**2 / 2, 0, 0])
    turn, centre, other = np.array([0, -ANGLE, 0]), place + [0, 0, LENGTH], np.array([5.0, 6.0, -7.0])
    moment = 2.0 / 12 * kappa
    for moved, about in ((shift, centre), (shift + np.cross(turn, other - centre), other)):
        found = once(bar(RigidMotion("bottom"), RigidMotion("top", moved, turn, about), middle=middle))
        for name, sign in (("bottom", 1), ("top", -1)):
            one = found[name, "reaction"]
            assert np.abs(one.moment - np.array([0, sign * moment, 0])).max() < 1e-9 * moment
            assert np.abs(one.force).max() < 1e-9 * moment
        assert np.abs(found["bar", "balance"].moment).max() < 1e-9 * moment


def test_ends_that_warp():
    """With the components of a rotation across the axis alone torsion is that of Saint-Venant: the exact moment."""
    turned, steel = RigidMotion("top", rotation=(0, 0, ANGLE)), Material(2.0, 0.3)
    held = Dirichlet("bottom", x=0.0, y=0.0), Dirichlet("foot", z=0.0), Dirichlet("top", x=turned.x, y=turned.y)
    moment = once(bar(*held, material=steel, cells=(4, 4, 8)))["top", "reaction"].moment
    exact = SQUARE * 2.0 / 2.6 * ANGLE / LENGTH
    assert abs(moment[2] / exact - 1) < 0.005 and np.abs(moment[:2]).max() < 1e-9 * exact
