"""Contact of the bodies of a scene: forces of contact pairs, and bodies without support."""

from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.problem.scene import Scene


def force_components(scene: Scene, rows: ConstraintRows, force: FloatArray) -> FloatArray:
    """Contributions of rows to the force of their contact pair: components along its direction, if it has one.

    Local.

    Args:
        force: (n,), along the normals [N].

    Returns:
        (n,) [N].
    """
    result = force.copy()
    for index, direction in enumerate(pair.unit_direction for pair in scene.contact):
        if direction is not None:
            ours = rows.contact == index
            result[ours] *= rows.normal[ours] @ direction
    return result


def loose_bodies(scene: Scene, rows: ConstraintRows, active: BoolArray) -> list[str]:
    """Names of the bodies that neither conditions nor the active rows (n,) support, on all ranks.  Collective."""
    motions = scene.rigid_motions
    if not len(motions.free):
        return []
    first, second = (
        motions.free_along(rows.position[active], rows.bodies[active, i], rows.normal[active]) for i in (0, 1)
    )
    resistance = (first - second).T @ (first - second)
    rows.prolongation.comm.Allreduce(MPI.IN_PLACE, resistance)
    return list(motions.unresisted(resistance))
