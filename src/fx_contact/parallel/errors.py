"""Typed errors: each message has the cause, the place and a remedy.

All derive from `FxContactError` and are raised on all ranks of a communicator (`parallel.mpi.together`), so that a
caller can catch them without risking a hang.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fx_contact.parallel.arrays import FloatArray


class FxContactError(Exception):
    """Base class of all errors of fx_contact.

    Attributes, set where a run fails after its first step (else None):
        record: StepRecord of the last step that was solved.
        forest: Forest of that step, or of the next one if that one failed.
        displacement: (owned, 3), displacement of the last step at the conforming vertices of that forest [m].
    """

    record: Any = None
    forest: Any = None
    displacement: FloatArray | None = None


class SceneError(FxContactError):
    """Invalid problem description: a material, a name, a boundary condition, an option."""


class GeometryError(FxContactError):
    """Invalid root mesh: inverted, non-hexahedral or non-conforming cells, or an order that is too high."""


class PairingError(FxContactError):
    """Two contact surfaces do not match facet by facet."""


class PartitionError(FxContactError):
    """The leaves cannot be distributed over the ranks."""


class SolveError(FxContactError):
    """The linear solver or the contact loop did not converge, or a step would not fit into the memory."""


class ValidityError(FxContactError):
    """The solution is outside the range of linear elasticity, or the scene has no load."""


class CompilationError(FxContactError):
    """Kernels in C cannot be compiled or loaded: no compiler, or no cache folder that can be written."""


class CallError(FxContactError):
    """Ranks make different calls, or one of them has ended its program."""


class OutputError(FxContactError):
    """Results cannot be written to the given place."""


class CheckpointError(FxContactError):
    """A checkpoint is missing, incomplete, damaged, of another format, or belongs to another problem."""


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Raises OutputError, which names a path, for an OSError in the block.  Local."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot write {str(path)!r}: {error.strerror}; make room, or name another folder"
        ) from None
