"""Model warnings of a scene itself, whatever its solution: loads that conditions hold, bodies left free on a plane."""

import numpy as np

from fx_contact.adaptive.validity import LARGE, MISSED, ModelWarning
from fx_contact.parallel.validation import percent
from fx_contact.problem.boundary_conditions import PLANE, RigidMotion, SymmetryPlane
from fx_contact.problem.scene import Scene


def warnings_of(scene: Scene) -> list[ModelWarning]:
    """Violated assumptions of a scene.  Local."""
    return [*_held_loads(scene), *_large_rotations(scene), *_free_on_planes(scene)]


def _large_rotations(scene: Scene) -> list[ModelWarning]:
    """Prescribed rotations that are not small."""
    warnings = []
    for condition in scene.dirichlet:
        angle = float(np.linalg.norm(condition.rotation)) if isinstance(condition, RigidMotion) else 0.0
        if angle > LARGE:
            message = (
                f"the rotation by {np.degrees(angle):.2g} degrees prescribed on {condition.where!r} is that of linear "
                f"elasticity, which lengthens lines across its axis by {percent(angle**2 / 2)}; limit "
                f"{np.degrees(LARGE):.2g} degrees"
            )
            warnings.append(ModelWarning("large rotation", angle, LARGE, condition.where, message))
    return warnings


def _held_loads(scene: Scene) -> list[ModelWarning]:
    """Surface forces and elastic supports of which a part acts on prescribed displacements of its surface."""
    message = (
        "{} acts by {:.0%} on displacements that conditions on its surface prescribe, where it moves nothing; limit "
        "{:.0%}: name surfaces apart, or leave that part out"
    )
    return [
        ModelWarning("held load", share, MISSED, load.surface, message.format(load.what, share, MISSED))
        for load, share in zip((*scene.tractions, *scene.springs), scene.held_shares)
        if share > MISSED
    ]


def _free_on_planes(scene: Scene) -> list[ModelWarning]:
    """Bodies with facets on a mirror of the scene, none of which has a SymmetryPlane."""
    mesh, warnings = scene.mesh, list[ModelWarning]()
    if scene.mirrors.parts == 1:
        return warnings
    outside = np.argwhere(mesh.face_neighbours == 1)
    rounding = PLANE * np.ptp(mesh.points, axis=0).max()
    held = np.zeros(mesh.faces.shape, dtype=bool)
    for condition in scene.dirichlet:
        if isinstance(condition, SymmetryPlane):
            held[tuple(mesh.surface(condition.surface).T)] = True
    for normal, at in zip(scene.mirrors.normals, scene.mirrors.at):
        heights = mesh.facet_points(outside, order=1) @ normal - at
        there = outside[(np.abs(heights) <= rounding).all(axis=1)]
        bodies = mesh.body[there[:, 0]]
        for body in np.setdiff1d(bodies, bodies[held[tuple(there.T)]]):
            count, name = int((bodies == body).sum()), mesh.bodies[body]
            message = (
                f"body {name!r} has {count} root facets on the symmetry plane with the normal {normal.round(6)}, and "
                "no SymmetryPlane there: its mirror image may pass through it; name these facets"
            )
            warnings.append(ModelWarning("free on a plane", float(count), 0.0, name, message))
    return warnings
