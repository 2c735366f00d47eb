"""Contact surfaces whose meshes do not match: their geometry, and the one that has the rows.  All is local."""

from functools import cached_property
from typing import Self

import numpy as np

from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.parallel.errors import PairingError
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.leaf_facets import LeafFacets
from fx_contact.problem.root_facets import RootFacets
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.surface_projection import Projected, SurfaceProjection
from fx_contact.problem.ties import Tie

#: Samples along each side of a root facet: of what it faces.
_SAMPLES = 4
#: Differences of sizes up to this are rounding [-].
_SAME = 1e-6
#: Ratio of moduli up to which bodies are equally soft.  Rows on the stiffer one take more iterations of the Gram system
#: (`studies/nonmatching`), those on the coarser one have worse pressures.
_ALIKE = 2.0


class NonmatchingSurfaces:
    """The surfaces of a contact, each of any mesh; the same on all ranks.

    Points of the first surface face the nearest place of the second along their normal, or along the direction of the
    contact; no place that is farther behind than the largest root facet.
    """

    def __init__(
        self,
        mesh: RootMesh,
        contact: ContactPair | Tie,
        onto_first: SurfaceProjection,
        onto_second: SurfaceProjection,
    ) -> None:
        self.mesh, self.contact, self._onto_first, self._onto_second = mesh, contact, onto_first, onto_second
        self.first, self.second = onto_first.facets, onto_second.facets

    @classmethod
    def of(cls, mesh: RootMesh, contact: ContactPair | Tie) -> Self:
        """Surfaces of a contact, with their search trees."""
        return cls(mesh, contact, *(SurfaceProjection(mesh, mesh.surface(name)) for name in contact.surfaces))

    def reversed(self) -> "NonmatchingSurfaces":
        """Surfaces of the reversed contact, with the same search trees."""
        return NonmatchingSurfaces(self.mesh, self.contact.reversed(), self._onto_second, self._onto_first)

    @cached_property
    def depth(self) -> float:
        """Largest diagonal of a root facet [m]: places of the second surface farther behind the first are not faced."""
        return max(float(np.linalg.norm(np.ptp(facets.corners, axis=1), axis=1).max()) for facets in self._both)

    @property
    def _both(self) -> tuple[RootFacets, RootFacets]:
        return self.first, self.second

    @cached_property
    def size(self) -> FloatArray:
        """(ncells, 6), root of the area of root facets, by that of their corners; 0 of others [m]."""
        result = np.zeros((len(self.mesh.cells), 6))
        for facets in self._both:
            result[tuple(facets.facets.T)] = facets.size
        return result

    def directions(self, normal: FloatArray) -> FloatArray:
        """Unit vectors (..., 3) along which points with unit normals (..., 3) face the second surface [-]."""
        direction = self.contact.unit_direction
        return normal if direction is None else np.broadcast_to(direction, normal.shape)

    def faced(self, position: FloatArray, direction: FloatArray) -> Projected:
        """Places on the second surface that points (k, 3) of the first one face in directions (k, 3)."""
        return self._onto_second(position, direction, self.depth)

    def nearest(self, position: FloatArray) -> FloatArray:
        """Bounds (k,) of the distance of points (k, 3) to the second surface [m]."""
        return self._onto_second.nearest(position)

    @cached_property
    def faced_samples(self) -> Int64Array:
        """(n, _SAMPLES^2), facets of the second surface that samples of the first one's root facets face, -1: none."""
        line = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        uv = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        at = self.first.at(np.arange(len(self.first)), np.broadcast_to(uv, (len(self.first), *uv.shape)))
        found = self.faced(at.position.reshape(-1, 3), self.directions(at.normal).reshape(-1, 3))
        return found.facet.reshape(-1, len(uv))

    def mean_ratios(self, moduli: FloatArray) -> tuple[float, float] | None:
        """Sizes of root facets, and moduli of their bodies, of the first surface over those that they face.

        Geometric means by area, None if facets of the first surface face none.

        Args:
            moduli: (nbodies,) [Pa].
        """
        faced = self.faced_samples
        weight = np.where(faced >= 0, self.first.size[:, None] ** 2, 0.0)
        if not weight.any():
            return None
        one, two = (moduli[self.mesh.body[facets.facets[:, 0]]] for facets in self._both)
        ratios = self.first.size[:, None] / self.second.size[faced], one[:, None] / two[faced]
        size, modulus = (float(np.exp((weight * np.log(ratio)).sum() / weight.sum())) for ratio in ratios)
        return size, modulus

    def faced_by(self, second: LeafFacets) -> tuple[BoolArray, tuple[IntArray, FloatArray]]:
        """Places on the first surface that the middles of second facets (k,) face.

        Along the normals of the second surface, or against the direction of the contact.

        Returns:
            (k,), facets whose middle faces one; of these, root facets (n, 2) and coordinates (n, 2) on them.
        """
        at = second.at(np.full((len(second), 1, 2), 0.5))
        normal, direction = at.normal[:, 0], self.contact.unit_direction
        along = normal if direction is None else np.broadcast_to(-direction, normal.shape)
        place = self._onto_first(at.position[:, 0], along, self.depth)
        return place.found, (self.first.facets[place.facet[place.found]], place.uv[place.found])


def oriented(mesh: RootMesh, contact: ContactPair | Tie, moduli: FloatArray) -> NonmatchingSurfaces:
    """Surfaces of the contact, or of its reverse: first the one with the rows, of the softer body, else the finer one.

    Raises PairingError if the surfaces do not face each other.

    Args:
        moduli: of the bodies (nbodies,) [Pa].
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
        f"{contact.label}: the surfaces do not face each other anywhere {along}: check their names and places{turn}"
    )
