"""The state after an adaptive step on disk, from which any number of ranks can go on.

Leaves and vertices are named by keys that do not depend on the ranks: a leaf with its indicator takes 16 bytes, a
vertex with its displacement 32.  The displacement is also the start of the next active set.  A checkpoint knows the
problem it belongs to, and has the records of all steps so far.
"""

from dataclasses import asdict, dataclass, fields
from numbers import Real
from uuid import uuid4

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.row_file import RowFile, write
from fx_contact.estimate.error_estimate import Estimate, Gain
from fx_contact.forest.forest import Forest
from fx_contact.parallel.agreement import check_alike, differences
from fx_contact.parallel.errors import CheckpointError, OutputError
from fx_contact.parallel.mpi import Directory, together
from fx_contact.parallel.validation import as_path, check_comm
from fx_contact.problem.facet_pairing import decode_leaf, leaf_code
from fx_contact.problem.fingerprint import problem
from fx_contact.problem.hexahedron import EDGE_CORNERS
from fx_contact.problem.lattice import MAX_LEVEL, SIDE, Lattice
from fx_contact.problem.scene import check_scene

NAME = "checkpoint"
KIND = "checkpoint of fx_contact, version 6"
_LEVEL_BITS = 4
#: What the content must hold besides its kind, as functions that tell whether a value can be meant.
_CONTENT = {
    "run": lambda run: isinstance(run, str),
    "problem": lambda problem: isinstance(problem, dict),
    "options": lambda options: isinstance(options, dict),
    "records": lambda records: isinstance(records, list)
    and len(records) > 0
    and all(isinstance(record, dict) and "step" in record for record in records),
    "estimate": lambda numbers: isinstance(numbers, list) and len(numbers) == 3 and _are_numbers(numbers),
    "gain": lambda gain: isinstance(gain, dict)
    and gain.keys() == {entry.name for entry in fields(Gain)}
    and _are_numbers(gain.values()),
}
#: Types of the tables, the least numbers of their columns, and the table that has as many rows.
_TABLES = {
    "leaves": ("<u8", 1, "leaves"),
    "indicator": ("<f8", 1, "leaves"),
    "refine": ("<f8", 1, "leaves"),
    "vertices": ("<i8", 1, "vertices"),
    "values": ("<f8", 3, "vertices"),
}
#: No energy and no error is larger [J].
_LARGEST = 1e150
_ADVICE = "take a copy of it if there is one, else remove it and begin anew"


class CheckpointWriter:
    """Keeps the last step of a run in a folder, and nobody else's.

    Every run has an id of its own, which its checkpoints hold: a run replaces its own checkpoint, or once that which
    it goes on from, and no other, whoever has written it in the meantime.

    Collective on comm.

    Args:
        folder: for the checkpoints; made if it is not there.
        comm: MPI communicator.
        problem: dict, the run's problem (`problem.problem`).
        options: dict that JSON can hold, the options that must not change.
        restart: Checkpoint from which the run goes on, the only one that may be in the folder already; or None.

    Raises:
        OutputError: the folder cannot be made, or holds a checkpoint that would be lost.
    """

    def __init__(self, folder, comm, problem, options, restart=None):
        self._problem, self._options = problem, options
        self._run = comm.bcast(uuid4().hex)
        self._replaceable = {self._run} | ({restart.run} if restart is not None else set())
        with together(comm):
            self._path = as_path("the folder for checkpoints", folder, OutputError) / NAME
            if comm.rank == 0:
                try:
                    self._path.parent.mkdir(parents=True, exist_ok=True)
                    self._allow()
                except OSError as error:
                    raise OutputError(
                        f"cannot keep a checkpoint in {str(folder)!r}: {error.strerror}; name another folder"
                    ) from None

    def save(self, step, records, gain):
        """Replace the checkpoint in the folder by the state after a step.

        Collective on the step's comm.

        Args:
            step: Step.
            records: list of dict, of all steps up to this one.
            gain: Gain of the run, before it has marked this step.

        Raises:
            OutputError: the checkpoint cannot be written, or another run has written one; what was there still is.
        """
        forest, error, prolongation = step.forest, step.estimate, step.elasticity.prolongation
        indicator = np.empty(len(forest))
        indicator[step.leaf_mesh.leaf] = error.error
        leaf, corner = prolongation.vertices.example.T
        values = np.concatenate([prolongation.prolong(step.contact.displacement), step.along[leaf, corner]], axis=1)
        # Conforming vertices by their owner; hanging ones, at -1, by every rank that has them, alike to rounding.
        rows = prolongation.conforming < prolongation.owned
        write(
            self._path,
            forest.comm,
            {
                "kind": KIND,
                "run": self._run,
                "problem": self._problem,
                "options": self._options,
                "records": records,
                "estimate": [error.error_global, error.energy_norm, error.cells],
                "gain": asdict(gain),
            },
            {
                "leaves": _names(forest.cell, forest.level, forest.anchor)[:, None],
                "indicator": indicator[:, None],
                "refine": step.contact_error.refine[:, None].astype(float),
                "vertices": prolongation.vertices.keys[rows, None],
                "values": values[rows],
            },
            self._allow,
        )
        self._replaceable = {self._run}

    def _allow(self):
        """Raises OutputError if there is a checkpoint of another run, or what is none that can be read.  Local."""
        if not self._path.exists():
            return
        try:
            run = _content(RowFile(self._path, MPI.COMM_SELF))["run"]
        except CheckpointError as error:
            raise OutputError(
                f"{str(self._path)!r} would be replaced, but is no checkpoint that can be read ({error}): remove it, "
                "or name another folder"
            ) from None
        if run not in self._replaceable:
            raise OutputError(
                f"{str(self._path)!r} is the checkpoint of another run and would be replaced: go on from it with "
                "restart, remove it, or name another folder"
            )


def _content(file):
    """What a file of rows says besides its tables, if it is a checkpoint.

    Local.

    Args:
        file: RowFile.

    Returns:
        dict.

    Raises:
        CheckpointError: it is none, or damaged.
    """
    content = file.content
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise CheckpointError(f"{str(file.path)!r} is no {KIND}")
    wrong = [name for name, fits in _CONTENT.items() if not fits(content.get(name))]
    for name, (kind, columns, like) in _TABLES.items():
        table, other = (file.tables.get(one, {"type": None, "rows": 0}) for one in (name, like))
        if table["type"] != kind or table["columns"] < columns or table["rows"] != other["rows"]:
            wrong.append(name)
    if wrong:
        raise CheckpointError(
            f"{str(file.path)!r} is damaged or of another version, for {', '.join(wrong)} in it is missing or makes no "
            f"sense: {_ADVICE}"
        )
    return content


def _are_numbers(values):
    """Whether all are numbers that can be meant: not negative, and with squares that are finite."""
    return all(isinstance(value, Real) and 0 <= value <= _LARGEST for value in values)


def _names(cell, level, anchor):
    """Names of leaves: (n,) uint64."""
    return leaf_code(cell, anchor).astype(np.uint64) << np.uint64(_LEVEL_BITS) | level.astype(np.uint64)


def _named(names):
    """Inverse of `_names`."""
    level = (names & np.uint64((1 << _LEVEL_BITS) - 1)).astype(np.int8)
    cell, anchor = decode_leaf((names >> np.uint64(_LEVEL_BITS)).astype(np.int64))
    return cell, level, anchor


def _are_leaves(mesh, cell, level, anchor):
    """Whether a root mesh can have such leaves.  Local."""
    side = SIDE >> level.astype(np.int32)
    return ((cell < len(mesh.cells)) & (level <= MAX_LEVEL) & ~(anchor % side[:, None]).any(axis=1)).all()


def _are_whole(comm, mesh, cell, level, anchor):
    """Whether leaves fill the root cells, and none is there twice or inside of another.  Collective on comm."""
    filled = np.bincount(cell, np.ldexp(1.0, -3 * level.astype(np.int32)), len(mesh.cells))  # without rounding
    comm.Allreduce(MPI.IN_PLACE, filled)
    names = np.unique(_names(cell, level, anchor))
    directory, fits = Directory(comm, names.view(np.int64)), len(names) == len(cell)
    fits &= bool((directory.lowest(np.full(len(names), comm.rank)) == comm.rank).all())
    above = [np.empty(0, dtype=np.uint64)]
    while len(cell):
        inner = level > 0
        level = level[inner] - 1
        anchor = anchor[inner] & -(SIDE >> level.astype(np.int32))[:, None]
        above.append(np.unique(_names(cell[inner], level, anchor)))
        cell, level, anchor = _named(above[-1])
    fits &= not directory.asked(np.concatenate(above).view(np.int64)).any()
    return comm.allreduce(fits, op=MPI.LAND) and bool((filled == 1).all())


def _is_balanced(forest):
    """Whether facing leaves have the same level, and no edge of a leaf more than one vertex inside.  Collective."""
    leaf, face = forest.contact_faces()
    level = forest.level[leaf]
    cell, anchor = forest.pairing.partners(forest.cell[leaf], level, forest.anchor[leaf], face)
    directory = Directory(forest.comm, _names(forest.cell, forest.level, forest.anchor).view(np.int64))
    _, found = directory.lookup(
        _names(cell, level, anchor).view(np.int64), np.zeros(len(forest)), np.ones(len(forest), dtype=bool)
    )
    leaf, edge = forest.edges.example[forest.level[forest.edges.example[:, 0]] < MAX_LEVEL].T
    ends = forest.corners[leaf[:, None], EDGE_CORNERS[edge]]
    quarters = forest.lattice.keys(forest.cell[leaf], (3 * ends + ends[:, ::-1]) // 4)
    crowded = forest.vertices.directory.asked(quarters.ravel()).any()
    return forest.comm.allreduce(bool(found.all() and not crowded), op=MPI.LAND)


@dataclass(frozen=True, eq=False)
class State:
    """What a checkpoint holds, distributed in some way.

    Attributes:
        forest: Forest.
        values: (n, 8, 3 + k) float64 at the corners of the leaves: displacement [m], and fields that go along.
        estimate: Estimate without stress, its errors in the order of the leaves.
        refine: (n,) int8, how often to refine each leaf for contact, whatever the estimate says.
        gain: Gain of the run, before it has marked this step.
    """

    forest: Forest
    values: np.ndarray
    estimate: Estimate
    refine: np.ndarray
    gain: Gain


class Checkpoint:
    """The last checkpoint in a folder.

    Collective on comm.

    Args:
        folder: in which a run has left it.
        scene: Scene, the same as that of the run.
        comm: MPI communicator, of any size.

    Attributes:
        path: of the file.
        comm: as given.
        run: id of the run that has written it.
        records: list of dict, of all steps so far.

    Raises:
        SceneError: folder or scene differ between ranks, or the scene is none.
        CheckpointError: there is none, it is not complete, damaged, of another format, or belongs to another scene.
    """

    def __init__(self, folder, scene, comm):
        check_comm(comm)
        with together(comm):
            check_scene(scene)
            self.path = as_path("the folder of a checkpoint", folder, CheckpointError) / NAME
            asked = problem(scene)
        check_alike(comm, {"folder": str(folder), **asked})
        self.comm, self._scene = comm, scene
        self._file = RowFile(self.path, comm)
        content = _content(self._file)
        self._compare(content["problem"], asked)
        self.run, self.records = content["run"], content["records"]

    def check(self, problem, options):
        """See that a run can go on from here.

        Local.

        Args:
            problem: dict, that of the run (`problem.problem`).
            options: dict that JSON can hold, those that must not change.

        Raises:
            CheckpointError: the run had another scene or other options.
        """
        self._compare(self._file.content["problem"], problem)
        self._compare(self._file.content["options"], options)

    def _compare(self, before, now):
        if differing := differences(before, now, "then", "now"):
            raise CheckpointError(
                f"{str(self.path)!r} belongs to another problem: {differing}; go on with what the run was begun with, "
                "or begin anew in another folder"
            )

    def load(self):
        """Read the state.

        Collective on comm.

        Returns:
            State, its leaves in equal blocks on the ranks.

        Raises:
            CheckpointError: the file is damaged.
        """
        scene, comm = self._scene, self.comm
        leaves, (whole, _, count) = _named(self._file.table("leaves")[:, 0]), self._file.content["estimate"]
        keys, values, error, refine = map(self._file.table, ("vertices", "values", "indicator", "refine"))
        with together(comm):
            self._see(_are_leaves(scene.mesh, *leaves), "some of its leaves are none of the root mesh")
            self._see(np.isfinite(values).all(), "some of its displacements are not finite")
            self._see(((error >= 0) & np.isfinite(error)).all(), "some of its errors are negative, or not finite")
            self._see(
                np.isin(refine, (0, 1, 2)).all(), "some of its leaves are to be refined other than once or twice"
            )
            self._see(
                count == self._file.tables["leaves"]["rows"], "it has another number of leaves than its estimate"
            )
        added = np.sqrt(comm.allreduce(float((error**2).sum())))
        self._see(abs(added - whole) <= 1e-6 * whole, "its errors do not add up to its estimate")
        self._see(_are_whole(comm, scene.mesh, *leaves), "its leaves do not fill the root cells, each of them once")
        forest = Forest(comm, scene.mesh, Lattice(scene.mesh), scene.pairing, *leaves)
        self._see(_is_balanced(forest), "the levels of its leaves do not fit together")
        keys, rows = np.unique(keys[:, 0], return_index=True)
        values, found = Directory(comm, keys).lookup(
            forest.vertices.keys, values[rows], np.ones(len(keys), dtype=bool)
        )
        with together(comm):
            self._see(found.all(), "it lacks vertices of its leaves")
        estimate = Estimate(None, error[:, 0], None, *self._file.content["estimate"])
        gain = Gain(**self._file.content["gain"])
        return State(forest, values[forest.vertices.cells], estimate, refine[:, 0].astype(np.int8), gain)

    def _see(self, right, damage):
        """Raises CheckpointError that says what the damage is, unless all is right.  Local."""
        if not right:
            raise CheckpointError(f"{str(self.path)!r} is damaged: {damage}; {_ADVICE}")
