"""dolfinx functions from nodal values of cells, and their files for ParaView: ADIOS2 (VTX) and VTK."""

import shutil
from pathlib import Path
from typing import Any

import numpy.typing as npt
from dolfinx import fem
from dolfinx.io import VTKFile, VTXWriter
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fx_contact.parallel import compat
from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.mpi import together

#: Upper bound for the bytes of a rank's part of an ADIOS2 file beside its arrays, in whole blocks of the disk.
_HEAD_BYTES = 2**15


def function_on(mesh: Mesh, element: Any, name: str, values: npt.NDArray[Any]) -> fem.Function:
    """A dolfinx Function with values (ncells, nodes, components) at the nodes of each local cell.  Collective."""
    function = fem.Function(fem.functionspace(mesh, element), name=name)
    function.x.array.reshape(-1, values.shape[2])[function.function_space.dofmap.list] = values
    return function


def write_vtx(comm: MPI.Intracomm, path: Path, functions: list[fem.Function], time: float) -> None:
    """Write functions of one element and any number of components into one file (of ADIOS2: a folder), replacing it.

    Collective on comm.  Raises OutputError if the file cannot be written, or there is no space for it: then an existing
    one is kept.  On a full disk ADIOS2 ends the program or hangs, so the free space is checked first.
    """
    size = comm.allreduce(_bytes(functions))
    with together(comm):
        if comm.rank == 0:
            with writing(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                _check_room(path, size)
                shutil.rmtree(path, ignore_errors=True)
                path.mkdir()
    with VTXWriter(comm, path, functions, engine="BP4") as writer:
        writer.write(float(time))


def write_vtu(comm: MPI.Intracomm, path: Path, functions: list[fem.Function], time: float) -> None:
    """Write functions into VTK files X_p0_000000.vtu, one per rank, and X.pvtu, which lists them.

    Collective on comm.  Raises OutputError if the folder cannot be written.
    """
    with together(comm):
        if comm.rank == 0:
            with writing(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                for old in path.parent.glob(f"{path.stem}_p*.vtu"):
                    old.unlink()
    series = path.with_suffix(".pvd")
    with VTKFile(comm, series, "w") as file:
        file.write_function(functions, float(time))
    del file  # writes the .pvd once more
    with together(comm):
        if comm.rank == 0:
            with writing(path):
                path.with_name(f"{path.stem}000000.pvtu").replace(path)
                series.unlink()


def _bytes(functions: list[fem.Function]) -> int:
    """Bytes of this rank's part of a file: positions, numbers and ghost marks of nodes, cells, fields, a header."""
    space = functions[0].function_space
    dofmap = space.dofmap
    nodes = max(len(space.mesh.geometry.x), dofmap.index_map.size_local + dofmap.index_map.num_ghosts)
    cells, corners = max(compat.geometry_nodes(space.mesh).shape, dofmap.list.shape)
    return (24 + 8 + 1) * nodes + 8 * (1 + corners) * cells + sum(f.x.array.nbytes for f in functions) + _HEAD_BYTES


def _check_room(path: Path, size: int) -> None:
    """Raises OutputError unless a file fits on the disk, counting the space of the one that it replaces."""
    free = shutil.disk_usage(path.parent).free + sum(file.stat().st_size for file in path.glob("*"))
    if free < size:
        raise OutputError(
            f"no space left on {str(path.parent)!r}: {path.name!r} takes {size / 1e6:.3g} MB, {free / 1e6:.3g} MB "
            "are free: make room, or name another folder"
        )
