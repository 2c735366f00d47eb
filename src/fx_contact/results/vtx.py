"""dolfinx functions from values at the nodes of cells, and files of them for ParaView: ADIOS2 (VTX), and VTK's own."""

import shutil

from dolfinx import fem
from dolfinx.io import VTKFile, VTXWriter

from fx_contact.parallel import compat
from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.mpi import together

#: Bytes that a rank's part of a file of ADIOS2 takes at most beside its arrays, in whole blocks of the disk.
_HEAD_BYTES = 2**15


def function_on(mesh, element, name, values):
    """A dolfinx Function with given values.

    Collective.

    Args:
        mesh: dolfinx Mesh.
        element: of the function, with k components.
        name: of the function.
        values: (ncells, nodes, k), at the nodes of each local cell in the order of the element.
    """
    function = fem.Function(fem.functionspace(mesh, element), name=name)
    function.x.array.reshape(-1, values.shape[2])[function.function_space.dofmap.list] = values
    return function


def write_vtx(comm, path, functions, time):
    """Write functions into one file, in the place of one that is there.

    Collective on comm.  On a full disk ADIOS2 ends the program or hangs, so the free space is checked first.

    Args:
        comm: MPI communicator.
        path: of the file, which for ADIOS2 is a folder.
        functions: list of dolfinx Function, of one element but for the number of components.
        time: to write with them.

    Raises:
        OutputError: the file cannot be written, or there is no room for it; then one that was there before still is.
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


def write_vtu(comm, path, functions, time):
    """Write functions into files that VTK reads by itself, a piece for each rank.

    Collective on comm.

    Args:
        comm: MPI communicator.
        path: of the file that names the pieces, X.pvtu; these stand beside it as X_p0_000000.vtu and so on.
        functions, time: as `write_vtx` has them.

    Raises:
        OutputError: the folder cannot be written.
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


def _bytes(functions):
    """Bytes of this rank's part of a file: positions, numbers and ghost marks of nodes, cells, fields, a header."""
    space = functions[0].function_space
    dofmap = space.dofmap
    nodes = max(len(space.mesh.geometry.x), dofmap.index_map.size_local + dofmap.index_map.num_ghosts)
    cells, corners = max(compat.geometry_nodes(space.mesh).shape, dofmap.list.shape)
    return (24 + 8 + 1) * nodes + 8 * (1 + corners) * cells + sum(f.x.array.nbytes for f in functions) + _HEAD_BYTES


def _check_room(path, size):
    """Raises OutputError unless a file of ADIOS2 fits on the disk, the space of the one it replaces counted.  Local."""
    free = shutil.disk_usage(path.parent).free + sum(file.stat().st_size for file in path.glob("*"))
    if free < size:
        raise OutputError(
            f"no space left on {str(path.parent)!r}: {path.name!r} takes {size / 1e6:.3g} MB, {free / 1e6:.3g} MB "
            "are free: make room, or name another folder"
        )
