"""Patch tests: fields that the discretisation must reproduce, through hanging nodes, contact and random partitions.

Where penetration is prevented, uniform compression is linear in each body.  A penalty k lets bodies overlap by F/k,
which leaves a jump p A/k at each node pair that varies where the tributary area A and the stiffness k do: the piecewise
linear field is not a solution.  For the penalty every pair starts with the gap -p A/k: pressed by the uniform pressure
p its penetration is p A/k without a jump of the displacement, and the exact solution is linear in each body again.
What is tested is that the forces of the pairs, area by area, balance the uniform stress of both bodies.  On facets that
are parallelograms A is the integral of the vertex's shape function; there the patch test is exact.
"""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx.fem import Function, assemble_scalar, form
from model_problems import (
    DISTRIBUTIONS,
    RUBBER,
    STEEL,
    conforming_positions,
    discrete,
    gathered,
    grown,
    pressed,
    roots,
    solved,
    two_boxes,
)
from mpi4py import MPI

from fx_contact import Material
from fx_contact.contact.enforcement import METHODS, Enforcement
from fx_contact.contact.row_kinds import create_rows
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.fem import elasticity as elasticity_module
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.external_forces import load
from fx_contact.fem.supports import Supports
from fx_contact.geometry import hexahedron
from fx_contact.items.boundary_conditions import Dirichlet, Traction
from fx_contact.items.contact import ContactPair
from fx_contact.parallel.timing import Stages
from fx_contact.scene.scene import Scene

PRESSURE = 0.01
SOFT = Material(young=1.0, poisson=0.4999)


def compressed(materials):
    """Two blocks between frictionless plates and two symmetry planes, and the strains (lateral, axial) of each."""
    mesh = two_boxes(upper=(2, 2, 2), depth=2, distortion=0.2, flat_contact=False)
    strain = [(m.poisson * PRESSURE / m.young, -PRESSURE / m.young) for m in materials]
    held = [Dirichlet(f"{body} {axis} low", **{axis: 0.0}) for body in ("lower", "upper") for axis in "xy"]
    plates = [Dirichlet("lower z low", z=-2 * strain[0][1]), Dirichlet("upper z high", z=2 * strain[1][1])]
    contact = ContactPair("lower contact", "upper contact", direction=(0, 0, 1))
    scene = Scene("patch", mesh, dict(zip(mesh.bodies, materials)), (*held, *plates), (contact,))
    return scene, np.array([(lateral, lateral, axial) for lateral, axial in strain])


@pytest.mark.parametrize(
    "degree, materials",
    [(1, (STEEL, RUBBER)), (1, (SOFT, STEEL)), (2, (STEEL, RUBBER))],
    ids=["unlike", "incompressible", "degree 2"],
)
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("method", METHODS)
def test_uniform_compression(degree, method, distribution, materials):
    """Two pressed blocks of distorted cells, refined at random, are in uniform stress to 1e-10."""
    scene, strain = compressed(materials)
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.1))
    elasticity = discrete(scene, forest, degree=degree)
    prolongation = elasticity.prolongation
    enforcement = Enforcement(method)
    pairs = create_rows(scene, prolongation, enforcement)
    everywhere(np.abs(pairs.gap).max(initial=0) < 1e-13, "a gap between the blocks")
    areas = gathered(WORLD, pairs.area)
    assert areas.max() > 4 * areas.min(), "contact is not refined unevenly"
    if method == "penalty":
        pairs = replace(pairs, gap=-PRESSURE * pairs.area / pairs.stiffness)
    supports = find_supports(scene, forest, prolongation)
    forces = load(scene, forest, elasticity)
    contact = solved(elasticity, pairs, supports, enforcement, forces)
    position, body = conforming_positions(forest, prolongation)
    exact = position * strain[body]
    size = WORLD.allreduce(np.abs(exact).max(), MPI.MAX)
    everywhere(np.abs(contact.displacement - exact).max() < 1e-10 * size, "the displacement is not linear")
    everywhere(contact.active.all(), "an open pair")
    total = WORLD.allreduce(contact.force.sum())
    assert abs(total - 4 * PRESSURE) < 1e-9 * 4 * PRESSURE
    everywhere(np.abs(contact.pressure / PRESSURE - 1).max(initial=0) < 1e-8, "the pressure is not uniform")

    estimator = Estimator(elasticity, find_shear_free(scene, forest, prolongation), Stages())
    error = estimator.error(elasticity.field(contact.displacement)).estimate
    assert error.relative < 1e-8, "the recovered stress of a linear field is that field's"
    energy = sum(4 * 2 * PRESSURE**2 / m.young for m in materials)
    assert abs(error.energy_norm**2 - energy) < 1e-9 * energy


def test_penalty_gap():
    """Without the initial overlap the force falls short by what the penalty gives way, inversely to its factor."""
    scene, strain = compressed((STEEL, RUBBER))
    forest = grown(roots(scene), 2, share=0.1)
    elasticity = discrete(scene, forest)
    short = []
    for factor in (100.0, 1000.0):
        enforcement = Enforcement("penalty", factor)
        pairs = create_rows(scene, elasticity.prolongation, enforcement)
        supports = find_supports(scene, forest, elasticity.prolongation)
        contact = solved(elasticity, pairs, supports, enforcement)
        short.append(1 - WORLD.allreduce(contact.force.sum()) / (4 * PRESSURE))
        everywhere((contact.penetration[contact.active] > 0).all(), "an active pair that does not overlap")
    assert 0 < short[1] < short[0] < 0.01
    assert abs(short[0] / short[1] - 10) < 0.1


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_translation(order):
    """A translation of the held faces moves everything alike, on curved cells and through hanging nodes, to 1e-10."""
    mesh = two_boxes(order=order, bend=0.15 if order > 1 else 0.0)
    shift = dict(x=0.1, y=-0.2, z=0.3)
    held = Dirichlet("lower z low", **shift), Dirichlet("upper z high", **shift)
    scene = Scene("shift", mesh, {"lower": STEEL, "upper": RUBBER}, held)
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 3, share=0.1))
    elasticity = discrete(scene, forest, order)
    assert elasticity.prolongation.hanging_global > 50
    supports = find_supports(scene, forest, elasticity.prolongation)
    contact = solved(elasticity, None, supports)
    everywhere(np.abs(contact.displacement - list(shift.values())).max() < 1e-10, "not a translation")
    assert contact.contact_iterations == 1 and len(contact.active) == 0


GRADIENT = np.array([[0.01, 0.02, 0.0], [-0.01, 0.03, 0.01], [0.0, -0.02, -0.02]])


def linear_boundary_error(mesh, rounds):
    """Energy error, relative, of the solution with a linear field prescribed at all boundary vertices."""
    scene = pressed(mesh, contact=False)
    forest = roots(scene)
    for _ in range(rounds):
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
    forest = DISTRIBUTIONS["contact-sfc"](forest)
    elasticity = discrete(scene, forest, mesh.order)
    prolongation = elasticity.prolongation
    outside = np.zeros((len(forest.vertices), 1))
    leaf, face = forest.boundary_faces(np.argwhere(mesh.face_neighbours == 1))
    outside[forest.vertices.cells[leaf[:, None], hexahedron.FACE_CORNERS[face]]] = 1
    outside = prolongation.restrict(outside)[:, 0] > 0
    position, _ = conforming_positions(forest, prolongation)
    supports = Supports(np.where(outside[:, None], position @ GRADIENT.T, np.nan))
    assert WORLD.allreduce(int((~outside).sum())) > 0
    contact = solved(elasticity, None, supports)
    u = elasticity.field(contact.displacement).function
    strain = ufl.as_matrix(((GRADIENT + GRADIENT.T) / 2).tolist())
    energies = []
    for gradient in (ufl.sym(ufl.grad(u)) - strain, strain):
        stress = elasticity.lame[0] * ufl.tr(gradient) * ufl.Identity(3) + 2 * elasticity.lame[1] * gradient
        dx = ufl.Measure("dx", elasticity.mesh, metadata={"quadrature_degree": 6})
        energies.append(WORLD.allreduce(assemble_scalar(form(ufl.inner(stress, gradient) * dx))))
    return np.sqrt(max(energies[0], 0) / energies[1])


def test_linear_field_on_straight_cells():
    """On distorted straight-sided cells a linear field prescribed on the boundary is reproduced."""
    assert linear_boundary_error(two_boxes(distortion=0.2), 1) < 1e-10


@pytest.mark.parametrize("order", [2, 3])
def test_linear_field_on_curved_cells(order):
    """On curved cells the energy error of a linear field falls at first order under uniform refinement."""
    mesh = two_boxes(upper=(1, 1, 1), order=order, bend=0.3)
    errors = [linear_boundary_error(mesh, rounds) for rounds in (1, 2, 3)]
    assert errors[0] > 1e-4, "the cells are not curved"
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (rates > 0.9).all(), f"rates {rates}"


def test_displacement_is_a_function_on_the_leaf_mesh():
    """A field has the values of the conforming displacement at the vertices of dolfinx's own coordinates."""
    scene = pressed(two_boxes())
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 2))
    elasticity = discrete(scene, forest)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    u = elasticity.field(position @ GRADIENT.T).function
    other = Function(elasticity.function_space)
    other.interpolate(lambda x: GRADIENT @ x)
    everywhere(np.abs(other.x.array - u.x.array).max() < 1e-14, "displacements sit at other vertices")


def indented(rounds, poisson, degree=1):
    """Mean displacement work of a clamped block under a uniform load, refined alike."""
    mesh = two_boxes(upper=(2, 2, 2), depth=2)
    held = tuple(Dirichlet(where, x=0.0, y=0.0, z=0.0) for where in ("lower z low", "upper z high"))
    load_on = (Traction("lower contact", (0.0, 0.0, -PRESSURE)),)
    soft = Material(young=1.0, poisson=poisson)
    scene = Scene("clamped", mesh, {"lower": soft, "upper": STEEL}, held, tractions=load_on)
    forest = roots(scene)
    for _ in range(rounds):
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
    forest = DISTRIBUTIONS["contact-sfc"](forest)
    elasticity = discrete(scene, forest, degree=degree)
    supports = find_supports(scene, forest, elasticity.prolongation)
    forces = load(scene, forest, elasticity)
    return WORLD.allreduce(float((forces * solved(elasticity, None, supports, forces=forces).displacement).sum()))


@pytest.mark.parametrize("degree, off, locked", [(1, 0.2, 0.5), (2, 0.02, 0.92)])
def test_nearly_incompressible_cells_do_not_lock(degree, off, locked, monkeypatch):
    """Two cells across give what eight, or at degree 2 four, give; fully integrated they are too stiff."""
    coarse, fine = (indented(rounds, SOFT.poisson, degree) for rounds in (0, 3 - degree))
    assert abs(coarse / fine - 1) < off
    monkeypatch.setattr(elasticity_module, "LOCKING_POISSON", 1.0)
    assert indented(0, SOFT.poisson, degree) < locked * fine


def test_cells_of_rubber_do_not_lock(monkeypatch):
    """At nu = 0.49 fully integrated cells converge, slowly: two cells across come close to eight of those."""
    coarse = indented(0, 0.49)
    monkeypatch.setattr(elasticity_module, "LOCKING_POISSON", 1.0)
    locked, fine = indented(0, 0.49), indented(2, 0.49)
    assert abs(coarse / fine - 1) < 0.1 and locked < 0.6 * fine


@pytest.mark.parametrize("poisson, projects", [(0.3, False), (0.39, False), (0.4, True), (0.49, True)])
def test_bodies_that_could_lock(poisson, projects):
    """From nu = 0.4 on volume strains are projected; below, nothing is computed for that."""
    scene = pressed(two_boxes(), materials=(STEEL, Material(young=1.0, poisson=poisson)))
    assert discrete(scene, roots(scene)).projects == projects
