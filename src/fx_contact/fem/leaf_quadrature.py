"""Gauss rules on the curved leaves of a forest and on their faces, with NumPy.

All is local.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, IntArray

#: Points along an axis of a leaf, in [0, 1], and their weights.
Rule: TypeAlias = tuple[FloatArray, FloatArray]

#: Integration points at once: few enough for the processor's cache.
_CHUNK = 1 << 17


def faces_on(forest: Forest, surface: str) -> Iterator[tuple[IntArray, int]]:
    """Leaves (n,) of this rank on a surface, with each local face that lies on it."""
    leaf, face = forest.boundary_faces(forest.mesh.surface(surface))
    for which in np.unique(face):
        yield leaf[face == which], int(which)


def gauss_rule(degree: int, order: int, face: int | None, more: int = 0, parts: int = 1) -> Rule:
    """The rule of loads on displacements of a degree, with so many points more, in each of so many parts."""
    # On a face the area vector is a polynomial of twice the order: a constant pressure is integrated exactly.
    points, weights = np.polynomial.legendre.leggauss(degree + (1 if face is None else order) + more)
    halves = np.add.outer(np.arange(parts), (points + 1) / 2).ravel()
    return halves / parts, np.tile(weights / 2, parts) / parts


def shape_functions(degree: int, face: int | None, rule: Rule) -> FloatArray:
    """The functions of a degree at the points of a rule, in the volume or on a local face: (g, (p+1)^3)."""
    return _tensor([hexahedron.lagrange(degree, x) for x in _on(face, *rule)[0]])


def integrands(
    forest: Forest, leaves: IntArray, order: int, density: Callable[..., FloatArray], face: int | None, rule: Rule
) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Chunks of leaves (n,), positions (n, g, 3) [m] of integration points, and densities times weights (n, g, k).

    The density (m, k), a quantity per volume or area, is a function of points (m, 3), on a face of normals too.
    """
    axes, weights = _on(face, *rule)
    value = [hexahedron.lagrange(order, x) for x in axes]
    slope = [hexahedron.lagrange_derivative(order, x) for x in axes]
    weight = _tensor([w[:, None] for w in weights])[:, 0]
    count = max(1, _CHUNK // len(weight))
    for start in range(0, len(leaves), count):
        part = leaves[start : start + count]
        nodal = leaf_positions(forest, part, order)
        x = hexahedron.tensor_evaluate(value, nodal).reshape(-1, 3)
        tangent = [
            hexahedron.tensor_evaluate([slope[a] if a == axis else value[a] for a in range(3)], nodal).reshape(-1, 3)
            for axis in (range(3) if face is None else hexahedron.FACE_TANGENTS[face])
        ]
        normal = np.cross(tangent[0], tangent[1])
        if face is None:
            measure = np.einsum("ni,ni->n", normal, tangent[2])
            values = density(x)
        else:
            measure = np.linalg.norm(normal, axis=1)
            values = density(x, hexahedron.FACE_ORIENTATION[face] * normal / measure[:, None])
        shape = len(part), len(weight), -1
        yield part, x.reshape(shape), (values * measure[:, None]).reshape(shape) * weight[:, None]


def _on(face: int | None, points: FloatArray, weights: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Points and weights along the three axes, in the volume or on a local face."""
    axes, rules = [points] * 3, [weights] * 3
    if face is not None:
        axes[hexahedron.FACE_AXIS[face]] = np.array([float(hexahedron.FACE_SIDE[face])])
        rules[hexahedron.FACE_AXIS[face]] = np.ones(1)
    return axes, rules


def _tensor(functions: Sequence[FloatArray]) -> FloatArray:
    """Products of 1D functions (m, k) along x, y, z at the tensor product of their points, x fastest: (m^3, k^3)."""
    fx, fy, fz = functions
    return np.kron(fz, np.kron(fy, fx))
