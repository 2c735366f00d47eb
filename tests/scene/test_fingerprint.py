"""Fingerprints: whatever a scene asks for is in its own, so that a restart of another problem is refused."""

from dataclasses import fields, replace

import numpy as np
import pytest

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Elastic,
    InitialStrain,
    Material,
    Pressure,
    RigidMotion,
    Scene,
    SymmetryPlane,
    ThermalStrain,
    Traction,
    block,
    root_mesh_from_shapes,
)
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.scene.fingerprint import mesh_digest, scene_parts

#: The nodes of a cell of order 1, turned by half a turn about z.
TURNED = [3, 2, 1, 0, 7, 6, 5, 4]


def two_cubes():
    """A cube on another one, with names for surfaces, a vertex and an edge."""
    cube = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)
    surfaces = {"bottom": "lower bottom", "head": "lower top", "foot": "upper bottom", "top": "upper top"}
    surfaces["lid"] = surfaces["top"]
    mesh = root_mesh_from_shapes({"lower": cube, "upper": cube.shifted(z=1)}, surfaces)
    return replace(mesh, curves={"edge": [[0, 8]]}, vertices={"corner": [15]})


def complete(mesh):
    """A scene that has one of each kind of condition and load."""
    return Scene(
        "two cubes",
        mesh,
        {"lower": Material(1.0, 0.3), "upper": Material(2.0, 0.2)},
        (
            Dirichlet("bottom", 0.0, 0.0, 0.0),
            Dirichlet("foot", 0.0, 0.0),
            SymmetryPlane("upper right"),
            Dirichlet("upper back", y=0.0, z=0.0),
        ),
        (ContactPair("head", "foot", direction=(0.0, 0.0, 1.0)),),
        (Traction("lid", (0.01, 0.0, 0.0)), Pressure("lid", 0.01)),
        symmetry=2,
        contact_centre=(0.5, 0.5, 1.0),
        body_forces=(BodyForce("upper", (0.0, 0.0, 0.01)),),
        strains=(ThermalStrain("upper", 1e-5, 20.0), InitialStrain("upper", 1e-3 * np.eye(3))),
        springs=(Elastic("upper left", 1.0, 1.0, 1.0, 1.0),),
    )


MESH = two_cubes()
SCENE = complete(MESH)
#: Another value of each field of a mesh,
OF_MESH = {
    "points": MESH.points * [1.0, 1.0, 1.1],
    "cells": MESH.cells[:, TURNED],
    "bodies": ("base", "upper"),
    "body": 1 - MESH.body,
    "surfaces": dict(MESH.surfaces) | {"lid": MESH.surfaces["bottom"]},
    "vertices": {"corner": [14]},
    "curves": {"edge": [[0, 9]]},
    "parts": {"coating": [0]},
}
#: of a scene, but for the name, which is that of its records, and the names of units,
OF_SCENE = {
    "mesh": replace(MESH, points=MESH.points * 2),
    "materials": dict(SCENE.materials) | {"lower": Material(1.5, 0.3)},
    "dirichlet": SCENE.dirichlet[:3],
    "contact": (replace(SCENE.contact[0], clearance=0.01),),
    "tractions": SCENE.tractions[:1],
    "symmetry": 1,
    "contact_centre": (0.5, 0.5, 2.0),
    "body_forces": (),
    "strains": (),
    "springs": (),
}
#: and of each thing that a scene holds: where it is, and its fields.
OF_PARTS = {
    Dirichlet: ("dirichlet", {"where": "head", "x": 0.01, "y": 0.01, "z": 0.01}),
    SymmetryPlane: ("dirichlet", {"surface": "lower right"}),
    ContactPair: ("contact", {"first": "top", "second": "bottom", "direction": None, "friction": 0.3}),
    Traction: ("tractions", {"surface": "upper left", "value": (0.01, 0.0, 0.01)}),
    Pressure: ("tractions", {"surface": "upper left", "value": 0.02}),
    Elastic: ("springs", {"surface": "lower left", "normal": 2.0, "x": None, "y": 2.0, "z": 2.0}),
    BodyForce: ("body_forces", {"body": "lower", "value": (0.0, 0.01, 0.01)}),
    ThermalStrain: ("strains", {"part": "lower", "expansion": 2e-5, "change": 30.0}),
    InitialStrain: ("strains", {"part": "lower", "value": 2e-3 * np.eye(3)}),
    Material: ("materials", {"young": 3.0, "poisson": 0.25}),
}


def with_part(kind, place, /, **entries):
    """The scene with entries of the first of its parts of a kind changed."""
    parts = getattr(SCENE, place)
    if place == "materials":
        return replace(SCENE, materials=parts | {"upper": replace(parts["upper"], **entries)})
    one = next(index for index, value in enumerate(parts) if isinstance(value, kind))
    return replace(SCENE, **{place: (*parts[:one], replace(parts[one], **entries), *parts[one + 1 :])})


def test_nothing_is_forgotten():
    """The tables above have all fields of a scene and of what hangs off it."""
    tables = {RootMesh: OF_MESH, Scene: {"name": None, "units": None} | OF_SCENE}
    tables |= {part: entries for part, (_, entries) in OF_PARTS.items()}
    in_contact = {ContactPair: {"moved", "clearance", "force"}, Scene: {"ties", "rigid_loads"}}  # of tests/contact
    for kind, table in tables.items():
        assert {one.name for one in fields(kind)} - in_contact.get(kind, set()) == table.keys(), kind
    held = [*SCENE.dirichlet, *SCENE.contact, *SCENE.tractions, *SCENE.body_forces, *SCENE.springs, *SCENE.strains]
    assert {type(one) for one in (*held, *SCENE.materials.values())} == OF_PARTS.keys()


def test_every_field_counts():
    """Where one field alone is another one the fingerprint is; a scene made alike has the same."""
    before, digest = scene_parts(SCENE), mesh_digest(MESH)
    assert scene_parts(replace(complete(two_cubes()), name="other")) == before
    meshes = {name: replace(MESH, **{name: value}) for name, value in OF_MESH.items()}
    assert not [name for name, mesh in meshes.items() if mesh_digest(mesh) == digest]
    scenes = {("scene", name): replace(SCENE, **{name: value}) for name, value in OF_SCENE.items()}
    for part, (place, entries) in OF_PARTS.items():
        scenes |= {(part.__name__, name): with_part(part, place, **{name: value}) for name, value in entries.items()}
    scenes["a plane that is held"] = replace(
        SCENE, dirichlet=(*SCENE.dirichlet[:2], Dirichlet("upper right", x=0.0), SCENE.dirichlet[3])
    )
    assert not [name for name, scene in scenes.items() if scene_parts(scene) == before]


@pytest.mark.parametrize("amount, same", [(1e-11, True), (1e-7, False)])
def test_positions_are_rounded(amount, same):
    """What another machine rounds otherwise is the same mesh: nine digits of its size count."""
    moved = MESH.points + amount * np.cos(np.arange(MESH.points.size)).reshape(-1, 3)
    assert (mesh_digest(replace(MESH, points=moved)) == mesh_digest(MESH)) == same


def test_rigid_motions():
    """Each field of a motion counts, at functions of position; one made alike is the same."""
    motion = RigidMotion("top", (0.0, 0.0, -0.01), (0.0, 0.01, 0.0), (0.5, 0.5, 2.0))

    def parts(motion):
        """Of the scene without planes, contact and surface forces."""
        held = Dirichlet("bottom", 0.0, 0.0, 0.0)
        return scene_parts(replace(SCENE, dirichlet=(held, motion), symmetry=1, springs=(), contact=(), tractions=()))

    known = [parts(motion), parts(RigidMotion("upper back", (0.0, 0.0, -0.01), (0.0, 0.01, 0.0), (0.5, 0.5, 2.0)))]
    others = {"translation": (0.0, 0.01, -0.01), "rotation": (0.0, 0.01, 0.01), "centre": (0.5, 0.5, 1.0)}
    known += [parts(replace(motion, **{name: value})) for name, value in others.items()]
    assert all(one != other for index, one in enumerate(known) for other in known[:index])
    assert parts(replace(motion)) == known[0]
