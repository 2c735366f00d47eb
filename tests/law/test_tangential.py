"""Tangent rows: a law of linear springs against exact solutions, with the displacement of the increment before."""

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import grown, roots
from mpi4py import MPI

from fx_contact import (
    Beginning,
    ContactPair,
    Dirichlet,
    Material,
    RigidPlane,
    Scene,
    Solver,
    SymmetryPlane,
    Traction,
    adapt,
    block,
    increments,
    root_mesh_from_shapes,
)
from fx_contact.contact.constraint_rows import Role
from fx_contact.contact.contact_system import Springs
from fx_contact.contact.row_kinds import tangent_axes
from fx_contact.items.friction import TangentialLaw
from fx_contact.law.tangential import STATUS
from fx_contact.law.tangents import TangentialStatus

pytestmark = pytest.mark.ranks(1, 2, 3)

EXACT = Solver(tolerance=1e-12)
YOUNG, STIFFNESS = 2.0, 3.0
#: Shear displacements of the top in turn.
SHEAR = (1e-3, 3e-3, 2e-3)


@dataclass(frozen=True)
class LinearSprings(TangentialLaw):
    """Tangential tractions in proportion to the slip of the load step, while normals are closed.

    Attributes:
        stiffness: per area [Pa/m].
    """

    stiffness: float


class SpringStatus(TangentialStatus):
    """Springs at the tangents of closed normals."""

    def springs(self, active):
        stiffness = np.where(self.closed(active), self.law.stiffness * self.rows.area, 0.0)
        return Springs(stiffness, np.where(self.ours, self.history, 0.0))


@pytest.fixture(autouse=True)
def law(monkeypatch):
    """The law is known."""
    monkeypatch.setitem(STATUS, LinearSprings, SpringStatus)


def sheared(shear, traction=0.0, upper=(2, 2, 2), below="base", law=LinearSprings(STIFFNESS)):
    """Two cubes, or one on a rigid plane, of nu = 0 in uniform compression, and in uniform shear by tractions."""
    bodies = {"base": block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1), "cube": block((0, 0, 0), (1, 1, 1), upper, 1)}
    second = "base top"
    if below == "plane":
        del bodies["base"]
        second = RigidPlane((0, 0, 0), (0, 0, 1))
    held = [Dirichlet("cube top", x=shear, z=-1e-2), *(SymmetryPlane(f"{body} front") for body in bodies)]
    held += [Dirichlet("base bottom", x=0.0, z=0.0)] if below == "base" else []
    sides = ("left", -traction), ("right", traction)
    loads = [Traction(f"{body} {side}", (0.0, 0.0, load)) for body in bodies for side, load in sides if load]
    pair = ContactPair("cube bottom", second, friction=0.0 if law is None else law)
    mesh = root_mesh_from_shapes(bodies)
    return Scene("sheared", mesh, dict.fromkeys(bodies, Material(YOUNG, 0.0)), held, pair, loads)


def tractions(bodies):
    """Tractions tau at the displacements `SHEAR`: tau = k (s_n - s_{n-1}) = (U_n - s_n) G / bodies, slips s_n."""
    found, before, shear_stiffness = {}, 0.0, YOUNG / 2 / bodies
    for shear in SHEAR:
        slip = (shear * shear_stiffness + STIFFNESS * before) / (STIFFNESS + shear_stiffness)
        found[shear], before = STIFFNESS * (slip - before), slip
    return found


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", ["pairs", "mortar", "obstacle"])
def test_increments_of_a_sheared_interface(kind, degree):
    """Uniform shear on graded meshes with hanging nodes; each increment slips from the one before."""
    how = {"upper": (3, 3, 2) if kind == "mortar" else (2, 2, 2), "below": "plane" if kind == "obstacle" else "base"}
    known = tractions(1 if kind == "obstacle" else 2)
    begin = Beginning.at_rest(grown(roots(sheared(0.0, **how)), 2, share=0.2))
    options = {"degree": degree, "beginning": begin, "solver": EXACT}
    for point in increments(lambda shear: sheared(shear, known[shear], **how), SHEAR, 0.1, **options):
        step, traction = point.step, known[point.value]
        assert WORLD.allreduce(len(step.forest)) > len(step.scene.mesh.cells), "no refined leaf"
        (contact,) = (one for one in step.resultants if one.kind == "contact")
        assert contact.force == pytest.approx((traction, 0, -step.record.force), rel=1e-8, abs=1e-10)
        for one in step.resultants:
            if one.kind == "balance":
                assert np.abs(one.force).max() < 1e-10
        rows = step.solution.rows
        tangents = rows.part(Role.TANGENT)
        assert WORLD.allreduce(len(tangents)) == 2 * WORLD.allreduce(len(step.rows))
        force = step.solution.row_force[rows.role == Role.TANGENT] / tangents.area
        expected = np.where(np.abs(tangents.normal[:, 0]) > 0.5, abs(traction), 0.0)
        everywhere(np.abs(np.abs(force) - expected).max(initial=0) < 1e-9, "another traction")


def rough(shear):
    """A cube pressed and pulled sideways on a larger base, which is refined at the edges."""
    bodies = {"base": block((-1, 0, -1), (2, 1, 0), (6, 2, 2), 1), "cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)}
    held = Dirichlet("base bottom", 0.0, 0.0, 0.0), Dirichlet("cube top", shear, 0.0, -5e-3)
    pair = ContactPair("cube bottom", "base top", friction=LinearSprings(STIFFNESS))
    return Scene("rough", root_mesh_from_shapes(bodies), dict.fromkeys(bodies, Material(YOUNG, 0.3)), held, pair)


def test_an_adaptive_path(folder):
    """Meshes are refined in each increment; the same on any number of ranks, and after a restart in the middle."""
    options = {"tolerance": 0.25, "degree": 1, "max_steps": 3, "solver": EXACT}
    alone = [point.step.record for point in increments(rough, SHEAR, comm=MPI.COMM_SELF, **options)]
    cells = [record.cells for record in alone]
    assert cells == sorted(cells) and cells[-1] > 40, "nothing is refined"
    found = [point.step.record for point in increments(rough, SHEAR[:2], folder=folder, **options)]
    found += [point.step.record for point in increments(rough, SHEAR, folder=folder, restart=True, **options)]
    assert len(found) == 3
    for one, other in zip(found, alone):
        assert (one.cells, one.active_pairs) == (other.cells, other.active_pairs)
        forces = (record.resultants[0].force for record in (one, other))
        assert next(forces) == pytest.approx(next(forces), rel=1e-7, abs=1e-10)
    assert abs(alone[-1].resultants[0].force[0]) < abs(alone[-2].resultants[0].force[0]), "no history"


def test_without_a_law():
    """A pair without a tangential law has neither rows nor forces of tangents."""
    step = next(adapt(sheared(SHEAR[0], law=None), 0.9))
    assert not (step.solution.rows.role == Role.TANGENT).any()
    assert abs(step.resultants[0].force[0]) < 1e-10


def test_frames():
    """n, t1, t2 are orthonormal and right-handed, along axes if n is, whatever its direction."""
    normal = np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(1).normal(size=(100, 3))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    one, two = tangent_axes(normal)
    assert np.abs(np.cross(one, two) - normal).max() < 1e-14
    assert np.abs(np.linalg.norm(one, axis=1) - 1).max() < 1e-14
    assert (np.sort(np.abs(one[:6]), axis=1) == [0, 0, 1]).all()
