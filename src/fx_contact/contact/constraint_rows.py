"""The constraint operator B: sparse rows, each with a gap D, an area and a stiffness.  Contact is B u <= D.

A row belongs to a node of the first contact surface, as a nodal multiplier does, and may have entries at any number of
nodes of both surfaces, or of the first alone.  Each contact of a scene has a `RowKind` that makes its rows
(`row_kinds`); everything else asks the rows.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.contact.contact_facets import facets_of
from fx_contact.contact.enforcement import CAP, Enforcement
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.problem.scene import Scene

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Blocks:
    """The entries of rows as blocks of 1 x 3, row by row.

    Attributes:
        row: (b,) int64, local number of the row, ascending.
        node: (b,) int64, position in the prolongation's index map.
        side: (b,) int64, 0 where the node is on the first surface, 1 on the second.
        values: (b, 3) float64 [-].
    """

    row: np.ndarray
    node: np.ndarray
    side: np.ndarray
    values: np.ndarray

    def sums(self, values, count):
        """Sums of (b,) float64 values over the blocks of each of `count` rows: (count,) float64.  Local."""
        return np.bincount(self.row, values, count).astype(float)


@dataclass(frozen=True, eq=False)
class Entries:
    """The jump of the displacement that each row takes: sum of weight times displacement of its nodes, row by row.

    Attributes:
        row: (b,) int64, local number of the row, ascending.
        node: (b,) int64, position in the prolongation's index map.
        side: (b,) int64, 0 where the node is on the first surface, 1 on the second.
        weight: (b,) float64, of a row 1 in all on the first surface, and -1 on the second, if there is one [-].
    """

    row: Ints
    node: Ints
    side: Ints
    weight: Floats


@dataclass(frozen=True, eq=False)
class RowColumns:
    """Rows of one contact on this rank, as its kind makes them; each row on one rank.

    Attributes:
        first, apart, area, stiffness, position, bodies: as in `ConstraintRows`.
        entries: Entries.
        across: (n, 3), the sum of the surfaces' normals times areas, out of the first body [m^2].
    """

    first: Ints
    entries: Entries
    across: Floats
    apart: Floats
    area: Floats
    stiffness: Floats
    position: Floats
    bodies: npt.NDArray[np.int32]


class PressureCorrection(Protocol):
    """A linear correction of force over area in the rows of one contact."""

    def change(self) -> Floats:
        """What is added to the pressures, 0 in rows of other contacts: (n,) [Pa].  Collective."""

    def transposed(self, weight: Floats) -> Floats:
        """Transpose of the correction as a map of pressures, of weights (n,): (n,).  Collective."""


class RowKind(ABC):
    """The rows of a contact of one type, and its geometry between their nodes.

    Args:
        scene: Scene.
        index: of the contact in the scene.
    """

    def __init__(self, scene: Scene, index: int) -> None:
        self.scene, self.index, self.contact = scene, index, scene.contact[index]

    def facets(self, forest: Forest) -> tuple[Ints, Ints]:
        """This rank's leaf facets on the first surface: (n,) leaves, (n,) local faces.  Local."""
        return facets_of(self.index, forest)

    def needed(self, space: Space) -> Ints:
        """Keys of nodes that rows made on this rank will need, beside those of its leaves: (k,).  Collective."""
        return np.empty(0, dtype=np.int64)

    @abstractmethod
    def columns(self, prolongation: Prolongation, enforcement: Enforcement) -> RowColumns:
        """The rows, with the stiffness of the enforcement's springs.  Collective."""

    @abstractmethod
    def apart(self, forest: Forest, leaf: Ints, face: Ints, points: npt.NDArray) -> Floats:
        """Vectors from points of the first surface to the second surface or the obstacle, undeformed.

        Local.  Along the normal they are the initial gap.

        Args:
            leaf, face: (n,) leaves and their local faces on the first surface.
            points: (n, m, 3) int32, lattice coordinates on those faces; float64 between lattice points.

        Returns:
            (n, m, 3) [m].
        """

    def pressure_correction(self, rows: "ConstraintRows", pressure: Floats) -> PressureCorrection | None:
        """Correction of force over area; None: there is none.

        Collective.

        Args:
            pressure: (n,), force over area, 0 in rows of other contacts [Pa].
        """
        return None


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """The rows of B that this rank holds, each row on one rank.

    Attributes:
        prolongation: Prolongation, on whose conforming unknowns B acts.
        kinds: RowKind of each contact of the scene.
        first: (n,) int64, the node of each row on the first surface, position in the prolongation's index map.
        entries: Entries: B u is their jump along the normal.
        normal: (n, 3) float64, unit direction from the first body to the second, the mean of both surfaces' normals.
        apart: (n, 3) float64, from the first side to the second, weighed as the row weighs, undeformed [m].
        gap: (n,) float64, D, initial distance along the normal on the true curved geometry [m].
        area: (n,) float64, tributary area [m^2].
        node_area: (n,) float64, sum of the areas of all rows with the same `first` [m^2].
        stiffness: (n,) float64, k_N, in exact contact that in the preconditioner matrix [N/m].
        modulus: (n, 2) float64, E/(1 - nu^2) of the first and the second body, inf of an obstacle [Pa].
        position: (n, 3) float64, undeformed position on the first surface [m].
        bodies: (n, 2) int32, first and second body, positions in the root mesh's `bodies`; -1: an obstacle.
        contact: (n,) int32, the contact of the scene that each row belongs to.
        symmetry: int, copies of the modelled part that make the whole.
    """

    prolongation: Prolongation
    kinds: tuple[RowKind, ...]
    first: Ints
    entries: Entries
    normal: Floats
    apart: Floats
    gap: Floats
    area: Floats
    node_area: Floats
    stiffness: Floats
    modulus: Floats
    position: Floats
    bodies: npt.NDArray[np.int32]
    contact: npt.NDArray[np.int32]
    symmetry: int

    def __len__(self) -> int:
        return len(self.first)

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of B: u = t on the first surface and 0 on the second gives B u = n . t.  Local."""
        entries = self.entries
        values = entries.weight[:, None] * self.normal[entries.row]
        return Blocks(entries.row, entries.node, entries.side, values)

    @property
    def key(self):
        """(n,) int64, number of each row, another for all rows of all ranks.  Local."""
        node = self.prolongation.index_map.local_to_global(self.first.astype(np.int32))
        return node << 32 | self.contact

    @property
    def node_keys(self):
        """(n,) int64, lattice key of each row's node on the first surface, the same on any number of ranks.  Local."""
        prolongation, keys = self.prolongation, self.prolongation.space.keys
        named = np.empty(len(prolongation.zeros(1)), dtype=np.int64)
        conforming = prolongation.conforming >= 0
        named[prolongation.conforming[conforming]] = keys[conforming]
        return named[self.first]

    @property
    def penalty_factor(self):
        """(n,) float64, c of k_N = c E* A^(1/2), A the node's area, 1/E* the sum of 1/modulus [-].  Local.

        Of a node with several rows c is that of all of them, for they share its k_N by their areas.
        """
        return self.stiffness * (1 / self.modulus).sum(axis=1) * np.sqrt(self.node_area) / self.area

    @property
    def capped_stiffness(self):
        """(n,) float64, k_N in the preconditioner matrix, at most that of the factor `CAP` [N/m].  Local."""
        factor = self.penalty_factor
        return self.stiffness * np.where(factor > CAP, CAP / factor, 1.0)

    def couplings(self):
        """Which conforming nodes a row couples: (owned + ghosts, owned + ghosts) scipy CSR bool.  Local."""
        imap, blocks = self.prolongation.index_map, self.blocks
        shape = len(self), imap.size_local + imap.num_ghosts
        touched = csr_matrix((np.ones(len(blocks.row), dtype=bool), (blocks.row, blocks.node)), shape=shape)
        return touched.T @ touched

    def jump(self, u):
        """B u, how far the bodies move towards each other.

        Collective.  The displacement of `first` is taken off first, so that long ways of both bodies are no rounding.

        Args:
            u: (owned, 3) float64, conforming displacement [m].

        Returns:
            (n,) float64 [m].
        """
        u, blocks, n = self.prolongation.ghosted(u), self.blocks, len(self)
        common = u[self.first]
        relative = np.einsum("bi,bi->b", blocks.values, u[blocks.node] - common[blocks.row])
        of_common = np.stack([blocks.sums(column, n) for column in blocks.values.T], axis=1)
        return blocks.sums(relative, n) + np.einsum("ni,ni->n", of_common, common)

    def penetration(self, u):
        """B u - D, positive where the bodies penetrate.  Collective; as `jump`."""
        return self.jump(u) - self.gap

    def transposed(self, force):
        """B^T f.

        Collective.

        Args:
            force: (n,) float64 [N].

        Returns:
            (owned, 3) float64, forces on the conforming nodes that it balances [N].
        """
        blocks, sums = self.blocks, self.prolongation.zeros(3)
        np.add.at(sums, blocks.node, force[blocks.row][:, None] * blocks.values)
        return self.prolongation.summed(sums)

    def closing(self, u: Floats) -> Floats:
        """Displacement of the first side less that of the second.

        Collective.  As in `jump`, that of `first` is taken off first.

        Args:
            u: (owned, 3), conforming displacement [m].

        Returns:
            (n, 3) [m]; B u along the normal.
        """
        u, entries = self.prolongation.ghosted(u), self.entries
        common, result = u[self.first], np.zeros((len(self), 3))
        np.add.at(result, entries.row, entries.weight[:, None] * (u[entries.node] - common[entries.row]))
        return result + np.bincount(entries.row, entries.weight, len(self))[:, None] * common

    def separation(self, u: Floats) -> Floats:
        """From the first side to the second, deformed: (n, 3) [m].  Collective; as `closing`."""
        return self.apart - self.closing(u)

    def pressure(self, force: Floats) -> Floats:
        """The contact pressure at the nodes of the rows: force over area, corrected as their kinds do.

        Collective.

        Args:
            force: (n,), compression positive [N].

        Returns:
            (n,) [Pa].
        """
        return force / self.area + sum(correction.change() for correction in self._pressure_corrections(force))

    def pressure_weights(self, force: Floats, weight: Floats) -> Floats:
        """The linear functional d of the forces that is a weighted sum of the pressures, w . p = d . f.

        Collective.  Limited corrections keep the limits that they have at these forces.

        Args:
            force: (n,), f [N].
            weight: (n,), w.

        Returns:
            (n,), d.
        """
        corrections = self._pressure_corrections(force)
        return (weight + sum(correction.transposed(weight) for correction in corrections)) / self.area

    def _pressure_corrections(self, force: Floats) -> list[PressureCorrection]:
        ours = ((kind, np.where(self.contact == kind.index, force / self.area, 0.0)) for kind in self.kinds)
        corrections = [kind.pressure_correction(self, pressure) for kind, pressure in ours]
        return [correction for correction in corrections if correction is not None]

    def pressing(self, force, group, count):
        """Force of groups of rows, and about the approach of the bodies that it takes.

        Collective.

        Args:
            force: (n,) float64, compression positive [N].
            group: (n,) int, the group of each row that presses, as `contact`.
            count: number of groups on all ranks.

        Returns:
            two (count,) float64: F of the modelled part [N], and F / (E* A^(1/2)) of the whole, A the area under
            pressure, as of a punch on a half-space [m].
        """
        presses = force > 0
        columns = force, self.area, self.area * (1 / self.modulus).sum(axis=1)
        sums = np.stack([np.bincount(group[presses], column[presses], count) for column in columns]).astype(float)
        self.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        total, area, compliance = sums
        approach = np.divide(total * compliance, area**1.5, out=np.zeros(count), where=area > 0)
        return total, np.sqrt(self.symmetry) * approach

    def at_first(self, values):
        """Sums over all rows with the same `first`, of whichever contact pair and rank.

        Collective.

        Args:
            values: (n, k) float64.

        Returns:
            (n, k) float64.
        """
        sums = self.prolongation.zeros(values.shape[1])
        np.add.at(sums, self.first, values)
        return self.prolongation.ghosted(self.prolongation.summed(sums))[self.first]


def force_components(scene, rows, force):
    """What forces of rows add to the force of their contact pair: along its direction, else all of them.

    Local.

    Args:
        scene: Scene.
        rows: ConstraintRows.
        force: (n,) float64, along the normals [N].

    Returns:
        (n,) float64 [N].
    """
    result = force.copy()
    for index, direction in enumerate(pair.unit_direction for pair in scene.contact):
        if direction is not None:
            ours = rows.contact == index
            result[ours] *= rows.normal[ours] @ direction
    return result


def loose_bodies(scene, rows, active):
    """Bodies that neither the displacement conditions nor the active rows hold.

    Collective.

    Args:
        scene: Scene.
        rows: ConstraintRows.
        active: (n,) bool.

    Returns:
        list of str, names of the bodies; the same on all ranks.
    """
    if not len(scene.rigid_motions.free):
        return []
    first, second = (
        scene.rigid_motions.free_along(rows.position[active], rows.bodies[active, i], rows.normal[active])
        for i in (0, 1)
    )
    resistance = (first - second).T @ (first - second)
    rows.prolongation.comm.Allreduce(MPI.IN_PLACE, resistance)
    return scene.rigid_motions.unresisted(resistance)
