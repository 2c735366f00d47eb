"""Results on disk: step records as JSON lines, fields for ParaView."""

import json
import math
import os

import basix.ufl
import numpy as np
from dolfinx import fem

from fx_contact.adaptive.step import check_step
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import as_folder, check_comm
from fx_contact.results.contact_surface import contact_functions
from fx_contact.results.vtx import function_on, write_vtu, write_vtx

#: Entries by which the record of a state is known, and the relative difference that solving for it again may make.
_TELLING, _SAME = ("cells", "dofs", "force", "estimate"), 1e-6


class RecordWriter:
    """Writes `steps.jsonl`: a step record a line, each on disk as soon as it is written.

    Collective on comm.

    Args:
        folder: for the results; made if it is not there.
        comm: MPI communicator.
        finished: list of StepRecord, of the steps before a restart.  With them the complete lines of the file stay,
            and missing ones are added; without, the file is begun anew.

    Attributes:
        path: of the file.

    Raises:
        SceneError: comm is no communicator.
        OutputError: the folder cannot be made or written, or has records of other steps than those before the restart.
    """

    @collective("comm")
    def __init__(self, folder, comm, finished=()):
        check_comm(comm)
        self.path = shared_path(comm, "the output folder", folder, OutputError, as_folder) / "steps.jsonl"
        self._comm, self._step, self._start = comm, None, 0  # the last step written, and where its line starts
        with together(comm):
            if comm.rank == 0:
                with writing(self.path):
                    self._begin(finished)

    @collective("self._comm")
    def write(self, record):
        """Append a record, or replace the last one written if it is of the same step.

        Collective on comm.

        Args:
            record: StepRecord.

        Raises:
            OutputError: the file cannot be written.
        """
        with together(self._comm):
            if self._comm.rank == 0:
                with writing(self.path):
                    self._write(record)

    def _begin(self, finished):
        """Keep the complete lines of finished steps, and add those that are missing.  Local."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.exists() and not self.path.is_file():  # a pipe would keep us waiting
            raise OutputError(f"{str(self.path)!r} is no file: remove it, or name another output folder")
        before = self.path.read_bytes() if finished and self.path.exists() else b""
        lines = before[: before.rfind(b"\n") + 1]
        there = [_step_of(line, finished) for line in lines.splitlines()]
        if None in there:
            raise OutputError(
                f"line {there.index(None) + 1} of {str(self.path)!r} is of another run, or of a step which the run "
                "that goes on has not done: name the output folder of that run, or a new one"
            )
        if not lines:
            self.path.write_bytes(b"")
        elif lines != before:
            os.truncate(self.path, len(lines))
        for record in finished:
            if record.step not in there:
                self._write(record)

    def _write(self, record):
        with self.path.open("rb+") as file:
            end = file.seek(0, os.SEEK_END)
            if record.step != self._step:
                self._step, self._start = record.step, end
            file.seek(self._start)
            file.write(json.dumps(record.as_json()).encode() + b"\n")
            file.truncate()


def _step_of(line, finished):
    """Number of the finished step whose record a line of `steps.jsonl` is, but for what it cost; None if of none."""
    try:
        entries = json.loads(line)
        known = next(record for record in finished if record.step == entries["step"])
        same = all(math.isclose(entries[name], getattr(known, name), rel_tol=_SAME) for name in _TELLING)
    except (ValueError, LookupError, TypeError, StopIteration):
        return None
    return known.step if same else None


@collective("step.forest.comm")
def write_fields(step, folder):
    """Write a step's fields for ParaView; all files keep the curved shape of the cells.

    Collective.  `fields.bp` (ADIOS2, VTX) has the continuous fields displacement [m] and stress [Pa] (`point_fields`);
    `cells.bp` has one value a cell: indicator [J^(1/2)], level, rank; `contact.pvtu` (VTK) has the fields on both sides
    of the contact surfaces, if there are any (`contact_functions`).

    Args:
        step: Step.
        folder: for the files, which are replaced if they are there.

    Raises:
        SceneError: no step.
        OutputError: a file cannot be written, or there is no room for it; then one that was there before still is.
    """
    check_step(step)
    comm, time, mesh, leaf = step.forest.comm, step.record.step, step.mesh, step.leaf_mesh.leaf
    folder = shared_path(comm, "the output folder", folder, OutputError, as_folder)
    write_vtx(comm, folder / "fields.bp", point_fields(step), time)
    values = {
        "indicator": step.estimate.error,
        "level": step.forest.level[leaf],
        "rank": np.full(len(leaf), comm.rank),
    }
    cells = [function_on(mesh, ("DG", 0), name, value[:, None, None]) for name, value in values.items()]
    write_vtx(comm, folder / "cells.bp", cells, time)
    if step.pairs is not None:
        write_vtu(comm, folder / "contact.pvtu", list(contact_functions(step).values()), time)


@collective("step.forest.comm")
def point_fields(step):
    """Displacement and stress at the points by which ParaView draws curved cells.

    Collective on the step's communicator.  VTX draws the cells of a function's order.  That of these is the higher one
    of geometry and displacement, so that the fields are written as they are, nothing of them lost.

    Args:
        step: Step.

    Returns:
        list of dolfinx Function: `displacement` [m] and `stress` [Pa], at equispaced points of each cell.
    """
    order, variant, fields = max(step.leaf_mesh.order, step.record.degree), basix.LagrangeVariant.equispaced, []
    for name, given in (("displacement", step.displacement), ("stress", step.stress)):
        element = basix.ufl.element("Lagrange", "hexahedron", order, lagrange_variant=variant, shape=given.ufl_shape)
        fields.append(fem.Function(fem.functionspace(step.mesh, element), name=name))
        fields[-1].interpolate(given)
    return fields
