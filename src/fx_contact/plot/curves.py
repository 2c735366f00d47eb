"""Curves: contact pressure over radius, error over unknowns, force over approach."""

from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.adaptive_loop import Run
from fx_contact.adaptive.contact_table import ContactTable
from fx_contact.adaptive.step import Step, check_step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.items.units import Units, labelled
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import OutputError, SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_comm, check_kind, check_kinds, check_name, check_number
from fx_contact.path.load_path import LoadPath, SweepPoint
from fx_contact.path.sweep_record import SweepRecord
from fx_contact.plot.canvas import axes_for, draw_on_first
from fx_contact.results.analytic import Hertz
from fx_contact.results.reference_values import ContactReference
from fx_contact.verdict.contact_figures import AXIS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Least ratio of the semi-axes of the ellipse with the second moments of the forces in round contact: 0.81 of a sphere
#: with four closed pairs (`contact_figures.ROUND`), 0.56 of cylinders with radii 10 and 25, crossed.
_ROUND = 0.7
#: The same ratio of a quarter of round contact about the common centre, ((1 - 2 / pi) / (1 + 2 / pi))^(1/2).
_QUARTER = 0.47
#: What entries of a record are.
_DIMENSIONS = {"force": "force", "max_pressure": "stress", "contact_radius": "length", "max_penetration": "length"}


@collective("step.forest.comm")
def draw_pressure(
    step: Step,
    path: str | Path | None = None,
    exact: Hertz | ContactReference | None = None,
    *,
    ax: "Axes | None" = None,
) -> "Path | Axes | None":
    """Contact pressure of all contact nodes over the radius, and a known solution with the differences from it.

    Collective on the step's communicator; rank 0 draws, into the PNG of the path or on `ax`, which is returned.

    Raises:
        SceneError: no step, or one without contact; contact that is not round, unless there is an exact solution; an
            exact solution of another kind.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=True)
    if exact is not None:
        check_kind("the exact solution", exact, Hertz, ContactReference)
    elif not _is_round(step):
        raise SceneError(
            "the contact is not round, so that its pressure is no function of a radius: call "
            "draw_pressure_map(step, path), or step.contact.along(start, end)"
        )
    table = step.contact.gathered()
    draw = partial(_draw_pressure, table=table, record=step.record, exact=exact)
    return draw_on_first(step.forest.comm, path, draw, axes_for, ax)


def _is_round(step: Step) -> bool:
    """False if the forces have other second moments in one direction than in another, or act at several contacts.

    Collective.
    """
    contact, mirrors, comm, record = step.contact, step.scene.mirrors, step.forest.comm, step.record
    if np.count_nonzero(record.pair_forces) > 1:
        return False
    if not record.force:
        return True
    arm = contact.points - np.asarray(record.contact_centre)
    tensor = mirrors.second_moment(comm.allreduce((arm.T * contact.force) @ arm))
    vector = mirrors.force(comm.allreduce(contact.force @ contact.normal))
    square = float(vector @ vector)
    if square <= (AXIS * mirrors.parts / step.scene.symmetry * record.force) ** 2:
        return False
    across = np.eye(3) - np.outer(vector, vector) / square
    _, least, most = np.sort(np.linalg.eigvalsh(across @ tensor @ across))
    whole = mirrors.parts == step.scene.symmetry
    return bool(least >= (_ROUND if whole else _QUARTER * _ROUND) ** 2 * most)


def _draw_pressure(
    axes: "Axes", table: ContactTable | None, record: StepRecord, exact: Hertz | ContactReference | None
) -> None:
    assert table is not None, "gathered on rank 0"
    arm = table.points - np.asarray(record.contact_centre)
    height = np.einsum("ni,ni->n", arm, table.normal)
    radius = np.sqrt(np.maximum((arm**2).sum(axis=1) - height**2, 0))
    closed = record.contact_radius  # None: the contact is not round
    reach = 1.6 * (radius[table.active].max(initial=0.0) if closed is None else closed) or radius.max(initial=0.0)
    near = radius <= reach
    scale = exact.contact_radius if exact else 1.0
    axes.plot(
        radius[near] / scale, table.pressure[near], "o", ms=4, mfc="none", color="#0072B2", label="contact nodes"
    )
    if exact:
        r, name = np.linspace(0, reach, 400, dtype=np.float64), getattr(exact, "name", "Hertz")
        axes.plot(r / scale, exact.pressure(r), color="#D55E00", lw=1.6, label=f"{name}, F = {exact.force:.4g}")
    below = axes
    if exact and axes.get_subplotspec():  # axes that the user placed leave no room below
        below = _add_strip(axes)
        off = table.pressure[near] - exact.pressure(radius[near])
        below.axhline(0, color="#D55E00", lw=1.2)
        below.plot(radius[near] / scale, 100 * off / exact.max_pressure, "o", ms=3, mfc="none", color="#0072B2")
        below.set_ylabel("difference\n[% of largest]", fontsize=8)
    units = record.units
    below.set_xlabel(f"radius / contact radius of {name}" if exact else labelled("radius", "length", units))
    axes.set_ylabel(labelled("contact pressure", "stress", units))
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_title(f"{record.dofs:,} dofs, estimated error {100 * record.estimate:.1f} %", fontsize=11)
    axes.legend(frameon=False)


def _add_strip(axes: "Axes") -> "Axes":
    """Axes below others, in a quarter of their space."""
    place = axes.get_subplotspec()
    assert place is not None
    places = place.subgridspec(2, 1, height_ratios=(3, 1))
    axes.set_subplotspec(places[0])
    axes.tick_params(labelbottom=False)
    below = axes.figure.add_subplot(places[1], sharex=axes)
    below.spines[["top", "right"]].set_visible(False)
    return below


@collective("comm")
def draw_convergence(
    records: Run | Sequence[StepRecord],
    path: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    ax: "Axes | None" = None,
) -> "Path | Axes | None":
    """Estimated errors of a run, or of its records, over the unknowns, and true errors where they were computed.

    Collective on comm; rank 0 draws, into the PNG of the path or on `ax`, which is returned.  The records are the same
    on all ranks.

    Raises:
        SceneError: comm is no communicator, or a record is none.
        OutputError: there is no record, or the picture cannot be written.
    """
    check_comm(comm)
    records = records.records if isinstance(records, Run) else records
    check_kinds("the records", records, StepRecord)
    if not records:
        raise OutputError("no convergence to draw: there is no record of a step")
    return draw_on_first(comm, path, partial(_draw_convergence, records=records), axes_for, ax)


def _draw_convergence(axes: "Axes", records: Sequence[StepRecord]) -> None:
    dofs, error = np.array([(r.dofs, 100 * r.estimate) for r in records]).T
    true = np.array([(r.dofs, 100 * r.true_error.relative) for r in records if r.true_error])
    axes.loglog(dofs, error, "o-", color="#0072B2", label="estimated")
    if len(true):
        axes.loglog(*true.T, "s", color="#D55E00", label="true")
    axes.axhline(100 * records[-1].tolerance, color="#555555", ls=":", label="tolerance")
    degree = records[-1].degree
    smooth = error[-1] * (dofs / dofs[-1]) ** (-degree / 3)
    label = f"uniform cells, smooth solution: dofs$^{{-{degree}/3}}$"
    axes.loglog(dofs, smooth, "--", color="#999999", lw=1, label=label)
    axes.set_xlabel("unknowns")
    axes.set_ylabel("relative energy error [%]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:,g}")
        axis.set_minor_formatter(_few_digits)
    axes.legend(frameon=False)


@collective("comm")
def draw_sweep(
    points: LoadPath | Sequence[SweepRecord | SweepPoint],
    path: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    quantity: "str | Callable[[StepRecord], float]" = "force",
    label: str = "value",
    logarithmic: bool = False,
    ax: "Axes | None" = None,
) -> "Path | Axes | None":
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
    units = known[-1].record.units
    draw = partial(_draw_sweep, rows=rows, quantity=name, label=label, logarithmic=logarithmic, units=units)
    return draw_on_first(comm, path, draw, axes_for, ax)


def _draw_sweep(
    axes: "Axes", rows: FloatArray, quantity: str, label: str, logarithmic: bool, units: Units = None
) -> None:
    axes.plot(*rows[np.argsort(rows[:, 0])].T, "o-", color="#0072B2")
    if logarithmic:
        axes.loglog()
    axes.set_xlabel(label)
    axes.set_ylabel(labelled(quantity.replace("_", " "), _DIMENSIONS.get(quantity, ""), units))


def _few_digits(value: float, _position: float) -> str:
    """Labels of the ticks at 2, 3 and 5 times a power of ten; more would run into each other."""
    first = f"{value:.0e}"[0]
    return f"{value:,g}" if first in "235" else ""
