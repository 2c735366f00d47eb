"""Contact at each contact node: on the ranks that own them, or in one table."""

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.arrays import BoolArray, FloatArray, Int32Array, Int64Array
from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import as_path

_HEAD = ("x", "y", "z", "normal x", "normal y", "normal z", "pressure", "gap", "force", "closed", "pair")
#: Further columns with friction.
_OF_FRICTION = ("traction x", "traction y", "traction z", "slip x", "slip y", "slip z", "slips")


@dataclass(frozen=True, eq=False, repr=False)
class ContactTable:
    """Contact nodes, a row each: of a step those that this rank owns; gathered all, sorted by contact pair and node.

    Attributes:
        points: (n, 3), undeformed positions on the first surface [m]; where the rim of the second one crosses facets,
            centres of the forces.
        normal: (n, 3), unit direction from the first body to the second.
        pressure: (n,), as from `ConstraintRows.pressure`, at degree 1 and inside of rims force over area [Pa].
        force: (n,), compression positive [N]; of the modelled part, without its symmetric copies.
        gap: (n,), distance of the deformed surfaces along the normal, negative where they penetrate [m].
        active: (n,), closed nodes.
        pair: (n,), number of the contact pair in the scene.
        names: of the scene's contact pairs, as `ContactPair.name`.
        key: (n,), lattice key of the node on the first surface.
        comm: of the ranks that have the rows, each row on one.
        traction: (n, 3), tangential, on the body that the normal points into; None: no friction [Pa].
        slip: (n, 3), of the other body on it in the load step, of closed nodes; None: no friction [m].
        slipping: (n,), closed nodes that slip, or are of pairs without friction; None: no pair has friction.
    """

    points: FloatArray
    normal: FloatArray
    pressure: FloatArray
    force: FloatArray
    gap: FloatArray
    active: BoolArray
    pair: Int32Array
    names: tuple[str, ...]
    key: Int64Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    comm: MPI.Intracomm = field(default_factory=lambda: MPI.COMM_SELF)
    traction: FloatArray | None = None
    slip: FloatArray | None = None
    slipping: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        what = "contact on this rank alone" if self.comm.size > 1 else "contact"
        return (
            f"{what}: {len(self):,} contact nodes, {int(self.active.sum()):,} closed\n"
            f"  force {self.force.sum():.6g}, largest pressure {self.pressure.max(initial=0.0):.5g}"
        )

    def to_csv(self, path: str | Path) -> Path:
        """Write a line for each contact node, below a line of headings; numbers with all digits, closed as 1 or 0.

        Local.  The folder is made if it is not there.  Raises OutputError unless the name ends in .csv and the file
        can be written.
        """
        path = as_path("the name of a table", path, OutputError)
        if path.suffix.lower() != ".csv":
            raise OutputError(
                f"the name of a table must end in .csv, got {str(path)!r}: if this is a folder, name a file"
            )
        numbers = np.column_stack([self.points, self.normal, self.pressure, self.gap, self.force])
        columns = [*numbers.T, self.active.astype(int), np.array(self.names)[self.pair]]
        for one in (self.traction, self.slip, self.slipping):
            columns += [] if one is None else list(np.atleast_2d(1 * one.T))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with open(path, "w", newline="") as file:
                lines = csv.writer(file)
                lines.writerow((*_HEAD, *_OF_FRICTION)[: len(columns)])
                lines.writerows(zip(*(column.tolist() for column in columns)))
        except OSError as error:
            raise OutputError(f"cannot write {str(path)!r}: {error}; name another file") from error
        return path

    @collective("self.comm")
    def gathered(self) -> "ContactTable | None":
        """The contact nodes of all ranks in one table on rank 0, the same on any number of ranks; None on the others.

        Collective on comm.
        """
        names = [name for name, column in vars(self).items() if isinstance(column, np.ndarray)]
        parts = self.comm.gather({name: getattr(self, name) for name in names}, root=0)
        if parts is None:
            return None
        columns = {name: np.concatenate([part[name] for part in parts]) for name in names}
        order = np.lexsort((columns["key"], columns["pair"]))
        return ContactTable(**{name: column[order] for name, column in columns.items()}, names=self.names)
