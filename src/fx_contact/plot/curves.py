"""Curves: contact pressure over the distance from the centre, error over unknowns, force over approach."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.adaptive_loop import Run
from fx_contact.adaptive.contact_table import ContactTable
from fx_contact.adaptive.step import Step, check_step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.items.units import labelled
from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_comm, check_kind, check_kinds, check_name, check_number
from fx_contact.path.load_path import BEFORE, LoadPath, SweepPoint
from fx_contact.path.sweep_record import SweepRecord
from fx_contact.plot.canvas import axes_for, draw_on_first
from fx_contact.results.analytic import KnownPressure

#: What entries of a record are.
_DIMENSIONS = {"force": "force", "max_pressure": "stress", "contact_radius": "length", "max_penetration": "length"}
#: Colours of computed and of known values.
_COMPUTED, _KNOWN = "#0072B2", "#D55E00"
#: Of tractions that stick, and that slip.
_OF_STATUS = "#009E73", "#E69F00"


@collective("step.forest.comm")
def draw_pressure(
    step: Step, path: str | Path | None = None, exact: KnownPressure | None = None, *, ax: Any = None
) -> Any:
    """Contact pressure of all contact nodes over their distance from the centre of the contact, and a known solution.

    With friction also the tangential tractions of nodes that stick, and that slip.

    A curve in round contact only; maps and lines of any contact: `results.contact_grid`.

    Collective on the step's communicator; rank 0 draws, into the PNG of the path or on `ax`, which is returned.

    Raises:
        SceneError: no step, or one without contact; an exact solution of another kind.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=True)
    if exact is not None:
        check_kind("the exact solution", exact, KnownPressure)
    table = step.contact.gathered()

    def draw(axes: Any) -> None:
        """On rank 0, which has the table."""
        assert table is not None, "gathered on rank 0"
        _draw_pressure(axes, table, step.record, exact)

    return draw_on_first(step.forest.comm, path, draw, axes_for, ax)


def _draw_pressure(axes: Any, table: ContactTable, record: StepRecord, exact: KnownPressure | None) -> None:
    arm = table.points - np.asarray(record.contact_centre)
    height = np.einsum("ni,ni->n", arm, table.normal)
    radius = np.sqrt(np.maximum((arm**2).sum(axis=1) - height**2, 0))
    closed = record.contact_radius  # None: the contact is not round
    reach = 1.6 * (radius[table.active].max(initial=0.0) if closed is None else closed) or radius.max(initial=0.0)
    near = radius <= reach
    scale = exact.contact_radius if exact else 1.0
    marks = {"ls": "", "marker": "o", "mfc": "none", "color": _COMPUTED}
    axes.plot(radius[near] / scale, table.pressure[near], ms=4, label="contact nodes", **marks)
    if table.traction is not None:
        traction = np.linalg.norm(table.traction, axis=1)
        for slips, name, mark in ((False, "stick", "s"), (True, "slip", "^")):
            some = near & table.active & (table.slipping == slips)
            look = {"ms": 4, "color": _OF_STATUS[slips], "label": f"traction, {name}"}
            axes.plot(radius[some] / scale, traction[some], mark, **look)
    title = labelled("distance from the centre", "length", record.units)
    if exact:
        r, name = np.linspace(0, reach, 400, dtype=np.float64), getattr(exact, "name", "Hertz")
        title = f"distance / contact radius of {name}"
        axes.plot(r / scale, exact.pressure(r), color=_KNOWN, lw=1.6, label=f"{name}, F = {exact.force:.4g}")
        off = 100 * (table.pressure[near] - exact.pressure(radius[near])) / exact.max_pressure
        inset = axes.inset_axes((0.66, 0.42, 0.33, 0.28))
        inset.axhline(0, color=_KNOWN, lw=1.2)
        inset.plot(radius[near] / scale, off, ms=3, **marks)
        inset.set_title("difference [% of largest]", fontsize=8)
        inset.tick_params(labelsize=8)
    told = f"{record.dofs:,} dofs, estimated error {100 * record.estimate:.1f} %"
    pressure = labelled("contact pressure", "stress", record.units)
    axes.set(xlabel=title, ylabel=pressure, ylim=(0, None), xlim=(0, None), title=told)
    axes.legend(frameon=False)


@collective("comm")
def draw_convergence(
    records: Run | Sequence[StepRecord],
    path: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    ax: Any = None,
) -> Any:
    """Estimated errors of a run, or of its records, over the unknowns, and true errors where they were computed.

    Collective on comm; rank 0 draws, into the PNG of the path or on `ax`, which is returned.  The records are the same
    on all ranks.

    Raises:
        SceneError: comm is no communicator, or a record is none.
        OutputError: there is no record, or the picture cannot be written.
    """
    check_comm(comm)
    steps = records.records if isinstance(records, Run) else records
    check_kinds("the records", steps, StepRecord)
    if not steps:
        raise OutputError("no convergence to draw: there is no record of a step")

    def draw(axes: Any) -> None:
        """Errors and the tolerance [%]; the slope of smooth solutions ends at the last estimate."""
        dofs, error = np.array([(step.dofs, 100 * step.estimate) for step in steps]).T
        true = np.array([(step.dofs, 100 * step.true_error.relative) for step in steps if step.true_error])
        axes.loglog(dofs, error, "o-", color=_COMPUTED, label="estimated")
        if len(true):
            axes.loglog(*true.T, "s", color=_KNOWN, label="true")
        axes.axhline(100 * steps[-1].tolerance, color="#555555", ls=":", label="tolerance")
        degree = steps[-1].degree
        label = f"uniform cells, smooth solution: dofs$^{{-{degree}/3}}$"
        axes.loglog(dofs, error[-1] * (dofs / dofs[-1]) ** (-degree / 3), "--", color="#999999", lw=1, label=label)
        axes.set(xlabel="unknowns", ylabel="relative energy error [%]")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:,g}")
            axis.set_minor_formatter(_few_digits)
        axes.legend(frameon=False)

    return draw_on_first(comm, path, draw, axes_for, ax)


@collective("comm")
def draw_sweep(
    points: LoadPath | Sequence[SweepRecord | SweepPoint],
    path: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    quantity: str | Callable[[StepRecord], float] = "force",
    label: str = "value",
    logarithmic: bool = False,
    ax: Any = None,
) -> Any:
    """A quantity over the parameter of a load path, or of its points; with the force, a force-approach curve.

    Collective on comm; rank 0 draws, into the PNG of the path or on `ax`, which is returned.  The points are the same
    on all ranks.

    Args:
        quantity: entry of a StepRecord that is a number, or a function of the record; its name is at the axis.
        label: of the parameter, with its unit.
        logarithmic: scale of both axes.

    Raises:
        SceneError: comm is no communicator, a point is none, or there is no such entry.
        OutputError: there is no point, or the picture cannot be written.
    """
    check_comm(comm)
    points = points.records if isinstance(points, LoadPath) else points
    check_kinds("the points", points, SweepRecord, SweepPoint)
    if not points:
        raise OutputError("no curve to draw: there is no point of a sweep, which is solved as it is iterated")
    known = [point.record if isinstance(point, SweepPoint) else point for point in points]
    numbers = [name for name, value in vars(known[0].record).items() if isinstance(value, (int, float))]
    if not callable(quantity):
        check_name("entry of a record", quantity, numbers)
    of = quantity if callable(quantity) else attrgetter(quantity)
    name = getattr(quantity, "__name__", "quantity") if callable(quantity) else quantity
    rows = np.array([(point.value, check_number(f"the {name} of a record", of(point.record))) for point in known])
    title = labelled(name.replace("_", " "), _DIMENSIONS.get(name, ""), known[-1].record.units)

    def draw(axes: Any) -> None:
        """In the order of the values, increments in their own: unloading is another curve."""
        history = any(point.begun == BEFORE for point in known)
        axes.plot(*(rows if history else rows[np.argsort(rows[:, 0])]).T, "o-", color=_COMPUTED)
        if logarithmic:
            axes.loglog()
        axes.set(xlabel=label, ylabel=title)

    return draw_on_first(comm, path, draw, axes_for, ax)


def _few_digits(value: float, _position: float) -> str:
    """Labels of the ticks at 2, 3 and 5 times a power of ten; more would run into each other."""
    first = f"{value:.0e}"[0]
    return f"{value:,g}" if first in "235" else ""
