"""Surface and body forces of a scene on the conforming unknowns, integrated over the curved leaves with NumPy.

Not with UFL: a user's force is a NumPy function of position.  Here it is taken at the integration points.  For UFL it
would have to be interpolated first, since a quadrature space cannot live on facets, and each new form takes seconds to
compile.
"""

import numpy as np
from dolfinx import fem

from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.parallel.mpi import together
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import BodyForce

#: Integration points at once: few enough for the processor's cache.
_CHUNK = 1 << 17


def load(scene, forest, elasticity):
    """Generalised external forces on the conforming nodes.

    Collective on forest.comm.

    Args:
        scene: Scene.
        forest: Forest.
        elasticity: Elasticity on the forest's mesh.

    Returns:
        (owned, 3) float64 [N].

    Raises:
        SceneError: a force that is a function fails or is not finite somewhere.
    """
    return load_and_totals(scene, forest, elasticity)[0]


def load_and_totals(scene, forest, elasticity):
    """As `load`, and what each surface and body force adds up to.

    Collective on forest.comm.

    Args:
        scene, forest, elasticity: as `load` takes them.

    Returns:
        (owned, 3) float64 [N]; (k, nbodies, 6) float64 of the k = tractions + body forces of the scene, in this order,
        and of each body: force [N] and moment about the origin [N m] of this rank's leaves, by the same Gauss rule.

    Raises:
        SceneError: as `load`.
    """
    space, order = elasticity.prolongation.space, elasticity.leaf_mesh.order
    forces = np.zeros((len(space), 3))
    totals = np.zeros((len(scene.tractions) + len(scene.body_forces), len(forest.mesh.bodies), 6))
    if scene.tractions or scene.body_forces:
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


def finer_totals(scene, elasticity):
    """What each load that is a function adds up to by a finer rule than that of `load_and_totals`.

    Collective on the mesh's communicator.  It has a Gauss point more along each axis, on facets in each of two halves.
    So a jump of the load inside a leaf lies between other points of the two.

    Args:
        scene: Scene.
        elasticity: Elasticity on the forest's mesh.

    Returns:
        (k, 4) float64 of the k = tractions + body forces of the scene, in this order, on this rank's leaves: the force
        and the integral of its magnitude [N]; 0 for constant loads.

    Raises:
        SceneError: as `load`.
    """
    space, order = elasticity.prolongation.space, elasticity.leaf_mesh.order
    totals = np.zeros((len(_loads(scene)), 4))
    if any(callable(force.value) for force in _loads(scene)):
        with together(space.forest.comm):
            for force, total in zip(_loads(scene), totals):
                for leaves, face in _places(space.forest, force) if callable(force.value) else ():
                    rule = _rule(space, order, face, more=1, parts=1 if face is None else 2)
                    for _, _, values in _integrands(space.forest, leaves, order, force.at, face, rule):
                        total[:3] += values.sum(axis=(0, 1))
                        total[3] += np.linalg.norm(values, axis=2).sum()
    return totals


def body_force(scene, elasticity):
    """Density of the body forces of a scene, interpolated at the nodes.

    Collective on the mesh's communicator.

    Args:
        scene: Scene.
        elasticity: Elasticity.

    Returns:
        dolfinx Function of three components [N/m^3]; None: there are no body forces.

    Raises:
        SceneError: a force that is a function fails or is not finite somewhere.
    """
    if not scene.body_forces:
        return None
    space = elasticity.prolongation.space
    mesh, density = space.forest.mesh, np.zeros((len(space), 3))
    body = mesh.body[space.forest.cell[space.example[:, 0]]]
    with together(space.forest.comm):
        for force in scene.body_forces:
            on = body == mesh.bodies.index(force.body)
            density[on] += force.at(space.positions(on))
    function = fem.Function(elasticity.nodal_space(3))
    function.x.array[:] = elasticity.at_blocks(density)
    return function


def _loads(scene):
    """All loads of a scene."""
    return *scene.tractions, *scene.body_forces


def _places(forest, force):
    """Leaves of this rank that a load acts on: (n,) int with each local face, None for the volume."""
    if isinstance(force, BodyForce):
        yield np.flatnonzero(forest.mesh.body[forest.cell] == forest.mesh.bodies.index(force.body)), None
        return
    leaf, face = forest.boundary_faces(forest.mesh.surface(force.surface))
    for which in np.unique(face):
        yield leaf[face == which], which


def _rule(space, order, face, more=0, parts=1):
    """Points on [0, 1] along an axis, and weights, with so many points more than a load is applied with, in parts."""
    # On a face the area vector is a polynomial of twice the order: a constant pressure is integrated exactly.
    points, weights = _gauss(space.degree + (1 if face is None else order) + more)
    return np.add.outer(np.arange(parts), points).ravel() / parts, np.tile(weights, parts) / parts


def _integrands(forest, leaves, order, density, face, rule):
    """Integration points of a load, some leaves after the other, and the force there times its weight.

    Yields (n,) int leaves, (n, g, 3) float64 positions [m] and (n, g, 3) float64 forces [N].

    Args:
        forest: Forest.
        leaves: (n,) int.
        order: geometry order of the leaves.
        density: function of points, and of normals where there is a face, that gives the force per volume or area.
        face: local face, or None for the volume.
        rule: points along an axis and their weights.
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
        x, force = x.reshape(len(part), -1, 3), (force * measure[:, None]).reshape(len(part), -1, 3)
        yield part, x, force * weight[:, None]


def _on(face, points, weights):
    """Points and weights along the three axes, on a local face or, without, in the volume."""
    axes, rules = [points] * 3, [weights] * 3
    if face is not None:
        axes[hexahedron.FACE_AXIS[face]] = np.array([float(hexahedron.FACE_SIDE[face])])
        rules[hexahedron.FACE_AXIS[face]] = np.ones(1)
    return axes, rules


def _gauss(count):
    """Gauss points on [0, 1] and their weights."""
    # NumPy has any number of points.  The errors of their last digits matter for gaps alone (`Space.facet_rule`).
    points, weights = np.polynomial.legendre.leggauss(count)
    return (points + 1) / 2, weights / 2


def _tensor(functions):
    """Products of 1D functions (m, k) along x, y, z at the tensor product of their points, x fastest: (m^3, k^3)."""
    fx, fy, fz = functions
    return np.kron(fz, np.kron(fy, fx))
