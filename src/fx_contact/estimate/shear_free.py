"""Planes that are held across alone, as by symmetry: no shear stress acts there, which recovered stresses know."""

from dataclasses import dataclass

import numpy as np

from fx_contact.fem.dirichlet import SAME_PLANE, nodes_on
from fx_contact.problem.boundary_conditions import ObliquePlane

#: Rows and columns of the six components of a symmetric stress in recovered fields.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Weights that make the scalar product of two stresses that of their six components.
_WEIGHT = np.sqrt([1, 1, 1, 2, 2, 2])
#: A facet is plane across an axis up to this part of its size.
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class ShearFree:
    """Where there is no shear stress, at owned conforming nodes.

    Local.

    Attributes:
        across: (owned, 3) bool, the axes across which a node lies on such a plane; where planes are oblique they are
            among the others.
        oblique: (k,) int nodes on oblique planes and (k, 6, 6) float64, the orthogonal projectors on stresses without
            shear on all such planes there; None: there are none.
    """

    across: np.ndarray
    oblique: tuple[np.ndarray, np.ndarray] | None = None

    def remove_shear(self, stress):
        """Take the shear out of stresses (owned, 6 or more), the first six as `VOIGT`; changed in place."""
        for component, (i, j) in enumerate(VOIGT):
            if i != j:
                stress[self.across[:, i] | self.across[:, j], component] = 0
        if self.oblique is not None:
            nodes, kept = self.oblique
            stress[nodes, :6] = np.einsum("nij,nj->ni", kept, stress[nodes, :6])


def find_shear_free(scene, forest, prolongation):
    """Where a plane is held across it only: no shear stress acts there, as by symmetry.

    Collective on forest.comm.  What counts is all that is held of a facet, in however many conditions.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        ShearFree.
    """
    mesh, space, planes = forest.mesh, prolongation.space, scene.oblique_planes
    on = np.zeros((len(space), 3 + len(planes)))
    held, loaded = np.zeros((len(mesh.cells), 6, on.shape[1]), bool), np.zeros((len(mesh.cells), 6), bool)
    for condition in scene.conditions:
        if isinstance(condition, ObliquePlane):
            held[(*mesh.surfaces[condition.where].T, 3 + planes.index(condition))] = True
        elif condition.where in mesh.surfaces:
            held[(*mesh.surfaces[condition.where].T, slice(3))] |= condition.held
    for traction in scene.tractions:
        loaded[tuple(mesh.surfaces[traction.surface].T)] = True
    alone = (held.sum(axis=2) == 1) & ~loaded
    for column in range(on.shape[1]):
        facets = np.argwhere(alone & held[:, :, column])
        if column < 3:
            extent = np.ptp(mesh.facet_points(facets), axis=1)
            facets = facets[extent[:, column] <= _FLAT * extent.max(axis=1)]
        on[nodes_on(space, facets), column] = 1
    on[prolongation.hanging] = 0
    on = prolongation.restrict(on) > 0
    if not planes:
        return ShearFree(on)
    nodes = np.flatnonzero(on[:, 3:].any(axis=1))
    shears = np.array([_shears(normal) for normal in (*np.eye(3), *(plane.normal for plane in planes))])
    values, vectors = np.linalg.eigh(np.tensordot(on[nodes].astype(float), shears, axes=1))
    vectors = vectors * (values <= SAME_PLANE)[:, None]
    kept = vectors @ vectors.swapaxes(1, 2) * (_WEIGHT / _WEIGHT[:, None])
    return ShearFree(np.where(on[:, 3:].any(axis=1)[:, None], False, on[:, :3]), (nodes, kept))


def _shears(normal):
    """The sum of t t^T over an orthonormal basis t of the shears on a plane, as six weighted components: (6, 6)."""
    tangents = np.linalg.svd(np.reshape(normal, (1, 3)))[2][1:]
    both = np.einsum("i,tj->tij", normal, tangents)
    both = (both + both.swapaxes(1, 2)) / np.sqrt(2)
    six = _WEIGHT * np.stack([both[:, i, j] for i, j in VOIGT], axis=1)
    return six.T @ six
