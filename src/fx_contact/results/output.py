"""Results on disk: step records as JSON lines, fields for ParaView."""

import json
import os
import shutil

import basix.ufl
import numpy as np
from dolfinx import fem
from dolfinx.io import VTXWriter

from fx_contact.adaptive.step import check_step
from fx_contact.adaptive.step_record import SolveRecord
from fx_contact.estimate.recovery import VOIGT
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.errors import OutputError, SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm, shown
from fx_contact.problem import hexahedron
from fx_contact.results.contact_surface import write_contact

#: Entries by which records of one state are known, and the relative difference that solving for it again may make.
_TELLING, _SAME = ("scene", "enforcement", "geometry_order", "cells", "dofs", "max_level", "force", "estimate"), 1e-6
#: Bytes that a rank's part of a file of ADIOS2 takes at most beside its arrays, in whole blocks of the disk.
_HEAD_BYTES = 2**15


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
        SceneError: comm is no communicator, or finished no list of records.
        OutputError: the folder cannot be made or written, or has records of other steps than those before the restart.
    """

    def __init__(self, folder, comm, finished=()):
        check_comm(comm)
        self.path = shared_path(comm, "the output folder", folder, OutputError) / "steps.jsonl"
        self._comm, self._step, self._start = comm, None, 0  # the last step written, and where its line starts
        with together(comm):
            if comm.rank == 0:
                self._try(lambda: self._begin(finished))

    def write(self, record):
        """Append a record, or replace the last one written if it is of the same step.

        Collective on comm.

        Args:
            record: StepRecord.

        Raises:
            SceneError: it is none, or JSON cannot hold it.
            OutputError: the file cannot be written.
        """
        with together(self._comm):
            if self._comm.rank == 0:
                self._try(lambda: self._write(record))

    def _begin(self, finished):
        if not isinstance(finished, (list, tuple)) or not all(isinstance(record, SolveRecord) for record in finished):
            raise SceneError(f"finished must be a list of the records of steps, got {shown(finished)}")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.exists() and not self.path.is_file():  # a pipe would keep us waiting
            raise OutputError(f"{str(self.path)!r} is no file: remove it, or name another output folder")
        before = self.path.read_bytes() if finished and self.path.exists() else b""
        lines = before[: before.rfind(b"\n") + 1]
        there = {entries["step"]: entries for entries in map(_entries, lines.splitlines()) if entries is not None}
        self._check_same_run(there, {record.step: json.loads(_line(record)) for record in finished})
        if not lines:
            self.path.write_bytes(b"")
        elif lines != before:
            os.truncate(self.path, len(lines))
        for record in finished:
            if record.step not in there:
                self._write(record)

    def _check_same_run(self, there, finished):
        """See that the records of the file are of finished steps, whatever they cost, and on how many ranks.

        Args:
            there, finished: step -> entries of its record, in the file and in the run that goes on.

        Raises:
            OutputError: they are of another run, whose records would be mixed with those of this one.
        """
        for step, entries in there.items():
            known = finished.get(step)
            if known is None:
                told = "which the run that goes on has not done yet"
            elif unlike := [name for name in _TELLING if not _agree(entries.get(name), known.get(name))]:
                name = unlike[0]
                told = f"{name} is {shown(entries.get(name))} there, {shown(known[name])} in the run that goes on"
            else:
                continue
            raise OutputError(
                f"{str(self.path)!r} has records of another run: of step {step}, {told}; they stay as they "
                "are: name the output folder of the run that goes on, or a new one"
            )

    def _write(self, record):
        line = _line(record).encode()
        with self.path.open("rb+") as file:
            end = file.seek(0, os.SEEK_END)
            if record.step != self._step:
                self._step, self._start = record.step, end
            file.seek(self._start)
            file.write(line)
            file.truncate()

    def _try(self, action):
        try:
            action()
        except OSError as error:
            raise OutputError(
                f"cannot write {str(self.path)!r}: {error.strerror}; name another output folder"
            ) from None


def _agree(one, other):
    """Whether entries of two records are of one state, which the last step may have been solved for twice."""
    if isinstance(one, float) and isinstance(other, float):
        return bool(abs(one - other) <= _SAME * max(abs(one), abs(other)))
    return one == other


def _line(record):
    """A record as a line of `steps.jsonl`.  Raises SceneError if it is none."""
    try:
        if isinstance(record, SolveRecord):
            return json.dumps(record.as_json()) + "\n"
    except (TypeError, ValueError, RecursionError):
        pass
    raise SceneError(f"a record must be that of a step, with entries that JSON can hold, got {shown(record)}")


def _entries(line):
    """The entries of a line of `steps.jsonl`, None if it is not that of a step."""
    try:
        entries = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entries if isinstance(entries, dict) and isinstance(entries.get("step"), int) else None


def write_fields(step, folder):
    """Write a step's fields for ParaView; all files keep the curved shape of the cells.

    Collective.  `fields.bp` (ADIOS2, VTX) has point fields, continuous of the mesh's order: displacement [m], stress
    [Pa]; `cells.bp` has one value a cell: indicator [J^(1/2)], level, rank; `contact.pvtu` has what `write_contact`
    says of the contact surfaces, if there are any.  On a full disk ADIOS2 ends the program or hangs, so
    the free space is checked first.

    Args:
        step: Step.
        folder: for the files, which are replaced if they are there.

    Raises:
        SceneError: no step.
        OutputError: a file cannot be written, or there is no room for it; then one that was there before still is.
    """
    check_step(step)
    folder = shared_path(step.forest.comm, "the output folder", folder, OutputError)
    leaf, mesh = step.leaf_mesh.leaf, step.leaf_mesh.mesh
    cells = {
        "indicator": step.estimate.error,
        "level": step.forest.level[leaf],
        "rank": np.full(len(leaf), step.forest.comm.rank),
    }
    tensor = [VOIGT.index((min(i, j), max(i, j))) for i in range(3) for j in range(3)]
    _write(
        step,
        folder / "fields.bp",
        [
            _nodal(step.leaf_mesh, "displacement", (3,), _values_of_cells(step.elasticity.u)),
            _nodal(step.leaf_mesh, "stress", (3, 3), _values_of_cells(step.estimate.stress)[:, :, tensor]),
        ],
    )
    _write(step, folder / "cells.bp", [_cellwise(mesh, *field) for field in cells.items()])
    if step.pairs is not None:
        write_contact(step, folder)


def _write(step, path, fields):
    """Write functions into a file of ADIOS2.  Collective."""
    comm = step.forest.comm
    size = comm.allreduce(_bytes(step.leaf_mesh.mesh, fields))
    with together(comm):
        if comm.rank == 0:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                _check_room(path, size)
                shutil.rmtree(path, ignore_errors=True)
                path.mkdir()
            except OSError as error:
                raise OutputError(
                    f"cannot write {str(path)!r}: {error.strerror}; name another output folder"
                ) from None
    with VTXWriter(comm, path, fields, engine="BP4") as writer:
        writer.write(float(step.record.step))


def _bytes(mesh, fields):
    """Bytes of this rank's part of a file: positions, numbers and ghost marks of nodes, cells, fields, a header."""
    nodes, (cells, corners) = len(mesh.geometry.x), mesh.geometry.dofmap.shape
    return (24 + 8 + 1) * nodes + 8 * (1 + corners) * cells + sum(f.x.array.nbytes for f in fields) + _HEAD_BYTES


def _check_room(path, size):
    """Raises OutputError unless a file of ADIOS2 fits on the disk, the space of the one it replaces counted.  Local."""
    free = shutil.disk_usage(path.parent).free + sum(file.stat().st_size for file in path.glob("*"))
    if free < size:
        raise OutputError(
            f"no space left on {str(path.parent)!r}: {path.name!r} takes {size / 1e6:.3g} MB, {free / 1e6:.3g} MB "
            "are free: make room, or name another output folder"
        )


def _values_of_cells(function):
    """Values of a nodal function at the nodes of each local cell: (ncells, (p+1)^3, k)."""
    values = function.x.array.reshape(-1, function.function_space.dofmap.index_map_bs)
    return values[function.function_space.dofmap.list]


def _nodal(leaf_mesh, name, shape, values):
    """A function of the geometry's order, as VTX needs it to draw curved cells, from nodal values.

    Args:
        values: (ncells, (p+1)^3, k) float64, of degree p.
    """
    element = basix.ufl.element(
        "Lagrange", "hexahedron", leaf_mesh.order, lagrange_variant=basix.LagrangeVariant.equispaced, shape=shape
    )
    space = fem.functionspace(leaf_mesh.mesh, element)
    degree = hexahedron.order_of(values.shape[1])
    along, nodes = hexahedron.lagrange(degree, space.element.basix_element.points), hexahedron.lattice(degree)
    functions = np.prod([along[:, axis, nodes[:, axis]] for axis in range(3)], axis=0)
    function = fem.Function(space, name=name)
    function.x.array.reshape(-1, values.shape[2])[space.dofmap.list] = np.matmul(functions, values)
    return function


def _cellwise(mesh, name, values):
    """A function with one value on each local cell."""
    function = fem.Function(fem.functionspace(mesh, ("DG", 0)), name=name)
    function.x.array[function.function_space.dofmap.list[:, 0]] = values
    return function
