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
from conftest import WORLD, everywhere
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
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.external_forces import load
from fx_contact.items import materials as materials_module
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
    monkeypatch.setattr(materials_module, "LOCKING_POISSON", 1.0)
    assert indented(0, SOFT.poisson, degree) < locked * fine


@pytest.mark.parametrize("poisson, projects", [(0.3, False), (0.39, False), (0.4, True), (0.49, True)])
def test_bodies_that_could_lock(poisson, projects):
    """From nu = 0.4 on volume strains are projected; below, nothing is computed for that."""
    scene = pressed(two_boxes(), materials=(STEEL, Material(young=1.0, poisson=poisson)))
    assert discrete(scene, roots(scene)).projects == projects
