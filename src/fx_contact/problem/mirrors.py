"""The whole bodies that a modelled part stands for: its mirror images in planes of symmetry."""

from dataclasses import dataclass

import numpy as np

from fx_contact.problem.boundary_conditions import PLANE, SymmetryPlane


@dataclass(frozen=True, eq=False)
class Mirrors:
    """Planes in which the modelled part is mirrored to give the whole, across different axes.

    All methods are local; sums over mirror images have the unit of what is summed.

    Attributes:
        across: (3,) bool, the axes across which there is such a plane.
        at: (3,) float64, where it is on its axis [m]; 0 on the others.
    """

    across: np.ndarray
    at: np.ndarray

    @property
    def parts(self):
        """Number of modelled parts in the whole, itself and its images."""
        return int(2 ** self.across.sum())

    def force(self, vectors):
        """Sums of vectors and their images: those across a plane cancel.  Local.

        Args:
            vectors: (..., 3) float64, of the modelled part.

        Returns:
            (..., 3) float64, of the whole.
        """
        return self.parts * np.where(self.across, 0.0, vectors)

    def moment(self, vectors):
        """As `force`, for moments (..., 3) about a point on all planes: one keeps the moment about its normal alone."""
        kept = [not np.delete(self.across, axis).any() for axis in range(3)]
        return self.parts * np.where(kept, vectors, 0.0)

    def second_moment(self, tensor):
        """As `force`, for (3, 3) float64 second moments about a point on all planes: mixed ones across one cancel."""
        mixed = (self.across[:, None] | self.across) & ~np.eye(3, dtype=bool)
        return self.parts * np.where(mixed, 0.0, tensor)

    def centre(self, point):
        """The centre of the whole: (3,) float64 [m], from that of the modelled part; on all planes."""
        return np.where(self.across, self.at, point)


def mirrors_of(scene):
    """The mirrors of a scene.

    Local.  An axis with planes of symmetry at two places is that of a slice, as of plane strain, which is not mirrored.
    Where the planes do not make `Scene.symmetry` copies, nothing is known of the whole.

    Args:
        scene: Scene.

    Returns:
        Mirrors; none if the scene is the whole, or if its whole is not known: then `parts` is not `scene.symmetry`.
    """
    mesh, places = scene.mesh, [[], [], []]
    for condition in scene.dirichlet:
        if isinstance(condition, SymmetryPlane):
            axis = int(condition.on(mesh).held.argmax())
            places[axis].append(mesh.facet_points(mesh.surface(condition.surface))[..., axis].mean())
    size = np.ptp(mesh.points, axis=0).max()
    found = Mirrors(
        np.array([bool(at) and np.ptp(at) <= PLANE * size for at in places]),
        np.array([np.mean(at) if at else 0.0 for at in places]),
    )
    return found if found.parts == scene.symmetry else Mirrors(np.zeros(3, dtype=bool), np.zeros(3))
