"""Prescribed displacements and symmetry planes of a scene on the conforming unknowns of a forest."""

import numpy as np
from mpi4py import MPI

from fx_contact.fem.supports import Supports
from fx_contact.parallel.mpi import together
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import merged
from fx_contact.problem.lattice import SIDE

#: Two conditions that prescribe one component agree where they differ by no more, relative to the largest of all:
#: positions of vertices between the nodes of the root mesh are rounded.
_SAME = 1e-9
#: A facet is plane across an axis up to this part of its size.
_FLAT = 1e-9


def find_supports(scene, forest, prolongation):
    """What the displacement conditions of a scene hold at this rank's conforming nodes.

    Collective on forest.comm.  Hanging nodes have none of their own.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        Supports at the owned conforming nodes.

    Raises:
        SceneError: a displacement that is a function fails or is not finite somewhere, or two conditions prescribe
            different values at one vertex.
    """
    with together(forest.comm):
        said = [_said(condition, scene, prolongation) for condition in scene.conditions]
    largest = max((np.nanmax(np.abs(values), initial=0.0) for _, values in said), default=0.0)
    same = _SAME * forest.comm.allreduce(largest, op=MPI.MAX)
    result = np.full((prolongation.owned, 3), np.nan)
    for condition, (at, values) in zip(scene.conditions, said):
        # The owner of a node need not have a leaf face on the surface: ranks that have one tell it.
        mean = prolongation.averaged(at, values)
        ours = np.flatnonzero(~np.isnan(mean).all(axis=1))
        with together(forest.comm):
            result[ours] = merged(
                result[ours], condition, mean[ours], same, lambda row: _position(prolongation, ours[row])
            )
    return Supports(result)


def held_nodes(scene, prolongation):
    """The nodes that each condition of a scene holds.

    Collective on prolongation.comm.

    Args:
        scene: Scene.
        prolongation: Prolongation of a Space on a forest of its root mesh.

    Returns:
        list of (k,) int64, for each of `scene.conditions` the conforming nodes that this rank owns of those it is on.
    """
    on = prolongation.zeros(len(scene.conditions))
    for column, condition in enumerate(scene.conditions):
        on[prolongation.conforming[_conforming_at(scene, prolongation, condition.where)], column] = 1
    return [np.flatnonzero(column) for column in prolongation.summed(on).T]


def _said(condition, scene, prolongation):
    """What a condition says of this rank's conforming nodes: (n,) their positions in the index map, (n, 3) [m]."""
    here = _conforming_at(scene, prolongation, condition.where)
    return prolongation.conforming[here], condition.at(prolongation.space.positions(here))


def _conforming_at(scene, prolongation, where):
    """This rank's conforming nodes at a named place: (n,) positions in the Space."""
    here = np.unique(_nodes_at(scene, prolongation.space, where))
    return here[~prolongation.hanging[here]]


def _position(prolongation, node):
    """Where an owned conforming node is: (3,) float64 [m]."""
    return prolongation.space.positions(np.flatnonzero(prolongation.conforming == node))[0]


def shear_free_components(scene, forest, prolongation):
    """Where a plane across an axis is held in that direction only: no shear stress acts there, as by symmetry.

    Collective on forest.comm.  What counts is all that is prescribed of a facet, in however many conditions.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        (owned, 3) bool, for each conforming node the directions in which it lies on such a plane.
    """
    mesh, space = forest.mesh, prolongation.space
    on = np.zeros((len(space), 3))
    held, loaded = np.zeros((len(mesh.cells), 6, 3), dtype=bool), np.zeros((len(mesh.cells), 6), dtype=bool)
    for condition in scene.conditions:
        if condition.where in mesh.surfaces:
            held[tuple(mesh.surfaces[condition.where].T)] |= condition.held
    for traction in scene.tractions:
        loaded[tuple(mesh.surfaces[traction.surface].T)] = True
    alone = (held.sum(axis=2) == 1) & ~loaded
    for axis in range(3):
        facets = np.argwhere(alone & held[:, :, axis])
        extent = np.ptp(mesh.facet_points(facets), axis=1)
        on[_nodes_on(space, facets[extent[:, axis] <= _FLAT * extent.max(axis=1)]), axis] = 1
    on[prolongation.hanging] = 0
    return prolongation.restrict(on) > 0


def _nodes_at(scene, space, name):
    """This rank's nodes on a named surface or curve, or at a named vertex, of the root mesh."""
    forest, mesh = space.forest, space.forest.mesh
    if name in mesh.surfaces:
        return _nodes_on(space, mesh.surfaces[name])
    if name in mesh.curves:
        leaf, edge = forest.boundary_edges(mesh.curves[name])
        return space.cells[leaf[:, None], space.edge_nodes[edge]]
    cell, corner = np.nonzero(np.isin(mesh.corners, scene.place(name)))
    points = (SIDE * hexahedron.CORNERS[corner])[:, None]
    place = space.find(forest.lattice.keys(cell, points)[:, 0])
    return place[place >= 0]


def _nodes_on(space, facets):
    """This rank's nodes of the leaf faces on facets (n, 2) of the root mesh: (m, (p+1)^2)."""
    return space.on_faces(*space.forest.boundary_faces(facets))
