"""A checkpoint on disk: one NumPy archive (.npz) with an array of each rank, complete or absent.

The archive is a ZIP file: `content.json`, and `NAME/RANK.npy` for each array, with a CRC-32 of each.  The ranks append
to it in turn: none waits inside MPI-IO, HDF5 or ADIOS2 for one that is killed or cannot write.  It replaces the old one
by an atomic rename.
"""

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4
from zipfile import BadZipFile, ZipFile

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.parallel.errors import CheckpointError, writing
from fx_contact.parallel.mpi import together

#: Version of the content; checkpoints up to version 8 were no archives.
VERSION = 11
#: First bytes of a ZIP file, and of checkpoints before version 9.
_ZIP, _EARLIER = b"PK\3\4", b"fx-rows\n"
_CONTENT = "content.json"
#: Errors of reading a damaged ZIP file, beside those of the system.
_DAMAGE = (BadZipFile, zlib.error, struct.error, ValueError, KeyError, EOFError, RuntimeError)


def write_checkpoint(
    path: Path,
    comm: MPI.Intracomm,
    content: Any,
    arrays: Mapping[str, npt.NDArray[Any]],
    allow: Callable[[], None] = lambda: None,
) -> None:
    """Write a file, replacing an old one.

    Collective on comm.

    Args:
        path: in a folder that is there and that all ranks see.
        content: as JSON can hold it, the same on all ranks.
        arrays: by name, (n, ...), n of each rank.
        allow: called by rank 0 before the new file replaces the old one; raises an error to keep the old one.

    Raises:
        OutputError: the file cannot be written; the old one stays, the new one is removed.
    """
    new = path.with_name(f"{path.name}.new-{comm.bcast(uuid4().hex)}")  # not shared by two runs in one folder
    rows = comm.gather({name: len(array) for name, array in arrays.items()}) or []
    try:
        with together(comm), writing(path):
            if comm.rank == 0:
                for left in path.parent.glob(f"{path.name}.new-{32 * '[0-9a-f]'}"):  # by killed runs
                    left.unlink()
                about = {"version": VERSION, "rows": {name: [n[name] for n in rows] for name in arrays}}
                with _appended(new) as archive:
                    archive.writestr(_CONTENT, json.dumps(about | {"content": content}, default=float))
        for turn in range(comm.size):
            with together(comm), writing(path):
                if comm.rank == turn:
                    with _appended(new) as archive:
                        for name, array in arrays.items():
                            with archive.open(_member(name, turn), "w", force_zip64=True) as member:
                                np.save(member, array, allow_pickle=False)
        with together(comm), writing(path):
            if comm.rank == 0:
                allow()
                os.replace(new, path)
                _sync(path.parent)
    finally:
        if comm.rank == 0:
            with suppress(OSError):
                new.unlink(missing_ok=True)


def _member(name: str, rank: int) -> str:
    return f"{name}/{rank}.npy"


@contextmanager
def _appended(path: Path) -> Iterator[ZipFile]:
    """An archive to append to, on the disk afterwards."""
    with ZipFile(path, "a") as archive:
        yield archive
    _sync(path)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class CheckpointFile:
    """A checkpoint, open for reading; `content` is that written with the arrays.

    Collective on comm, of any size.

    Raises:
        CheckpointError: there is no such file, it is not complete, damaged, of another format or version.
    """

    def __init__(self, path: Path, comm: MPI.Intracomm) -> None:
        self._path, self._comm = path, comm
        about = None
        with together(comm), _reading(path):
            self._archive = _opened(path)
            if comm.rank == 0:
                about = json.loads(self._archive.read(_CONTENT))
                if about["version"] != VERSION:
                    raise _other_version(path)
        about = comm.bcast(about)
        self.content, self._rows = about["content"], about["rows"]

    def array(self, name: str) -> npt.NDArray[Any]:
        """This rank's share of an array: blocks of nearly equal length, in the order of the ranks that wrote them.

        Collective on comm.  Raises CheckpointError if it cannot be read, or its checksum is wrong.
        """
        comm, ends = self._comm, np.cumsum(self._rows[name])
        starts = ends - self._rows[name]
        low, high = (int(ends[-1]) * (comm.rank + i) // comm.size for i in (0, 1))
        own = [piece for piece in range(len(ends)) if starts[piece] < high and ends[piece] > low] or [0]
        with together(comm), _reading(self._path):
            pieces = [self._piece(name, piece)[max(low - starts[piece], 0) : high - starts[piece]] for piece in own]
            return np.concatenate(pieces)

    def _piece(self, name: str, rank: int) -> npt.NDArray[Any]:
        """The array that a rank has written."""
        with self._archive.open(_member(name, rank)) as member:
            array: npt.NDArray[Any] = np.lib.format.read_array(  # type: ignore[no-untyped-call]  # of NumPy
                member, allow_pickle=False
            )
            if member.read() or len(array) != self._rows[name][rank]:  # to the end, where the checksum is compared
                raise BadZipFile
        return array


def _opened(path: Path) -> ZipFile:
    """The archive of a checkpoint; open, it survives its replacement."""
    if path.exists() and not path.is_file():  # reading a pipe would wait
        raise CheckpointError(f"{str(path)!r} is no file, so it is no checkpoint: name another folder")
    file = path.open("rb")
    begin = file.read(len(_EARLIER))
    if begin == _EARLIER:
        raise _other_version(path)
    if not _ZIP.startswith(begin[: len(_ZIP)]):
        raise CheckpointError(f"{str(path)!r} is no checkpoint of this program")
    return ZipFile(file)


def _other_version(path: Path) -> CheckpointError:
    return CheckpointError(
        f"{str(path)!r} was written by another release of fx_contact: go on with that release, or begin anew"
    )


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Errors of reading become a CheckpointError that names the file."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"cannot read the checkpoint {str(path)!r}: {error.strerror}") from None
    except _DAMAGE:
        raise CheckpointError(
            f"{str(path)!r} is damaged or not complete: take a copy if there is one, else remove it and begin anew"
        ) from None
