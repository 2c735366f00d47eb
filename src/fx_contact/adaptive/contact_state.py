"""What happens at each contact node pair: on the ranks that hold them, or in one table."""

import csv
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import as_path

_HEAD = ("x", "y", "z", "normal x", "normal y", "normal z", "pressure", "gap", "force", "closed", "pair")


@dataclass(frozen=True, eq=False, repr=False)
class _Columns:
    """What is known of each node pair, as `ContactState` explains it."""

    points: np.ndarray
    normal: np.ndarray
    pressure: np.ndarray
    force: np.ndarray
    gap: np.ndarray
    active: np.ndarray
    pair: np.ndarray
    names: tuple[str, ...]

    def __len__(self):
        return len(self.points)


@dataclass(frozen=True, eq=False, repr=False)
class ContactTable(_Columns):
    """All contact node pairs, sorted by contact pair and node: alike on any number of ranks.

    Attributes:
        points, normal, pressure, force, gap, active, pair, names: as of `ContactState`, of all ranks.
    """

    def __repr__(self):
        return _summary("contact", self)

    def to_csv(self, path):
        """Write a line for each node pair, below a line of headings; numbers with all digits, closed as 1 or 0.

        Local.

        Args:
            path: of the file; its folder is made if it is not there.

        Returns:
            Path of the file.

        Raises:
            OutputError: it cannot be written, or its name does not end in .csv.
        """
        path = as_path("the name of a table", path, OutputError)
        if path.suffix.lower() != ".csv":
            raise OutputError(
                f"the name of a table must end in .csv, got {str(path)!r}: if this is a folder, name a file"
            )
        numbers = np.column_stack([self.points, self.normal, self.pressure, self.gap, self.force]).tolist()
        rows = zip(numbers, self.active.astype(int).tolist(), self.pair.tolist())
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with open(path, "w", newline="") as file:
                lines = csv.writer(file)
                lines.writerow(_HEAD)
                lines.writerows((*values, closed, self.names[pair]) for values, closed, pair in rows)
        except OSError as error:
            raise OutputError(f"cannot write {str(path)!r}: {error}; name another file") from error
        return path


@dataclass(frozen=True, eq=False, repr=False)
class ContactState(_Columns):
    """Contact at the node pairs that this rank holds; each pair is on one rank.

    Attributes:
        points: (n, 3) float64, undeformed positions on the first surface [m].
        normal: (n, 3) float64, unit direction from the first body to the second.
        pressure: (n,) float64, at degree 1 force over tributary area, as from `ConstraintRows.pressure` [Pa].
        force: (n,) float64, compression positive [N]; of the modelled part, without its symmetric copies.
        gap: (n,) float64, distance of the deformed surfaces along the normal, negative where they penetrate [m].
        active: (n,) bool, whether the pair is closed.
        pair: (n,) int32, which of the scene's contact pairs it belongs to.
        names: of the scene's contact pairs, as `ContactPair.name`.
        key: (n,) int64, lattice key of the node on the first surface.
        comm: MPI communicator.
    """

    key: np.ndarray
    comm: MPI.Comm

    def __repr__(self):
        return _summary("contact on this rank alone", self)

    @collective("self.comm")
    def gathered(self):
        """The node pairs of all ranks in one table, on rank 0.

        Collective on comm.

        Returns:
            ContactTable on rank 0, None on the others.
        """
        columns = self.points, self.normal, self.pressure, self.force, self.gap, self.active, self.pair
        parts = self.comm.gather((self.key, *columns), root=0)
        if parts is None:
            return None
        key, *columns = map(np.concatenate, zip(*parts))
        order = np.lexsort((key, columns[-1]))
        return ContactTable(*(column[order] for column in columns), self.names)


def _summary(what, rows):
    """Two lines on node pairs: str."""
    return (
        f"{what}: {len(rows):,} node pairs, {int(rows.active.sum()):,} closed\n"
        f"  force {rows.force.sum():.6g}, largest pressure {rows.pressure.max(initial=0.0):.5g}"
    )
