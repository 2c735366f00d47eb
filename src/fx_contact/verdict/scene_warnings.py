"""Model warnings of a scene itself, whatever its solution: loads that do not act, bodies left free on a plane."""

from collections.abc import Iterator

import numpy as np

from fx_contact.geometry.hexahedral_mesh import PLANE
from fx_contact.items.boundary_conditions import RigidMotion, called
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.validation import percent
from fx_contact.scene.held_loads import held_across
from fx_contact.scene.mirrors import mirror_group
from fx_contact.scene.rigid_faces import RigidFace
from fx_contact.scene.scene import Scene
from fx_contact.verdict.model_warning import LARGE, MISSED, ModelWarning

#: Largest ratio of moduli in one unit: steel on rubber of 2 MPa has 1e5; Pa taken for MPa make 1e6 [-].
UNLIKE = 1e5


def warnings_of(scene: Scene) -> list[ModelWarning]:
    """Violated assumptions of a scene.  Local."""
    of_loads = *_held_loads(scene), *_zero_loads(scene), *_loads_on_contact(scene)
    return [*of_loads, *_large_rotations(scene), *_free_on_planes(scene), *_unlike_moduli(scene)]


def _unlike_moduli(scene: Scene) -> list[ModelWarning]:
    """Moduli that seem to be in several units, unless the scene names its unit, in which all are materials."""
    young = {name: scene.materials[name].isotropic.young for name in scene.mesh.regions}
    soft, hard = min(young, key=young.__getitem__), max(young, key=young.__getitem__)
    ratio = young[hard] / young[soft]
    if ratio <= UNLIKE or scene.units is not None:
        return []
    message = (
        f"{hard!r} is {ratio:.3g} times as stiff as {soft!r}, as if one modulus were in Pa and the other in MPa; limit "
        f"{UNLIKE:g}, from which on a body is as good as rigid; `Scene(units=...)` checks each modulus instead"
    )
    return [ModelWarning("unlike moduli", ratio, UNLIKE, hard, message)]


def _large_rotations(scene: Scene) -> Iterator[ModelWarning]:
    """Prescribed rotations that are not small."""
    for condition in scene.dirichlet:
        angle = float(np.linalg.norm(condition.rotation)) if isinstance(condition, RigidMotion) else 0.0
        if angle > LARGE:
            message = (
                f"the rotation by {np.degrees(angle):.2g} degrees prescribed on {condition.where!r} is that of linear "
                f"elasticity, which lengthens lines across its axis by {percent(angle**2 / 2)}; limit "
                f"{np.degrees(LARGE):.2g} degrees"
            )
            yield ModelWarning("large rotation", angle, LARGE, condition.where, message)


def _held_loads(scene: Scene) -> Iterator[ModelWarning]:
    """Surface forces and elastic supports of which a part acts on prescribed displacements of its surface."""
    for load, share in zip((*scene.tractions, *scene.springs), scene.held_shares):
        if share > MISSED:
            message = (
                f"{load.what} acts by {share:.0%} on displacements that conditions on its surface prescribe, where "
                f"it moves nothing; limit {MISSED:.0%}: name surfaces apart, or leave that part out"
            )
            yield ModelWarning("held load", share, MISSED, load.surface, message)


def _zero_loads(scene: Scene) -> Iterator[ModelWarning]:
    """Loads, and stress-free strains, that are zero at all sampling points."""
    for load in (*scene.tractions, *scene.body_forces, *scene.strains):
        value = called(load.what, load.value, scene.mesh.samples(load.place)) if callable(load.value) else load.value
        if not np.any(value):
            message = f"{load.what} is zero everywhere and has no effect; check its value"
            yield ModelWarning("zero load", 0.0, 0.0, load.place, message)


def _loads_on_contact(scene: Scene) -> Iterator[ModelWarning]:
    """Surface forces and elastic supports of which a part acts on contact or tied surfaces."""
    mesh, every = scene.mesh, scene.contact_surfaces.every
    loads = [load for load in (*scene.tractions, *scene.springs) if every[tuple(mesh.surface(load.surface).T)].any()]
    joined = _joined(scene) if loads else every
    for load in loads:
        facets = mesh.surface(load.surface)
        area = mesh.facet_areas(facets)
        share = float(area @ joined[tuple(facets.T)] / area.sum())
        if share > MISSED:
            message = (
                f"{load.what} acts by {share:.0%} of its area on contact or tied surfaces, also where they are closed; "
                f"limit {MISSED:.0%}: name another surface"
            )
            yield ModelWarning("load on contact", share, MISSED, load.surface, message)


def _joined(scene: Scene) -> FloatArray:
    """(ncells, 6), parts of root facets on contact and tied surfaces; of those meshed apart the part that faces any."""
    result: FloatArray = np.zeros(scene.mesh.faces.shape)
    for index, interface in enumerate(scene.interfaces):
        if index in scene.nonmatching:
            for surfaces in (scene.nonmatching[index], scene.nonmatching[index].reversed()):
                np.maximum.at(result, tuple(surfaces.first.facets.T), (surfaces.faced_samples >= 0).mean(axis=1))
        elif not isinstance(interface, RigidFace):
            result[scene.contact_surfaces.on(index)] = 1.0
    return result


def _free_on_planes(scene: Scene) -> list[ModelWarning]:
    """Bodies with facets on a plane of symmetry, none of which a condition holds along its normal.

    Mirrors of SymmetryPlanes first; if these make too few copies, other planes without normal displacement, unless
    enough of them are held by all bodies.
    """
    mirrors = scene.mirrors
    if mirrors.parts == scene.symmetry:
        return [free for row, at in zip(mirrors.normals, mirrors.at) for free in _free_on(scene, np.asarray(row), at)]
    warnings, held = list[ModelWarning](), list[FloatArray]()
    for name, normal in scene.symmetry_planes:
        at = float((scene.mesh.facet_points(scene.mesh.surface(name), order=1) @ normal).mean())
        free = [*_free_on(scene, normal, at)]
        warnings += free
        held += [normal] if not free else []
    return [] if len(mirror_group(np.array(held).reshape(-1, 3), scene.symmetry)) >= scene.symmetry else warnings


def _free_on(scene: Scene, normal: FloatArray, at: float) -> Iterator[ModelWarning]:
    """Bodies with facets on a plane with a normal (3,) at a place along it [m], none of which is held there."""
    mesh = scene.mesh
    outside = np.argwhere(mesh.face_neighbours == 1)
    heights = mesh.facet_points(outside, order=1) @ normal - at
    there = outside[(np.abs(heights) <= PLANE * np.ptp(mesh.points, axis=0).max()).all(axis=1)]
    held = np.einsum("i,nij,j->n", normal, held_across(mesh, scene.conditions, there), normal) > PLANE
    bodies = mesh.body[there[:, 0]]
    for body in np.setdiff1d(bodies, bodies[held]):
        count, name = int((bodies == body).sum()), mesh.bodies[body]
        message = (
            f"body {name!r} has {count} root facets on the symmetry plane with the normal {normal.round(6)}, and "
            "no SymmetryPlane there: its mirror image may pass through it; name these facets"
        )
        yield ModelWarning("free on a plane", float(count), 0.0, name, message)
