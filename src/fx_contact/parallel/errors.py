"""Typed errors: each says what is wrong, where, and what to do about it.

Every error of this package derives from `FxContactError` and is raised on all ranks of a communicator
(see `fx_contact.parallel.mpi.together`), so that a caller may catch it without risking a hang.
"""

from contextlib import contextmanager


class FxContactError(Exception):
    """Base of all errors raised by fx_contact.

    Attributes, set where a run fails after it has begun (else None), so that nothing is lost:
        record: StepRecord of the last step that was solved.
        forest: Forest of that step, or the one after it where that was being solved.
        displacement: (owned, 3) float64, the last step's displacement on that forest's conforming vertices [m].
    """

    record = forest = displacement = None


class SceneError(FxContactError):
    """The description of the problem is wrong: a material, a tag, a boundary condition, an option."""


class GeometryError(FxContactError):
    """The root mesh is unusable: inverted, non-hexahedral or non-conforming cells, too high an order."""


class PairingError(FxContactError):
    """Two contact surfaces do not match facet by facet."""


class PartitionError(FxContactError):
    """The leaves cannot be distributed over the ranks."""


class SolveError(FxContactError):
    """The linear solver or the contact loop did not converge, or a step would not fit into the memory."""


class ValidityError(FxContactError):
    """The solution is outside of what linear elasticity is valid for, or nothing loads the scene."""


class CompilationError(FxContactError):
    """The kernels of the finite elements cannot be compiled: no compiler, or no folder to keep them in."""


class CallError(FxContactError):
    """Ranks do not make the same call, or one of them has ended its program."""


class OutputError(FxContactError):
    """Results cannot be written where the user asked for."""


class CheckpointError(FxContactError):
    """A checkpoint is missing, incomplete, damaged, of another format, or belongs to another problem."""


@contextmanager
def writing(path):
    """A block that writes a file.

    Local.

    Args:
        path: of the file, for the error.

    Raises:
        OutputError: the system does not let it.
    """
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot write {str(path)!r}: {error.strerror}; make room, or name another folder"
        ) from None
