"""Start of a run from a refined forest with a displacement."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.state import State
from fx_contact.adaptive.step import Step, check_step
from fx_contact.fem.nodal_fields import NodalFields
from fx_contact.fem.space import DEGREES
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.geometry.lattice import MAX_LEVEL
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray
from fx_contact.parallel.errors import PartitionError, SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.memory import check_leaves
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm, check_count, check_flag, check_number, check_same_comm, shown
from fx_contact.scene.fingerprint import same_mesh, scene_parts
from fx_contact.scene.scene import Scene, check_scene


@dataclass(frozen=True, eq=False)
class Beginning:
    """Start of a run from a refined forest instead of the root cells; checked when the run begins.

    Attributes:
        forest: on the scene's root mesh, with its contact pairs and communicator.
        values: (n, (p+1)^3, 3 + k) at the nodes of its leaves, finite, p = 1 or 2: a first guess of the displacement
            [m], then any continuous fields of degree p, which are carried through refinement and partition.  In a run
            of another degree they are interpolated.
        adapted: the forest is adapted to such a solution; else its estimate counts as that of a first mesh.
        motions: first guess of `StepRecord.motions`; None: obstacles below forces begin where they touch.
    """

    forest: Forest
    values: FloatArray
    adapted: bool = False
    motions: Mapping[str, Any] | None = None

    def check(self, scene: Scene, comm: MPI.Intracomm) -> None:
        """Raises SceneError unless a run of a scene can begin here.  Local."""
        forest, values = self.forest, self.values
        if not isinstance(forest, Forest):
            raise SceneError(f"the forest of a Beginning must be a Forest, got {shown(forest)}")
        check_flag("`adapted` of a Beginning", self.adapted)
        check_same_comm("the forest of the Beginning", forest.comm, comm)
        if not same_mesh(forest.mesh, scene.mesh):
            raise SceneError("the forest of the Beginning is of another root mesh than the scene: begin with its own")
        if not forest.stands_on(scene.pairing, scene.contact_surfaces):
            raise SceneError("the forest of the Beginning has other contact pairs than the scene: begin with its own")
        if not isinstance(values, np.ndarray) or values.dtype != np.float64:
            raise SceneError(f"the values of a Beginning must be an array of float64, got {shown(values)}")
        nodes = [(degree + 1) ** 3 for degree in DEGREES]
        if values.ndim != 3 or len(values) != len(forest) or values.shape[1] not in nodes or values.shape[2] < 3:
            shape = f"({len(forest)}, {' or '.join(map(str, nodes))}, 3 or more)"
            raise SceneError(
                f"the values of a Beginning must be an array of shape {shape}, three components of the displacement "
                f"and other fields at the nodes of each leaf, got one of {values.shape}"
            )
        if not np.isfinite(values).all():
            raise SceneError("the values of a Beginning must be finite: they are a first guess of the displacement")
        if self.motions is not None:
            check_motions(self.motions, scene)

    def state(self, degree: int) -> State:
        """The state from which a run with displacements of a degree begins.  Local."""
        sizes = {"displacement": 3, "carried": self.values.shape[2] - 3}
        fields = NodalFields(self.forest, self.values, sizes)
        return State(fields.of_degree(degree), self.motions, 1.0 if self.adapted else None)

    @classmethod
    def at_rest(cls, forest: Forest) -> Self:
        """A forest with zero displacement.  Local."""
        return cls(forest, np.zeros((len(forest), (DEGREES[0] + 1) ** 3, 3)))

    @classmethod
    @collective("comm")
    def uniform(cls, scene: Scene, levels: int, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Self:
        """The root cells, refined uniformly `levels` times, up to `lattice.MAX_LEVEL`, with zero displacement.

        Collective on comm.

        Raises:
            SceneError: scene or levels are invalid, or differ between ranks.
            SolveError: so many leaves would not fit into the memory.
        """
        check_comm(comm)
        with together(comm):
            check_scene(scene)
            check_count("the number of refinements", levels, least=0)
            if levels > MAX_LEVEL:
                raise SceneError(f"root cells can be refined {MAX_LEVEL} times, got {levels}: take a finer root mesh")
            asked = scene_parts(scene) | {"number of refinements": int(levels)}
        check_alike(comm, asked)
        forest = Forest.of_roots(comm, scene.mesh, scene.pairing, scene.contact_surfaces)
        check_leaves(comm, len(forest) * 8 ** int(levels))
        for _ in range(levels):
            forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
        return cls.at_rest(forest)

    @classmethod
    @collective("step.forest.comm")
    def after(cls, step: Step, marked: BoolArray | IntArray) -> Self:
        """The refined forest of a step, with its displacement as the first guess and as carried field.

        Collective on step.forest.comm.

        Args:
            marked: (n,), leaves to refine, or how often to refine each.

        Raises:
            SceneError: the step is no Step, or marked is invalid.
            GeometryError: leaves of the finest level are marked.
            SolveError: the new forest would not fit into the memory.
        """
        check_step(step)
        forest = step.forest
        with together(forest.comm):
            if not isinstance(marked, np.ndarray) or marked.dtype.kind not in "bui" or marked.shape != (len(forest),):
                raise SceneError(
                    f"marked must be an array of bool or whole numbers, one for each of the {len(forest)} leaves of "
                    f"this rank, got {shown(marked)}"
                )
            if not ((marked >= 0) & (marked <= MAX_LEVEL)).all():
                raise SceneError(
                    f"marked must say how often to refine each leaf, 0 to {MAX_LEVEL} times, got "
                    f"{marked.min()} to {marked.max()}"
                )
        refined, values = forest.refined_with(marked.astype(np.int8), np.tile(step.nodal_displacement, 2))
        assert values is not None, "given values are interpolated"
        return cls(refined, values, True, step.record.motions)


def check_motions(motions: object, scene: Scene) -> None:
    """Raises SceneError unless it has a finite distance for each obstacle below a force, by the name of the pair."""
    pairs = {pair.name: pair.motion for pair in scene.contact}
    moved = [name for name, motion in pairs.items() if motion is not None]
    if not isinstance(motions, Mapping) or not all(name in motions for name in moved):
        wanted = ", ".join(map(repr, moved)) or "no contact pair"
        raise SceneError(
            f"the motions of a Beginning must be a dict with distances of {wanted}, got {shown(motions)}"
        )
    for name in motions:
        if name in moved:
            check_number(f"the motion of {name!r}", motions[name])
        elif name in pairs:
            raise SceneError(
                f"{name!r} has no given force in this scene, and so no motion, got {shown(motions[name])}: "
                "dataclasses.replace(beginning, motions=None) keeps mesh and displacement alone"
            )


def first_forest(scene: Scene, comm: MPI.Intracomm, kind: str) -> Forest:
    """The root cells, refined where facets are too large, then uniformly until every rank gets a leaf.

    Collective on comm.  The kind of partition is a key of `partition.KINDS`.  Raises PartitionError.
    """
    forest = Forest.of_roots(comm, scene.mesh, scene.pairing, scene.contact_surfaces)
    while comm.allreduce(bool((large := forest.too_large(np.zeros(len(forest), dtype=bool))).any()), op=MPI.LOR):
        forest, _ = forest.refined(large)
    while True:
        try:
            return repartition(forest, None, kind)[0]
        except PartitionError:
            if forest.size_global > 64 * comm.size:
                raise
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
