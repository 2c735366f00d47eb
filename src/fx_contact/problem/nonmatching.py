"""Contact surfaces whose meshes do not match: their geometry, and the finer one.  All is local."""

from functools import cached_property

import numpy as np

from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.errors import PairingError
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.leaf_facets import LeafFacets
from fx_contact.problem.root_facets import RootFacets
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.surface_projection import Projected, SurfaceProjection
from fx_contact.problem.ties import Tie

#: Samples along each side of a root facet: of what it faces.
_SAMPLES = 4
#: Ratios of sizes up to this are rounding.
_SAME = 1e-6


class NonmatchingSurfaces:
    """The surfaces of a contact, each of any mesh; the same on all ranks.

    Points of the first surface face the nearest place of the second along their normal, or along the direction of the
    contact; no place that is farther behind than the largest root facet.
    """

    def __init__(self, mesh: RootMesh, contact: ContactPair | Tie) -> None:
        self.mesh, self.contact = mesh, contact
        self.first, self.second = (RootFacets(mesh, mesh.surface(name)) for name in contact.surfaces)

    @cached_property
    def _onto_second(self) -> SurfaceProjection:
        return SurfaceProjection(self.mesh, self.second.facets)

    @cached_property
    def _onto_first(self) -> SurfaceProjection:
        return SurfaceProjection(self.mesh, self.first.facets)

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

    def mean_ratio(self) -> float:
        """Mean size of the first surface's root facets over that of those which they face, geometric, by area [-].

        Raises PairingError if no facet faces one.
        """
        faced = self.faced_samples
        seen = faced >= 0
        if not seen.any():
            raise PairingError(
                f"contact pair ({', '.join(map(repr, self.contact.surfaces))}): the surfaces do not face each other "
                "anywhere, neither along the normals of the first nor along a given direction; exchange or rename the "
                "surfaces, or turn the direction round"
            )
        ratio = np.log(self.first.size[:, None] / self.second.size[faced])
        weight = np.where(seen, self.first.size[:, None] ** 2, 0.0)
        return float(np.exp((weight * ratio).sum() / weight.sum()))

    def places_on_first(self, facets: LeafFacets) -> tuple[Int64Array, FloatArray]:
        """Root facets (k, 2) of the first surface that the middles of second facets (k,) face, and their coordinates.

        (-1, -1) where a middle faces none.  Along the normals of the second surface, or against the direction.
        """
        at = facets.at(np.full((len(facets), 1, 2), 0.5))
        normal, direction = at.normal[:, 0], self.contact.unit_direction
        along = normal if direction is None else np.broadcast_to(-direction, normal.shape)
        found = self._onto_first(at.position[:, 0], along, self.depth)
        place = np.full((len(facets), 2), -1, dtype=np.int64)
        place[found.found] = self.first.facets[found.facet[found.found]]
        return place, found.uv


def finer_first(mesh: RootMesh, contact: ContactPair | Tie) -> ContactPair | Tie:
    """The contact, or its reverse if the second surface is the finer one.  Raises PairingError."""
    one = NonmatchingSurfaces(mesh, contact)
    return contact.reversed() if one.mean_ratio() > 1 + _SAME else contact
