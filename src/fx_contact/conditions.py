"""Prescribed displacements and symmetry planes of a scene on the conforming unknowns of a forest."""

import numpy as np

from fx_contact import reference
from fx_contact._mpi import together
from fx_contact.lattice import SIDE


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
        SceneError: a displacement that is a function fails or is not finite somewhere.
    """
    vertices = forest.vertices
    sums = np.zeros((len(vertices), 6))
    with together(forest.comm):
        for condition in scene.conditions:
            at = np.zeros(len(vertices), dtype=bool)
            at[_vertices_at(scene, forest, condition.where)] = True
            rows, held = np.flatnonzero(at & ~prolongation.hanging), np.flatnonzero(condition.held)
            leaf, corner = vertices.example[rows].T
            points = forest.mesh.evaluate(forest.cell[leaf], forest.corner_coordinates(leaf, corner))[:, 0]
            sums[np.ix_(rows, held)] = condition.at(points)[:, held]
            sums[np.ix_(rows, 3 + held)] = 1
    # The owner of a vertex need not have a leaf face on the surface: ranks that have one tell it.
    total = prolongation.restrict(sums)
    with np.errstate(invalid="ignore"):
        return np.where(total[:, 3:] > 0, total[:, :3] / total[:, 3:], np.nan)


def shear_free_components(scene, forest, prolongation):
    """Where a plane across an axis is held in that direction only: no shear stress acts there, as by symmetry.

    Collective on forest.comm.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.

    Returns:
        (owned, 3) bool, for each conforming vertex the directions in which it lies on such a plane.
    """
    on = np.zeros((len(forest.vertices), 3))
    loaded = {traction.surface for traction in scene.tractions}
    for condition in scene.conditions:
        held = np.flatnonzero(condition.held)
        if len(held) == 1 and condition.where in forest.mesh.surfaces and condition.where not in loaded:
            normals = forest.mesh.outward_normals(forest.mesh.surfaces[condition.where])
            if np.allclose(np.abs(normals[:, held[0]]), 1):
                on[_vertices_at(scene, forest, condition.where), held[0]] = 1
    on[prolongation.hanging] = 0
    return prolongation.restrict(on) > 0


def _vertices_at(scene, forest, name):
    """This rank's vertices on a named surface or curve, or at a named vertex, of the root mesh."""
    mesh = forest.mesh
    if name in mesh.surfaces:
        leaf, face = forest.boundary_faces(mesh.surfaces[name])
        return forest.vertices.cells[leaf[:, None], reference.FACE_CORNERS[face]]
    if name in mesh.curves:
        leaf, edge = forest.boundary_edges(mesh.curves[name])
        return forest.vertices.cells[leaf[:, None], reference.EDGE_CORNERS[edge]]
    cell, corner = np.nonzero(np.isin(mesh.corners, scene.place(name)))
    points = (SIDE * reference.CORNERS[corner])[:, None]
    place = forest.vertices.find(forest.lattice.keys(cell, points)[:, 0])
    return place[place >= 0]
