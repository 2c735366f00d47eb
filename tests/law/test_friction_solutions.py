"""Friction against exact solutions: press fits and belts."""

import numpy as np
import pytest
from friction_checks import check_law, resultant

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Material,
    RigidCylinder,
    Scene,
    SolveError,
    Solver,
    SymmetryPlane,
    Traction,
    adapt,
    increments,
    ring,
    root_mesh_from_shapes,
)

MU = 0.3

# ------------------------------------------------------------------------------------------------------- press fits

BORE, JOINT, RIM, LENGTH, INTERFERENCE, YOUNG = 8.0, 20.0, 40.0, 60.0, 2e-3, 210e3
RINGS = {"shaft": (BORE, JOINT + INTERFERENCE / 2), "hub": (JOINT - INTERFERENCE / 2, RIM)}
#: Pressure of Lame's solution with free ends, whatever Poisson's ratio of like rings.
FIT = YOUNG * INTERFERENCE / JOINT / sum((r**2 + q**2) / (r**2 - q**2) for q, r in ((BORE, JOINT), (JOINT, RIM)))
PULL = 2 * np.pi * JOINT * LENGTH * MU * FIT
#: Accuracy of the pressure on the root mesh, two cells across each ring (8e-4 was found), and of radii as if alike.
ROUND = 1e-3


def fitted_rings():
    """Root mesh of shaft and hub, with lines on bore and rim, on the axes x and y and in the plane z = 0."""
    curves = {}
    for name, radius in (("shaft", BORE), ("hub", RIM)):

        def line(points, across, r=radius):
            return (np.abs(np.hypot(*points[:2]) - r) < 1e-3 * r) & (np.abs(points[across]) < 1e-6)

        for across, axis in enumerate("yxz"):
            curves[f"{name} {axis}"] = name, lambda x, i=across, on=line: on(x, i)
    rings = {name: ring(*radii, LENGTH, (2, 4, 1), 2) for name, radii in RINGS.items()}
    return root_mesh_from_shapes(rings, curves=curves)


def press_fit(mu, pull=0.0, torque=0.0, shift=None, poisson=0.0):
    """Two rings with interference.  Body forces of shaft and hub pull and turn, without axial stress, as
    their ends carry the shear stress of an infinite length; lines hold what they leave free.

    Without friction the lines of the shaft hold it too.  With a shift its bore is moved along the axis, the rim held.
    """
    held, loads, shears = [], [], []
    for name in ("hub",) if mu else RINGS:
        held += [Dirichlet(f"{name} x", y=0.0), Dirichlet(f"{name} y", x=0.0), Dirichlet(f"{name} z", z=0.0)]
    if shift is not None:
        held[2:] = Dirichlet("hub outside", z=0.0), Dirichlet("shaft inside", z=shift)
    for (name, (low, high)), free, sign in zip(RINGS.items(), (BORE, RIM), (1, -1)):
        axial = sign * pull / (np.pi * (high**2 - low**2) * LENGTH)
        around = sign * torque / (np.pi / 2 * (high**4 - low**4) * LENGTH)

        def inside(x, a=axial, b=around):
            return np.stack([-b * x[1], b * x[0], a + 0 * x[0]])

        def at_end(x, a=axial, r=free):
            factor = a * (r**2 - (radius2 := x[0] ** 2 + x[1] ** 2)) / (2 * radius2) * np.sign(x[2] - LENGTH / 2)
            return np.stack([factor * x[0], factor * x[1], 0 * x[0]])

        if mu:
            loads.append(BodyForce(name, inside))
            shears += [Traction(f"{name} {end}", at_end) for end in ("bottom", "top")]
    materials = dict.fromkeys(RINGS, Material(YOUNG, poisson))
    pair = ContactPair("shaft outside", "hub inside", friction=mu)
    return Scene(
        "press fit", fitted_rings(), materials, held, pair, shears, body_forces=loads, contact_centre=(0.0, 0.0, 0.0)
    )


def loaded(shares, **options):
    """Last step of a press fit assembled without friction, then loaded in proportion by shares of force and torque."""
    force, torque = shares

    def scene(part):
        if part == 0.0:
            return press_fit(0.0, poisson=0.3)
        return press_fit(MU, part * force * PULL, part * torque * PULL * JOINT, poisson=0.3)

    *_, last = increments(scene, (0.0, 0.5, 1.0), 0.9, geometry_order=2)
    return last.step


@pytest.mark.ranks(1)
@pytest.mark.parametrize("angle", [0, 30, 60, 90])
def test_press_fit_below_and_beyond_sliding(angle):
    """Force and torque are on a circle: the fit carries 0.5 % less, and slides by 0.5 % more."""
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    step = loaded((1 - 5 * ROUND) * direction)
    check_law(step)
    assert step.record.force == pytest.approx(PULL / MU, rel=ROUND)
    carried = resultant(step)
    assert (carried.force[2], carried.moment[2] / JOINT) == pytest.approx(
        tuple(PULL * direction), abs=6 * ROUND * PULL
    )
    with pytest.raises(SolveError):
        loaded((1 + 5 * ROUND) * direction)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("torque", [0.0, 0.6])
def test_pull_out(torque):
    """Pulled out below a torque, all nodes slip on spirals: (F / F_0)^2 + (T / T_0)^2 = 1."""

    def scene(shift):
        return press_fit(MU, torque=torque * PULL * JOINT, shift=shift) if shift else press_fit(0.0)

    *_, last = increments(scene, (0.0, 4e-4, 4e-3), 0.9, geometry_order=2)
    slipping, sticking = check_law(last.step)
    assert sticking == 0 < slipping
    carried = resultant(last.step)
    force, moment = carried.force[2] / PULL, carried.moment[2] / (PULL * JOINT)
    assert force > 0 and np.hypot(force, moment) == pytest.approx(1.0, rel=ROUND)
    assert moment == pytest.approx(torque, abs=6 * ROUND)


# ------------------------------------------------------------------------------------------------------------- belts

THICKNESS, AROUND = 0.02, 96


def belt(mu):
    """A slice of a belt on a quarter of a rigid drum, held at one end, with a tension at the other."""
    shape = ring(1.0, 1 + THICKNESS, np.pi / 2 / AROUND, (1, AROUND, 1), 2, quarters=1)
    drum = RigidCylinder((0, 0, 0), (0, 0, 1), 1.0)
    held = [SymmetryPlane(f"belt {side}") for side in ("x = 0", "bottom", "top")]
    pair, load = ContactPair("belt inside", drum, friction=mu), Traction("belt y = 0", (0.0, -1e-4, 0.0))
    return Scene("belt", root_mesh_from_shapes({"belt": shape}), {"belt": Material(1.0, 0.0)}, held, pair, load)


def tension_ratio(mu):
    """exp(lambda phi) on 90 degrees, with friction at the inner side: lambda (1 + mu lambda e) = mu (1 - e)."""
    e = THICKNESS / (2 + THICKNESS)
    return np.exp((np.sqrt(1 + 4 * mu**2 * e * (1 - e)) - 1) / (2 * mu * e) * np.pi / 2)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("mu, right", [(0.2, 1.36469), (0.5, 2.17217)])
def test_belt_on_a_drum(mu, right):
    """The held end cannot slip: there the tension is constant over half of a node spacing."""
    assert tension_ratio(mu) == pytest.approx(right, abs=1e-5)
    step = next(adapt(belt(mu), 0.9, geometry_order=2, solver=Solver(tolerance=1e-10)))
    slipping, sticking = check_law(step)
    assert 0 < sticking <= 3 < slipping and step.record.active_pairs == slipping + sticking
    ratio = resultant(step, "traction").force[1] / resultant(step, "symmetry").force[0]
    assert ratio == pytest.approx(right, rel=mu * np.pi / 2 / AROUND / 4)
