"""Resultants: of known loads, in balance on all ready scenes, the same of a part and of the whole."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from model_problems import EXACT, of_kind
from scenes.test_ready_scenes import READY

from fx_contact import BodyForce, Dirichlet, Material, Pressure, StepRecord, Traction, solve
from fx_contact.scene.mirrors import Mirrors, mirror_group
from fx_contact.scenes import hertz, indentation, shrink_fit, stack
from fx_contact.verdict.contact_figures import _is_round
from fx_contact.verdict.resultants import _resultant

#: Part of the contact force that the solver's tolerance, 1e-13 here, may leave.
CLOSE = 1e-10


def once(scene, degree=1, **options):
    """The record of one step on the root mesh."""
    return solve(scene, 0.9, degree=degree, max_steps=1, solver=EXACT, **options).record


def column(**parts):
    """Two blocks, 1 x 1 x 2 in all, of which nothing is mirrored: x and y from 0 to 1/2 are all there is."""
    return replace(stack((Material(1.0, 0.3),) * 2, height=1.0), symmetry=1, **parts)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", READY)
def test_balance_of_ready_scenes(name, degree):
    """Forces and moments on each body add up to nothing, forces on the whole too; facing nodes may be on two ranks."""
    scene = READY[name]()
    record = once(scene, degree, partition_kind="sfc")
    scale = record.force
    for body in of_kind(record, "balance").values():
        assert np.linalg.norm(body.force) < CLOSE * scale
        # Bodies of about 1 m; the degree must follow the geometry.
        assert np.linalg.norm(body.moment) < (CLOSE if record.geometry_order <= degree else 0.01) * scale
    whole = [one for one in record.resultants if one.kind not in ("contact", "symmetry", "balance")]
    assert np.linalg.norm(np.sum([one.force for one in whole], axis=0)) < CLOSE * scale if whole else name == "rings"
    for pair, force, alignment in zip(scene.contact, record.pair_forces, record.pair_alignments):
        vector = np.array(of_kind(record, "contact")[pair.name].force)
        along = np.linalg.norm(vector) if pair.direction is None else vector @ pair.unit_direction
        assert abs(along - force * (alignment if pair.direction is None else 1)) < CLOSE * scale
    assert record.resultants == StepRecord.from_json(json.loads(json.dumps(record.as_json()))).resultants


def test_stack_passes_its_load_on():
    """A pressure on top: each contact, and the reaction below, have the load's force, about any centre."""
    record = once(stack(pressure=0.01, side=2.0))
    forces = of_kind(record, "traction") | of_kind(record, "contact") | of_kind(record, "reaction")
    assert list(forces) == ["top", "on block 0 on under block 1", "on block 1 on under block 2", "bottom"]
    for one, sign in zip(forces.values(), (-1, 1, 1, 1)):
        assert np.allclose(one.force, [0, 0, sign * 0.04], atol=1e-9) and one.parts == 4
    older = {name: value for name, value in record.as_json().items() if name not in ("resultants", "pair_alignments")}
    assert StepRecord.from_json(older).resultants is None
    cuts = of_kind(record, "symmetry")  # a quarter's half width and heights; no stress acts across
    assert list(cuts) == ["x = 0", "y = 0"] and all(np.allclose(cut.force, 0, atol=1e-9) for cut in cuts.values())


@pytest.mark.parametrize("degree", [1, 2])
def test_load_off_the_middle(degree):
    """A traction that grows along x, a pressure and a weight: force and moment by hand; the clamped end balances."""
    clamped = Dirichlet("bottom", x=0.0, y=0.0, z=0.0), Dirichlet("top", z=0.0)
    scene = column(
        dirichlet=(*clamped, Dirichlet("under block 1", x=0.0, y=0.0)),
        tractions=(Traction("x = 0", lambda x: np.stack([0 * x[0], 1e-3 * x[2], 0 * x[0]])), Pressure("y = 0", 2e-3)),
        body_forces=(BodyForce("block 1", (0.0, 0.0, -1e-2)),),
        contact_centre=(0.25, 0.25, 1.0),
    )
    record = once(scene, degree)
    assert np.allclose(of_kind(record, "pressure")["y = 0"].force, [0, 2e-3, 0])  # on 0.5 x 2 m^2
    along, weight = of_kind(record, "traction")["x = 0"], of_kind(record, "body force")["block 1"]
    # On x = 0, half as wide as 2 high: int 1e-3 z dA = 1e-3, at z = 4/3, 0.25 m beside the centre.
    assert np.allclose(along.force, [0, 1e-3, 0]) and np.allclose(along.moment, [-1e-3 / 3, 0, -0.25e-3])
    assert np.allclose(weight.force, [0, 0, -0.25e-2]) and np.allclose(weight.moment, 0, atol=1e-12)
    acting = [one for one in record.resultants if one.kind not in ("contact", "balance")]
    for what in ("force", "moment"):
        assert np.abs(np.sum([getattr(one, what) for one in acting], axis=0)).max() < 1e-9
        assert max(np.abs(getattr(one, what)).max() for one in of_kind(record, "balance").values()) < 1e-9
    assert {one.point for one in record.resultants} == {(0.25, 0.25, 1.0)}


def test_conditions_share_what_both_prescribe():
    """A condition that is there twice has half of the reaction each; on an edge only the common component is shared."""
    scene = stack((Material(1.0, 0.3),) * 2)
    single = of_kind(once(scene), "reaction")["top"].force[2]
    twice = replace(scene, dirichlet=(*scene.dirichlet, Dirichlet("top", z=-0.01)))
    tops = [one for one in once(twice).resultants if one.name == "top"]
    assert len(tops) == 2 and all(abs(one.force[2] / single - 0.5) < 1e-9 for one in tops)


@pytest.mark.parametrize(
    "make", [lambda **k: hertz(1.0, 0.2, order=2, coarse=3, **k), lambda **k: indentation(coarse=2, **k)]
)
def test_quarter_and_full_model(make):
    """Figures, contact and reactions of the flat faces are those of the whole, whatever is modelled."""
    quarter, full = (once(make(symmetry=which)) for which in ("quarter", "full"))
    for kind, name in (("contact", None), ("reaction", "top"), ("reaction", "bottom")):
        one, other = (of_kind(r, kind)[name or next(iter(of_kind(r, kind)))] for r in (quarter, full))
        assert np.allclose(one.force, other.force, atol=1e-7 * full.force) and (one.parts, other.parts) == (4, 1)
        assert np.allclose(one.moment, other.moment, atol=1e-7 * full.force)
        assert abs(abs(one.force[2]) / full.force - 1) < 1e-7
    assert full.cells == 4 * quarter.cells and full.active_pairs > quarter.active_pairs > 3
    assert (quarter.contact_radius is None) == (full.contact_radius is None)
    for name in ("force", "max_pressure", "contact_radius", "estimate"):
        assert getattr(full, name) == pytest.approx(getattr(quarter, name), rel=1e-6), name


def test_centre_of_a_part():
    """It is on the planes of symmetry, as that of the whole."""
    scene = replace(stack(cells=(1, 1, 1)), contact_centre=(0.2, 0.3, 1.0))
    record = once(scene)
    assert np.allclose(record.contact_centre, [0, 0, 1]) and record.resultants[0].point == (0, 0, 1)


def test_forces_without_a_direction():
    """On a quarter of a ring the sum of magnitudes is pi / (2 sqrt 2) of the vector, on all of it that is nothing."""
    scene = shrink_fit(interference=1e-3, coarse=4)
    quarter, ring = once(replace(scene, symmetry=1)), once(scene)
    assert abs(quarter.pair_alignments[0] * np.pi / np.sqrt(8) - 1) < 0.01
    assert ring.pair_alignments[0] < 1e-6 and np.abs(of_kind(ring, "contact")["shaft on hub"].force).max() < 1e-12
    assert abs(ring.force / quarter.force / 8 - 1) < 1e-9 and ring.contact_radius is None


@pytest.mark.parametrize("symmetry", ["quarter", "full"])
def test_centre_is_the_centroid(symmetry):
    """Wherever round contact is, its radius is about its own centre, with or without mirrors."""
    scene = hertz(coarse=2, symmetry=symmetry, displacement=0.4)
    here = once(scene, 2)
    elsewhere = replace(scene.mesh, points=scene.mesh.points + [0.1, 0.2, -0.3])
    there = once(replace(scene, mesh=elsewhere, contact_centre=None), 2)
    assert here.contact_radius > 0.1 and abs(there.contact_radius / here.contact_radius - 1) < 1e-6
    assert np.allclose(there.contact_centre[:2], [0.1, 0.2])
    # On the lower sphere of radius 1: r^2 / 2 below the pole, in the mean a fifth of the square of the contact radius.
    assert abs((-0.3 - there.contact_centre[2]) / (there.contact_radius**2 / 5) - 1) < 0.05


def test_images_of_a_resultant():
    """Mirrored across x: a plane doubles what is along it and the moment about its normal.

    Of planes of symmetry, and in the balance of a body, it is that of the modelled part.
    """
    normal = np.eye(3)[:1]
    scene = SimpleNamespace(mirrors=Mirrors(normal, np.zeros(1), mirror_group(normal, 2)))
    row = np.arange(1.0, 7.0)
    for kind in ("contact", "traction", "pressure", "body force", "reaction"):
        whole = _resultant("it", kind, row, (0.0, 0.0, 0.0), scene)
        assert (whole.force, whole.moment, whole.parts) == ((0.0, 4.0, 6.0), (8.0, 0.0, 0.0), 2)
    for kind in ("symmetry", "balance"):
        part = _resultant("it", kind, row, (0.0, 0.0, 0.0), scene)
        assert (*part.force, *part.moment, part.parts) == (*row, 1)


@pytest.mark.parametrize("degrees, has_axis", [(30, True), (85, True), (95, False), (180, False)])
def test_contact_with_an_axis(degrees, has_axis):
    """Uniform pressure on a cap up to the angle t: its forces add up to (1 + cos t) / 2 of their magnitudes."""
    cosine = 1 - (1 - np.cos(np.radians(degrees))) * (np.arange(100) + 0.5) / 100  # equal areas
    around = np.pi / 4 * np.arange(8)
    sine = np.sqrt(1 - cosine**2)
    columns = np.outer(sine, np.cos(around)), np.outer(sine, np.sin(around)), np.outer(cosine, np.ones(8))
    normal = np.stack(columns, axis=-1).reshape(-1, 3)
    vector, length = normal.sum(axis=0), len(normal)
    assert abs(np.linalg.norm(vector) / length - (1 + np.cos(np.radians(degrees))) / 2) < 1e-12
    assert _is_round(normal.T @ normal, vector, length, np.inf) == has_axis


#: Pressures at x, y on the contact, and what it is: within the unit circle, or an ellipse or square.
SPREAD = {
    "Hertz": (lambda x, y: max(1 - x**2 - y**2, 0) ** 0.5, True),
    "ellipse 1 : 0.93": (lambda x, y: max(1 - x**2 - (y / 0.93) ** 2, 0) ** 0.5, True),
    "ellipse 1 : 0.87": (lambda x, y: max(1 - x**2 - (y / 0.87) ** 2, 0) ** 0.5, False),
    "round punch": (lambda x, y: (1 - x**2 - y**2) ** -0.5 if x**2 + y**2 < 1 else 0, False),
    "uniform on a circle": (lambda x, y: x**2 + y**2 < 1, False),
    "uniform on a square": (lambda x, y: max(abs(x), abs(y)) < 0.8, False),
}


@pytest.mark.parametrize("pressure, round_contact", SPREAD.values(), ids=SPREAD)
def test_contact_of_round_bodies(pressure, round_contact):
    """By the second moments of the forces, and by the area that they need."""
    x = np.linspace(-1, 1, 101)
    position = np.array([(a, b, 0.0) for a in x for b in x])
    force = np.array([float(pressure(a, b)) for a, b, _ in position])
    tensor, total = (position.T * force) @ position, force.sum()
    area = np.count_nonzero(force) * (x[1] - x[0]) ** 2
    assert _is_round(tensor, np.array([0, 0, total]), total, area) == round_contact


def test_radius_of_one_round_contact():
    """Spheres have it; a square has none, nor have three layers, whose areas add up."""
    scene = hertz(coarse=2, displacement=0.4, symmetry="full")
    assert once(scene, 2).contact_radius > 0.1
    ends = Dirichlet("bottom", z=0.0), Dirichlet("top", z=-0.4)
    unknown = replace(scene, dirichlet=(*ends, *scene.dirichlet[2:]), symmetry=2)
    assert once(unknown, 2).contact_radius is None, "of two parts one is not known"
    for layers in (2, 3):
        assert once(stack((Material(1.0, 0.3),) * layers)).contact_radius is None
