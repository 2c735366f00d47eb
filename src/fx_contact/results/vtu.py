"""Grids of pyvista in VTK's own format, by VTK's own writers."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy.typing as npt
from mpi4py import MPI

from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.mpi import together


def write_grid(comm: MPI.Intracomm, path: Path, grid: Any) -> None:
    """Write this rank's grid into X.vtu, on several ranks into X_RANK.vtu with X.pvtu, which lists them all.

    Collective on comm.  All grids have the same arrays.  Raises OutputError if a file cannot be written.

    Args:
        path: X, in a folder that is made if it is not there; files of an earlier call are removed.
    """
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    with together(comm):
        if comm.rank == 0:
            with writing(path):
                old = path.with_suffix(".vtu"), path.with_suffix(".pvtu"), *_pieces(path)
                path.parent.mkdir(parents=True, exist_ok=True)
                for file in old:
                    file.unlink(missing_ok=True)
                if comm.size > 1:
                    _write_list(path.with_suffix(".pvtu"), comm.size, grid)
    piece = path.with_suffix(".vtu") if comm.size == 1 else path.with_name(f"{path.name}_{comm.rank}.vtu")
    with together(comm):
        writer.SetFileName(str(piece))
        writer.SetInputData(grid)
        if not writer.Write() or writer.GetErrorCode():
            raise OutputError(
                f"cannot write {str(piece)!r}: is there space on the disk? Or name another output folder"
            )


def _pieces(path: Path) -> list[Path]:
    """Files X_RANK.vtu that are there."""
    files = path.parent.glob(f"{path.name}_*.vtu")
    return [file for file in files if file.stem.removeprefix(f"{path.name}_").isdigit()]


def _write_list(path: Path, pieces: int, grid: Any) -> None:
    """The list of all pieces and of their arrays: VTK's own writer lists those alone that it has written itself."""
    files = "".join(f'<Piece Source="{path.stem}_{rank}.vtu"/>' for rank in range(pieces))
    points, cells = _arrays(grid.point_data.items()), _arrays(grid.cell_data.items())
    lists = f"<PPointData>{points}</PPointData><PCellData>{cells}</PCellData>"
    lists += f"<PPoints>{_arrays([('Points', grid.points)])}</PPoints>"
    content = f'<PUnstructuredGrid GhostLevel="0">{lists}{files}</PUnstructuredGrid>'
    path.write_text(f'<VTKFile type="PUnstructuredGrid" version="0.1">{content}</VTKFile>\n')


def _arrays(named: Iterable[tuple[str, npt.NDArray[Any]]]) -> str:
    """Types, names and components of arrays."""
    return "".join(
        f'<PDataArray type="{array.dtype.name.title()}" Name="{name}" NumberOfComponents="{(*array.shape, 1)[1]}"/>'
        for name, array in named
    )
