"""The recovered stress, the energies that come with it, and the stress that is shown."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx import fem
from model_problems import (
    ALONG,
    DISTRIBUTIONS,
    RUBBER,
    STEEL,
    conforming_positions,
    discrete,
    grown,
    pressed,
    roots,
    two_boxes,
    wedge,
)

from fx_contact import Dirichlet, Scene, adapt
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import ShearFree, find_shear_free
from fx_contact.estimate.stress_projection import projected_stress
from fx_contact.estimate.stress_recovery import StressRecovery, six
from fx_contact.fem.external_forces import body_force
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.items.boundary_conditions import BodyForce, Traction
from fx_contact.items.materials import VOIGT, Material
from fx_contact.parallel.timing import Stages

DEGREES = pytest.mark.parametrize("degree", (1, 2))


def boxes(degree=2, share=0.2, materials=(STEEL, RUBBER), force=None, distribution="roots", **shape):
    """Two boxes with hanging nodes: Elasticity, positions of its unknowns, no node without shear, and the Estimator."""
    scene = pressed(two_boxes(**shape), materials=materials)
    if force is not None:
        scene = replace(scene, body_forces=tuple(BodyForce(body, force) for body in scene.mesh.bodies))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2, share=share))
    elasticity = discrete(scene, forest, degree=degree)
    assert (elasticity.prolongation.hanging_global > 10) == (share > 0)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    nowhere = ShearFree(np.zeros(position.shape, dtype=bool))
    return elasticity, position, nowhere, Estimator(elasticity, nowhere, Stages(), body_force(scene, elasticity))


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
    elasticity, position, _, estimator = boxes(degree, bend=0.2)
    u = 0.1 * np.sin(3 * position)
    estimate = estimator.error(elasticity.field(u)).estimate
    energy, error2 = WORLD.allreduce(np.array([estimate.energy.sum(), (estimate.error**2).sum()]))
    assert estimate.relative > 0.04, "hardly an error"
    assert abs(energy / elasticity.energy_norm(u) ** 2 - 1) < 1e-12
    assert abs(error2 / estimate.error_global**2 - 1) < 1e-12
    assert abs((energy + error2) / estimate.energy_norm**2 - 1) < 1e-12
    assert estimate.cells == elasticity.prolongation.space.forest.size_global


@DEGREES
def test_no_shear_stress_where_symmetry_forbids_it(degree):
    """On planes across x that are named, s_xy and s_xz are 0, the other components as without."""
    elasticity, position, nowhere, _ = boxes(degree)
    field = elasticity.field(position @ np.array([[1.0, 0.5, 0.2], [0.3, 2.0, 0.4], [0.6, 0.1, 3.0]]))
    plane = np.zeros(position.shape, dtype=bool)
    plane[:, 0] = np.abs(position[:, 0]) < 1e-9
    recoveries = (StressRecovery(elasticity, where, Stages()) for where in (nowhere, ShearFree(plane)))
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
    elasticity, position, _, estimator = boxes(degree, bend=0.2)
    error = estimator.error(elasticity.field(np.cross([0.3, -0.2, 0.5], position) + [1.0, 2.0, 3.0]))
    assert error.estimate.energy_norm < 1e-12
    everywhere(np.abs(error.stress.x.array).max(initial=0) < 1e-12, "a stress")


#: Of degree 2 with E = 3 Pa and nu = 0, on boxes of cells.
UNIT_CELLS = {"materials": (Material(3.0, 0.0),) * 2, "distortion": 0.0}


def test_a_linear_stress_has_no_error():
    """At degree 2 it is recovered as it is, at hanging nodes and at the boundary too."""
    elasticity, position, _, estimator = boxes(**UNIT_CELLS)
    x, y, _ = position.T
    field = elasticity.field(np.stack([x**2, -4 * x * y, 0 * x], axis=1))  # in equilibrium
    error = estimator.error(field)
    x, y, _ = elasticity.prolongation.space.positions()[elasticity.node_of_block].T
    known = 3 * np.stack([2 * x, -4 * x, 0 * x, 0 * x, 0 * x, -2 * y], axis=1)
    everywhere(np.abs(error.stress.x.array.reshape(-1, 6) - known).max(initial=0) < 1e-11, "another stress")
    assert error.estimate.relative < 1e-12


def test_stresses_come_from_the_superconvergent_points():
    """Of the stress E y^2 they make E (y^2 - 1/6) at the ends of unit cells, E (y^2 + 1/12) in the middle."""
    elasticity, position, _, estimator = boxes(share=0.0, **UNIT_CELLS)
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
    elasticity, position, _, estimator = boxes(
        share=0.0, force=lambda x: np.stack([-18 * x[0], 0 * x[0], 0 * x[0]]), **UNIT_CELLS
    )
    x = position[:, 0]
    field = elasticity.field(np.stack([x**3, 0 * x, 0 * x], axis=1))
    estimate = estimator.error(field).estimate
    everywhere(np.abs(estimate.error**2 - 3 / 20).max(initial=0) < 1e-12, "another error")
    everywhere((estimator.error(field, loaded=False).estimate.error < 1e-6).all(), "a force that does not act")


def test_a_displacement_in_equilibrium_has_no_element_residual():
    """Of u = (x^2 y, 0, 0) with f = -div sigma (3) alone is left: E / 360 in a unit cell, of the shear E x^2 / 2."""
    elasticity, position, _, estimator = boxes(
        share=0.0, force=lambda x: np.stack([-6 * x[1], -3 * x[0], 0 * x[0]]), **UNIT_CELLS
    )
    x, y, _ = position.T
    field = elasticity.field(np.stack([x**2 * y, 0 * x, 0 * x], axis=1))
    loaded, free = (estimator.error(field, loaded=loaded).estimate for loaded in (True, False))
    everywhere(np.abs(loaded.error**2 - 3 / 360).max(initial=0) < 1e-12, "another error")
    assert free.error_global > 2 * loaded.error_global


def test_estimates_of_tall_cells_fall():
    """Those of a pressed column, clamped at both ends, its cells 1:40: true errors of nested meshes can only fall."""
    column = block((0.0, 0.0, 0.0), (1.0, 1.0, 10.0), (4, 4, 1), 1)
    mesh = root_mesh_from_shapes({"column": column}, {"foot": "column bottom", "head": "column top"})
    held = Dirichlet("foot", 0.0, 0.0, 0.0), Dirichlet("head", 0.0, 0.0, -0.01)
    scene = Scene("column", mesh, {"column": Material(1.0, 0.3)}, held, ())
    estimates = [step.record.estimate for step in adapt(scene, 0.1, WORLD, max_steps=3)]
    assert len(estimates) == 3
    assert max(np.diff(estimates)) < 0  # 0.208, 0.158, 0.096; with tractions on facets 0.208, 0.357, 0.425


@DEGREES
def test_the_stress_that_is_shown(degree):
    """It is the nearest continuous one to sigma_h: their difference is orthogonal to all of these."""
    elasticity, position, nowhere, _ = boxes(degree, distribution="strewn")
    field = elasticity.field(np.sin(3 * position + [0.0, 1.0, 2.0]))
    shown, dx = projected_stress(elasticity, field, nowhere, Stages()), elasticity.measure()
    any_stress = fem.Function(shown.function_space)
    nodal = np.cos(5 * position @ np.arange(18.0).reshape(3, 6))
    any_stress.x.array[:] = elasticity.at_blocks(elasticity.prolongation.prolong(nodal))
    off, size = shown - ufl.as_vector(six(elasticity.stress(field))), ufl.inner(shown, shown)
    products = [fem.assemble_scalar(fem.form(form * dx)) for form in (ufl.inner(off, any_stress), size)]
    product, size = WORLD.allreduce(np.array(products))
    assert abs(product) < 1e-7 * size and size > 0.1


def test_a_quadratic_displacement_has_its_linear_stress():
    """At degree 2, on boxes, at hanging nodes and at the boundary too; in each body by its own moduli."""
    elasticity, position, nowhere, _ = boxes(distribution="strewn", distortion=0.0)
    x, y, z = position.T
    field = elasticity.field(np.stack([x**2 + y * z, -4 * x * y, z * y], axis=1))
    shown = projected_stress(elasticity, field, nowhere, Stages())
    values = elasticity.at_leaves(shown)
    x, y, z = np.moveaxis(elasticity.prolongation.space.positions()[elasticity.prolongation.space.cells], -1, 0)
    strain = [2 * x, -4 * x, y, z / 2, y / 2, (z - 4 * y) / 2]
    first, second = np.empty((2, len(values), 1))
    for lame, of_leaf in zip(elasticity.lame, (first, second)):
        of_leaf[elasticity.leaf_mesh.leaf] = lame.x.array[lame.function_space.dofmap.list]
    known = [2 * second * e + (i < 3) * first * sum(strain[:3]) for i, e in enumerate(strain)]
    largest = WORLD.allreduce(float(np.abs(known).max(initial=0.0)))
    everywhere(np.abs(values - np.stack(known, axis=2)).max(initial=0.0) < 1e-6 * largest, "another stress")
