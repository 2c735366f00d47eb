"""Planes without shear stress: only the displacement across them is prescribed, as by symmetry."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fx_contact.fem.dirichlet import SAME_PLANE, nodes_on
from fx_contact.fem.prolongation import Prolongation
from fx_contact.forest.forest import Forest
from fx_contact.items.boundary_conditions import ObliquePlane
from fx_contact.items.materials import VOIGT
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray
from fx_contact.scene.scene import Scene

#: Weights that make the scalar product of two stresses that of their six components.
_WEIGHT = np.sqrt([1, 1, 1, 2, 2, 2])
#: A facet is plane across an axis up to this part of its size.
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class ShearFree:
    """Owned conforming nodes without shear stress.

    Local.

    Attributes:
        across: (owned, 3), the node lies on such a plane normal to the axis, and on no oblique one.
        oblique: (k,) nodes on oblique planes, and (k, 6, 6), projectors on stresses without shear on their planes.
    """

    across: BoolArray
    oblique: tuple[IntArray, FloatArray] = (np.zeros(0, dtype=np.int64), np.zeros((0, 6, 6)))

    def remove_shear(self, stress: FloatArray) -> None:
        """Remove the shear of stresses (owned, ..., 6 or more) in place, the first six as `VOIGT`."""
        for component, (i, j) in enumerate(VOIGT):
            if i != j:
                stress[self.across[:, i] | self.across[:, j], ..., component] = 0
        nodes, kept = self.oblique
        stress[nodes, ..., :6] = np.einsum("nij,n...j->n...i", kept, stress[nodes, ..., :6])


def find_shear_free(scene: Scene, forest: Forest, prolongation: Prolongation) -> ShearFree:
    """Nodes of plane facets with prescribed normal displacement, free tangential displacement, no load or tie.

    Collective on forest.comm.
    """
    mesh, space, planes = forest.mesh, prolongation.space, scene.oblique_planes
    on = np.zeros((len(space), 3 + len(planes)))
    prescribed, loaded = np.zeros((len(mesh.cells), 6, on.shape[1]), bool), np.zeros((len(mesh.cells), 6), bool)
    for condition in scene.conditions:
        if isinstance(condition, ObliquePlane):
            prescribed[(*mesh.surfaces[condition.where].T, 3 + planes.index(condition))] = True
        elif condition.where in mesh.surfaces:
            prescribed[(*mesh.surfaces[condition.where].T, slice(3))] |= condition.held
    ties = (name for tie in scene.ties for name in tie.surfaces)
    for name in (*(force.surface for force in (*scene.tractions, *scene.springs, *scene.rigid_loads)), *ties):
        loaded[tuple(mesh.surface(name).T)] = True
    alone: BoolArray = (prescribed.sum(axis=2) == 1) & ~loaded
    for column in range(on.shape[1]):
        facets = np.argwhere(alone & prescribed[:, :, column])
        if column < 3:
            extent = np.ptp(mesh.facet_points(facets), axis=1)
            facets = facets[extent[:, column] <= _FLAT * extent.max(axis=1)]
        on[nodes_on(space, facets), column] = 1
    on[prolongation.hanging] = 0
    on_planes: BoolArray = np.greater(prolongation.restrict(on), 0)
    oblique: BoolArray = np.any(on_planes[:, 3:], axis=1, keepdims=True)
    nodes = np.flatnonzero(oblique)
    shears = np.array([_shears(normal) for normal in (*np.eye(3), *(plane.normal for plane in planes))])
    values, vectors = np.linalg.eigh(np.tensordot(on_planes[nodes].astype(float), shears, axes=1))
    vectors = vectors * np.asarray(values <= SAME_PLANE)[:, None]
    kept = vectors @ vectors.swapaxes(1, 2) * (_WEIGHT / _WEIGHT[:, None])
    return ShearFree(on_planes[:, :3] & ~oblique, (nodes, kept))


def _shears(normal: npt.ArrayLike) -> FloatArray:
    """The sum of t t^T over an orthonormal basis t of the shears on a plane, as six weighted components: (6, 6)."""
    tangents = np.linalg.svd(np.reshape(normal, (1, 3)))[2][1:]
    both = np.einsum("i,tj->tij", np.asarray(normal, np.float64), tangents)
    both = (both + both.swapaxes(1, 2)) / np.sqrt(2)
    six = _WEIGHT * np.stack([both[:, i, j] for i, j in VOIGT], axis=1)
    return np.asarray(six.T @ six)
