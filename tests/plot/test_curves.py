"""Truth of curves: values in the unit of their labels, against figures made up."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from model_problems import step_record
from mpi4py import MPI

from fx_contact.adaptive.step_record import TrueError
from fx_contact.path.load_path import SweepPoint
from fx_contact.path.sweep_record import SweepRecord
from fx_contact.plot import draw_convergence, draw_sweep
from fx_contact.plot.curves import _draw_pressure


@pytest.fixture
def axes():
    """Axes of matplotlib that nobody sees."""
    from matplotlib.figure import Figure

    return Figure().subplots()


def lines(axes):
    """What is drawn, by label: points (n, 2)."""
    return {line.get_label(): np.array(line.get_data()).T for line in axes.lines}


def test_convergence(axes):
    """Errors and tolerance in per cent; the slope of smooth solutions ends at the last estimate."""
    true = TrueError(0.0, 0.0, 1, 0.08)
    records = [
        step_record(0, dofs=1000, estimate=0.4, degree=2, tolerance=0.05),
        step_record(1, dofs=8000, estimate=0.1, degree=2, tolerance=0.05, true_error=true),
    ]
    draw_convergence(records[:1], comm=MPI.COMM_SELF, ax=axes)
    assert np.allclose(lines(axes)["estimated"], [(1000, 40)])
    axes.clear()
    draw_convergence(records, comm=MPI.COMM_SELF, ax=axes)
    drawn = lines(axes)
    assert axes.get_ylabel() == "relative energy error [%]" and axes.get_xlabel() == "unknowns"
    assert np.allclose(drawn["estimated"], [(1000, 40), (8000, 10)]) and np.allclose(drawn["true"], [(8000, 8)])
    assert np.allclose(drawn["tolerance"][:, 1], 5)
    (smooth,) = (points for label, points in drawn.items() if "smooth" in label)
    assert "-2/3" in str(list(drawn)) and np.allclose(smooth[:, 1], [10 * 8 ** (2 / 3), 10])


def test_pressure(axes):
    """Radii about the contact's centre over the exact one, pressures as they are, differences in % of the largest."""
    table = SimpleNamespace(
        points=np.array([[1.0, 2.0, 7.0], [1.0, 2.5, 3.0], [5.0, 2.0, 3.0]]),
        normal=np.tile([0.0, 0.0, 1.0], (3, 1)),
        pressure=np.array([8.0, 3.0, 0.0]),
        active=np.array([True, True, False]),
        traction=None,
    )
    record = step_record(0, contact_centre=(1.0, 2.0, 3.0), contact_radius=0.6, dofs=1000, estimate=0.125)
    exact = SimpleNamespace(contact_radius=0.5, max_pressure=10.0, force=2.0, pressure=lambda r: 10.0 - 10 * r)
    _draw_pressure(axes, table, record, exact)
    (inset,) = axes.child_axes
    assert np.allclose(lines(axes)["contact nodes"], [(0, 8), (1, 3)]), "the third is farther than 1.6 radii"
    assert np.allclose(lines(axes)["Hertz, F = 2"][-1], [1.6 * 0.6 / 0.5, 10 - 9.6])
    off = inset.lines[-1].get_data()
    assert np.allclose(off, [(0, 1), (-20, -20)]) and inset.get_title() == "difference [% of largest]"
    assert axes.get_title() == "1,000 dofs, estimated error 12.5 %"
    assert axes.get_xlabel() == "distance / contact radius of Hertz" and axes.get_ylabel() == "contact pressure"


@pytest.mark.parametrize("active, radius", [(True, None), (False, 0.0)])
def test_pressure_of_one_pair(axes, active, radius):
    """Where no closed pair is away from the contact's centre all pairs are drawn."""
    points, normal = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.tile([0.0, 0.0, 1.0], (2, 1))
    values = {"pressure": np.zeros(2), "active": np.array([active, False]), "traction": None}
    shown = SimpleNamespace(points=points, normal=normal, **values)
    record = step_record(0, contact_centre=(0.0, 0.0, 0.0), contact_radius=radius, dofs=10, estimate=0.5)
    _draw_pressure(axes, shown, record, None)
    assert np.allclose(lines(axes)["contact nodes"], [(0, 0), (2, 0)])
    _draw_pressure(axes, shown, replace(record, units=("mm", "GPa")), None)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("distance from the centre [mm]", "contact pressure [GPa]")


def point(number, units=None, **figures):
    """A point of a load path, at the value of its number."""
    costs = {"begun": "anew", "solves": 1, "unknowns": 0, "cpu_seconds": 0.0}
    return SweepRecord(point=number, value=float(number), record=step_record(0, units=units, **figures), **costs)


def test_sweep(axes):
    """In the order of the values, with the names of both."""
    draw = partial(draw_sweep, comm=MPI.COMM_SELF, ax=axes, label="depth [m]")
    draw([point(2, max_pressure=30.0), point(1, max_pressure=10.0)], quantity="max_pressure", logarithmic=True)
    assert np.allclose(axes.lines[0].get_data(), [(1, 2), (10, 30)])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("depth [m]", "max pressure") and axes.get_xscale() == "log"
    for quantity, label in (("max_pressure", "max pressure [MPa]"), ("dofs", "dofs")):
        draw([point(1, ("mm", "MPa"))], quantity=quantity)
        assert axes.get_ylabel() == label


def test_increments_in_their_order(axes):
    """Unloading is another curve than loading."""
    records = [replace(point(number, force=10.0 * i), begun="before") for i, number in enumerate((0, 2, 1))]
    draw_sweep(records, comm=MPI.COMM_SELF, ax=axes)
    assert np.allclose(axes.lines[0].get_data(), [(0, 2, 1), (0, 10, 20)])


def test_points_of_a_sweep(axes):
    """Points as `sweep` yields them are drawn as their records are."""
    records = [point(number, force=2.0 + number) for number in range(2)]
    draw_sweep([SweepPoint(1.0, None, records[1]), records[0]], comm=MPI.COMM_SELF, ax=axes)
    assert np.allclose(axes.lines[0].get_data(), [(0, 1), (2, 3)])

    def twice(record):
        """A function of a record, whose name is at the axis."""
        return 2 * record.force

    draw_sweep(records, comm=MPI.COMM_SELF, ax=axes, quantity=twice)
    assert np.allclose(axes.lines[1].get_data(), [(0, 1), (4, 6)]) and axes.get_ylabel() == "twice"
