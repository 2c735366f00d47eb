"""Symmetric operators on displacements, and the equations (A + T) u = b that a linear solver is given.

A `LinearSolver` has the stiffness A; a term T stands beside it and is never assembled.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.arrays import FloatArray


class Operator(ABC):
    """A symmetric operator from displacements to forces, (owned, 3) arrays.  Collective."""

    @abstractmethod
    def add_product(self, u: FloatArray, y: FloatArray) -> None:
        """y := y + A u; both contiguous, u [m], y [N]."""

    @abstractmethod
    def diagonal(self) -> FloatArray:
        """The diagonal, (owned, 3) [N/m]."""

    def add_force(self, u: FloatArray, y: FloatArray) -> None:
        """y := y + A u - a of a term with a load a, evaluated without the rounding of A u and a; here a = 0."""
        self.add_product(u, y)


class MatrixOperator(Operator):
    """A PETSc matrix of three unknowns a node, in any format."""

    def __init__(self, mat: PETSc.Mat, objects: PetscObjects) -> None:
        self.mat = mat
        self._x, self._y = map(objects.add, mat.createVecs())

    def add_product(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_product`."""
        self._x.array[:] = u.ravel()
        self.mat.mult(self._x, self._y)
        y += self._y.array_r.reshape(-1, 3)

    def diagonal(self) -> FloatArray:
        """As `Operator.diagonal`."""
        self.mat.getDiagonal(self._y)
        return self._y.array_r.reshape(-1, 3).copy()


class PressureOperator(Operator):
    """D^T C D, the part of the stiffness that a matrix A lacks.

    Attributes:
        comm: of the run.
        missing: (m,), C [Pa].
        schur: (m,), S^-1 [Pa].
    """

    comm: MPI.Intracomm
    missing: FloatArray
    schur: FloatArray

    def __len__(self) -> int:
        return len(self.missing)

    @abstractmethod
    def strains(self, u: FloatArray) -> FloatArray:
        """D u of (owned, 3) [m]: (m,) [m^(3/2)].  Collective."""

    @abstractmethod
    def forces(self, pressure: FloatArray) -> FloatArray:
        """D^T s of (m,) [Pa m^(3/2)]: (owned, 3) [N], 0 in constrained directions.  Collective."""

    @abstractmethod
    def add_to(self, mat: PETSc.Mat) -> None:
        """Add it to a matrix that has the entries of K, except in constrained directions.  Collective."""

    def add_product(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_product`."""
        y += self.forces(self.missing * self.strains(u))


class Sum(Operator):
    """The sum of operators; None is left out."""

    def __init__(self, terms: Sequence[Operator | None]) -> None:
        self._terms = [term for term in terms if term is not None]

    def add_product(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_product`."""
        for term in self._terms:
            term.add_product(u, y)

    def add_force(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_force`."""
        for term in self._terms:
            term.add_force(u, y)

    def diagonal(self) -> FloatArray:
        """As `Operator.diagonal`."""
        return np.sum([term.diagonal() for term in self._terms], axis=0)


class Projector(Protocol):
    """A constraint projector P with B P = 0: `contact.projection.Projection`."""

    rigid: bool

    def apply(self, u: FloatArray) -> None:
        """u := P u."""

    def apply_transpose(self, f: FloatArray) -> FloatArray:
        """f := P^T f; returns the constraint forces that balance the rest of f."""

    def add_yielding(self, forces: FloatArray, u: FloatArray) -> None:
        """Add the displacement by which constraints that are not rigid yield to their forces."""


@dataclass(frozen=True, eq=False)
class Equations:
    """(A + T) u = b with the stiffness A of a solver, on the displacements that satisfy linear constraints.

    Attributes:
        load: (owned, 3), b without the load a of the term [N].
        term: T, whose forces are T u - a; None: 0.
        projector: P with B P = 0; a first guess satisfies B u = D.  None: no constraints.
    """

    load: FloatArray
    term: Operator | None = None
    projector: Projector | None = None

    def residual(self, stiffness: Operator, u: FloatArray) -> FloatArray:
        """b + a - (A + T) u, (owned, 3) [N].  Collective."""
        forces = np.zeros_like(u)
        stiffness.add_product(u, forces)
        if self.term is not None:
            self.term.add_force(u, forces)
        return self.load - forces
