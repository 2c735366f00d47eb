"""The whole bodies that a modelled part stands for: its mirror images in planes of symmetry, and theirs."""

from dataclasses import dataclass

import numpy as np

from fx_contact.parallel.errors import SceneError
from fx_contact.problem.boundary_conditions import PLANE, ObliquePlane, SymmetryPlane

#: Entries of rotations and reflections, or components of unit vectors, up to which two are the same.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Mirrors:
    """Planes in which the modelled part is mirrored, again and again, to give the whole.

    All methods are local; sums over mirror images have the unit of what is summed.

    Attributes:
        normals: (n, 3) float64, unit normals of different directions.
        at: (n,) float64, place of each plane along its normal [m].
        images: (parts, 3, 3) float64, the group that the reflections generate: the identity and all images.
    """

    normals: np.ndarray
    at: np.ndarray
    images: np.ndarray

    @property
    def parts(self):
        """Number of modelled parts in the whole, itself and its images."""
        return len(self.images)

    def force(self, vectors):
        """Sums of vectors and their images: what no plane is across stays, times their number.  Local.

        Args:
            vectors: (..., 3) float64, of the modelled part.

        Returns:
            (..., 3) float64, of the whole.
        """
        return vectors @ _summed(self.images).T + 0.0  # no -0.0

    def moment(self, vectors):
        """As `force`, for moments (..., 3) about a point on all planes, which a reflection turns round too."""
        return vectors @ _summed(np.linalg.det(self.images)[:, None, None] * self.images).T + 0.0

    def second_moment(self, tensor):
        """As `force`, for (3, 3) float64 second moments about a point on all planes."""
        return (self.images @ tensor @ self.images.swapaxes(1, 2)).sum(axis=0)

    def centre(self, point):
        """The centre of the whole: (3,) float64 [m], from that of the modelled part; on all planes."""
        if not len(self.at):
            return point
        inverse = np.linalg.pinv(self.normals, rcond=_SAME)
        return point - inverse @ (self.normals @ point) + inverse @ self.at


def mirrors_of(scene):
    """The mirrors of a scene.

    Local.  A direction with planes of symmetry at two places is that of a slice, as of plane strain, which is not
    mirrored.  Where the planes make fewer copies than `Scene.symmetry`, nothing is known of the whole.

    Args:
        scene: Scene.

    Returns:
        Mirrors; none if the scene is the whole, or if its whole is not known: then `parts` is not `scene.symmetry`.

    Raises:
        SceneError: `scene.symmetry` is no multiple of the copies that the planes make.
    """
    mesh, normals, places = scene.mesh, [], []
    for condition in scene.dirichlet:
        if isinstance(condition, SymmetryPlane):
            plane = condition.on(mesh)
            normal = np.array(plane.normal) if isinstance(plane, ObliquePlane) else plane.held.astype(float)
            at = float((mesh.facet_points(mesh.surface(condition.surface)) @ normal).mean())
            same = [i for i, other in enumerate(normals) if np.linalg.norm(np.cross(normal, other)) < _SAME]
            if not same:
                normals.append(normal)
                places.append([at])
            for i in same:
                places[i].append(at * np.sign(normal @ normals[i]))
    size = np.ptp(mesh.points, axis=0).max()
    single = [i for i, at in enumerate(places) if np.ptp(at) <= PLANE * size]
    normals = np.array([normals[i] for i in single]).reshape(-1, 3)
    found = Mirrors(normals, np.array([np.mean(places[i]) for i in single]), mirror_group(normals, scene.symmetry))
    if scene.symmetry > 1 and scene.symmetry % found.parts:
        copies = found.parts if found.parts < scene.symmetry else f"more than {scene.symmetry}"
        raise SceneError(
            f"symmetry={scene.symmetry}, but planes of symmetry in {len(single)} directions make {copies} copies of a "
            "part: take their number, or a multiple of it"
        )
    off = np.abs(normals @ found.centre(np.zeros(3)) - found.at).max(initial=0.0)
    if found.parts == scene.symmetry and off <= PLANE * size:
        return found
    return Mirrors(np.zeros((0, 3)), np.zeros(0), np.eye(3)[None])


def mirror_group(normals, most):
    """The group that reflections in planes through the origin generate.

    Local.

    Args:
        normals: (n, 3) float64, their unit normals.
        most: elements after which no more are looked for: of most angles it has no end.

    Returns:
        (m, 3, 3) float64, the identity first.
    """
    mirrors = np.eye(3) - 2 * normals[:, :, None] * normals[:, None]
    images, new = np.eye(3)[None], np.eye(3)[None]
    while len(new) and len(images) <= most:
        found = (mirrors[:, None] @ new).reshape(-1, 3, 3)
        far = np.abs(found[:, None] - np.concatenate([images, found])).max(axis=(2, 3)) > _SAME
        first = np.arange(len(found))[:, None] > np.arange(-len(images), len(found))
        new = found[(far | ~first).all(axis=1)]
        images = np.concatenate([images, new])
    return images


def _summed(images):
    """The sum of images, its rounding left out: (3, 3)."""
    result = images.sum(axis=0)
    return np.where(np.abs(result) > _SAME * len(images), result, 0.0)
