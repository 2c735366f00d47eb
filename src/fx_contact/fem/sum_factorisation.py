"""P^T K P at degree 2 without its entries: cell by cell, by sum factorisation.

With the Gauss points x_q of a cell, its geometry G_q = |J|^(1/2) J^(-T), and the elastic moduli C,

    K u = sum_q grad^T G_q^T w_q C G_q grad u(x_q).

Interpolation to x_q, the reference gradient, and their transposes are products with 3 x 3 matrices along each axis.
One G is kept of a cell with an affine map.  `_LANES` cells are done at once, in the registers of the processor.
Source: M. Kronbichler, K. Kormann, Computers & Fluids 63, 2012.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csr_matrix

from fx_contact.fem.cell_stiffness import CellStiffness, parts
from fx_contact.fem.elasticity import Elasticity, Rows
from fx_contact.fem.supports import Supports
from fx_contact.fem.volume_term import VolumeTerm
from fx_contact.geometry import hexahedron
from fx_contact.items.materials import TENSOR
from fx_contact.linalg.matrix import BlockMatrix, CellOperator, add_blocks, create_matrix, with_operator
from fx_contact.linalg.stopping import EnergyNorm
from fx_contact.parallel.arrays import FloatArray, Int32Array, IntArray
from fx_contact.parallel.compilation import library
from fx_contact.parallel.memory import check_memory, give_back

#: Cells that are done at once: numbers in a vector register of today's processors.
_LANES = 4
#: Relative variation of G in a cell up to which its map counts as affine: rounding.
_AFFINE = 1e-14

_Scalar = TypeVar("_Scalar", bound=np.generic)


def matrix_free(
    elasticity: Elasticity, rows: Rows | None = None, mixed: bool = False, supports: Supports | None = None
) -> BlockMatrix:
    """As `Elasticity.stiffness` at degree 2, with entries for contact rows and oblique planes alone.

    Collective on the mesh's communicator.

    Raises:
        SolveError: there is not enough memory.
        CompilationError: as `library`.
    """
    prolongation = elasticity.prolongation
    imap, comm = prolongation.index_map, prolongation.comm
    supports = supports or Supports(np.full((prolongation.owned, 3), np.nan))
    size = imap.size_local + imap.num_ghosts
    graph = csr_matrix((size, size), dtype=bool) if rows is None else rows.couplings()
    on_planes = supports.oblique_nodes
    graph = graph + csr_matrix((np.ones(len(on_planes), dtype=bool), (on_planes, on_planes)), (size, size))
    what = f"the stiffness of {3 * imap.size_global:,} unknowns"
    needed = 3 * 8 * 9 * 27 * len(elasticity.cells)  # the metric, thrice while cells are sorted
    check_memory(comm, what, needed, "ask for a larger tolerance, or use more hosts")
    entries = create_matrix(comm, graph, imap)
    if len(on_planes):
        room = np.zeros((len(on_planes), 3, 3)), np.arange(len(on_planes)), np.arange(len(on_planes) + 1)
        add_blocks(entries.mat, bsr_matrix(room), prolongation.numbers[on_planes])
    operator = CellwiseStiffness(elasticity, mixed, supports, lambda: elasticity.stiffness(rows, mixed, supports))
    give_back()
    return replace(with_operator(operator, entries), held=operator.held)


def energy_norm(elasticity: Elasticity, matrix: BlockMatrix, volume: VolumeTerm | None) -> EnergyNorm:
    """omega (4) of displacements by a matrix and the term beside it, or by an integral.  Local, the result not."""
    operator = matrix.operator
    if operator is None:
        return elasticity.energy_norm

    def of(u: FloatArray) -> float:
        """omega of (owned, 3) [m]: [J^(1/2)].  Collective on matrix.comm."""
        beside = 0.0 if volume is None else float(volume.missing @ volume.strains(u) ** 2)
        return float(np.sqrt(max(matrix.comm.allreduce(operator.energy(u) + beside), 0.0)))

    return of


class CellwiseStiffness(CellOperator):
    """P^T K P with springs on the displacements that supports leave free; its diagonal in the other directions.

    Collective on the mesh's communicator.  Values stand at the places of `Prolongation.index_map`, then at this
    rank's hanging nodes.

    Attributes:
        held: (owned, 3), forces of prescribed displacements [N].
    """

    def __init__(
        self, elasticity: Elasticity, mixed: bool, supports: Supports, entire: Callable[[], BlockMatrix]
    ) -> None:
        self._prolongation, self._supports, self._entire = elasticity.prolongation, supports, entire
        prolongation, hanging = self._prolongation, np.flatnonzero(self._prolongation.hanging)
        self._size = prolongation.index_map.size_local + prolongation.index_map.num_ghosts
        place = prolongation.conforming.copy()
        place[hanging] = self._size + np.arange(len(hanging), dtype=np.int32)
        weights = prolongation.matrix[hanging]
        self._masters = np.unique(weights.indices)
        self._weights = weights[:, self._masters]
        self._transposed = self._weights.T.tocsr()
        kernel = elasticity.cell_stiffness(mixed)
        self._compiled = library(prolongation.comm, _source(kernel))
        self._compiled.add_product.restype = ctypes.c_double
        self._cells = _sorted_cells(kernel, place[elasticity.cells])
        size, springs = self._size + len(hanging), elasticity.springs
        self._values, self._springs = np.zeros((size, 3)), None if springs is None else springs.matrix(place, size)
        self.held = self._product(supports.values)
        self._fixed = np.flatnonzero(~supports.free.ravel())
        self._kept = self.diagonal().ravel()[self._fixed]

    def add_product(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_product`."""
        free = self._supports.tangential(u).copy()
        free.ravel()[self._fixed] = 0.0
        forces = self._supports.tangential(self._product(free))
        forces.ravel()[self._fixed] = self._kept * u.ravel()[self._fixed]
        y += forces

    def energy(self, u: FloatArray) -> float:
        """As `CellOperator.energy`."""
        values = self._prolonged(u)
        springs = 0.0 if self._springs is None else float(values.ravel() @ (self._springs @ values.ravel()))
        of_cells = (self._compiled.add_product(*some.arguments, _address(values), None) for some in self._cells)
        return sum(of_cells, springs)

    def _prolonged(self, u: FloatArray) -> FloatArray:
        values, size = self._values, self._size
        values[:size] = self._prolongation.ghosted(u)
        values[size:] = self._weights @ values[self._masters]
        return values

    def _product(self, u: FloatArray) -> FloatArray:
        """P^T K P of (owned, 3)."""
        values, size, sums = self._prolonged(u), self._size, np.zeros_like(self._values)
        if self._springs is not None:
            sums += (self._springs @ values.ravel()).reshape(-1, 3)
        for some in self._cells:
            self._compiled.add_product(*some.arguments, _address(values), _address(sums))
        sums[self._masters] += self._transposed @ sums[size:]
        return self._prolongation.summed(sums[:size])

    def diagonal(self) -> FloatArray:
        """As `Operator.diagonal`."""
        return np.einsum("nii->ni", self.blocks())

    def blocks(self) -> FloatArray:
        """As `CellOperator.blocks`: of hanging nodes by the squares of their weights."""
        blocks = np.zeros((len(self._values), 9))
        for some in self._cells:
            self._compiled.add_diagonal(*some.arguments, _address(blocks))
        if self._springs is not None:
            for i, j in np.ndindex(3, 3):
                blocks[:, 3 * i + j] += self._springs[i::3, j::3].diagonal()
        blocks[self._masters] += self._transposed.power(2) @ blocks[self._size :]
        cells = self._prolongation.summed(blocks[: self._size]).reshape(-1, 1, 1, 3, 3)
        self._supports.eliminate(cells, np.arange(len(cells))[:, None])
        return cells[:, 0, 0]

    def assembled(self) -> BlockMatrix:
        """As `CellOperator.assembled`."""
        return self._entire()


@dataclass(frozen=True, eq=False)
class _Cells:
    """Groups of `_LANES` cells of one material, all affine or all curved; the last is filled up with empty cells.

    Attributes:
        nodes: (groups, 27, lanes) int32, places of the nodes.
        law: (6, 6), moduli [Pa].
        metric: (groups, points, 9, lanes), of one point or 27 [m^(1/2)].
        polynomials: (groups, 27, 4, lanes), times (w lambda)^(1/2); None: no volume strain is projected.
    """

    nodes: Int32Array
    law: FloatArray
    metric: FloatArray
    polynomials: FloatArray | None

    @property
    def arguments(self) -> tuple[object, ...]:
        """Arguments of the functions in C."""
        count, points = ctypes.c_int64(len(self.nodes)), ctypes.c_int(self.metric.shape[1])
        nodes, law = _address(self.nodes), _address(self.law)
        return count, nodes, law, points, _address(self.metric), _address(self.polynomials)


def _sorted_cells(kernel: CellStiffness, places: Int32Array) -> list[_Cells]:
    """Cells with nodes at places (ncells, 27), by material and affine or curved map."""
    found: dict[tuple[int, bool], list[tuple[IntArray, FloatArray]]] = {}
    for part in parts(np.arange(len(places)), 9 * 27):
        metric = kernel.metric(part).reshape(-1, 27, 9)
        apart, size = np.abs(metric - metric[:, :1]).max(axis=(1, 2)), np.abs(metric).max(axis=(1, 2))
        kinds = np.stack([kernel.material[part], apart <= _AFFINE * size], axis=1)
        for material, affine in np.unique(kinds, axis=0):
            some = (kinds == (material, affine)).all(axis=1)
            piece = part[some], metric[some, : 1 if affine else None]
            found.setdefault((material, affine), []).append(piece)
    return [_grouped(kernel, places, *map(np.concatenate, zip(*pieces))) for pieces in found.values()]


def _grouped(kernel: CellStiffness, places: Int32Array, cells: IntArray, metric: FloatArray) -> _Cells:
    polynomials = None
    if kernel.projected(cells).any():
        scale = np.sqrt(kernel.weights[:, None] * kernel.volume[cells, None, None])
        at_points = np.broadcast_to(metric, (len(cells), 27, 9)).reshape(-1, 27, 3, 3)
        polynomials = _in_lanes(kernel.polynomials(at_points) * scale)
    law = np.ascontiguousarray(kernel.moduli[kernel.material[cells[0]]])
    return _Cells(_in_lanes(places[cells]), law, _in_lanes(metric), polynomials)


def _in_lanes(values: npt.NDArray[_Scalar]) -> npt.NDArray[_Scalar]:
    """Values (n, ...) of cells by groups: (groups, ..., lanes), filled up with zeros."""
    groups = -(-len(values) // _LANES)
    filled = np.zeros((groups * _LANES, *values.shape[1:]), values.dtype)
    filled[: len(values)] = values
    return np.ascontiguousarray(np.moveaxis(filled.reshape(groups, _LANES, *values.shape[1:]), 1, -1))


def _source(kernel: CellStiffness) -> str:
    """The program in C with its tables."""
    value = hexahedron.lagrange(2, kernel.points)
    slope = hexahedron.lagrange_derivative(2, kernel.points) @ np.linalg.inv(value)
    tables = {"value": value, "value_back": value.T, "slope": slope, "slope_back": slope.T}
    tables |= {"weight": kernel.weights, "gradient": kernel.slopes}
    lines = [_table("int", "six", np.array(TENSOR))]
    lines += [_table("double", name, values) for name, values in tables.items()]
    return "\n".join([*lines, Path(__file__).with_suffix(".c").read_text()])


def _table(kind: str, name: str, values: FloatArray | IntArray) -> str:
    entries = str(values.tolist()).replace("[", "{").replace("]", "}")
    return f"static const {kind} {name}{''.join(f'[{n}]' for n in values.shape)} = {entries};"


def _address(values: FloatArray | Int32Array | None) -> ctypes.c_void_p:
    return ctypes.c_void_p(None if values is None else values.ctypes.data)
