"""Displacement fields, and integrals over the cells of a mesh that depend on them."""

from collections.abc import Sequence
from dataclasses import dataclass

import ufl
from dolfinx import fem
from mpi4py import MPI

from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.compilation import compiled


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """A displacement [m], continuous across hanging facets, and its elastic strain [-], from `Elasticity.field`.

    Attributes:
        strain: sym grad u less the stress-free strain.
        volume_strain: its trace.
        projected: the volume strain of nearly incompressible bodies; None: there are none.
        stress_free: the stress-free strain, a 3 x 3 tensor; None: the scene has none.
    """

    function: fem.Function
    strain: ufl.core.expr.Expr
    volume_strain: ufl.core.expr.Expr
    projected: fem.Function | None = None
    stress_free: fem.Function | None = None


class Integral:
    """A linear form or a functional, compiled once and integrated for any fields in the place of its coefficients.

    Collective on comm.  Raises CompilationError as `compiled`.
    """

    def __init__(
        self, comm: MPI.Intracomm, form: ufl.Form, arguments: Sequence[DisplacementField | fem.Function]
    ) -> None:
        self._form, self._arguments = compiled(comm, form), [_functions(argument) for argument in arguments]

    def vector(self, *fields: DisplacementField | fem.Function) -> FloatArray:
        """The linear form for some fields, this rank's cells alone: (n,).  Local."""
        self._set(fields)
        return fem.assemble_vector(self._form).array

    def sum(self, *fields: DisplacementField | fem.Function) -> float:
        """The functional for some fields, this rank's cells alone.  Local."""
        self._set(fields)
        return float(fem.assemble_scalar(self._form))

    def _set(self, fields: Sequence[DisplacementField | fem.Function]) -> None:
        for argument, field in zip(self._arguments, fields, strict=True):
            for place, function in zip(argument, _functions(field), strict=True):
                place.x.array[:] = function.x.array


def _functions(field: DisplacementField | fem.Function) -> tuple[fem.Function, ...]:
    if not isinstance(field, DisplacementField):
        return (field,)
    return tuple(one for one in (field.function, field.projected, field.stress_free) if one is not None)
