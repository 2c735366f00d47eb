"""The model warning of kinks between root facets, and of an obstacle."""

import numpy as np
import pytest
from conftest import everywhere
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    RigidCylinder,
    RigidSurface,
    Scene,
    SymmetryPlane,
    block,
    ring,
    root_mesh_from_shapes,
    solve,
)
from studies.nonmatching.kinks import exact, press_fit

pytestmark = pytest.mark.ranks(1, 2, 3)


def kinks(step):
    """Values of the warnings."""
    return [doubt.value for doubt in step.record.doubts if doubt.kind == "kinks"]


@pytest.mark.parametrize("order, off", [(2, 0.1), (4, 0.03)])
def test_press_fit(order, off):
    """Of unlike meshes: pressures are off by more than 10 % at order 2, which is said, and by less than 3 % at 4."""
    step = solve(press_fit(order, (9, 8)), 0.03, max_steps=1)
    pressure = np.abs(step.contact.pressure[step.contact.active] / exact() - 1).max(initial=0.0)
    if order == 2:
        (value,) = kinks(step)
        assert 0.5 * value < step.forest.comm.allreduce(pressure, max) < 2 * value and value > off
    else:
        everywhere(pressure < off, "pressures")
        assert not kinks(step)


def test_meshed_alike():
    """Facets of both surfaces have the same kinks, whatever their order."""
    assert not kinks(solve(press_fit(2, (4, 4)), 0.9, max_steps=1))


@pytest.mark.parametrize("order", [2, 6])
def test_obstacle(order):
    """A ring of two cells a quarter on a smooth shaft."""
    shape = ring(1.0, 2.0, 0.5, (1, 2, 1), order, quarters=1)
    held = [SymmetryPlane(f"ring {side}") for side in ("x = 0", "y = 0", "bottom", "top")]
    shaft = ContactPair("ring inside", RigidCylinder((0, 0, 0), (0, 0, 1), 1.001))
    scene = Scene("shaft", root_mesh_from_shapes({"ring": shape}), {"ring": Material(1.0, 0.3)}, tuple(held), shaft)
    assert bool(kinks(solve(scene, 0.9, max_steps=1))) == (order == 2)


@pytest.mark.parametrize("spacing, n", [(0.2, 4), (0.25, 4), (0.25, 3), (0.25, 1)])
def test_a_scan(spacing, n):
    """Of heights on a paraboloid, between and on the edges of facets: kinks of bilinear interpolation alone."""
    at = spacing * np.arange(-6, 7)
    heights = (at**2 + at[:, None] ** 2) / 8
    linear, spline = RegularGridInterpolator((at, at), heights), RectBivariateSpline(at, at, heights)
    mesh = root_mesh_from_shapes({"base": block((-1, -1, -1), (1, 1, 0), (n, n, 2), 1)})
    for height, kinked in ((lambda x: linear(x[:2].T), True), (lambda x: spline.ev(x[0], x[1]), False)):
        scan = RigidSurface(
            lambda x, height=height: height(x) - x[2] - 0.01,
            lambda x: np.multiply.outer([0.0, 0.0, -1.0], np.ones(len(x[0]))),
        )
        held, pair = Dirichlet("base bottom", 0, 0, 0), ContactPair("base top", scan)
        step = solve(Scene("scan", mesh, {"base": Material(1.0, 0.3)}, held, pair), 0.3, max_steps=2)
        assert bool(kinks(step)) == kinked
        for place in (one.place for one in step.record.doubts if one.kind == "kinks"):
            off = np.array(place[:2]) / spacing
            assert np.abs(off - off.round()).min() < 0.02, "a line of samples, within 1/40 of a facet"


@pytest.mark.parametrize("n", [2, 3])
def test_a_rounded_stamp(n):
    """Its slopes are continuous, its curvature is not."""
    stamp = RigidSurface(
        lambda x: np.maximum(np.hypot(x[0], x[1]) - 0.4, 0) ** 2 / 0.4 - x[2] - 0.01,
        lambda x: np.multiply.outer([0.0, 0.0, -1.0], np.ones(len(x[0]))),
    )
    mesh = root_mesh_from_shapes({"base": block((0, 0, -1), (1, 1, 0), (n, n, 2), 1)})
    held, pair = Dirichlet("base bottom", 0, 0, 0), ContactPair("base top", stamp)
    assert not kinks(solve(Scene("stamp", mesh, {"base": Material(1.0, 0.3)}, held, pair), 0.3, max_steps=2))
