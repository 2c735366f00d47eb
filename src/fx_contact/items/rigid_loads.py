"""Loads on surfaces that stay rigid: a flange, a fixture, a part that is not modelled.  All is local."""

from dataclasses import dataclass

from fx_contact.items.boundary_conditions import Placed
from fx_contact.parallel.validation import check_label, check_vector


@dataclass(frozen=True)
class RigidLoad(Placed):
    """A force and a moment on a surface that moves as a rigid body, u = t + r x (x - c), with small unknown t and r.

    Where the surface meets symmetry planes and prescribed displacements, those motions that they allow are left.  It
    shares no node with contacts, ties and other rigid loads.

    Raises SceneError if the surface has no name, or a vector is not three finite numbers.

    Attributes:
        force: of all symmetric parts as forces in the records; a surface off the symmetry planes has images, and each
            gets force / symmetry [N].
        moment: about `point`, likewise [N m].
        point: c; None: the centroid of the surface [m].
    """

    KIND = "the rigid load on"

    surface: str
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        check_label("the surface of a rigid load", self.surface)
        for name in ("force", "moment", "point"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, check_vector(f"the {name} of {self.what}", value))
