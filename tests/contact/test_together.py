"""A tie, contact of surfaces meshed apart, and an obstacle below a force in one scene, meeting at edges."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import leaves
from mpi4py import MPI

from fx_contact import (
    ContactPair,
    Dirichlet,
    Displacement,
    Material,
    RigidSphere,
    Scene,
    SymmetryPlane,
    Tie,
    adapt,
    block,
    root_mesh_from_shapes,
    solve,
)

FORCE = 1e-3


def pressed(**ball):
    """A ball on a block that is tied onto another one and stands beside a wall, all meshed apart."""
    bodies = {
        "low": block((0, 0, 0), (1, 1, 1), (2, 2, 1), 1),
        "high": block((0, 0, 1), (1, 1, 2), (3, 3, 2), 1),
        "wall": block((1, 0, 0.5), (1.5, 1, 2), (1, 2, 3), 1),
    }
    held = Dirichlet("low bottom", x=0.0, y=0.0, z=0.0), Dirichlet("wall right", x=0.0, y=0.0, z=0.0)
    return Scene(
        name="together",
        mesh=root_mesh_from_shapes(bodies),
        materials={"low": Material(1.0, 0.3), "high": Material(2.0, 0.45), "wall": Material(5.0, 0.2)},
        dirichlet=(*held, *(SymmetryPlane(f"{body} front") for body in bodies)),
        contact=(
            ContactPair("high top", RigidSphere((0.7, 0.0, 3.0), 1.0), **ball),
            ContactPair("high right", "wall left"),
        ),
        ties=(Tie("low top", "high bottom"),),
        symmetry=2,
    )


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("degree, most", [(1, 2), (2, 1)])
def test_forces(degree, most):
    """Of the ball as prescribed, all in equilibrium, and on the tie; the same as on one rank."""
    scene, goal = pressed(force=(0.0, 0.0, -FORCE)), Displacement((0.0, 0.0, 1.5), (0, 0, 1), 0.1)
    runs = [
        list(adapt(scene, 0.3, comm, degree=degree, max_steps=2, goals=(goal,))) for comm in (WORLD, MPI.COMM_SELF)
    ]
    for here, alone in zip(*runs, strict=True):
        everywhere(np.array_equal(leaves(here.forest), leaves(alone.forest)), "other leaves")
        ball, wall = here.record.pair_forces
        assert abs(ball / FORCE - 1) < 1e-6 and wall > 0
        # Each solve leaves up to 1e-7 of the forces.
        assert np.allclose(here.record.pair_forces, alone.record.pair_forces, rtol=2e-7, atol=0)
        assert np.allclose(here.record.goals[0].value, alone.record.goals[0].value, rtol=1e-6)
        forces = {one.name: np.array(one.force) for one in here.resultants if one.kind in ("contact", "tie")}
        assert abs(forces["low top tied to high bottom"][2] / FORCE - 1) < 1e-6
        for one in here.resultants:
            if one.kind == "balance":
                assert np.abs([*one.force, *one.moment]).max() < 1e-7 * FORCE
        rows = here.rows
        everywhere(np.isfinite(rows.modulus[:, 0]).all() and (rows.bodies[:, 0] == 1).all(), "bodies of the rows")


@pytest.mark.ranks(2)
def test_remote_rows():
    """Rows with nodes of other ranks: none on one rank, and fewer where the partition keeps facing leaves together."""
    scene = pressed(moved=(0.0, 0.0, -0.02))
    together, apart = (solve(scene, 0.9, degree=1, partition_kind=kind).record for kind in ("contact-sfc", "sfc"))
    assert together.partition.split_pairs < apart.partition.split_pairs
    assert together.remote_rows < apart.remote_rows
    assert solve(scene, 0.9, MPI.COMM_SELF, degree=1).record.remote_rows == 0
