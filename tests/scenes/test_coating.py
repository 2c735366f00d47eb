"""A coating of a thousandth of the size, indented, against an axisymmetric solution with layers."""

import pytest

from fx_contact import adapt
from studies.layers.run import coated, known


@pytest.mark.slow
@pytest.mark.parametrize(
    "ratio, tolerance, degree, within",
    [
        pytest.param(1e-3, 0.03, 2, 3e-3, marks=pytest.mark.ranks(1, 2, 3)),
        (10.0, 0.06, 2, 5e-3),
        (10.0, 0.2, 1, 0.04),
    ],
)
def test_force(ratio, tolerance, degree, within):
    """Within the square of the tolerance and the sampling of a round contact; PCG takes at most four times as many
    iterations as without a coating.
    """
    steps = [step.record for step in adapt(coated(10.0, ratio), tolerance, degree=degree, allow=("large strain",))]
    assert steps[-1].reached and steps[-1].force == pytest.approx(known(10.0, ratio), rel=within)
    assert max(max(record.krylov_iterations) for record in steps) <= 40
