"""The stress that is shown."""

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx import fem
from model_problems import DISTRIBUTIONS, conforming_positions, discrete, grown, pressed, roots, two_boxes

from fx_contact.estimate.shear_free import ShearFree
from fx_contact.estimate.stress_projection import projected_stress
from fx_contact.estimate.stress_recovery import six
from fx_contact.parallel.timing import Stages


def boxes(degree, distortion=0.15):
    """Elasticity on two boxes with hanging nodes, its leaves strewn over the ranks, and positions of the unknowns."""
    scene = pressed(two_boxes(distortion=distortion))
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 2, share=0.2))
    elasticity = discrete(scene, forest, degree=degree)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    assert elasticity.prolongation.hanging_global > 10
    return elasticity, position, ShearFree(np.zeros(position.shape, dtype=bool))


@pytest.mark.parametrize("degree", [1, 2])
def test_it_is_the_nearest_continuous_stress(degree):
    """sigma* - sigma_h is orthogonal to all continuous stresses."""
    elasticity, position, nowhere = boxes(degree)
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
    elasticity, position, nowhere = boxes(2, distortion=0.0)
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
