"""Checks of a scene that need all of it: units, small strains, tractions where displacements are prescribed."""

import numpy as np

from fx_contact.parallel.errors import SceneError
from fx_contact.problem.boundary_conditions import Traction

#: Largest ratios of two bodies' moduli and sizes that double precision holds in one system [-].
_STIFFEST, _SMALLEST = 1e15, 1e6
#: Displacements over sizes, and tractions over moduli, above which a unit must be wrong [-].
_LARGEST = 100.0
#: Difference of two prescribed displacements over the size of all bodies above which no strain can be small [-].
_LARGEST_STRAIN = 1.0
#: Components of a surface force below this part of the largest are rounding [-].
_ACTING = 1e-9


def check_units(scene):
    """Raises SceneError for moduli, sizes or loads that cannot be in one system of units.  Local."""
    mesh = scene.mesh
    young = {name: scene.materials[name].young for name in mesh.bodies}
    soft, hard = min(young, key=young.get), max(young, key=young.get)
    if young[hard] > _STIFFEST * young[soft]:
        raise SceneError(
            f"body {hard!r} is {young[hard] / young[soft]:.2g} times as stiff as {soft!r}, more than double "
            "precision holds: check the units of the moduli, or make it 1e6 times as stiff, which is as good as rigid"
        )
    size = np.ptp(mesh.points, axis=0).max()
    for index, name in enumerate(mesh.bodies):
        own = np.ptp(mesh.points[mesh.corners[mesh.body == index]].reshape(-1, 3), axis=0).max()
        if size > _SMALLEST * own:
            raise SceneError(
                f"body {name!r} is {own:.3g} m large, all bodies together {size:.3g} m: check the units "
                "and the place of each body"
            )
    ranges = [np.empty((0, 3))]
    for condition in scene.conditions:
        values = condition.at(scene.samples(condition.where))
        largest = np.nanmax(np.abs(values))
        if largest > _LARGEST * size:
            raise SceneError(
                f"the displacement on {condition.where!r} is {largest:.3g} m, the bodies are {size:.3g} m large: "
                "strains must be small, check the units"
            )
        ranges.append(np.where(condition.held, [values.min(axis=0), values.max(axis=0)], np.nan))
    _check_strain(np.concatenate(ranges), size)
    for traction in scene.tractions:
        body = mesh.bodies[mesh.body[mesh.surface(traction.surface)[0, 0]]]
        points = scene.samples(traction.surface)
        largest = np.abs(traction.at(points, np.ones_like(points))).max()
        if largest > _LARGEST * young[body]:
            raise SceneError(
                f"{traction.what} is {largest:.3g} Pa, Young's modulus of {body!r} {young[body]:.3g} Pa: strains must "
                "be small, check the units"
            )
    for force in scene.body_forces:
        largest = np.abs(force.at(scene.samples(force.body))).max()
        if largest * size > _LARGEST * young[force.body]:
            raise SceneError(
                f"{force.what} is {largest:.3g} N/m^3, over {size:.3g} m {largest * size:.3g} Pa, Young's modulus "
                f"{young[force.body]:.3g} Pa: strains must be small, check the units"
            )


def _check_strain(values, size):
    """Raises SceneError where prescribed displacements (n, 3) [m], NaN where free, differ by more than the size."""
    for component, column in zip("xyz", values.T):
        known = column[~np.isnan(column)]
        if len(known) and np.ptp(known) > _LARGEST_STRAIN * size:
            raise SceneError(
                f"prescribed displacements along {component} differ by {np.ptp(known):.3g} m, from {known.min():.3g} "
                f"to {known.max():.3g}, and all bodies together are {size:.3g} m large: strains must be small"
            )


def check_forces(scene):
    """Raises SceneError for a surface force along a component that is prescribed on all of its surface.  Local."""
    mesh = scene.mesh
    prescribed = scene.prescribed(mesh.points)
    for traction in scene.tractions:
        facets = mesh.surface(traction.surface)
        held = ~np.isnan(prescribed[scene.place(traction.surface)]).any(axis=0)
        points, normals = mesh.facet_points(facets, order=1), mesh.outward_normals(facets)
        acting = np.abs(traction.at(points.reshape(-1, 3), np.repeat(normals, 4, axis=0))).max(axis=0)
        acts = acting > _ACTING * acting.max()
        idle = held & acts
        # A pressure on a curved surface has all components; it is enough that one of them works.
        if idle.any() and (isinstance(traction, Traction) or not (acts & ~held).any()):
            component = "xyz"[int(idle.argmax())]
            raise SceneError(
                f"{traction.what} pulls along {component}, where a condition prescribes the displacement everywhere on "
                "it: one of the two must go"
            )
