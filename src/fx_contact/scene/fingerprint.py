"""Fingerprint of a scene, for comparison between ranks and with a checkpoint."""

import hashlib
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import evaluated
from fx_contact.parallel.arrays import FloatArray
from fx_contact.scene.scene import Scene

#: Items of a scene that are compared, by their names in messages.
_ITEMS = {
    "displacement conditions": "dirichlet",
    "contact pairs": "contact",
    "tractions": "tractions",
    "body forces": "body_forces",
    "ties": "ties",
    "rigid loads": "rigid_loads",
    "stress-free strains": "strains",
    "elastic supports": "springs",
}


def scene_parts(scene: Scene) -> dict[str, Any]:
    """Parts of a scene for JSON, with digests of the root mesh and of the values of functions of position.  Local."""
    centre = () if scene.contact_centre is None else scene.contact_centre
    return {
        "root mesh": mesh_digest(scene.mesh),
        "materials": {name: item_fields(scene.mesh, material) for name, material in scene.materials.items()},
        **{title: [item_fields(scene.mesh, item) for item in getattr(scene, name)] for title, name in _ITEMS.items()},
        "symmetry": [int(scene.symmetry), *map(float, centre)],
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


def item_fields(mesh: RootMesh, item: Any, place: str | None = None) -> list[Any]:
    """Class and fields of an item for JSON; digests of functions by their values at samples of a place.

    Local.  By default the place is the first field of the item.  Raises SceneError as `evaluated`.
    """
    values = [getattr(item, one.name) for one in fields(item)]
    result: list[Any] = [type(item).__name__]
    for value in values:
        if value is None or isinstance(value, str):
            result.append(value)
        elif callable(value):
            points = mesh.samples(place or values[0])
            given = value(points.T.copy())
            what = f"what is prescribed on {place or values[0]!r}"
            result.append(_digest(evaluated(what, lambda _, given=given: given, points, *np.shape(given)[:-1])))
        elif is_dataclass(value):
            result += item_fields(mesh, value, values[0])
        else:
            result += (entry if isinstance(entry, str) else float(entry) for entry in np.ravel(value).tolist())
    return result


def _digest(values: FloatArray) -> str:
    """Digest of the values of a function, rounded to 1e-9 of the largest."""
    size = np.abs(values).max(initial=0.0)
    rounded = np.rint(values / size * 1e9 if size else values).astype(np.int64)
    digest = hashlib.sha256(repr(float(f"{size:.9g}")).encode() + rounded.tobytes())
    return f"function {digest.hexdigest()[:16]}"
