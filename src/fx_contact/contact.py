"""Node-to-node contact B, assembled facet pair by facet pair: gaps, stiffnesses, forces and pressures.

Each pair of facing leaf facets is a super-element of four node pairs that share its area as a uniform pressure would be
shared.  What would fall to a hanging node pair goes to its masters, so that the contact status belongs to conforming
pairs only and the total area is kept.  A pair lives on the rank that owns both its vertices: B^T B needs no message
(section 3 of the paper).
"""

from dataclasses import dataclass
from numbers import Real

import numpy as np
from dolfinx.la import InsertMode, vector
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact import reference
from fx_contact._mpi import Directory
from fx_contact.errors import SceneError
from fx_contact.lattice import SIDE


@dataclass(frozen=True)
class Penalty:
    """How hard a penetration is resisted.

    Attributes:
        factor: c of the surface stiffness c E*/h [-], consistent under refinement, h the size of the facet.
        node_stiffness: k_N [N/m], the same for every node pair as in equation (1); used instead of the factor if given.

    Raises:
        SceneError: a value that is not positive.
    """

    factor: float = 100.0
    node_stiffness: float | None = None

    def __post_init__(self):
        for name in ("factor", "node_stiffness"):
            value = getattr(self, name)
            if name == "node_stiffness" and value is None:
                continue
            if not isinstance(value, Real) or not (np.isfinite(value) and value > 0):
                raise SceneError(f"the penalty {name} must be a positive number, got {value!r}")


@dataclass(frozen=True, eq=False)
class NodePairs:
    """The contact pairs of conforming vertices that this rank holds, each pair on one rank.

    Attributes:
        prolongation: Prolongation whose conforming vertices are paired.
        first, second: (n,) int64, positions in its index map.
        normal: (n, 3) float64, unit direction from the first body to the second.
        gap: (n,) float64, initial distance D along it on the true curved geometry [m].
        area: (n,) float64, tributary area [m^2].
        stiffness: (n,) float64, k_N [N/m].
        position: (n, 3) float64, undeformed position on the first surface [m].
        bodies: (n, 2) int32, first and second body, positions in the root mesh's `bodies`.
    """

    prolongation: object
    first: np.ndarray
    second: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    area: np.ndarray
    stiffness: np.ndarray
    position: np.ndarray
    bodies: np.ndarray

    def __len__(self):
        return len(self.first)

    def penetration(self, u):
        """B u - D at each pair, positive where the bodies overlap.

        Collective.

        Args:
            u: (owned, 3) float64, conforming displacement [m].

        Returns:
            (n,) float64 [m].
        """
        u = self.prolongation.ghosted(u)
        return np.einsum("ni,ni->n", self.normal, u[self.first] - u[self.second]) - self.gap


def node_pairs(scene, forest, prolongation, penalty):
    """Find the conforming node pairs of a forest.

    Collective on forest.comm.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.
        penalty: Penalty.

    Returns:
        NodePairs, one block a contact pair of the scene.
    """
    blocks = [_pairs_of(index, scene, forest, prolongation, penalty) for index in range(len(scene.contact))]
    return NodePairs(prolongation, *(np.concatenate(column) for column in zip(*blocks)))


def loose_bodies(scene, pairs, active):
    """Bodies that neither the displacement conditions nor the active pairs hold.

    Collective.

    Args:
        scene: Scene.
        pairs: NodePairs.
        active: (n,) bool.

    Returns:
        list of str, names of the bodies; the same on all ranks.
    """
    if not len(scene.free_motions):
        return []
    first, second = (
        scene.motion(pairs.position[active], pairs.bodies[active, i], pairs.normal[active]) for i in (0, 1)
    )
    resistance = (first - second).T @ (first - second)
    pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, resistance)
    return scene.unresisted(resistance)


def _pairs_of(index, scene, forest, prolongation, penalty):
    """Columns of NodePairs, after the prolongation, for one contact pair of the scene."""
    vertices, pairing = forest.vertices, forest.pairing
    leaf, face = forest.contact_faces()
    ours = pairing.first[forest.cell[leaf], face] & (pairing.pair[forest.cell[leaf], face] == index)
    leaf, face = leaf[ours], face[ours]
    corner = reference.FACE_CORNERS[face]
    vertex = vertices.cells[leaf[:, None], corner]
    points = forest.corners[leaf[:, None], corner]
    here = _evaluate(forest, forest.cell[leaf], points)
    cell, _, opposite = pairing.opposite(forest.cell[leaf], face, points)
    there = _evaluate(forest, cell, opposite)
    keys = forest.lattice.keys(cell, opposite)

    area, vector_area = _facet_shares(here, face)
    size = np.sqrt(area.sum(axis=1))
    modulus = _contact_modulus(scene, forest.mesh.body[forest.cell[leaf]], forest.mesh.body[cell])
    stiffness = (penalty.factor * modulus / size)[:, None] * area
    sums = np.zeros((len(vertices), 5))
    np.add.at(sums, vertex, np.concatenate([area[:, :, None], stiffness[:, :, None], vector_area], axis=2))

    # A pair belongs to a rank that has a facet of it: the owner of both vertices, but where contact pairs meet.
    distinct, example = np.unique(vertex, return_index=True)
    conform = ~prolongation.hanging[distinct]
    distinct, example = distinct[conform], example[conform]
    _, owner = Directory(forest.comm, vertices.keys[distinct]).number()
    own = owner == forest.comm.rank
    first, example = prolongation.conforming[distinct[own]].astype(np.int64), example[own]
    sums = prolongation.ghosted(prolongation.restrict(sums))
    area, stiffness, normal = sums[first, 0], sums[first, 1], sums[first, 2:]
    if scene.contact[index].direction is not None:
        normal = np.broadcast_to(np.asarray(scene.contact[index].direction, dtype=float), normal.shape)
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    if penalty.node_stiffness is not None:
        stiffness = np.full(len(first), float(penalty.node_stiffness))
    here, there = here.reshape(-1, 3)[example], there.reshape(-1, 3)[example]
    gap = np.einsum("ni,ni->n", normal, there - here)
    bodies = forest.mesh.body[np.stack([forest.cell[leaf], cell], axis=1)][example // 4]
    return first, prolongation.find(keys.ravel()[example]), normal, gap, area, stiffness, here, bodies


def _facet_shares(corners, face):
    """Integrals of the four bilinear functions over straight-sided facets, so that a uniform pressure is exact.

    Returns (n, 4) areas and (n, 4, 3) areas times the outward normals.
    """
    gauss = 0.5 + np.array([-1, 1]) / np.sqrt(12)
    v, u = (g.ravel() for g in np.meshgrid(gauss, gauss, indexing="ij"))
    value = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
    along_u = np.stack([v - 1, 1 - v, -v, v], axis=1) @ corners
    along_v = np.stack([u - 1, -u, 1 - u, u], axis=1) @ corners
    normal = np.cross(along_u, along_v) * reference.FACE_ORIENTATION[face][:, None, None]
    return np.linalg.norm(normal, axis=2) @ value / 4, value.T @ normal / 4


def _evaluate(forest, cell, points):
    """Positions (n, 4, 3) of lattice points (n, 4, 3) of root cells."""
    flat = points.reshape(-1, 3, 1) / SIDE
    return forest.mesh.evaluate(np.repeat(cell, 4), flat).reshape(-1, 4, 3)


def _contact_modulus(scene, first, second):
    """E* [Pa] of two bodies: 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2."""
    moduli = np.array([scene.materials[name].plane_strain_modulus for name in scene.mesh.bodies])
    return 1 / (1 / moduli[first] + 1 / moduli[second])


class PenaltyTerm:
    """k_N B^T B and k_N B^T D of the active pairs, on the components that no condition prescribes.

    Args:
        pairs: NodePairs.
        prescribed: (owned, 3) float64, prescribed displacements [m], NaN where free.
    """

    def __init__(self, pairs, prescribed):
        self.pairs = pairs
        known = pairs.prolongation.ghosted(prescribed)
        free, known = np.isnan(known), np.nan_to_num(known)
        self._rows = [
            np.where(free[place], sign * pairs.normal, 0.0)
            for place, sign in ((pairs.first, 1.0), (pairs.second, -1.0))
        ]
        jump = known[pairs.first] - known[pairs.second]
        self._gap = pairs.gap - np.einsum("ni,ni->n", pairs.normal, jump)

    def reserve(self, matrix):
        """Make room in a matrix for the blocks that couple the two vertices of every pair.  Local."""
        self._add(matrix, np.arange(len(self.pairs)), np.zeros(len(self.pairs)))

    def change(self, matrix, before, after):
        """Turn the term of one active set into that of another.

        Collective.

        Args:
            matrix: PETSc Mat that has the term of `before`.
            before, after: (n,) bool, active pairs.
        """
        changed = np.flatnonzero(before != after)
        sign = np.where(after[changed], 1.0, -1.0)
        self._add(matrix, changed, sign * self.pairs.stiffness[changed])
        matrix.assemble()

    def _add(self, matrix, which, stiffness):
        pairs = self.pairs
        imap = pairs.prolongation.index_map
        nodes = np.stack([pairs.first[which], pairs.second[which]], axis=1).astype(np.int32)
        nodes = imap.local_to_global(nodes.ravel()).astype(np.int32).reshape(-1, 2)
        rows = np.stack([row[which] for row in self._rows], axis=1)
        blocks = np.einsum("n,nai,nbj->nabij", stiffness, rows, rows)
        indptr = np.arange(0, 4 * len(which) + 1, 2, dtype=np.int32)
        columns = np.repeat(nodes, 2, axis=0).ravel()
        matrix.setValuesBlockedIJV(
            indptr, columns, np.ascontiguousarray(blocks), addv=PETSc.InsertMode.ADD, rowmap=nodes.ravel()
        )

    def difference(self, before, after):
        """The product with what one active set has and another has not, for few pairs.

        Local; the function it returns is collective.

        Args:
            before, after: (n,) bool, active pairs.

        Returns:
            function (x, y) of (owned, 3) float64 that adds (B^T k_N B of after - that of before) x to y.
        """
        prolongation, changed = self.pairs.prolongation, np.flatnonzero(before != after)
        stiffness = np.where(after[changed], 1.0, -1.0) * self.pairs.stiffness[changed]
        places = self.pairs.first[changed], self.pairs.second[changed]
        rows = [row[changed] for row in self._rows]

        def add(x, y):
            x = prolongation.ghosted(x)
            force = stiffness * sum(np.einsum("ni,ni->n", row, x[place]) for row, place in zip(rows, places))
            result = vector(prolongation.index_map, 3)
            values = result.array.reshape(-1, 3)
            for row, place in zip(rows, places):
                np.add.at(values, place, force[:, None] * row)
            result.scatter_reverse(InsertMode.add)
            y += values[: prolongation.owned]

        return add

    def right_hand_side(self, active):
        """k_N B^T D of the active pairs.

        Collective.

        Args:
            active: (n,) bool.

        Returns:
            (owned, 3) float64 [N].
        """
        prolongation = self.pairs.prolongation
        force = np.where(active, self.pairs.stiffness * self._gap, 0.0)[:, None]
        result = vector(prolongation.index_map, 3)
        values = result.array.reshape(-1, 3)
        np.add.at(values, self.pairs.first, force * self._rows[0])
        np.add.at(values, self.pairs.second, force * self._rows[1])
        result.scatter_reverse(InsertMode.add)
        return values[: prolongation.owned].copy()
