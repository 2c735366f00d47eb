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

#: Leaves at once: few enough for the processor's cache.
_CHUNK = 1 << 12


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
            for traction, total in zip(scene.tractions, totals):
                leaf, face = forest.boundary_faces(forest.mesh.surface(traction.surface))
                for which in np.unique(face):
                    _add((forces, total), space, leaf[face == which], order, traction.at, which)
            for force, total in zip(scene.body_forces, totals[len(scene.tractions) :]):
                body = forest.mesh.bodies.index(force.body)
                leaves = np.flatnonzero(forest.mesh.body[forest.cell] == body)
                _add((forces, total), space, leaves, order, force.at)
    return elasticity.prolongation.restrict(forces), totals


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


def _add(sums, space, leaves, order, density, face=None):
    """Add the integrals of a force over leaves, or over one local face of theirs, times the functions of the nodes.

    Args:
        sums: (m, 3) float64, at the nodes [N], and (nbodies, 6) float64, force [N] and moment [N m] by body; changed.
        space: Space.
        leaves: (n,) int.
        order: geometry order of the leaves.
        density: function of points, and of normals where there is a face, that gives the force per volume or area.
        face: local face, or None for the volume.
    """
    # On a face the area vector is a polynomial of twice the order: a constant pressure is integrated exactly.
    points, weights = _gauss(space.degree + (1 if face is None else order))
    axes, rules = [points] * 3, [weights] * 3
    if face is not None:
        axes[hexahedron.FACE_AXIS[face]] = np.array([float(hexahedron.FACE_SIDE[face])])
        rules[hexahedron.FACE_AXIS[face]] = np.ones(1)
    value = [hexahedron.lagrange(order, x) for x in axes]
    slope = [hexahedron.lagrange_derivative(order, x) for x in axes]
    functions = _tensor([hexahedron.lagrange(space.degree, x) for x in axes])
    weight = _tensor([w[:, None] for w in rules])[:, 0]
    forces, totals = sums
    for start in range(0, len(leaves), _CHUNK):
        part = leaves[start : start + _CHUNK]
        nodal = leaf_positions(space.forest, part, order)
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
        force = (force * measure[:, None]).reshape(len(part), -1, 3) * weight[:, None]
        np.add.at(forces, space.cells[part], functions.T @ force)
        moment = np.cross(x.reshape(force.shape), force).sum(axis=1)
        body = space.forest.mesh.body[space.forest.cell[part]]
        np.add.at(totals, body, np.concatenate([force.sum(axis=1), moment], axis=1))


def _gauss(count):
    """Gauss points on [0, 1] and their weights."""
    # NumPy has any number of points.  The errors of their last digits matter for gaps alone (`Space.facet_rule`).
    points, weights = np.polynomial.legendre.leggauss(count)
    return (points + 1) / 2, weights / 2


def _tensor(functions):
    """Products of 1D functions (m, k) along x, y, z at the tensor product of their points, x fastest: (m^3, k^3)."""
    fx, fy, fz = functions
    return np.kron(fz, np.kron(fy, fx))
