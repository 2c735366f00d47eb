"""Surface and body forces of a scene on the conforming unknowns, integrated over the curved leaves with NumPy.

A user's force is a NumPy function of position, evaluated at the integration points.
"""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from dolfinx import fem

from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.leaf_quadrature import faces_on, gauss_rule, integrands, shape_functions
from fx_contact.fem.nodal_strain import sum_at_nodes
from fx_contact.forest.forest import Forest
from fx_contact.items.boundary_conditions import BodyForce, Pressure, Traction
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.mpi import together
from fx_contact.scene.scene import Scene

_Load: TypeAlias = Traction | Pressure | BodyForce


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
                    rule = gauss_rule(space.degree, order, face)
                    functions = shape_functions(space.degree, face, rule)
                    for part, x, values in integrands(forest, leaves, order, force.at, face, rule):
                        np.add.at(forces, space.cells[part], functions.T @ values)
                        moment = np.cross(x, values).sum(axis=1)
                        body = forest.mesh.body[forest.cell[part]]
                        np.add.at(total, body, np.concatenate([values.sum(axis=1), moment], axis=1))
    return elasticity.prolongation.restrict(forces), totals


def nodal_volumes(forest: Forest, elasticity: Elasticity) -> FloatArray:
    """Integrals (owned,) of the functions of the conforming nodes [m^3].  Collective on forest.comm."""
    space, order = elasticity.prolongation.space, elasticity.leaf_mesh.order
    volumes, rule = np.zeros((len(space), 1)), gauss_rule(space.degree, order, None)
    functions, every = shape_functions(space.degree, None, rule), np.arange(len(forest))
    for part, _, values in integrands(forest, every, order, lambda x: np.ones((len(x), 1)), None, rule):
        np.add.at(volumes, space.cells[part], functions.T @ values)
    return elasticity.prolongation.restrict(volumes)[:, 0]


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
                    rule = gauss_rule(space.degree, order, face, more=1, parts=1 if face is None else 2)
                    for _, _, values in integrands(space.forest, leaves, order, force.at, face, rule):
                        total[:3] += values.sum(axis=(0, 1))
                        total[3] += np.linalg.norm(values, axis=2).sum()
    return totals


def body_force(scene: Scene, elasticity: Elasticity) -> fem.Function | None:
    """Density of the body forces of a scene [N/m^3], interpolated at the nodes of each cell; None: there are none.

    Collective on the mesh's communicator.  Raises errors as `load`.
    """
    if not scene.body_forces:
        return None
    space = elasticity.prolongation.space
    return elasticity.of_cells(sum_at_nodes(scene.body_forces, space, elasticity.leaf_mesh, (3,)))


def _loads(scene: Scene) -> tuple[_Load, ...]:
    return *scene.tractions, *scene.body_forces


def _places(forest: Forest, force: _Load) -> Iterator[tuple[IntArray, int | None]]:
    """Leaves (n,) of this rank under a load, with each local face; None for the volume."""
    if isinstance(force, BodyForce):
        yield np.flatnonzero(np.isin(forest.cell, forest.mesh.cells_of(force.body))), None
        return
    yield from faces_on(forest, force.surface)
