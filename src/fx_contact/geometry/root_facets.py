"""Curved facets of the root mesh: positions, tangents and normals at any point, and where lines meet them.

A facet is (root cell, local face); its coordinates (u, v) in [0, 1]^2 run along the face's first and second tangent.
All is local: the root mesh is on every rank.
"""

from typing import NamedTuple

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray

#: Nodal values gathered at once, so that they fit into the processor's cache.
_CHUNK = 1 << 18
#: Newton's method stops after a step below the root of the rounding of (u, v), for it converges quadratically.
_STEP = 1e-9
#: Steps of Newton's method: a quarter of a circle takes 5 of them, a point that they do not bring near is no solution.
_STEPS = 12
#: Facets are continued by their polynomials up to this distance, in facets; no solution farther out is wanted.
_BEYOND = 1.0


class SurfacePoints(NamedTuple):
    """Points of a surface.

    Attributes:
        position: (..., 3) [m].
        first, second: (..., 3), derivatives of the position by u and v [m].
        outward: (..., 3), their vector product, turned out of the body [m^2].
    """

    position: FloatArray
    first: FloatArray
    second: FloatArray
    outward: FloatArray

    @property
    def jacobian(self) -> FloatArray:
        """(...), area by du dv [m^2]."""
        return np.linalg.norm(self.outward, axis=-1)

    @property
    def normal(self) -> FloatArray:
        """(..., 3), unit normal out of the body [-]."""
        return np.asarray(self.outward / self.jacobian[..., None])


class RootFacets:
    """Facets (n, 2) of a root mesh as (root cell, local face).

    Attributes:
        facets: (n, 2).
        order: of the geometry.
        orientation: (n,), +1 where the first tangent times the second points out of the body, else -1.
    """

    def __init__(self, mesh: RootMesh, facets: IntArray) -> None:
        self.facets, self.order = facets, mesh.order
        self.orientation: Int64Array = hexahedron.FACE_ORIENTATION[facets[:, 1]]
        n = self.order + 1
        x = mesh.points[mesh.facet_nodes(facets)].reshape(len(facets), n, n, 3)
        slope = hexahedron.lagrange_derivative(self.order, np.arange(n) / self.order)
        nodal = np.concatenate([x, slope @ x, np.einsum("ij,fjud->fiud", slope, x)], axis=3)
        self._nodal = nodal.reshape(len(facets), n * n, 9)
        #: (n, 4, 3), positions of the corners, first tangent fastest [m].
        self.corners: FloatArray = x[:, :: self.order, :: self.order].reshape(len(facets), 4, 3)

    def __len__(self) -> int:
        return len(self.facets)

    @property
    def size(self) -> FloatArray:
        """(n,), root of the area of the quadrilateral of the corners, along their mean plane [m]."""
        return np.asarray(np.sqrt(np.linalg.norm(hexahedron.area_vectors(self.corners), axis=1)))

    def at(self, facet: IntArray, uv: FloatArray) -> SurfacePoints:
        """Points (k, m) of facets (k,) at coordinates (k, m, 2), or (m, 2) on all."""
        uv = np.broadcast_to(uv, (len(facet), *uv.shape[-2:]))
        values = np.empty((*uv.shape[:2], 9))
        size = _CHUNK // (9 * (self.order + 1) ** 2)
        for start in range(0, len(facet), size):
            part = slice(start, start + size)
            values[part] = face_functions(self.order, uv[part]) @ self._nodal[facet[part]]
        position, first, second = values[..., :3], values[..., 3:6], values[..., 6:]
        outward = np.cross(first, second) * self.orientation[facet][:, None, None]
        return SurfacePoints(position, first, second, outward)

    def on_lines(
        self, facet: IntArray, origin: FloatArray, direction: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Coordinates (k, m, 2) where lines through (k, m, 3) meet facets (k,), and (k, m) those that were found.

        Facets are continued beyond their edges by their polynomials.

        Args:
            direction: (k, m, 3) or (k, 1, 3), of the lines; of any length.
            start: (k, m, 2), coordinates to begin with.
        """
        uv, step = start.copy(), np.full(start.shape, np.inf)
        direction = np.broadcast_to(direction, origin.shape)
        left = np.arange(len(facet))
        for _ in range(_STEPS):
            at = self.at(facet[left], uv[left])
            away, along = origin[left] - at.position, direction[left]
            with np.errstate(all="ignore"):  # lines in the tangent plane are not found
                scale = np.einsum("kmi,kmi->km", along, np.cross(at.first, at.second))
                along_u = np.einsum("kmi,kmi->km", away, np.cross(at.second, along)) / scale
                along_v = np.einsum("kmi,kmi->km", away, np.cross(along, at.first)) / scale
            step[left] = np.stack([along_u, along_v], axis=-1)
            uv[left] += np.clip(np.nan_to_num(step[left]), -_BEYOND, _BEYOND)
            uv[left] = np.clip(uv[left], -_BEYOND, 1 + _BEYOND)
            left = left[~(np.abs(step[left]) <= _STEP).all(axis=(1, 2))]
            if not len(left):
                break
        return uv, (np.abs(step) <= _STEP).all(axis=2)


def face_functions(order: int, uv: FloatArray) -> FloatArray:
    """Lagrange functions (..., (p+1)^2) of the nodes of a face, u fastest, at coordinates (..., 2).  Local."""
    functions = hexahedron.lagrange(order, uv)
    u, v = functions[..., 0, :], functions[..., 1, :]
    return np.asarray(v[..., :, None] * u[..., None, :]).reshape(*uv.shape[:-1], (order + 1) ** 2)
