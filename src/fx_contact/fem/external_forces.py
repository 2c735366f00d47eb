"""Surface and body forces of a scene on the conforming unknowns, integrated over the curved leaves with NumPy.

A user's force is a NumPy function of position, evaluated at the integration points.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from dolfinx import fem

from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.mpi import together
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import BodyForce, Pressure, Traction
from fx_contact.problem.scene import Scene

#: Integration points at once: few enough for the processor's cache.
_CHUNK = 1 << 17

_Load: TypeAlias = Traction | Pressure | BodyForce
#: Points along an axis of a leaf, in [0, 1], and their weights.
_Rule: TypeAlias = tuple[FloatArray, FloatArray]


def load(scene: Scene, forest: Forest, elasticity: Elasticity) -> FloatArray:
    """Generalised external forces (owned, 3) [N] on the conforming nodes.

    Collective on forest.comm.  Raises SceneError if a force that is a function fails or is not finite somewhere.
    """
    return load_and_totals(scene, forest, elasticity)[0]


def load_and_totals(scene: Scene, forest: Forest, elasticity: Elasticity) -> tuple[FloatArray, FloatArray]:
    """Generalised external forces (owned, 3) [N] on the conforming nodes, and the resultants of each load.

    Collective on forest.comm.  Raises errors as `load`.

    Returns:
        The forces; (k, nbodies, 6), force [N] and moment about the origin [N m] of each load on this rank's leaves of
        each body, by the same Gauss rule.  The k loads are the tractions, then the body forces of the scene.
    """
    space, order = elasticity.prolongation.space, elasticity.leaf_mesh.order
    forces = np.zeros((len(space), 3))
    totals = np.zeros((len(_loads(scene)), len(forest.mesh.bodies), 6))
    if len(totals):
        with together(forest.comm):
            for force, total in zip(_loads(scene), totals):
                for leaves, face in _places(forest, force):
                    rule = _rule(space, order, face)
                    functions = _tensor([hexahedron.lagrange(space.degree, x) for x in _on(face, *rule)[0]])
                    for part, x, values in _integrands(forest, leaves, order, force.at, face, rule):
                        np.add.at(forces, space.cells[part], functions.T @ values)
                        moment = np.cross(x, values).sum(axis=1)
                        body = forest.mesh.body[forest.cell[part]]
                        np.add.at(total, body, np.concatenate([values.sum(axis=1), moment], axis=1))
    return elasticity.prolongation.restrict(forces), totals


def finer_totals(scene: Scene, elasticity: Elasticity) -> FloatArray:
    """Force of each load given by a function, by a finer rule than in `load_and_totals`.

    Collective on the mesh's communicator.  Raises errors as `load`.  The rule has a Gauss point more along each axis,
    on facets in each of two halves: a jump inside a leaf lies between different points of the two rules.

    Returns:
        (k, 4), of the loads in the order of `load_and_totals`, on this rank's leaves: the force and the integral of its
        magnitude [N]; 0 for constant loads.
    """
    space, order = elasticity.prolongation.space, elasticity.leaf_mesh.order
    loads = _loads(scene)
    totals = np.zeros((len(loads), 4))
    if any(callable(force.value) for force in loads):
        with together(space.forest.comm):
            for force, total in zip(loads, totals):
                for leaves, face in _places(space.forest, force) if callable(force.value) else ():
                    rule = _rule(space, order, face, more=1, parts=1 if face is None else 2)
                    for _, _, values in _integrands(space.forest, leaves, order, force.at, face, rule):
                        total[:3] += values.sum(axis=(0, 1))
                        total[3] += np.linalg.norm(values, axis=2).sum()
    return totals


def body_force(scene: Scene, elasticity: Elasticity) -> fem.Function | None:
    """Density of the body forces of a scene [N/m^3], interpolated at the nodes of each cell; None: there are none.

    Collective on the mesh's communicator.  Raises errors as `load`.
    """
    if not scene.body_forces:
        return None
    space, nodes = elasticity.prolongation.space, elasticity.cells[:, elasticity.order]
    root, density = space.forest.cell[elasticity.leaf_mesh.leaf], np.zeros((*nodes.shape, 3))
    with together(space.forest.comm):
        for force in scene.body_forces:
            cells, nodal = np.isin(root, scene.mesh.cells_of(force.body)), np.zeros((len(space), 3))
            on = np.isin(np.arange(len(space)), nodes[cells])
            nodal[on] = force.at(space.positions(on))
            density[cells] += nodal[nodes[cells]]
    function = fem.Function(elasticity.discontinuous())
    function.x.array.reshape(-1, 3)[function.function_space.dofmap.list] = density
    return function


def _loads(scene: Scene) -> tuple[_Load, ...]:
    return *scene.tractions, *scene.body_forces


def _places(forest: Forest, force: _Load) -> Iterator[tuple[IntArray, int | None]]:
    """Leaves (n,) of this rank under a load, with each local face; None for the volume."""
    if isinstance(force, BodyForce):
        yield np.flatnonzero(np.isin(forest.cell, forest.mesh.cells_of(force.body))), None
        return
    leaf, face = forest.boundary_faces(forest.mesh.surface(force.surface))
    for which in np.unique(face):
        yield leaf[face == which], int(which)


def _rule(space: Space, order: int, face: int | None, more: int = 0, parts: int = 1) -> _Rule:
    """The rule of loads, with so many points more, in each of so many parts."""
    # On a face the area vector is a polynomial of twice the order: a constant pressure is integrated exactly.
    points, weights = np.polynomial.legendre.leggauss(space.degree + (1 if face is None else order) + more)
    halves = np.add.outer(np.arange(parts), (points + 1) / 2).ravel()
    return halves / parts, np.tile(weights / 2, parts) / parts


def _integrands(
    forest: Forest, leaves: IntArray, order: int, density: Callable[..., FloatArray], face: int | None, rule: _Rule
) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Chunks of leaves (n,), positions (n, g, 3) [m] of integration points, and forces times weights (n, g, 3) [N].

    The density, force per volume or area, is a function of points, on a face of normals too.
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
            force = density(x)
        else:
            measure = np.linalg.norm(normal, axis=1)
            force = density(x, hexahedron.FACE_ORIENTATION[face] * normal / measure[:, None])
        shape = len(part), -1, 3
        yield part, x.reshape(shape), (force * measure[:, None]).reshape(shape) * weight[:, None]


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
