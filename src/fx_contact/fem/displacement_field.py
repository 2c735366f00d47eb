"""Displacement fields, and integrals over the cells of a mesh that depend on them."""

from collections.abc import Sequence
from dataclasses import dataclass

import ufl
from dolfinx import fem
from mpi4py import MPI

from fx_contact.fem.compilation import compiled
from fx_contact.parallel.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """A displacement [m], continuous across hanging facets, and its volume strain [-], from `Elasticity.field`.

    Of nearly incompressible bodies the volume strain is `projected`; None: there are none.
    """

    function: fem.Function
    volume_strain: ufl.core.expr.Expr
    projected: fem.Function | None = None


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
    return (field.function,) if field.projected is None else (field.function, field.projected)
