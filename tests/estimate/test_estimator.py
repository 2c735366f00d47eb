"""The recovered stress, and the energies that come with it."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import ALONG, conforming_positions, discrete, grown, pressed, roots, two_boxes, wedge

from fx_contact import Dirichlet, Scene, adapt
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import VOIGT, ShearFree, find_shear_free
from fx_contact.estimate.stress_recovery import StressRecovery
from fx_contact.fem.external_forces import body_force
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.parallel.timing import Stages
from fx_contact.problem.boundary_conditions import BodyForce, Traction
from fx_contact.problem.materials import Material
from studies.boxes import DOWN, UP, Boxes

DEGREES = pytest.mark.parametrize("degree", (1, 2))


@pytest.mark.parametrize("loaded", [False, True])
def test_no_shear_stress_on_oblique_planes(loaded):
    """At nodes on planes n.s.t = 0 for all t along them, unless a plane is loaded; what has no shear stays."""
    sides = dict(zip(("left", "front", "bottom"), np.linalg.inv(ALONG)))
    scene = wedge(tractions=(Traction("bottom", (0.0, 0.0, 0.1)),) if loaded else ())
    forest = grown(roots(scene), 2, share=0.1)
    prolongation = Prolongation(Space(forest, 2))
    position, _ = conforming_positions(forest, prolongation)
    index = [[VOIGT.index((min(i, j), max(i, j))) for j in range(3)] for i in range(3)]
    up, before = ALONG[:, 2], np.sin(9 * position @ np.arange(18.0).reshape(3, 6))
    calm = np.array([(2 * np.eye(3) + 3 * np.outer(up, up))[pair] for pair in VOIGT]) + np.zeros((len(position), 1))
    found, shear_free = before.copy(), find_shear_free(scene, forest, prolongation)
    for stress in (found, calm):
        kept = stress.copy()
        shear_free.remove_shear(stress)
        everywhere(stress is found or np.abs(stress - kept).max(initial=0.0) < 1e-13, "a stress without shear")
    anywhere = np.zeros(len(position), dtype=bool)
    for side, normal in sides.items():
        normal = normal / np.linalg.norm(normal)
        on = np.abs(position @ normal) < 1e-9
        traction = found[on][:, index] @ normal
        along = traction - np.outer(traction @ normal, normal)
        if not (loaded and side == "bottom"):
            everywhere(np.abs(along).max(initial=0.0) < 1e-13, f"shear on the plane {side}")
            anywhere |= on
    everywhere((found[~anywhere] == before[~anywhere]).all(), "another stress elsewhere")
    assert WORLD.allreduce(int((~anywhere & (np.abs(position @ up) < 1e-9)).sum())) > 0 or not loaded


@DEGREES
def test_energies_add_up(degree):
    """The energy of sigma_h is that of its displacement; omega (4) has xi too, omega^2 = |sigma_h|^2 + xi^2."""
    scene = pressed(two_boxes(bend=0.2))
    forest = grown(roots(scene), 2, share=0.2)
    elasticity = discrete(scene, forest, degree=degree)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    u = 0.1 * np.sin(3 * position)
    nowhere = ShearFree(np.zeros(u.shape, dtype=bool))
    estimate = Estimator(elasticity, nowhere, Stages()).error(elasticity.field(u)).estimate
    energy, error2 = WORLD.allreduce(np.array([estimate.energy.sum(), (estimate.error**2).sum()]))
    assert estimate.relative > 0.04, "hardly an error"
    assert abs(energy / elasticity.energy_norm(u) ** 2 - 1) < 1e-12
    assert abs(error2 / estimate.error_global**2 - 1) < 1e-12
    assert abs((energy + error2) / estimate.energy_norm**2 - 1) < 1e-12
    assert estimate.cells == forest.size_global


@DEGREES
def test_no_shear_stress_where_symmetry_forbids_it(degree):
    """On planes across x that are named, s_xy and s_xz are 0, the other components as without."""
    scene = pressed(two_boxes())
    forest = grown(roots(scene), 1, share=0.2)
    elasticity = discrete(scene, forest, degree=degree)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    field = elasticity.field(position @ np.array([[1.0, 0.5, 0.2], [0.3, 2.0, 0.4], [0.6, 0.1, 3.0]]))
    plane = np.zeros(position.shape, dtype=bool)
    plane[:, 0] = np.abs(position[:, 0]) < 1e-9
    recoveries = (StressRecovery(elasticity, ShearFree(which), Stages()) for which in (0 * plane > 0, plane))
    free, held = (recovery.stress(field) for recovery in recoveries)
    on = elasticity.at_blocks(elasticity.prolongation.prolong(np.repeat(plane[:, :1], 6, axis=1).astype(float)))
    on, free, held = (values.reshape(-1, 6) for values in (on, free.x.array, held.x.array))
    on = np.abs(on - 1).max(axis=1) < 1e-12
    shear = [VOIGT.index(pair) for pair in ((0, 1), (0, 2))]
    others = [i for i in range(6) if i not in shear]
    assert WORLD.allreduce(int(on.sum())) > 4
    everywhere(np.abs(held[on][:, shear]).max(initial=0) < 1e-12, "a shear stress")
    everywhere(np.abs(free[:, shear]).min(initial=1) > 0.1, "no shear stress without symmetry")
    everywhere(np.abs(held - free)[:, others].max(initial=0) < 1e-12, "another normal stress")


@DEGREES
def test_rigid_motions_have_no_error(degree):
    """Nor stress, on bent cells with hanging nodes."""
    scene = pressed(two_boxes(bend=0.2))
    forest = grown(roots(scene), 2, share=0.2)
    elasticity = discrete(scene, forest, degree=degree)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    field = elasticity.field(np.cross([0.3, -0.2, 0.5], position) + [1.0, 2.0, 3.0])
    error = Estimator(elasticity, ShearFree(np.zeros(position.shape, dtype=bool)), Stages()).error(field)
    assert error.estimate.energy_norm < 1e-12
    everywhere(np.abs(error.stress.x.array).max(initial=0) < 1e-12, "a stress")


def unit_cells(hanging, force=None):
    """Elasticity of degree 2 on boxes of cells with E = 3 Pa and nu = 0, positions of its unknowns, an Estimator."""
    scene = pressed(two_boxes(distortion=0.0), materials=(Material(3.0, 0.0),) * 2)
    forest = grown(roots(scene), 2, share=0.2) if hanging else roots(scene)
    if force is not None:
        scene = replace(scene, body_forces=tuple(BodyForce(body, force) for body in scene.mesh.bodies))
    elasticity = discrete(scene, forest, degree=2)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    nowhere = ShearFree(np.zeros(position.shape, dtype=bool))
    return elasticity, position, Estimator(elasticity, nowhere, Stages(), body_force(scene, elasticity))


def test_a_linear_stress_has_no_error():
    """At degree 2 it is recovered as it is, at hanging nodes and at the boundary too."""
    elasticity, position, estimator = unit_cells(hanging=True)
    x, y, _ = position.T
    assert elasticity.prolongation.hanging_global > 10
    field = elasticity.field(np.stack([x**2, -4 * x * y, 0 * x], axis=1))  # in equilibrium
    error = estimator.error(field)
    x, y, _ = elasticity.prolongation.space.positions()[elasticity.node_of_block].T
    known = 3 * np.stack([2 * x, -4 * x, 0 * x, 0 * x, 0 * x, -2 * y], axis=1)
    everywhere(np.abs(error.stress.x.array.reshape(-1, 6) - known).max(initial=0) < 1e-11, "another stress")
    assert error.estimate.relative < 1e-12


def test_stresses_come_from_the_superconvergent_points():
    """Of the stress E y^2 they make E (y^2 - 1/6) at the ends of unit cells, E (y^2 + 1/12) in the middle."""
    elasticity, position, estimator = unit_cells(hanging=False)
    x, y, _ = position.T
    field = elasticity.field(np.stack([x * y**2, 0 * x, 0 * x], axis=1))
    stress = estimator.error(field).stress.x.array.reshape(-1, 6)[:, VOIGT.index((0, 0))]
    y = elasticity.prolongation.space.positions()[elasticity.node_of_block, 1]
    known = 3 * (y**2 - np.where(np.abs(y - np.rint(y)) < 0.1, 1 / 6, -1 / 12))
    everywhere(np.abs(stress - known).max(initial=0) < 1e-12, "another stress")


def test_the_element_residual_is_the_error_of_a_cubic():
    """Of u = x^3 and its quadratic interpolant, in a unit cell E / 20; the recovered stress is that of the interpolant.

    Without the body force f = -6 E x nothing is left: div sigma_h is constant in each cell.
    """
    elasticity, position, estimator = unit_cells(
        hanging=False, force=lambda x: np.stack([-18 * x[0], 0 * x[0], 0 * x[0]])
    )
    x = position[:, 0]
    field = elasticity.field(np.stack([x**3, 0 * x, 0 * x], axis=1))
    estimate = estimator.error(field).estimate
    everywhere(np.abs(estimate.error**2 - 3 / 20).max(initial=0) < 1e-12, "another error")
    everywhere((estimator.error(field, loaded=False).estimate.error < 1e-6).all(), "a force that does not act")


def test_a_displacement_in_equilibrium_has_no_element_residual():
    """Of u = (x^2 y, 0, 0) with f = -div sigma (3) alone is left: E / 360 in a unit cell, of the shear E x^2 / 2."""
    elasticity, position, estimator = unit_cells(
        hanging=False, force=lambda x: np.stack([-6 * x[1], -3 * x[0], 0 * x[0]])
    )
    x, y, _ = position.T
    field = elasticity.field(np.stack([x**2 * y, 0 * x, 0 * x], axis=1))
    loaded, free = (estimator.error(field, loaded=loaded).estimate for loaded in (True, False))
    everywhere(np.abs(loaded.error**2 - 3 / 360).max(initial=0) < 1e-12, "another error")
    assert free.error_global > 2 * loaded.error_global


def test_estimates_of_tall_cells_fall():
    """Those of a pressed column, clamped at both ends, its cells 1:40: true errors of nested meshes can only fall."""
    boxes = Boxes(1)
    boxes.add("column", (0.0, 0.0, 0.0), (1.0, 1.0, 10.0), (4, 4, 1))
    ends = {"foot": boxes.facets(DOWN, 0.0), "head": boxes.facets(UP, 10.0)}
    held = Dirichlet("foot", 0.0, 0.0, 0.0), Dirichlet("head", 0.0, 0.0, -0.01)
    scene = Scene("column", boxes.mesh(ends), {"column": Material(1.0, 0.3)}, held, ())
    estimates = [step.record.estimate for step in adapt(scene, 0.16, WORLD, max_steps=3)]
    assert len(estimates) == 3
    assert max(np.diff(estimates)) < 0  # 0.208, 0.158, 0.096; with tractions on facets 0.208, 0.357, 0.425
