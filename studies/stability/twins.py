"""Twins of a scene, whose solutions follow from its own: in other units, turned, or with surfaces exchanged.

All functions are local.
"""

from dataclasses import replace

import numpy as np

from fx_contact import (
    Dirichlet,
    Material,
    RigidCone,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    SceneError,
    SymmetryPlane,
    Traction,
    Tresca,
)

#: Entries of obstacles that are points, directions and lengths.
_POINTS = {RigidPlane: "point", RigidSphere: "centre", RigidCylinder: "point", RigidCone: "apex"}
_DIRECTIONS = {RigidPlane: "normal", RigidCylinder: "axis", RigidCone: "axis"}
_LENGTHS = {RigidSphere: "radius", RigidCylinder: "radius"}


def scaled(scene, length=1.0, stress=1.0):
    """The scene in other units: forces grow by stress x length^2, displacements by length.

    Args:
        scene: Scene.
        length: factor of all lengths [-].
        stress: factor of moduli and tractions [-].
    """

    def times(factor, value):
        """A value or a function of position in the other units."""
        if value is None or callable(value):
            return value and (lambda x: factor * np.asarray(value(x / length)))
        return tuple(factor * float(v) for v in value) if np.ndim(value) else factor * float(value)

    def larger(pair):
        """A contact whose obstacle, motion, clearance and bound of friction are in the other units."""
        moved, clearance = times(length, pair.moved), times(length, pair.clearance)
        friction = Tresca(stress * pair.friction.bound) if isinstance(pair.friction, Tresca) else pair.friction
        second = _changed(pair.second, (_POINTS, _LENGTHS), lambda value: times(length, value))
        return replace(pair, second=second, moved=moved, clearance=clearance, friction=friction)

    return replace(
        scene,
        mesh=replace(scene.mesh, points=length * scene.mesh.points),
        materials={name: Material(stress * m.young, m.poisson) for name, m in scene.materials.items()},
        dirichlet=tuple(
            c if isinstance(c, SymmetryPlane) else replace(c, **{i: times(length, getattr(c, i)) for i in "xyz"})
            for c in scene.dirichlet
        ),
        contact=tuple(map(larger, scene.contact)),
        tractions=tuple(replace(t, value=times(stress, t.value)) for t in scene.tractions),
        body_forces=tuple(replace(f, value=times(stress / length, f.value)) for f in scene.body_forces),
        contact_centre=scene.contact_centre and times(length, scene.contact_centre),
    )


def turned(scene, rotation):
    """The scene seen from another direction: the same forces and displacements, turned.

    Args:
        scene: Scene.
        rotation: (3, 3), orthogonal; with determinant 1, since a mirrored cell is inverted.

    Raises:
        SceneError: a condition on some components only turns out of the axes.
    """
    rotation = np.asarray(rotation)

    def turn(vector):
        if callable(vector):
            return lambda x: rotation @ vector(rotation.T @ x)
        return tuple((rotation @ np.asarray(vector, dtype=np.float64)).tolist())

    def turn_pair(pair):
        second = _changed(pair.second, (_POINTS, _DIRECTIONS), turn)
        direction = None if pair.direction is None else turn(pair.direction)
        return replace(pair, second=second, direction=direction, moved=turn(pair.moved))

    def turn_load(load):
        if isinstance(load, Traction):
            return replace(load, value=turn(load.value))
        pressure = load.value
        return replace(load, value=lambda x: pressure(rotation.T @ x)) if callable(pressure) else load

    return replace(
        scene,
        mesh=replace(scene.mesh, points=scene.mesh.points @ rotation.T),
        dirichlet=tuple(
            c if isinstance(c, SymmetryPlane) else _turned_condition(c, rotation) for c in scene.dirichlet
        ),
        contact=tuple(map(turn_pair, scene.contact)),
        tractions=tuple(map(turn_load, scene.tractions)),
        body_forces=tuple(replace(f, value=turn(f.value)) for f in scene.body_forces),
        contact_centre=scene.contact_centre and turn(scene.contact_centre),
    )


def swapped(scene):
    """The scene with first and second surface of every contact pair exchanged: the same forces."""
    return replace(scene, contact=tuple(pair.reversed() for pair in scene.contact))


def _changed(second, kinds, change):
    """An obstacle with those of its entries changed that some kinds name; the name of a surface remains."""
    names = [kind[type(second)] for kind in kinds if type(second) in kind]
    return replace(second, **{name: change(getattr(second, name)) for name in names}) if names else second


def _turned_condition(condition, rotation):
    given, values = condition.held, (condition.x, condition.y, condition.z)
    image = np.abs(rotation[:, given])
    if not given.all() and not np.allclose(image.max(axis=0), 1):
        raise SceneError(
            f"the condition on {condition.where!r} holds some components only, which turn out of the axes: prescribe "
            "all three, or turn by right angles"
        )
    held = np.ones(3, dtype=bool) if given.all() else image.max(axis=1) > 0.5

    def moved(row):
        """What the condition prescribes along one of the turned axes."""
        if not any(map(callable, values)):
            return float(sum(rotation[row, i] * values[i] for i in np.flatnonzero(given)))
        return lambda x: rotation[row, given] @ np.nan_to_num(condition.at((rotation.T @ x).T)).T[given]

    return Dirichlet(condition.where, *(moved(row) if held[row] else None for row in range(3)))
