"""Tables of rows in one file that all ranks write: in whole, or not at all.

    8 bytes of magic, version, length and CRC-32 of the header | the header, JSON | the tables, row after row

A new file is written beside the old one and renamed when it is complete and on the disk: whenever and wherever a rank
is killed, the file of that name is either the old or the new one.  Each rank writes its rows at their place by itself,
not through MPI-IO, HDF5 or ADIOS2, where a rank that is killed or cannot write makes others wait for ever.  All numbers
have 8 bytes, little-endian.  The checksum of a table is a sum over its words, each mixed with its place, so that it
does not depend on which rank has which rows; a change of any one word changes it.
"""

import json
import os
import struct
import zlib
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import CheckpointError, writing
from fx_contact.parallel.hashing import GOLDEN, mixed
from fx_contact.parallel.mpi import together

#: How files begin, and the version of their layout and of what checkpoints keep in them.
MAGIC, VERSION = b"fx-rows\n", 8
_PREAMBLE = struct.Struct("<8sQQQ")


def write_rows(path, comm, content, tables, allow=lambda: None):
    """Write a file, in the place of one that is there.

    Collective on comm.

    Args:
        path: of the file, in a folder that is there and that all ranks see.
        comm: MPI communicator.
        content: what JSON can hold, the same on all ranks.
        tables: name -> (n, k) float64, int64 or uint64, this rank's rows; they follow those of the rank before.
        allow: function that rank 0 calls before the new file takes the place of the old one; it raises an error if it
            must not.

    Raises:
        OutputError: the file cannot be written; the old one stays, and nothing of the new one.
    """
    path = Path(path)
    new = path.with_name(f"{path.name}.new-{comm.bcast(uuid4().hex)}")  # not shared by two runs in one folder
    tables = {name: np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")) for name, rows in tables.items()}
    layout, pieces, end = {}, [], 0
    for name, rows in tables.items():
        count, first = comm.allreduce(len(rows)), comm.exscan(rows.size) or 0
        layout[name] = {
            "start": end,
            "rows": count,
            "columns": rows.shape[1],
            "type": rows.dtype.str,
            "checksum": _checksum(rows, first, comm),
        }
        pieces.append((end + 8 * first, rows))
        end += 8 * count * rows.shape[1]
    header = json.dumps({"content": content, "tables": layout, "bytes": end}, default=float).encode()
    header = comm.bcast(_PREAMBLE.pack(MAGIC, VERSION, len(header), zlib.crc32(header)) + header)
    if comm.rank == 0:
        pieces.insert(0, (-len(header), header))
    try:
        with together(comm), writing(path):
            if comm.rank == 0:
                for left in path.parent.glob(f"{path.name}.new-{32 * '[0-9a-f]'}"):  # by killed runs
                    left.unlink()
                new.touch()
        with together(comm), writing(path):
            # O_DSYNC: each write is on the disk when it returns, and over NFS leaves the bytes beside it alone.
            with open(os.open(new, os.O_WRONLY | os.O_DSYNC), "wb") as file:
                for place, data in pieces:
                    file.seek(len(header) + place)
                    file.write(data)
        with together(comm), writing(path):
            if comm.rank == 0:
                allow()
                _rename(new, path)
    finally:
        if comm.rank == 0:
            with suppress(OSError):
                new.unlink(missing_ok=True)


def _rename(new, path):
    """The new file takes the name of the old one, on the disk too.  Local."""
    os.replace(new, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


class RowFile:
    """A file of tables, open for reading.

    Collective on comm.

    Args:
        path: of the file.
        comm: MPI communicator, of any size.

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
            if self.path.exists() and not self.path.is_file():  # reading a pipe would wait
                raise CheckpointError(f"{str(self.path)!r} is no file, so it is no checkpoint: name another folder")
            self._file = self.path.open("rb")  # held: it stays what it is when another takes its name
            if comm.rank == 0:
                header = _header(self.path, self._file)
        header = comm.bcast(header)
        self.content, self.tables, self._begin = header["content"], header["tables"], header["begin"]

    def table(self, name):
        """This rank's share of a table: about as many rows for each rank, in the order of the file.

        Collective on comm.

        Args:
            name: a key of `tables`.

        Returns:
            (n, k) array as it was written.

        Raises:
            CheckpointError: it cannot be read, or its checksum is wrong.
        """
        comm, path, table = self._comm, self.path, self.tables[name]
        columns = table["columns"]
        low, high = (table["rows"] * (comm.rank + i) // comm.size for i in (0, 1))
        rows = np.empty((high - low, columns), table["type"])
        with together(comm), _read(path):
            self._file.seek(self._begin + table["start"] + 8 * low * columns)
            self._file.readinto(rows)
        if _checksum(rows, low * columns, comm) != table["checksum"]:
            raise _damaged(path, f"its table {name!r}")
        return rows


def _header(path, file):
    """The checked header of an open file, and where its tables begin.  Local."""
    size = os.fstat(file.fileno()).st_size
    preamble = file.read(_PREAMBLE.size)
    if preamble[: len(MAGIC)] != MAGIC[: len(preamble)]:
        raise CheckpointError(f"{str(path)!r} is no checkpoint of this program")
    if len(preamble) < _PREAMBLE.size:
        raise _damaged(path, "its length")
    _, version, length, checksum = _PREAMBLE.unpack(preamble)
    if version != VERSION:
        raise CheckpointError(
            f"{str(path)!r} has version {version} of the format, this program reads {VERSION}: go on with the release "
            "that wrote it, or begin anew"
        )
    text = file.read(min(length, size))
    if len(text) < length or zlib.crc32(text) != checksum:
        raise _damaged(path, "its header")
    header = json.loads(text) | {"begin": file.tell()}
    if size != header["begin"] + header["bytes"]:
        raise _damaged(path, "its length")
    return header


def _damaged(path, what):
    return CheckpointError(
        f"{str(path)!r} is damaged or not complete, as {what} shows: take a copy of it if there is one, else remove it "
        "and begin anew"
    )


def _checksum(rows, first, comm):
    """Checksum of all ranks' rows, `first` the number of words on the ranks before.  Collective on comm."""
    words = rows.reshape(-1).view("<u8").astype(np.uint64)
    words += np.arange(first, first + len(words), dtype=np.uint64) * GOLDEN
    total = mixed(mixed(words)).sum(dtype=np.uint64, keepdims=True)
    comm.Allreduce(MPI.IN_PLACE, total)
    return int(total[0])


@contextmanager
def _read(path):
    """Errors of the system become a CheckpointError that names the file."""
    try:
        yield
    except OSError as error:
        raise CheckpointError(f"cannot read the checkpoint {str(path)!r}: {error.strerror}") from None
