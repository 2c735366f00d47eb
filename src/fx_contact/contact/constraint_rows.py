"""The constraint operator B: sparse rows, each with a role, a direction, a gap D, an area and a stiffness.

A row belongs to a node of the first contact surface, as a nodal multiplier, and has entries at any number of nodes of
both surfaces, or of the first alone.  A `RowKind` makes the rows of a contact (`row_kinds`).  The rows of one node and
interface have the same entries and are the axes of a frame: normal n and tangents t1, t2 of a contact, x, y, z of a
tie.  Laws of the rows: `law`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.contact.enforcement import CAP, Enforcement
from fx_contact.contact.rim import Rim
from fx_contact.contact.row_entries import Entries, KeyedEntries
from fx_contact.fem.prolongation import Prolongation
from fx_contact.forest.forest import Forest
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int8Array, Int32Array, Int64Array, IntArray
from fx_contact.scene.scene import Scene


class Role(IntEnum):
    """Role of a row."""

    #: B u <= D along the normal of a contact.
    NORMAL = 0
    #: Tangent of a contact, with a law of its own.
    TANGENT = 1
    #: B u = D along an axis of a tie or of a motion.
    EQUATION = 2


@dataclass(frozen=True, eq=False)
class RowColumns:
    """Rows of one contact along one axis of their frames, each on one rank; as in `ConstraintRows`.

    Attributes:
        across: (n, 3), the sum of the surfaces' normals times areas, out of the first body; of other axes than the
            normal these axes times areas [m^2].
        role, axis: of all rows.
        yielded: number of this rank's rows that are left out for others at their nodes (`precedence`).
        rim: of contact meshed apart.
    """

    first: Int64Array
    entries: KeyedEntries
    across: FloatArray
    apart: FloatArray
    area: FloatArray
    stiffness: FloatArray
    modulus: FloatArray
    position: FloatArray
    bodies: Int32Array
    role: Role = Role.NORMAL
    axis: int = 0
    yielded: int = 0
    rim: Rim | None = None

    def along(self, direction: FloatArray, role: Role, axis: int) -> "RowColumns":
        """The rows along other unit vectors, (3,) or (n, 3), without gap.  Local."""
        across = self.area[:, None] * direction
        return replace(self, across=across, apart=np.zeros_like(self.apart), role=role, axis=axis)


class PressureCorrection(Protocol):
    """A linear correction of force over area in the rows of one contact, 0 in others."""

    def change(self) -> FloatArray:
        """(n,) [Pa].  Collective."""

    def transposed(self, weight: FloatArray) -> FloatArray:
        """Its transpose times weights (n,): (n,).  Collective."""


class RowKind(ABC):
    """The rows of a contact or tie, by its index among `Scene.interfaces`, and the geometry between their nodes."""

    SLIDES: ClassVar[bool] = False  # the gap does not depend on tangential motion, as over a plane
    #: Weight of the second side in the projection, over its modulus.
    FOLLOWED: ClassVar[float] = 1.0
    #: Parts of each side of a facet in the sampling of the least gap; 64 miss 1/4096 of the variation of a round gap.
    PARTS: ClassVar[int] = 64
    INTEGRATED: ClassVar[bool] = False  # rows hold integrals of the gap, also of what is between nodes

    def __init__(self, scene: Scene, index: int) -> None:
        self.scene, self.index, self.contact = scene, index, scene.oriented[index]

    def facets(self, forest: Forest) -> tuple[Int64Array, Int64Array]:
        """This rank's leaf facets on the first surface: (n,) leaves, (n,) local faces.  Local."""
        leaf, face = forest.contact_faces()
        ours = forest.contact_surfaces.on(self.index, 0)[forest.cell[leaf], face]
        return leaf[ours], face[ours]

    @abstractmethod
    def columns(self, prolongation: Prolongation, enforcement: Enforcement) -> RowColumns:
        """The rows.  Collective."""

    def tie_columns(self, prolongation: Prolongation, enforcement: Enforcement) -> list[RowColumns]:
        """The rows of a tie along x, y and z.  Collective."""
        columns = self.columns(prolongation, enforcement)
        return [columns.along(np.eye(3)[axis], Role.EQUATION, axis) for axis in range(3)]

    @abstractmethod
    def apart(self, forest: Forest, leaf: Int64Array, face: Int64Array, points: IntArray | FloatArray) -> FloatArray:
        """Vectors from points of the first surface to the second or the obstacle, undeformed: (n, m, 3) [m].

        Local.  Without the clearance.  By the lattice coordinates (n, m, 3) of the points on local faces (n,) of leaves
        (n,).
        """

    def apart_from(self, position: FloatArray, normal: FloatArray) -> FloatArray | None:
        """As `apart`, from positions (k, 3) [m] with normals (k, 3) of any length: (k, 3) [m].

        Local.  None: on facets `apart` has the order of the root mesh.
        """
        return None

    def covered(self, facets: LeafFacets, uv: FloatArray) -> BoolArray:
        """Places uv (k, 2) of first facets (n,) that face the second surface or the obstacle: (n, k).  Local."""
        return np.ones((len(facets), len(uv)), dtype=bool)

    def pressure_correction(self, rows: "ConstraintRows", pressure: FloatArray) -> PressureCorrection | None:
        """Correction of force over area (n,) [Pa], 0 in rows of other contacts; None: there is none.  Collective."""
        return None


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """The rows of B, each on one rank.

    Attributes:
        prolongation: B acts on its conforming unknowns; it has the nodes of all entries.
        kinds: of each contact of the scene, then of its ties.
        first: (n,), the node of each row on the first surface, position in the prolongation's index map.
        entries: B u = n . [u].
        normal: (n, 3), direction n of the row: from the first body to the second, the mean of both surfaces' unit
            normals, or another axis of the frame.
        apart: (n, 3), vector from the first side to the second with the weights of the row, undeformed, and the
            clearance along the normal; 0 in other directions than the normal [m].
        gap: (n,), D, initial distance along the normal on the true curved geometry, and the clearance [m].
        area: (n,), tributary area [m^2].
        node_area: (n,), sum of the areas of all rows with the same `first` [m^2].
        stiffness: (n,), k_N, in exact contact that in the preconditioner matrix [N/m].
        modulus: (n, 2), E/(1 - nu^2) of the first and the second side, inf of an obstacle [Pa].
        position: (n, 3), undeformed position on the first surface, at rims the centre of the force [m].
        bodies: (n, 2), first and second body, positions in the root mesh's `bodies`; -1: an obstacle.
        contact: (n,), index of the contact or tie among `Scene.interfaces`, ascending.
        role: (n,), `Role` of each row.
        axis: (n,), number of the axis in the frame: n, t1, t2 of a contact, x, y, z of a tie.
        symmetry: number of copies of the modelled part in the bodies.
        yielded: as of `RowColumns`, of all kinds.
        rims: of contacts meshed apart, by their indices.
    """

    prolongation: Prolongation
    kinds: tuple[RowKind, ...]
    first: Int64Array
    entries: Entries
    normal: FloatArray
    apart: FloatArray
    gap: FloatArray
    area: FloatArray
    node_area: FloatArray
    stiffness: FloatArray
    modulus: FloatArray
    position: FloatArray
    bodies: Int32Array
    contact: Int32Array
    role: Int8Array
    axis: Int8Array
    symmetry: int
    yielded: int = 0
    rims: dict[int, Rim] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.first)

    def part(self, role: Role) -> "ConstraintRows":
        """The rows of a role, and the kinds of ties or of contacts.  Local."""
        kinds = tuple(kind for kind in self.kinds if kind.contact.EQUALITY == (role == Role.EQUATION))
        some = self.role == role
        if len(kinds) == len(self.kinds) and some.all():
            return self
        return replace(self.taken(np.flatnonzero(some)), kinds=kinds)

    def taken(self, rows: IntArray) -> "ConstraintRows":
        """Some of the rows (m,) by number, in this order, perhaps more than once.  Local."""
        entries, count = self.entries, np.bincount(self.entries.row, minlength=len(self))
        first, each = np.cumsum(count) - count, count[rows]
        start = np.cumsum(each) - each
        some = np.arange(each.sum()) + np.repeat(first[rows] - start, each)
        row = np.repeat(np.arange(len(rows)), each)
        kept = Entries(row, entries.node[some], entries.side[some], entries.weight[some])
        return replace(self, entries=kept, **{name: getattr(self, name)[rows] for name in _OF_ROWS})

    @cached_property
    def values(self) -> FloatArray:
        """The 1 x 3 blocks of B at the entries: (b, 3) [-].  Local."""
        return self.entries.weight[:, None] * self.normal[self.entries.row]

    @property
    def key(self) -> Int64Array:
        """(n,), unique number of each row, on all ranks.  Local."""
        node: Int64Array = self.prolongation.index_map.local_to_global(self.first.astype(np.int32))
        return node << 32 | self.contact << 2 | self.axis

    @property
    def node_keys(self) -> Int64Array:
        """(n,), lattice key of each row's node on the first surface, the same on any number of ranks.  Local."""
        return self.prolongation.keys[self.first]

    @property
    def penalty_factor(self) -> FloatArray:
        """(n,), c of k_N = c E* A^(1/2), A the area of the node, 1/E* the sum of 1/modulus [-].  Local."""
        compliance = np.asarray((1 / self.modulus).sum(axis=1))
        return self.stiffness * compliance * np.sqrt(self.node_area) / self.area

    @property
    def capped_stiffness(self) -> FloatArray:
        """(n,), k_N in the preconditioner matrix, at most that of the factor `CAP` [N/m].  Local."""
        factor = self.penalty_factor
        return self.stiffness * np.where(factor > CAP, CAP / factor, 1.0)

    def couplings(self) -> csr_matrix:
        """Pairs of conforming nodes in one row: (owned + ghosts, owned + ghosts) bool.  Local."""
        row, node = self.entries.row, self.entries.node
        shape = len(self), len(self.prolongation.zeros(0))
        touched = csr_matrix((np.ones(len(row), dtype=bool), (row, node)), shape=shape)
        return touched.T @ touched

    def closing(self, u: FloatArray) -> FloatArray:
        """The jump [u], the displacement of the first side less that of the second: (n, 3) [m].

        Collective.  Displacements are relative to that of `first`: common motions make no rounding.

        Args:
            u: (owned, 3), conforming displacement [m].
        """
        u, entries = self.prolongation.ghosted(u), self.entries
        common, result = u[self.first], np.zeros((len(self), 3))
        np.add.at(result, entries.row, entries.weight[:, None] * (u[entries.node] - common[entries.row]))
        return result + entries.sums(entries.weight, len(self))[:, None] * common

    def jump(self, u: FloatArray) -> FloatArray:
        """B u, the approach of the bodies: (n,) [m].  Collective; as `closing`."""
        return np.asarray(np.einsum("ni,ni->n", self.normal, self.closing(u)))

    def penetration(self, u: FloatArray) -> FloatArray:
        """B u - D, positive where the bodies penetrate: (n,) [m].  Collective; as `closing`."""
        return self.jump(u) - self.gap

    def transposed(self, force: FloatArray) -> FloatArray:
        """B^T f of forces (n,), at the conforming nodes: (owned, 3) [N].  Collective."""
        return self.prolongation.sums_at(self.entries.node, force[self.entries.row][:, None] * self.values)

    def sliding(self, u: FloatArray) -> FloatArray:
        """Tangential distance of the sides, deformed, 0 in rows that slide: (n,) [m].  Collective; as `closing`."""
        apart = self.separation(u)
        tangential = apart - np.einsum("ni,ni->n", apart, self.normal)[:, None] * self.normal
        slides = np.array([kind.SLIDES for kind in self.kinds])
        return np.where(slides[self.contact], 0.0, np.linalg.norm(tangential, axis=1))

    def separation(self, u: FloatArray) -> FloatArray:
        """From the first side to the second, deformed: (n, 3) [m].  Collective; as `closing`."""
        return self.apart - self.closing(u)

    @property
    def remote(self) -> int:
        """Number of all ranks' rows with nodes of other ranks.  Collective."""
        away = self.entries.node >= self.prolongation.owned
        return int(self.prolongation.comm.allreduce(len(np.unique(self.entries.row[away]))))

    def at_nodes(self, contact: int, values: FloatArray) -> FloatArray:
        """Values (n, k) of the rows of one contact, by its index, at this rank's nodes: (m, k).  Collective."""
        ours, nodal = self.contact == contact, self.prolongation.zeros(values.shape[1])
        nodal[self.first[ours]] = values[ours]
        return self.prolongation.prolong(self.prolongation.summed(nodal))

    def pressure(self, force: FloatArray) -> FloatArray:
        """Contact pressure (n,) [Pa] of forces (n,) [N]: force over area, corrected by the kinds.  Collective."""
        return force / self.area + sum(correction.change() for correction in self._pressure_corrections(force))

    def pressure_weights(self, force: FloatArray, weight: FloatArray) -> FloatArray:
        """The functional d (n,) of the forces f (n,) [N] with d . f = w . p, for weights w (n,) of the pressures p.

        Collective.  Corrections are limited as at f.
        """
        corrections = self._pressure_corrections(force)
        return (weight + sum(correction.transposed(weight) for correction in corrections)) / self.area

    def _pressure_corrections(self, force: FloatArray) -> list[PressureCorrection]:
        ours = ((kind, np.where(self.contact == kind.index, force / self.area, 0.0)) for kind in self.kinds)
        corrections = [kind.pressure_correction(self, pressure) for kind, pressure in ours]
        return [correction for correction in corrections if correction is not None]

    def force_and_approach(self, force: FloatArray, group: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Normal force F of groups of rows, and the approach F / (E* A^(1/2)) of a flat punch of their pressed area A.

        Collective.  By forces (n,) [N] and group numbers (n,) below `count` of the rows.

        Returns:
            two (count,): F of the modelled part [N], and the approach of the bodies [m].
        """
        presses = force > 0
        columns = force, self.area, self.area * (1 / self.modulus).sum(axis=1)
        sums = np.stack([np.bincount(group[presses], column[presses], count) for column in columns]).astype(float)
        self.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        total, area, compliance = sums
        approach = np.divide(total * compliance, area**1.5, out=np.zeros(count), where=area > 0)
        return total, np.sqrt(self.symmetry) * approach

    def force_components(self, force: FloatArray) -> FloatArray:
        """Components (n,) [N] of normal forces (n,) along the direction of their contact, if it has one.  Local."""
        result = force.copy()
        for kind in self.kinds:
            direction = kind.contact.unit_direction
            if direction is not None:
                ours = self.contact == kind.index
                result[ours] *= self.normal[ours] @ direction
        return result


#: Columns of `ConstraintRows` with an entry for each row.
_OF_ROWS = "first normal apart gap area node_area stiffness modulus position bodies contact role axis".split()
