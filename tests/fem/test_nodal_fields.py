"""Fields at nodes that are carried on: polynomials stay what they are, to rounding."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import grown, pressed, roots, two_boxes

from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.fem.nodal_fields import NodalFields
from fx_contact.forest.partition import KINDS


def field(forest, degree, power):
    """A polynomial of the position at the nodes of a degree: (n, (degree+1)^3, 1)."""
    return (leaf_positions(forest, slice(None), degree) @ [[1.0], [2.0], [-3.0]]) ** power


def made(degree):
    """A field of the degree, and the positions, on a forest with hanging nodes."""
    forest = grown(roots(pressed(two_boxes(margin=1))), 2)
    fields = NodalFields.of(forest, degree, {"polynomial": field(forest, degree, degree)})
    return fields.with_field("positions", leaf_positions(forest, slice(None), degree))


def check(fields, degree):
    """They are what they were."""
    expected = field(fields.forest, fields.degree, degree), leaf_positions(fields.forest, slice(None), fields.degree)
    for name, values in zip(("polynomial", "positions"), expected):
        off = np.abs(fields[name] - values).max(initial=0.0)
        everywhere(off < 1e-12 * max(1.0, np.abs(values).max(initial=0.0)), f"{name} is off by {off}")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degree", [1, 2])
def test_polynomials_stay(degree, kind):
    """Through refinement, repartition and coarsening, one after the other."""
    fields = made(degree)
    check(fields, degree)
    finer = fields.refined((np.arange(len(fields.forest)) % 3).astype(np.int8))
    assert finer.forest.size_global > 2 * fields.forest.size_global
    moved = finer.repartitioned(kind)
    coarse = moved.coarsened(np.maximum(moved.forest.level - 1, 0), kind)
    assert coarse.forest.size_global < moved.forest.size_global
    for one in (finer, moved, coarse):
        check(one, degree)


def test_degrees_and_names():
    """A linear field is one of degree 2 too; fields are replaced and removed by name."""
    linear = made(1)
    check(linear.of_degree(2), 1)
    assert (
        linear.of_degree(1) is linear
        and "positions" in linear
        and linear.without("positions").sizes.keys() == {"polynomial"}
    )
    twice = linear.with_field("polynomial", 2 * linear["polynomial"])
    everywhere(np.array_equal(twice["polynomial"], 2 * linear["polynomial"]), "not replaced")
    none = NodalFields.of(linear.forest, 2, {})
    assert none.degree == 2 and none.refined(np.zeros(len(none.forest), np.int8)).sizes == {}
    with pytest.raises(KeyError):
        none["positions"]
    assert WORLD.allreduce(len(none.array)) == linear.forest.size_global
