"""Contact surfaces whose meshes do not match: their geometry, and the one that has the rows.  All is local."""

from collections.abc import Sequence
from functools import cached_property
from typing import Self

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.geometry.root_facets import RootFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import SMOOTH, ContactPair
from fx_contact.items.ties import Tie
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.parallel.errors import PairingError
from fx_contact.surfaces.surface_projection import Projected, SurfaceProjection

#: Samples of a facet, of what it faces: the middles of 4 x 4 parts.
SAMPLES = np.stack(np.meshgrid(*2 * [(np.arange(4) + 0.5) / 4]), axis=-1).reshape(-1, 2)
#: Middles of the edges of a facet, as `hexahedron.FACE_EDGES`.
EDGE_MIDDLES = np.array([[0.5, 0.0], [0.5, 1.0], [0.0, 0.5], [1.0, 0.5]])
#: Differences of sizes up to this are rounding [-].
_SAME = 1e-6
#: Ratio of moduli up to which bodies are equally soft.  Rows on the stiffer one take more iterations of the Gram system
#: (`studies/nonmatching`), those on the coarser one have worse pressures.
_ALIKE = 2.0


class NonmatchingSurfaces:
    """The surfaces of a contact, each of any mesh; the same on all ranks.

    Points of the first surface face the nearest place of the second along their normal, or along the direction of the
    contact; no place that is farther behind than the largest root facet.

    Args:
        onto: projections onto the first surface and onto the second.

    Attributes:
        before: surfaces of contacts and ties that act instead where they join the same facets.
    """

    def __init__(self, mesh: RootMesh, contact: ContactPair | Tie, onto: Sequence[SurfaceProjection]) -> None:
        self.mesh, self.contact = mesh, contact
        self._onto_first, self._onto_second = onto
        self._both = self.first, self.second = self._onto_first.facets, self._onto_second.facets
        self.before: tuple[NonmatchingSurfaces, ...] = ()

    @classmethod
    def of(cls, mesh: RootMesh, contact: ContactPair | Tie) -> Self:
        """Surfaces of a contact, with their search trees."""
        return cls(mesh, contact, [SurfaceProjection(mesh, mesh.surface(name)) for name in contact.surfaces])

    def reversed(self) -> "NonmatchingSurfaces":
        """Surfaces of the reversed contact, with the same search trees."""
        return NonmatchingSurfaces(self.mesh, self.contact.reversed(), (self._onto_second, self._onto_first))

    @cached_property
    def depth(self) -> float:
        """Largest diagonal of a root facet [m]: places of the second surface farther behind the first are not faced."""
        return max(float(np.linalg.norm(np.ptp(facets.corners, axis=1), axis=1).max()) for facets in self._both)

    def directions(self, normal: FloatArray) -> FloatArray:
        """Unit vectors (..., 3) along which points with unit normals (..., 3) face the second surface [-]."""
        direction = self.contact.unit_direction
        return normal if direction is None else np.broadcast_to(direction, normal.shape)

    def faced(self, position: FloatArray, direction: FloatArray) -> Projected:
        """Places on the second surface that points (..., 3) of the first one face in directions (..., 3)."""
        return self._onto_second(position, direction, self.depth)

    def nearest(self, position: FloatArray) -> FloatArray:
        """Bounds (k,) of the distance of points (k, 3) to the second surface [m]."""
        return self._onto_second.nearest(position)

    def joins(self, first: IntArray, second: IntArray) -> BoolArray:
        """(k,), True for pairs of root facets (k, 2) and (k, 2) that are on both surfaces, one on each."""
        on = np.zeros((2, len(self.mesh.cells), 6), dtype=bool)
        for side, facets in zip(on, self._both):
            side[tuple(facets.facets.T)] = True
        (one, other), (two, another) = on[:, *first.T], on[:, *second.T]
        return np.asarray(one & another | other & two)

    def joined_before(self, first: IntArray, second: IntArray) -> BoolArray:
        """(k,), pairs of root facets that `before` joins, as of `joins`."""
        return np.any([np.zeros(len(first), dtype=bool), *(one.joins(first, second) for one in self.before)], axis=0)

    @cached_property
    def faced_samples(self) -> Int64Array:
        """(n, 16), facets of the second surface that samples of the first one's root facets face, -1: none."""
        at = self.first.at(np.arange(len(self.first)), SAMPLES)
        return self.faced(at.position, self.directions(at.normal)).facet

    @cached_property
    def uncovered(self) -> tuple[float, str]:
        """Part of the smaller surface's area that faces nothing [-], and its name."""
        parts = []
        for surfaces in (self, self.reversed()):
            area = surfaces.first.size**2
            part = float(area @ (surfaces.faced_samples < 0).mean(axis=1) / area.sum())
            parts.append((float(area.sum()), part, surfaces.contact.surfaces[0]))
        return min(parts)[1:]

    @cached_property
    def _continuation(self) -> SurfaceProjection | None:
        """Facets with which the boundary goes on smoothly at the rim of the second surface; None: it has an edge."""
        mesh, named = self.mesh, np.zeros((len(self.mesh.cells), 6), dtype=bool)
        named[tuple(self.second.facets.T)] = True
        others = np.argwhere((mesh.face_neighbours == 1) & ~named)
        edges, normals = _at_edges(mesh, self.second.facets)
        others = others[np.isin(edges_of(mesh, others), edges).any(axis=1)]
        theirs, other_normals = _at_edges(mesh, others)
        order = np.argsort(edges)
        place = order[np.minimum(np.searchsorted(edges[order], theirs), len(order) - 1)]
        smooth = (edges[place] == theirs) & (np.einsum("ni,ni->n", normals[place], other_normals) > SMOOTH)
        others = others[smooth.reshape(-1, 4).any(axis=1)]
        return SurfaceProjection(mesh, others) if len(others) else None

    @property
    def goes_on(self) -> bool:
        """True if the boundary of the second body goes on smoothly somewhere beyond the rim of its surface."""
        return self._continuation is not None

    def cut_off(self, facets: LeafFacets, joined: BoolArray) -> FloatArray:
        """Parts (k,) of facets of the first surface that face nothing, but what goes on beyond the second one's rim.

        Without what is `joined` by a contact or tie, (ncells, 6).
        """
        assert self._continuation is not None, "as of `goes_on`"
        at = facets.at(SAMPLES)
        direction = self.directions(at.normal)
        missed = ~self.faced(at.position, direction).found
        beyond = self._continuation(at.position[missed], direction[missed], self.depth)
        cell, face = self._continuation.facets.facets[beyond.facet].T
        missed[missed] = beyond.found & ~joined[cell, face]
        return np.asarray(missed.mean(axis=1))

    def mean_ratios(self, moduli: FloatArray) -> tuple[float, float] | None:
        """Sizes of root facets, and moduli of their materials, of the first surface over those that they face.

        Geometric means by area, None if facets of the first surface face none.

        Args:
            moduli: (nregions,) [Pa].
        """
        faced = self.faced_samples
        weight = np.where(faced >= 0, self.first.size[:, None] ** 2, 0.0)
        if not weight.any():
            return None
        one, two = (moduli[self.mesh.region[facets.facets[:, 0]]] for facets in self._both)
        ratios = self.first.size[:, None] / self.second.size[faced], one[:, None] / two[faced]
        size, modulus = (float(np.exp((weight * np.log(ratio)).sum() / weight.sum())) for ratio in ratios)
        return size, modulus

    def faced_by(self, second: LeafFacets) -> tuple[BoolArray, tuple[IntArray, FloatArray]]:
        """Places on the first surface that the middles of second facets (k,) face.

        Along the normals of the second surface, or against the direction of the contact.

        Returns:
            (k,), facets whose middle faces one; of these, root facets (n, 2) and coordinates (n, 2) on them.
        """
        at = second.at(np.array([[0.5, 0.5]]))
        normal, direction = at.normal[:, 0], self.contact.unit_direction
        along = normal if direction is None else np.broadcast_to(-direction, normal.shape)
        place = self._onto_first(at.position[:, 0], along, self.depth)
        return place.found, (self.first.facets[place.facet[place.found]], place.uv[place.found])


def edges_of(mesh: RootMesh, facets: IntArray) -> Int64Array:
    """Numbers (n, 4) of the edges of facets (n, 2)."""
    return np.asarray(mesh.edges[facets[:, :1], hexahedron.FACE_EDGES[facets[:, 1]]])


def _at_edges(mesh: RootMesh, facets: IntArray) -> tuple[Int64Array, FloatArray]:
    """Edges (4 n,) of facets (n, 2), and the unit normals (4 n, 3) of the facets at their middles."""
    at = RootFacets(mesh, facets).at(np.arange(len(facets)), EDGE_MIDDLES)
    return edges_of(mesh, facets).ravel(), at.normal.reshape(-1, 3)


def oriented(mesh: RootMesh, contact: ContactPair | Tie, moduli: FloatArray) -> NonmatchingSurfaces:
    """Surfaces of the contact, or of its reverse: first the one with the rows, of the softer body, else the finer one.

    Raises PairingError if the surfaces do not face each other.

    Args:
        moduli: of the mesh's regions (nregions,) [Pa].
    """
    surfaces = NonmatchingSurfaces.of(mesh, contact)
    ratios = surfaces.mean_ratios(moduli)
    if ratios is not None:
        size, modulus = ratios
        softer = modulus < 1 / _ALIKE
        finer = size <= 1 + _SAME and modulus <= _ALIKE
        return surfaces if softer or finer else surfaces.reversed()
    if surfaces.reversed().mean_ratios(moduli):  # smaller than a sample's part of a facet
        return surfaces.reversed()
    along, turn = "along their normals", ""
    if contact.direction is not None:
        along, turn = f"along the direction {tuple(contact.direction)}", ", or turn the direction round"
    raise PairingError(
        f"{contact.label}: the surfaces do not face each other {along}, or on less than a sixteenth of a facet, or are "
        f"farther inside each other than the largest facet is wide: check their names and places{turn}"
    )
