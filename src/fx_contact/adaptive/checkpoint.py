"""The state after an adaptive step on disk, from which any number of ranks can continue.

Leaves and nodes are named by keys that do not depend on the ranks: a leaf with its indicator takes 25 bytes, a node
with its displacement 32.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.checkpoint_file import CheckpointFile, write_checkpoint
from fx_contact.adaptive.settings import Settings
from fx_contact.adaptive.state import State
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.estimate.estimator import Estimate
from fx_contact.fem.nodal_fields import NodalFields
from fx_contact.fem.space import Space, child_error
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import with_cuts
from fx_contact.geometry.lattice import Lattice
from fx_contact.parallel.agreement import check_alike, differences
from fx_contact.parallel.errors import CheckpointError, OutputError, writing
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import Directory, together
from fx_contact.parallel.validation import as_folder, check_comm
from fx_contact.scene.fingerprint import scene_parts
from fx_contact.scene.scene import Scene, check_scene
from fx_contact.surfaces.facet_pairing import decode_leaf, leaf_code

NAME = "checkpoint"
#: Bits of the level in the name of a leaf, after its `leaf_code`.
_LEVEL_BITS = 4


class CheckpointWriter:
    """Writer of the last step of a run in a folder.

    Collective on comm.  A run replaces its own checkpoint, known by its id, or that from which it continues, no other.

    Args:
        folder: made if it is not there.
        settings: of the run.
        restart: from which the run continues.

    Raises:
        OutputError: the folder cannot be made, or holds a checkpoint that would be lost.
        CheckpointError: an existing file of the same name is no checkpoint, or cannot be read.
    """

    def __init__(
        self, folder: str | Path, comm: MPI.Intracomm, settings: Settings, restart: "Checkpoint | None" = None
    ) -> None:
        self._settings = {"problem": settings.problem, "options": settings.fixed()}
        self._run = comm.bcast(uuid4().hex)
        self._replaceable = {self._run} | ({restart.run} if restart is not None else set())
        with together(comm):
            self._path = as_folder("the folder for checkpoints", folder, OutputError) / NAME
            if comm.rank == 0:
                with writing(self._path):
                    self._path.parent.mkdir(parents=True, exist_ok=True)
                    self._allow()

    def save(self, step: Step, records: Sequence[StepRecord], further: Mapping[str, Any] | None = None) -> None:
        """Replace the checkpoint in the folder by the state after a step.

        Collective on step.forest.comm.  Raises OutputError if it cannot be written, or another run has written one; the
        old file stays.

        Args:
            records: of all steps up to this one.
            further: entries for JSON, beside or instead of those of the content.
        """
        state, prolongation = State.of(step), step.elasticity.prolongation
        forest, error, fields = state.forest, state.estimate, state.fields
        assert error is not None, "of a solved state"
        leaf, node = prolongation.space.example.T
        # Conforming nodes by their owner; hanging ones, at -1, by every rank that has them, alike to rounding.
        rows = prolongation.conforming < prolongation.owned
        level = forest.level.astype(np.uint64)
        content: dict[str, Any] = {
            "run": self._run,
            **self._settings,
            "degree": prolongation.space.degree,
            "fields": dict(fields.sizes),
            "records": [record.as_json() for record in records],
            "estimate": [error.error_global, error.energy_norm, error.cells],
        }
        arrays = {
            "leaves": leaf_code(forest.cell, forest.anchor).astype(np.uint64) << np.uint64(_LEVEL_BITS) | level,
            "indicator": error.error,
            "edge": np.zeros(len(forest), dtype=bool) if error.at_edge is None else error.at_edge,
            "refine": step.contact_error.refine.astype(np.int8),
            "nodes": prolongation.space.keys[rows],
            "values": fields.array[leaf[rows], node[rows]],
        }
        write_checkpoint(self._path, forest.comm, content | dict(further or {}), arrays, self._allow)
        self._replaceable = {self._run}

    def _allow(self) -> None:
        """Raises OutputError for the checkpoint of another run, CheckpointError for another file.  Local."""
        if self._path.exists() and CheckpointFile(self._path, MPI.COMM_SELF).content["run"] not in self._replaceable:
            raise OutputError(
                f"{str(self._path)!r} is the checkpoint of another run and would be replaced: continue from it with "
                "restart, remove it, or name another folder"
            )


class Checkpoint:
    """The last checkpoint in the folder of a run of a scene.

    Collective on comm, of any size.

    Attributes:
        run: id of the run.
        records: of all steps so far.

    Raises:
        SceneError: folder or scene differ between ranks, or the scene is no Scene.
        CheckpointError: there is none, it is not complete, damaged, of another format, or belongs to another scene.
    """

    @collective("comm")
    def __init__(self, folder: str | Path, scene: Scene, comm: MPI.Intracomm) -> None:
        check_comm(comm)
        with together(comm):
            check_scene(scene)
            self.path = as_folder("the folder of a checkpoint", folder, CheckpointError) / NAME
            asked = scene_parts(scene)
        check_alike(comm, {"folder": str(folder), **asked})
        self.comm, self._scene = comm, scene
        self._file = CheckpointFile(self.path, comm)
        content = self._file.content
        self._compare(content["problem"], asked)
        self.run: str = content["run"]
        try:
            self.records = [StepRecord.from_json(entries) for entries in content["records"]]
        except TypeError:
            raise CheckpointError(f"{str(self.path)!r} is of another version of fx_contact: begin anew") from None

    def check(self, settings: Settings) -> None:
        """Raises CheckpointError unless a run with these settings can continue here.  Local."""
        self._compare(self._file.content["problem"], settings.problem)
        self._compare(self._file.content["options"], settings.fixed())

    def _compare(self, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        if differing := differences(before, now, "then", "now"):
            raise CheckpointError(
                f"{str(self.path)!r} belongs to another problem: {differing}; continue with the settings of the run, "
                "or begin anew in another folder"
            )

    @collective("self.comm")
    def load(self) -> State:
        """The state, its leaves in equal blocks on the ranks.

        Collective on comm.  Raises CheckpointError if the file is damaged.
        """
        scene, comm, content, array = self._scene, self.comm, self._file.content, self._file.array
        names, keys, values = map(array, ("leaves", "nodes", "values"))
        error, at_edge, refine = map(array, ("indicator", "edge", "refine"))
        level = (names & np.uint64((1 << _LEVEL_BITS) - 1)).astype(np.int8)
        cell, anchor = decode_leaf((names >> np.uint64(_LEVEL_BITS)).astype(np.int64))
        root = comm, scene.mesh, Lattice(scene.mesh), scene.pairing, scene.contact_surfaces
        forest = with_cuts(Forest(*root, cell, level, anchor))
        keys, rows = np.unique(keys, return_index=True)
        space = Space(forest, content["degree"])
        directory = Directory(comm, keys, forest.homes.of_points)
        values, _ = directory.lookup(space.keys, values[rows], np.ones(len(keys), dtype=bool))
        xi, omega, cells = content["estimate"]
        estimate = Estimate(error, None, xi, omega, cells, child_error(space.degree), at_edge)
        last, fields = self.records[-1], NodalFields(forest, values[space.cells], content["fields"])
        return State(fields, last.motions, last.assumed_effectivity, estimate, refine, last.expected_estimate)
