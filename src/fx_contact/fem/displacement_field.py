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
    """A displacement and its volume strain, from `Elasticity.field`.

    Attributes:
        function: displacement, continuous across hanging facets [m].
        volume_strain: div u, projected in nearly incompressible bodies [-].
        projected: the projected volume strain; None: no body is nearly incompressible.
    """

    function: fem.Function
    volume_strain: ufl.core.expr.Expr
    projected: fem.Function | None = None

    @property
    def functions(self) -> tuple[fem.Function, ...]:
        """The Functions with the field's values.  Local."""
        return (self.function,) if self.projected is None else (self.function, self.projected)


class Integral:
    """A form compiled once and integrated for any fields.

    Collective on comm.

    Args:
        comm: the user's communicator.
        form: a linear form or a functional.
        arguments: coefficients of the form in the place of the fields, for no other use.
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
    return field.functions if isinstance(field, DisplacementField) else (field,)
