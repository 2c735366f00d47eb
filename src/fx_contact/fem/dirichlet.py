"""Prescribed displacements and symmetry planes of a scene on the conforming unknowns of a forest."""

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.mpi import together
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import Prescribed
from fx_contact.problem.lattice import SIDE

#: Two conditions that prescribe one component agree where they differ by no more, relative to the largest of all:
#: positions of vertices between the nodes of the root mesh are rounded.
_SAME = 1e-9
#: A facet is plane across an axis up to this part of its size.
_FLAT = 1e-9


def prescribed_displacements(scene, forest, prolongation):
    """Prescribed displacement components at this rank's conforming vertices.

    Collective on forest.comm.  Hanging vertices have none of their own.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        (owned, 3) float64 [m], NaN where the component is free.

    Raises:
        SceneError: a displacement that is a function fails or is not finite somewhere, or two conditions prescribe
            different values at one vertex.
    """
    with together(forest.comm):
        said = [_said(condition, scene, forest, prolongation) for condition in scene.conditions]
    largest = max((np.nanmax(np.abs(values), initial=0.0) for _, values in said), default=0.0)
    result = Prescribed(prolongation.owned, _SAME * forest.comm.allreduce(largest, op=MPI.MAX))
    imap = prolongation.index_map
    for condition, (at, values) in zip(scene.conditions, said):
        # The owner of a vertex need not have a leaf face on the surface: ranks that have one tell it.
        sums = np.zeros((imap.size_local + imap.num_ghosts, 4))
        sums[at] = np.column_stack([np.nan_to_num(values), np.ones(len(at))])
        total = prolongation.summed(sums)
        ours = np.flatnonzero(total[:, 3])
        mean = np.where(condition.held, total[ours, :3] / total[ours, 3:], np.nan)
        with together(forest.comm):
            result.add(condition.where, ours, mean, lambda vertex: _position(forest, prolongation, vertex))
    return result.values


def _said(condition, scene, forest, prolongation):
    """What a condition says of this rank's conforming vertices: (n,) their positions in the index map, (n, 3) [m]."""
    vertices = forest.vertices
    here = np.unique(_vertices_at(scene, forest, condition.where))
    here = here[~prolongation.hanging[here]]
    return prolongation.conforming[here], condition.at(forest.positions(*vertices.example[here].T))


def _position(forest, prolongation, vertex):
    """Where an owned conforming vertex is: (3,) float64 [m]."""
    (here,) = np.flatnonzero(prolongation.conforming == vertex)
    return forest.positions(*forest.vertices.example[[here]].T)[0]


def shear_free_components(scene, forest, prolongation):
    """Where a plane across an axis is held in that direction only: no shear stress acts there, as by symmetry.

    Collective on forest.comm.  What counts is all that is prescribed of a facet, in however many conditions.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        (owned, 3) bool, for each conforming vertex the directions in which it lies on such a plane.
    """
    mesh, on = forest.mesh, np.zeros((len(forest.vertices), 3))
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
        on[_corners_of(forest, facets[extent[:, axis] <= _FLAT * extent.max(axis=1)]), axis] = 1
    on[prolongation.hanging] = 0
    return prolongation.restrict(on) > 0


def _vertices_at(scene, forest, name):
    """This rank's vertices on a named surface or curve, or at a named vertex, of the root mesh."""
    mesh = forest.mesh
    if name in mesh.surfaces:
        return _corners_of(forest, mesh.surfaces[name])
    if name in mesh.curves:
        leaf, edge = forest.boundary_edges(mesh.curves[name])
        return forest.vertices.cells[leaf[:, None], hexahedron.EDGE_CORNERS[edge]]
    cell, corner = np.nonzero(np.isin(mesh.corners, scene.place(name)))
    points = (SIDE * hexahedron.CORNERS[corner])[:, None]
    place = forest.vertices.find(forest.lattice.keys(cell, points)[:, 0])
    return place[place >= 0]


def _corners_of(forest, facets):
    """This rank's vertices at the corners of the leaves on facets (n, 2) of the root mesh: (m, 4)."""
    leaf, face = forest.boundary_faces(facets)
    return forest.vertices.cells[leaf[:, None], hexahedron.FACE_CORNERS[face]]
