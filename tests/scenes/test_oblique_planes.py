"""Whole runs with planes of symmetry oblique to the axes: a wedge, scenes that are turned, sectors of round bodies."""

import numpy as np
import pytest
from conftest import everywhere
from model_problems import ALONG, EXACT, grown, roots, wedge

from demos.hertz_reference import hertz_a
from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    Reaction,
    Scene,
    SymmetryPlane,
    adapt,
    ball,
    root_mesh_from_shapes,
)
from fx_contact.adaptive.beginning import Beginning
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry.shapes import rotation
from fx_contact.scenes import hertz, shrink_fit
from studies.stability.twins import turned

#: Pressures around a wedge and on its top.
AROUND, ON_TOP = 0.003, 0.001


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("degree, poisson", [(1, 0.3), (2, 0.3), (1, 0.45), (2, 0.49)])
def test_uniform_stress(degree, poisson):
    """The displacement is linear, with hanging nodes; the planes react to what the loads leave."""
    loads = (Pressure("right", AROUND), Pressure("back", AROUND), Pressure("top", ON_TOP))
    scene = wedge(Material(2.0, poisson), tractions=loads, symmetry=24)
    beginning = Beginning.at_rest(grown(roots(scene), 2, share=0.1))
    (step,) = adapt(scene, 0.5, degree=degree, max_steps=1, beginning=beginning, solver=EXACT)
    record, up = step.record, ALONG[:, 2]
    assert record.hanging_nodes > 20 and record.estimate < 1e-8
    across, along = (poisson * (AROUND + ON_TOP) - AROUND) / 2, (2 * poisson * AROUND - ON_TOP) / 2
    strain = across * np.eye(3) + (along - across) * np.outer(up, up)
    exact = leaf_positions(step.forest, slice(None), degree) @ strain
    everywhere(np.abs(step.nodal_displacement - exact).max() < 1e-10 * AROUND, "the displacement is not linear")
    energy = -0.5 * (AROUND * 2 * across + ON_TOP * along)  # twice, in a volume of 1/2
    assert abs(step.estimate.energy_norm**2 / energy - 1) < 1e-9
    # The sides opposite to the planes have their areas: 1, 1 and 1/2.
    normals = np.linalg.inv(ALONG) / np.linalg.norm(np.linalg.inv(ALONG), axis=1)[:, None]
    reactions = sum(np.array(one.force) for one in record.resultants if one.kind == "symmetry")
    assert np.allclose(reactions, [AROUND, AROUND, 0.5 * ON_TOP] @ normals, atol=1e-10)
    (balance,) = (one for one in record.resultants if one.kind == "balance")
    assert np.abs([balance.force, balance.moment]).max() < 1e-10
    whole = [one for one in record.resultants if one.kind == "pressure"]
    assert all(one.parts == 24 and np.abs([one.force, one.moment]).max() < 1e-12 for one in whole)


def last(scene, tolerance, **options):
    """The last step of a run."""
    *_, step = adapt(scene, tolerance, **options)
    return step


TURNED = [
    pytest.param(*case, marks=pytest.mark.ranks(ranks)) for *case, ranks in ((1, 0.3, 3), (2, 0.3, 1), (2, 0.45, 2))
]


@pytest.mark.parametrize("degree, poisson", TURNED)
def test_turned_hertz(degree, poisson):
    """A quarter of two spheres turned by 30 degrees about z is what it was, hanging nodes and rubber too."""
    scene = hertz(order=2, coarse=2, material=Material(1.0, poisson))
    goals = (Reaction("top", 0.05),)
    here, there = (last(one, 0.2, degree=degree, goals=goals) for one in (scene, turned(scene, rotation("z", 30))))
    here, there = _checked_alike(here, there, 0.3 if degree == 2 else 0.6)
    assert here.hanging_nodes > 100 and there.resultants[0].parts == 4
    assert np.allclose(here.contact_centre, there.contact_centre, atol=1e-12)
    one, other = (record.goals[0] for record in (here, there))
    assert abs(other.value / one.value - 1) < 1e-7 and abs(other.error / one.error - 1) < 1e-3


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("degree", [1, 2])
def test_tilted_rings(degree):
    """Rings that three planes alone hold, in no direction of the axes; their forces add up to none."""
    scene = shrink_fit(coarse=1, order=2)
    here, there = (last(one, 0.1, degree=degree) for one in (scene, turned(scene, rotation((1.0, 2.0, 3.0), 50.0))))
    here, there = _checked_alike(here, there, 0.9)
    assert there.resultants[0].parts == 8 and np.abs(there.resultants[0].force).max() < 1e-7 * there.force


def _checked_alike(one, other, more):
    """The records of two steps with the same leaves, forces, energies; the other may have so many more iterations.

    Algebraic multigrid, which takes components by themselves, notices oblique planes, at degree 1 more than at 2.
    """
    energies, (here, there) = (one.estimate.energy_norm, other.estimate.energy_norm), (one.record, other.record)
    for name in ("cells", "dofs", "active_pairs", "hanging_nodes", "max_level"):
        assert getattr(here, name) == getattr(there, name), name
    for name in ("force", "max_pressure", "estimate"):
        assert abs(getattr(there, name) / getattr(here, name) - 1) < 1e-6, name
    assert abs(energies[1] / energies[0] - 1) < 1e-7
    assert there.krylov_iterations[-1] <= 1 + (1 + more) * here.krylov_iterations[-1]
    return here, there


def sector_of_ball(degrees):
    """A place for `Shape.placed`: an octant of a ball becomes a sector, and stays smooth at the pole."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def place(x):
        sheared = np.stack([x[0] + cosine * x[1], sine * x[1], x[2]])
        return sheared * np.linalg.norm(x, axis=0) / np.maximum(np.linalg.norm(sheared, axis=0), 1e-300)

    return place


@pytest.mark.ranks(2)
def test_sector_of_two_spheres():
    """A twelfth gives the force, pressure and radius of the whole that a computation with axial symmetry gives."""
    lower = ball(1.0, 2, octants=1).placed(sector_of_ball(30.0)).shifted(z=-1)
    lower = lower.named("pole", "outside", where=lambda x: x[2] > -0.45)
    sides, bodies = ("x = 0", "y = 0"), ("lower", "upper")
    scene = Scene(
        name="sector of spheres",
        mesh=root_mesh_from_shapes({"lower": lower, "upper": lower.mirrored("z")}),
        materials=dict.fromkeys(bodies, Material(1.0, 0.3)),
        dirichlet=(
            *(Dirichlet(f"{body} z = 0", z=0.005 * sign) for body, sign in zip(bodies, (1, -1))),
            *(SymmetryPlane(f"{body} {side}") for body in bodies for side in sides),
        ),
        contact=(ContactPair("lower pole", "upper pole", direction=(0, 0, 1)),),
        symmetry=12,
    )
    record, known = last(scene, 0.05).record, hertz_a()
    assert scene.mirrors.parts == record.resultants[0].parts == 12
    assert abs(record.force / known.force - 1) < 2e-3
    assert np.allclose(record.resultants[0].force, [0.0, 0.0, record.force], atol=1e-9 * record.force)
    assert abs(record.max_pressure / known.max_pressure - 1) < 0.02
    assert abs(record.contact_radius / known.contact_radius - 1) < 0.01
