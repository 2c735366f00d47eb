"""Grids of pyvista in VTK's own format, by VTK's own writers."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.mpi import together


def write_grid(comm: MPI.Intracomm, path: Path, grid: Any) -> Path:
    """Write this rank's grid into X.vtu, on several ranks into X_RANK.vtu with X.pvtu, which lists them all.

    Collective on comm.  Each grid has a cell, and all have the same arrays.  Returns the path of X.vtu or X.pvtu.
    Raises OutputError if a file cannot be written.

    Args:
        path: X, in an existing folder; files of an earlier call are removed.
    """
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    with together(comm):
        if comm.rank == 0:
            with writing(path):
                old = path.with_suffix(".vtu"), path.with_suffix(".pvtu"), *_pieces(path)
                for file in old:
                    file.unlink(missing_ok=True)
            if comm.size > 1:
                _write_list(path.with_suffix(".pvtu"), comm.size, grid)
    piece = path.with_suffix(".vtu") if comm.size == 1 else path.with_name(f"{path.name}_{comm.rank}.vtu")
    with together(comm):
        _write(vtkXMLUnstructuredGridWriter(), piece, grid)
    return piece if comm.size == 1 else path.with_suffix(".pvtu")


def _pieces(path: Path) -> list[Path]:
    """Files X_RANK.vtu that are there."""
    files = path.parent.glob(f"{path.name}_*.vtu")
    return [file for file in files if file.stem.removeprefix(f"{path.name}_").isdigit()]


def _write_list(path: Path, pieces: int, grid: Any) -> None:
    """The list of all pieces, whose files the ranks replace: VTK lists those alone that it has written itself."""
    from vtkmodules.vtkIOParallelXML import vtkXMLPUnstructuredGridWriter

    sample = grid.copy(deep=False).extract_cells([0])
    for data in (sample.point_data, sample.cell_data):
        for name in {*data} - {*grid.point_data, *grid.cell_data}:  # added by VTK
            del data[name]
    writer = vtkXMLPUnstructuredGridWriter()
    writer.SetNumberOfPieces(pieces)
    writer.SetStartPiece(0)
    writer.SetEndPiece(pieces - 1)
    _write(writer, path, sample)


def _write(writer: Any, path: Path, grid: Any) -> None:
    """Write a file.  Raises OutputError."""
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    if not writer.Write() or writer.GetErrorCode():
        raise OutputError(f"cannot write {str(path)!r}: is there space on the disk? Or name another output folder")
