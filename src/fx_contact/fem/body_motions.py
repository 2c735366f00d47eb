"""Rigid motions of bodies at the nodes: their sums and work, and a projector that leaves some out of a displacement."""

from __future__ import annotations

from copy import copy
from functools import cached_property

import numpy as np
from petsc4py import PETSc

from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.external_forces import nodal_volumes
from fx_contact.fem.supports import Supports
from fx_contact.linalg.operator import MatrixOperator, Projector
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.arrays import FloatArray
from fx_contact.scene.scene import Scene

#: Energies of rigid motions, relative to those of the diagonal, up to which they are the rounding of 0.
UNRESISTED = 1e-12


class BodyMotions:
    """Rigid motions of the bodies of a scene at the owned conforming nodes.  Local at its making.

    Attributes:
        rigid: the motions, with the names of the bodies.
    """

    def __init__(self, scene: Scene, elasticity: Elasticity, supports: Supports) -> None:
        self.rigid, self._elasticity, self._supports = scene.rigid_motions, elasticity, supports
        self._prolongation, self._count = elasticity.prolongation, len(scene.mesh.bodies)
        space = self._prolongation.space
        cell = space.forest.cell[space.example[:, 0]]
        self._body = self._prolongation.injected(scene.mesh.body[cell].astype(np.int64))

    @cached_property
    def modes(self) -> FloatArray:
        """(6, owned, 3), displacements for unit coefficients of each node's body, 0 where held [-].  Local."""
        space = self._prolongation.space
        leaf, local = space.example.T
        positions = self._elasticity.leaf_mesh.positions(leaf, local, space.degree)
        positions = self._prolongation.injected(positions)
        modes = self.rigid.modes(positions, self._body).swapaxes(0, 1)
        return np.stack([self._supports.free_part(mode) for mode in np.ascontiguousarray(modes)])

    @cached_property
    def volumes(self) -> FloatArray:
        """(owned, 1), integrals of the functions of the nodes [m^3].  Collective at the first call."""
        return nodal_volumes(self._prolongation.space.forest, self._elasticity)[:, None]

    def sums(self, values: FloatArray, modes: FloatArray | None = None) -> FloatArray:
        """This rank's sums over each body of modes (6, owned, 3) times values (owned, 3): (nbodies, 6)."""
        work = [np.einsum("ni,ni->n", mode, values) for mode in (self.modes if modes is None else modes)]
        return np.stack([np.bincount(self._body, one, minlength=self._count) for one in work], axis=1)

    def work(self, forces: FloatArray) -> FloatArray:
        """Work (2, nbodies, 6) [N] of forces (owned, 3) [N] in unit motions; by magnitudes.  Collective."""
        sizes = [np.linalg.norm(values, axis=-1, keepdims=True) for values in (forces, self.modes)]
        sums = np.stack([self.sums(forces), self.sums(*sizes)])
        return self._prolongation.comm.allreduce(sums)

    def displacement(self, motion: FloatArray) -> FloatArray:
        """The displacement (owned, 3) [m] of coefficients (nbodies, 6) [m].  Local."""
        return np.einsum("nm,mni->ni", motion[self._body], self.modes)

    def resistance(self, matrix: PETSc.Mat) -> FloatArray:
        """R^T K R of a matrix K without coupling of bodies, and R^T diag(K) R: (2, nbodies, 6, 6) [N/m].  Collective.

        Cells resist rotations where their geometry has a higher order than the displacements.
        """
        products: FloatArray = np.zeros_like(self.modes)
        with PetscObjects() as objects:
            operator = MatrixOperator(matrix, objects)
            for index in range(6):
                operator.add_product(self.modes[index], products[index])
            of_diagonal = operator.diagonal() * self.modes
        sums = np.stack([np.stack([self.sums(one) for one in each], axis=2) for each in (products, of_diagonal)])
        return np.asarray(self._prolongation.comm.allreduce(sums))

    def gram(self) -> FloatArray:
        """(nbodies, 6, 6), integrals of products of modes over each body [m^3].  Collective."""
        sums = np.stack([self.sums(self.volumes * mode) for mode in self.modes], axis=2)
        return self._prolongation.comm.allreduce(sums)

    def total(self, values: FloatArray) -> FloatArray:
        """`sums` of all ranks.  Collective."""
        return np.asarray(self._prolongation.comm.allreduce(self.sums(values)))


class FreeMotions:
    """Rigid motions N that nothing resists and no load drives, left out of displacements.

    The projector Q u = u - N (N^T V N)^-1 N^T V u with V the volumes of the nodes, behind another one with P N = N:
    means of displacement and rotation over the free bodies are 0, and forces Q^T f are balanced as by inertia.

    Collective.

    Args:
        motions: (k, nbodies, 6), linearly independent coefficients.
    """

    def __init__(self, bodies: BodyMotions, motions: FloatArray) -> None:
        self._bodies, self._motions = bodies, motions
        gram = np.einsum("kbm,bmn,lbn->kl", motions, bodies.gram(), motions)
        self._dual = np.tensordot(np.linalg.inv(gram), motions, axes=1)
        self._behind: Projector | None = None
        self.rigid = True

    def behind(self, projector: Projector) -> FreeMotions:
        """The product Q P with another projector.  Local."""
        other = copy(self)
        other._behind, other.rigid = projector, projector.rigid
        return other

    def remaining(self, u: FloatArray) -> FloatArray:
        """Q u, (owned, 3) [m]."""
        share = np.einsum("kbm,bm->k", self._dual, self._bodies.total(self._bodies.volumes * u))
        return u - self._bodies.displacement(np.tensordot(share, self._motions, axes=1))

    def apply(self, u: FloatArray) -> None:
        """As `operator.Projector`."""
        if self._behind is not None:
            self._behind.apply(u)
        u[:] = self.remaining(u)

    def apply_transpose(self, f: FloatArray) -> FloatArray:
        """As `operator.Projector`."""
        share = np.einsum("kbm,bm->k", self._motions, self._bodies.total(f))
        f -= self._bodies.volumes * self._bodies.displacement(np.tensordot(share, self._dual, axes=1))
        return np.zeros(0) if self._behind is None else self._behind.apply_transpose(f)

    def add_yielding(self, forces: FloatArray, u: FloatArray) -> None:
        """As `operator.Projector`."""
        if self._behind is not None:
            self._behind.add_yielding(forces, u)
            u[:] = self.remaining(u)
