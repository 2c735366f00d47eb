"""Tables of rows in one file, written by all ranks at once with MPI-IO: in whole, or not at all.

    8 bytes of magic, version, length and CRC-32 of the header | the header, JSON | the tables, row after row

A new file is made beside the old one and takes its name when it is complete and on the disk: whenever and wherever a
rank is killed, a file of that name is either the old or the new one.  All numbers have 8 bytes, little-endian.  The
checksum of a table is a sum over its words, each mixed with its place, so that it does not depend on which rank has
which rows; a change of any one word changes it.
"""

import json
import os
import re
import shutil
import struct
import zlib
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import CheckpointError, OutputError
from fx_contact.parallel.mpi import together

MAGIC, VERSION = b"fx-rows\n", 1
_PREAMBLE = struct.Struct("<8sQQQ")
_ADVICE = "take a copy of it if there is one, else remove it and begin anew"


def write(path, comm, content, tables, allow=lambda: None):
    """Write a file, in the place of one that is there.

    Collective on comm.

    Args:
        path: of the file, in a folder that is there.
        comm: MPI communicator.
        content: what JSON can hold, the same on all ranks.
        tables: name -> (n, k) float64, int64 or uint64, this rank's rows; they follow those of the rank before.
        allow: function that rank 0 calls before the file is begun and before it takes the place of the old one; it
            raises an error if it must not.

    Raises:
        OutputError: the file cannot be written; what was there before still is, and nothing of the new file.
    """
    path = Path(path)
    # A name of its own each time: Open MPI locks a semaphore that is called like the file, and whoever is killed in
    # between leaves it locked for all that come after.
    new = path.with_name(f"{path.name}.new-{comm.bcast(uuid4().hex)}")
    tables = {name: np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")) for name, rows in tables.items()}
    layout, first = {}, {}
    for name, rows in tables.items():
        first[name] = comm.exscan(rows.size) or 0
        layout[name] = {
            "rows": comm.allreduce(len(rows)),
            "columns": rows.shape[1],
            "type": rows.dtype.str,
            "checksum": _checksum(rows, first[name], comm),
        }
    header = json.dumps({"content": content, "tables": layout}, default=float).encode()
    header = comm.bcast(header + b" " * (-len(header) % 8))
    head = _PREAMBLE.pack(MAGIC, VERSION, len(header), zlib.crc32(header)) + header
    starts, end = _places(len(header), layout)
    pieces = [(starts[name] + 8 * first[name], rows.view(np.uint64)) for name, rows in tables.items()]
    with together(comm), _written(path):
        if comm.rank == 0:
            allow()
            _remove_left(path)
    try:
        _write_pieces(path, new, comm, end, [(0, head), *pieces] if comm.rank == 0 else pieces)
        with together(comm), _written(path):
            if comm.rank == 0:
                allow()
                _put_in_place(new, path)
    except OutputError:
        with together(comm):
            if comm.rank == 0:
                _give_up(new, path, end)
        raise


def _write_pieces(path, new, comm, end, pieces):
    """Write (place, words) into a new file of all ranks that ends at a place.  Collective on comm."""
    with together(comm), _written(path):
        file = MPI.File.Open(comm, str(new), MPI.MODE_CREATE | MPI.MODE_WRONLY)
        file.Set_size(end)
    with together(comm), _written(path):
        try:  # of what is inside, nothing is collective: a rank on which it fails still meets the others below
            for place, words in pieces:
                file.Write_at(place, words)
        finally:
            try:
                file.Sync()
            finally:
                file.Close()


def _remove_left(path):
    """Remove what killed runs have left of new files, known by its exact name.  Local."""
    for left in path.parent.iterdir():
        if re.fullmatch(re.escape(path.name) + r"\.new-[0-9a-f]{32}", left.name) and not left.is_dir():
            left.unlink()


def _put_in_place(new, path):
    """The new file takes the name of the old one.  Local."""
    os.replace(new, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # else the new name may be lost with the power
    finally:
        os.close(folder)


def _give_up(new, path, size):
    """Remove half a file, and see whether there was room for the whole.  Local.

    Raises:
        OutputError: there was not.
    """
    with suppress(OSError):
        new.unlink(missing_ok=True)
        free = shutil.disk_usage(path.parent).free
        if free < size:
            raise OutputError(
                f"no space left on {str(path.parent)!r}: {path.name!r} takes {size / 1e6:.3g} MB, {free / 1e6:.3g} MB "
                "are free; what was there before still is: make room, or name another folder"
            ) from None


class RowFile:
    """A file of tables, open for reading.

    Collective on comm.

    Args:
        path: of the file.
        comm: MPI communicator; it need not be as large as that which wrote the file.

    Attributes:
        content: what was written with the tables.
        tables: name -> dict of each table's `rows`, `columns` and `type`.

    Raises:
        CheckpointError: there is no such file, it is not complete, damaged, of another format or version.
    """

    def __init__(self, path, comm):
        self.path, self._comm = Path(path), comm
        header = None
        with together(comm), _read(self.path):
            if self.path.exists() and not self.path.is_file():  # a pipe would keep us waiting
                raise CheckpointError(f"{str(self.path)!r} is no file, so it is no checkpoint: name another folder")
            self._file = self.path.open("rb")  # held: it stays what it is when another takes its name
            if comm.rank == 0:
                header = _header(self.path, self._file)
        header = comm.bcast(header)
        self.content, self.tables, self._starts = header["content"], header["tables"], header["starts"]

    def table(self, name):
        """This rank's share of a table: about as many rows for each rank, in the order of the file.

        Collective on comm.

        Args:
            name: of the table.

        Returns:
            (n, k) array as it was written.

        Raises:
            CheckpointError: there is no such table, it cannot be read, or its checksum is wrong.
        """
        comm, path = self._comm, self.path
        if name not in self.tables:
            raise CheckpointError(f"{str(path)!r} has no table {name!r}: it is no checkpoint of this program")
        table = self.tables[name]
        columns = table["columns"]
        low, high = (table["rows"] * (comm.rank + i) // comm.size for i in (0, 1))
        rows = np.empty((high - low, columns), np.uint64)
        with together(comm), _read(path):
            self._file.seek(self._starts[name] + 8 * low * columns)
            self._file.readinto(rows)
        if _checksum(rows, low * columns, comm) != table["checksum"]:
            raise CheckpointError(f"{str(path)!r} is damaged: the checksum of its table {name!r} is wrong; {_ADVICE}")
        return rows.view(table["type"])


def _header(path, file):
    """The checked header of an open file, and where its tables start.  Local."""
    size = os.fstat(file.fileno()).st_size
    if size < _PREAMBLE.size:
        raise _incomplete(path, size)
    magic, version, length, checksum = _PREAMBLE.unpack(file.read(_PREAMBLE.size))
    if magic != MAGIC:
        raise CheckpointError(f"{str(path)!r} is no checkpoint of this program")
    if version != VERSION:
        raise CheckpointError(
            f"{str(path)!r} has version {version} of the format, this program reads {VERSION}: go on with the release "
            "that wrote it, or begin anew"
        )
    header = file.read(min(length, size))
    if len(header) < length:
        raise _incomplete(path, size)
    if zlib.crc32(header) != checksum:
        raise CheckpointError(f"{str(path)!r} is damaged: the checksum of its header is wrong; {_ADVICE}")
    try:
        header = json.loads(header)
    except (ValueError, RecursionError):  # no JSON, no text, or too deep
        header = None
    if not _is_header(header):
        raise CheckpointError(f"{str(path)!r} is damaged or of another version: its header makes no sense; {_ADVICE}")
    header["starts"], end = _places(length, header["tables"])
    if size != end:
        raise _incomplete(path, size, f" of {end}")
    return header


def _is_header(header):
    """Whether a header has content, and says of each table what it needs to.  Local."""
    if not isinstance(header, dict) or "content" not in header or not isinstance(header.get("tables"), dict):
        return False
    return all(
        isinstance(table, dict)
        and all(isinstance(table.get(name), int) and table[name] >= 0 for name in ("rows", "columns", "checksum"))
        and table.get("type") in ("<f8", "<i8", "<u8")
        for table in header["tables"].values()
    )


def _incomplete(path, size, expected=""):
    return CheckpointError(f"{str(path)!r} is not complete: it has {size}{expected} bytes; {_ADVICE}")


def _places(length, layout):
    """Where each table starts, after a header of some length, and where the file ends [bytes]."""
    starts, end = {}, _PREAMBLE.size + length
    for name, table in layout.items():
        starts[name], end = end, end + 8 * table["rows"] * table["columns"]
    return starts, end


def _checksum(rows, first, comm):
    """Checksum of all ranks' rows, `first` the number of words on the ranks before.  Collective on comm."""
    words = rows.reshape(-1).view("<u8").astype(np.uint64)
    with np.errstate(over="ignore"):
        words += np.arange(first, first + len(words), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        words ^= words >> np.uint64(32)
        words *= np.uint64(0xBF58476D1CE4E5B9)
        words ^= words >> np.uint64(29)
        total = words.sum(dtype=np.uint64, keepdims=True)
    comm.Allreduce(MPI.IN_PLACE, total)
    return int(total[0])


@contextmanager
def _read(path):
    """Errors of the system become a CheckpointError that names the file."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"cannot read the checkpoint {str(path)!r}: {error.strerror}") from None


@contextmanager
def _written(path):
    """Errors of the system and of MPI-IO become an OutputError that names the file."""
    try:
        yield
    except (OSError, MPI.Exception) as error:
        reason = error.strerror if isinstance(error, OSError) else error.Get_error_string()
        raise OutputError(
            f"cannot write {str(path)!r}: {reason}; what was there before still is: make room, or name another folder"
        ) from None
