"""Fingerprint of a scene, for comparison between ranks and with a checkpoint."""

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import ScalarValue, SymmetryPlane, Traction, VectorValue, evaluated
from fx_contact.items.contact import Contact, ContactPair
from fx_contact.items.elastic_support import Elastic
from fx_contact.items.obstacles import RigidSurface
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.scene.scene import Scene


def scene_parts(scene: Scene) -> dict[str, Any]:
    """Parts of a scene for JSON, with digests of the root mesh and of the values of functions of position.  Local."""
    return {
        "root mesh": mesh_digest(scene.mesh),
        "materials": {name: material.data for name, material in scene.materials.items()},
        "displacement conditions": [
            (
                [c.surface, "symmetry plane"]
                if isinstance(c, SymmetryPlane)
                else _given(scene, c.where, 1, c.x, c.y, c.z)
            )
            for c in scene.dirichlet
        ],
        "contact pairs": [_of_contact(scene, c) for c in scene.contact],
        "tractions": [
            _given(scene, t.surface, 3 if isinstance(t, Traction) else 1, t.value) for t in scene.tractions
        ],
        "body forces": [_given(scene, f.body, 3, f.value) for f in scene.body_forces],
        **({"ties": [tie.data for tie in scene.ties]} if scene.ties else {}),
        **({"rigid loads": [load.data for load in scene.rigid_loads]} if scene.rigid_loads else {}),
        **({"stress-free strains": [_of_strain(scene, strain) for strain in scene.strains]} if scene.strains else {}),
        **({"elastic supports": [_of_support(support) for support in scene.springs]} if scene.springs else {}),
        "symmetry": [int(scene.symmetry), *_floats(() if scene.contact_centre is None else scene.contact_centre)],
    }


def mesh_digest(mesh: RootMesh) -> str:
    """Digest of a root mesh.

    Local.  Positions are rounded to 1e-9 of the mesh's size, since Gmsh rounds differently on other machines.
    """
    size = np.ptp(mesh.points, axis=0).max()
    digest = hashlib.sha256(repr([mesh.bodies, float(f"{size:.9g}")]).encode())
    for array in (np.rint(mesh.points / size * 1e9), mesh.cells, mesh.body):
        digest.update(np.ascontiguousarray(array, np.int64))
    for kind in (mesh.surfaces, mesh.vertices, mesh.curves, mesh.parts):
        for name in sorted(kind):
            digest.update(repr([name, np.shape(kind[name])]).encode())
            digest.update(np.ascontiguousarray(kind[name], np.int64))
    return digest.hexdigest()[:16]


def same_mesh(one: RootMesh, other: RootMesh) -> bool:
    """True for root meshes of one digest.  Local."""
    return one is other or mesh_digest(one) == mesh_digest(other)


def _of_contact(scene: Scene, contact: Contact) -> list[Any]:
    """A contact for JSON, with digests of the functions of an obstacle by their values at samples of the surface."""
    if not isinstance(contact, ContactPair) or not isinstance(contact.obstacle, RigidSurface):
        return contact.data
    return [
        *contact.data,
        *_given(scene, contact.first, 1, lambda x: contact.distances(x.T)[0]),
        *_given(scene, contact.first, 3, lambda x: contact.distances(x.T)[1].T),
    ]


def _of_strain(scene: Scene, strain: ThermalStrain | InitialStrain) -> list[Any]:
    """A strain for JSON, with a digest of its values at samples of the part."""
    return _given(scene, strain.part, 9, lambda x: strain.at(x.T).reshape(-1, 9).T)


def _of_support(support: Elastic) -> list[Any]:
    """An elastic support for JSON."""
    stiffness = (support.normal, support.x, support.y, support.z)
    return [support.surface, *(None if value is None else float(value) for value in stiffness)]


def _given(scene: Scene, name: str, components: int, *values: ScalarValue | VectorValue | None) -> list[Any]:
    """A place and its prescribed values for JSON: numbers, or digests of functions by their values at its samples."""
    result: list[Any] = [name]
    for value in values:
        if not callable(value):
            result.append(None if value is None else _floats(np.atleast_1d(value)))
            continue
        found = evaluated(f"what is prescribed on {name!r}", value, scene.mesh.samples(name), components)
        size = np.abs(found).max()
        rounded = np.rint(found / size * 1e9 if size else found).astype(np.int64)
        digest = hashlib.sha256(repr(float(f"{size:.9g}")).encode() + rounded.tobytes())
        result.append(f"function {digest.hexdigest()[:16]}")
    return result


def _floats(values: Iterable[float]) -> list[float]:
    return [float(value) for value in values]
