"""Truth of curves and scale bars: values in the unit of their labels, against figures made up."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from model_problems import step_record
from mpi4py import MPI

from fx_contact.path.load_path import SweepPoint
from fx_contact.path.sweep_record import SweepRecord
from fx_contact.plot.canvas import add_length
from fx_contact.plot.curves import _draw_convergence, _draw_pressure, _draw_sweep, draw_sweep


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
    records = [
        step_record(0, dofs=1000, estimate=0.4, degree=2, tolerance=0.05),
        step_record(1, dofs=8000, estimate=0.1, degree=2, tolerance=0.05, true_error=SimpleNamespace(relative=0.08)),
    ]
    _draw_convergence(axes, records[:1])
    assert np.allclose(lines(axes)["estimated"], [(1000, 40)])
    axes.clear()
    _draw_convergence(axes, records)
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
    )
    record = step_record(0, contact_centre=(1.0, 2.0, 3.0), contact_radius=0.6, dofs=1000, estimate=0.125)
    exact = SimpleNamespace(contact_radius=0.5, max_pressure=10.0, force=2.0, pressure=lambda r: 10.0 - 10 * r)
    _draw_pressure(axes, table, record, exact)
    _, below = axes.figure.axes
    assert np.allclose(lines(axes)["contact nodes"], [(0, 8), (1, 3)]), "the third is farther than 1.6 radii"
    assert np.allclose(lines(axes)["Hertz, F = 2"][-1], [1.6 * 0.6 / 0.5, 10 - 9.6])
    off = below.lines[-1].get_data()
    assert np.allclose(off, [(0, 1), (-20, -20)]) and below.get_ylabel() == "difference\n[% of largest]"
    assert axes.get_title() == "1,000 dofs, estimated error 12.5 %"
    assert below.get_xlabel() == "radius / contact radius of Hertz" and axes.get_ylabel() == "contact pressure"


@pytest.mark.parametrize("active, radius", [(True, None), (False, 0.0)])
def test_pressure_of_one_pair(axes, active, radius):
    """Where no closed pair is away from the contact's centre all pairs are drawn."""
    points, normal = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.tile([0.0, 0.0, 1.0], (2, 1))
    shown = SimpleNamespace(points=points, normal=normal, pressure=np.zeros(2), active=np.array([active, False]))
    record = step_record(0, contact_centre=(0.0, 0.0, 0.0), contact_radius=radius, dofs=10, estimate=0.5)
    _draw_pressure(axes, shown, record, None)
    assert np.allclose(lines(axes)["contact nodes"], [(0, 0), (2, 0)])
    _draw_pressure(axes, shown, replace(record, units=("mm", "GPa")), None)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("radius [mm]", "contact pressure [GPa]")


def test_sweep(axes):
    """In the order of the values, with the names of both."""
    _draw_sweep(axes, np.array([(2.0, 30.0), (1.0, 10.0)]), "max_pressure", "depth [m]", True)
    assert np.allclose(axes.lines[0].get_data(), [(1, 2), (10, 30)])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("depth [m]", "max pressure") and axes.get_xscale() == "log"
    _draw_sweep(axes, np.ones((1, 2)), "max_pressure", "depth [mm]", False, ("mm", "MPa"))
    assert axes.get_ylabel() == "max pressure [MPa]"
    _draw_sweep(axes, np.ones((1, 2)), "dofs", "depth [mm]", False, ("mm", "MPa"))
    assert axes.get_ylabel() == "dofs"


def test_points_of_a_sweep(axes):
    """Points as `sweep` yields them are drawn as their records are."""
    figures = {"begun": "anew", "solves": 1, "unknowns": 0, "cpu_seconds": 0.0}
    records = [
        SweepRecord(point=point, value=float(point), record=step_record(0, force=2.0 + point), **figures)
        for point in range(2)
    ]
    draw_sweep([SweepPoint(1.0, None, records[1]), records[0]], comm=MPI.COMM_SELF, ax=axes)
    assert np.allclose(axes.lines[0].get_data(), [(0, 1), (2, 3)])

    def twice(record):
        """A function of a record, whose name is at the axis."""
        return 2 * record.force

    draw_sweep(records, comm=MPI.COMM_SELF, ax=axes, quantity=twice)
    assert np.allclose(axes.lines[1].get_data(), [(0, 1), (4, 6)]) and axes.get_ylabel() == "twice"


@pytest.mark.parametrize("scale, length", [(1.0, 0.2), (3.0, 1.0), (0.013, 0.005), (240.0, 50.0)])
def test_scale_bar(scale, length):
    """As long as it says, across the view, inside the picture."""
    drawn = {}
    plotter = SimpleNamespace(
        camera=SimpleNamespace(parallel_scale=scale, focal_point=(1.0, 2.0, 3.0), up=(0, 0, 1)),
        renderer=SimpleNamespace(GetViewport=lambda: (0.0, 0.0, 0.5, 1.0)),
        window_size=(1600, 600),
        add_lines=lambda ends, **_: drawn.update(ends=ends),
        add_point_labels=lambda at, texts, **_: drawn.update(at=at, text=texts[0]),
        reset_camera_clipping_range=lambda: None,
    )
    plotter.camera.position = np.array(plotter.camera.focal_point) - (0.0, 10.0, 0.0)
    add_length(plotter)
    along = drawn["ends"][1] - drawn["ends"][0]
    assert np.allclose(along, [length, 0, 0]) and float(drawn["text"]) == length
    add_length(plotter, ("mm", "MPa"))
    assert drawn["text"] == f"{length:g} mm"
    seen = (drawn["ends"] - plotter.camera.focal_point) @ np.eye(3)[:, [0, 2]] / scale  # of half the height
    assert (np.abs(seen) < [800 / 600, 1.0]).all() and (drawn["at"][0] - drawn["ends"][0])[2] > 0
