"""Results on disk: step records as JSON lines, fields for ParaView."""

import json
import shutil
from pathlib import Path

import basix.ufl
import numpy as np
from dolfinx import fem
from dolfinx.io import VTXWriter

from fx_contact import reference
from fx_contact._mpi import together
from fx_contact.errors import OutputError
from fx_contact.estimate import VOIGT


class RecordWriter:
    """Step records, one JSON object a line, each on disk as soon as it is written.

    Collective on comm.

    Args:
        folder: for the results; made if it is not there, and `steps.jsonl` in it begun anew.
        comm: MPI communicator.

    Raises:
        OutputError: the folder cannot be made or written.
    """

    def __init__(self, folder, comm):
        self.path = Path(folder) / "steps.jsonl"
        self._comm, self._last = comm, 0
        with together(comm):
            if comm.rank == 0:
                self._try(lambda: (self.path.parent.mkdir(parents=True, exist_ok=True), self.path.write_text("")))

    def write(self, record):
        """Append one record.

        Collective on comm.

        Args:
            record: dict that JSON can hold.

        Raises:
            OutputError: the file cannot be written.
        """
        with together(self._comm):
            if self._comm.rank == 0:
                self._try(lambda: self._append(json.dumps(record) + "\n"))

    def amend(self, record):
        """Replace the last record, when later work on the same step has changed it.

        Collective on comm.

        Args:
            record: dict that JSON can hold.

        Raises:
            OutputError: the file cannot be written.
        """
        with together(self._comm):
            if self._comm.rank == 0:
                self._try(lambda: self._append(json.dumps(record) + "\n", self._last))

    def _append(self, line, position=None):
        with self.path.open("r+") as file:
            self._last = file.seek(0, 2) if position is None else file.seek(position)
            file.write(line)
            file.truncate()

    def _try(self, action):
        try:
            action()
        except OSError as error:
            raise OutputError(
                f"cannot write {str(self.path)!r}: {error.strerror}; name another output folder"
            ) from None


def write_fields(step, path):
    """Write a step's fields for ParaView, on cells of the mesh's own order, so that curved shapes are kept.

    Collective.  Point fields: displacement [m], stress [Pa]; cell fields, constant on each cell: indicator
    [J^(1/2)], level, rank.

    Args:
        step: Step.
        path: of the ADIOS2 file (VTX), ending in .bp; replaced if it is there.

    Raises:
        OutputError: the file cannot be written.
    """
    comm, path = step.forest.comm, Path(path)
    with together(comm):
        if comm.rank == 0:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                shutil.rmtree(path, ignore_errors=True)
                path.mkdir()
            except OSError as error:
                raise OutputError(
                    f"cannot write {str(path)!r}: {error.strerror}; name another output folder"
                ) from None
    with VTXWriter(comm, path, _fields(step), engine="BP4") as writer:
        writer.write(float(step.record["step"]))


def _fields(step):
    """The fields as functions that are discontinuous between cells, all of the mesh's order, as VTX wants them."""
    mesh, order = step.leaf_mesh.mesh, step.leaf_mesh.order
    kind = dict(lagrange_variant=basix.LagrangeVariant.equispaced, discontinuous=True)
    points = basix.ufl.element("Lagrange", "hexahedron", order, **kind).basix_element.points
    along = reference.lagrange(1, points)
    shape = np.prod([along[:, axis, reference.CORNERS[:, axis]] for axis in range(3)], axis=0)

    def nodal(name, function):
        """A Q1 field, from its values at the cells' corners."""
        values = function.x.array.reshape(-1, function.function_space.dofmap.index_map_bs)
        return name, np.einsum("pi,nik->npk", shape, values[function.function_space.dofmap.list])

    def constant(name, values):
        return name, np.broadcast_to(values[:, None, None], (len(values), len(points), 1))

    name, voigt = nodal("stress", step.estimate.stress)
    tensor = voigt[:, :, [VOIGT.index((min(i, j), max(i, j))) for i in range(3) for j in range(3)]]
    leaf = step.leaf_mesh.leaf
    fields = (
        nodal("displacement", step.elasticity.u),
        (name, tensor),
        constant("indicator", step.estimate.error),
        constant("level", step.forest.level[leaf]),
        constant("rank", np.full(len(leaf), mesh.comm.rank)),
    )
    functions = []
    for name, values in fields:
        size = {1: (), 3: (3,), 9: (3, 3)}[values.shape[2]]
        space = fem.functionspace(mesh, basix.ufl.element("Lagrange", "hexahedron", order, shape=size, **kind))
        function = fem.Function(space, name=name)
        function.x.array.reshape(-1, values.shape[2])[space.dofmap.list] = values
        functions.append(function)
    return functions
