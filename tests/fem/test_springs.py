"""Elastic supports: exact rods, forces of known displacements, the same stiffness in matrix, forces and energy."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    ALONG,
    DISTRIBUTIONS,
    PLANES,
    STEEL,
    conforming_positions,
    discrete,
    grown,
    roots,
    solved,
    wedge,
)
from petsc4py import PETSc

from fx_contact import Dirichlet, Elastic, Scene, Traction, block, cylinder, root_mesh_from_shapes
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.external_forces import load
from fx_contact.fem.supports import Supports

pytestmark = pytest.mark.ranks(1, 2, 3)

PULL = 0.01


def rod(material=STEEL, cells=(2, 2, 2), **parts):
    """A unit cube, its inner nodes out of place, pulled at the top."""
    shape = block((0, 0, 0), (1, 1, 1), cells, 1).placed(lambda x: x + 0.1 * np.sin(np.pi * x).prod(axis=0))
    mesh = root_mesh_from_shapes({"rod": shape}, {side: f"rod {side}" for side in shape.sides})
    return Scene("rod", mesh, {"rod": material}, **{"tractions": (Traction("top", (0, 0, PULL)),)} | parts)


def on_springs(stiffness):
    """Rods on springs and their exact displacement (n, 3) at points: along the normal of a wedge, and along axes."""
    normal, strain = ALONG[:, 2], PULL / STEEL.young
    along = np.outer(normal, normal)
    oblique = wedge(held=PLANES[:2], springs=Elastic("bottom", stiffness), tractions=Traction("top", PULL * normal))
    exact = {
        "oblique": lambda x: strain * x @ ((1 + STEEL.poisson) * along - STEEL.poisson * np.eye(3)),
        "axes": lambda x: np.column_stack([0 * x[:, :2], PULL * x[:, 2] / STEEL.young]),
    }
    held = Elastic("bottom", x=1e-3, y=2e-3, z=0.25 * stiffness), Elastic("bottom", normal=0.75 * stiffness)
    scenes = {"oblique": oblique, "axes": rod(replace(STEEL, poisson=0.0), springs=held)}
    shift = {"oblique": PULL / stiffness * normal, "axes": np.array([0, 0, PULL / stiffness])}
    return {name: (scenes[name], lambda x, name=name: exact[name](x) + shift[name]) for name in scenes}


@pytest.mark.parametrize("name", ["oblique", "axes"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("distribute", DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)
def test_exact_rod(name, degree, distribute):
    """Its displacement is linear: rigid by the springs, uniform strain; reactions and energy are those of springs."""
    stiffness = 0.5
    scene, exact = on_springs(stiffness)[name]
    forest = distribute(grown(roots(scene), 2))
    elasticity = discrete(scene, forest, degree=degree)
    assert elasticity.prolongation.hanging_global > 0
    supports = find_supports(scene, forest, elasticity.prolongation)
    u = solved(elasticity, None, supports, forces=load(scene, forest, elasticity)).displacement
    position, _ = conforming_positions(forest, elasticity.prolongation)
    everywhere(np.abs(u - exact(position)).max(initial=0.0) < 1e-11, "another displacement")
    field = elasticity.field(u)
    totals = WORLD.allreduce(elasticity.springs.totals(elasticity.at_leaves(field.function))).sum(axis=(0, 1))
    area = 1.0 if name == "axes" else np.linalg.norm(np.cross(ALONG[:, 0], ALONG[:, 1]))
    across = ALONG[:, 2] if name == "oblique" else np.array([0.0, 0.0, 1.0])
    assert np.abs(totals[:3] + PULL * area * across).max() < 1e-11
    assert np.abs(totals[:3] + stiffness * area * across * (exact(np.zeros((1, 3))) @ across)).max() < 1e-11
    energy = PULL**2 * area * (1 / STEEL.young + 1 / stiffness)  # the rod is 1 long
    assert abs(elasticity.energy_norm(u) ** 2 / energy - 1) < 1e-9


def test_matrix_forces_and_energy_are_of_one_stiffness():
    """K u is the internal force, u . K u the energy; the coarse level is I^T K I, with oblique and hanging nodes."""
    scene = wedge(held=PLANES[:1], distortion=0.0, springs=(Elastic("bottom", 0.5), Elastic("top", x=1, y=2, z=3)))
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 2))
    elasticity = discrete(scene, forest, degree=2)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    u = np.sin(position @ np.array([[1.0, 2, 0], [0, 1, 3], [2, 0, 1]]))
    matrix = elasticity.stiffness().mat
    matrix.assemble()
    x, y = matrix.createVecs()
    x.array[:] = u.ravel()
    matrix.mult(x, y)
    forces = elasticity.internal_forces(elasticity.field(u)).ravel()
    everywhere(np.abs(y.array - forces).max(initial=0.0) < 1e-12, "another force")
    assert abs(x.dot(y) / elasticity.energy_norm(u) ** 2 - 1) < 1e-12
    nothing = Supports(np.full(u.shape, np.nan))
    coarse = create_coarse_level(elasticity, nothing)
    product = matrix.convert(PETSc.Mat.Type.AIJ).ptap(coarse.interpolation)
    assert (product - coarse.matrix).norm() < 1e-12 * product.norm()
    without = discrete(wedge(held=PLANES, distortion=0.0), forest, degree=2).energy_norm(u)
    assert elasticity.energy_norm(u) > 1.01 * without


def test_round_surface():
    """A cylinder moved across its axis by d: half of its surface resists; turned about its axis, none of it."""
    pin = cylinder(2.0, 3.0, (2, 2), 3)
    mesh = root_mesh_from_shapes({"pin": pin}, {side: f"pin {side}" for side in pin.sides})
    scene = Scene("pin", mesh, {"pin": STEEL}, Dirichlet("bottom", 0.0, 0.0, 0.0), springs=Elastic("outside", 0.7))
    forest = DISTRIBUTIONS["strewn"](roots(scene))
    elasticity = discrete(scene, forest, order=3)
    position, _ = conforming_positions(forest, elasticity.prolongation)

    def total(u):
        """Force and moment about the origin."""
        leaves = elasticity.at_leaves(elasticity.field(u).function)
        return WORLD.allreduce(elasticity.springs.totals(leaves)).sum(axis=(0, 1))

    across, turned = np.full(position.shape, [0.01, 0.0, 0.0]), 0.01 * np.cross([0.0, 0.0, 1.0], position)
    force = -0.7 * 0.01 * np.pi * 2.0 * 3.0
    assert np.abs(total(across) - [force, 0, 0, 0, 1.5 * force, 0]).max() < 1e-4 * abs(force)
    assert np.abs(total(turned)).max() < 0.01 * abs(force)
