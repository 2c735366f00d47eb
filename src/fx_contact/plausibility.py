"""Whether the numbers of a scene make sense together: units, small strains, tractions against conditions."""

import numpy as np

from fx_contact.errors import SceneError

#: Largest ratios of two bodies' moduli and sizes that double precision holds in one system [-].
_STIFFEST, _SMALLEST = 1e15, 1e6
#: Displacements over sizes, and tractions over moduli, above which a unit must be wrong [-].
_LARGEST = 100.0


def check_units(scene):
    """Raises SceneError for numbers of which one cannot be in the unit of the others.  Local."""
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
    for condition in scene.dirichlet:
        largest = np.nanmax(np.abs(condition.values))
        if largest > _LARGEST * size:
            raise SceneError(
                f"the displacement on {condition.where!r} is {largest:.3g} m, the bodies are {size:.3g} m large: "
                "strains must be small, check the units"
            )
    for traction in scene.tractions:
        body = mesh.bodies[mesh.body[mesh.surface(traction.surface)[0, 0]]]
        largest = np.abs(traction.value).max()
        if largest > _LARGEST * young[body]:
            raise SceneError(
                f"the traction on {traction.surface!r} is {largest:.3g} Pa, Young's modulus of {body!r} "
                f"{young[body]:.3g} Pa: strains must be small, check the units"
            )


def check_tractions(scene):
    """Raises SceneError for a traction that does no work: on a surface held in its direction.  Local."""
    prescribed = scene.prescribed(scene.mesh.points)
    for traction in scene.tractions:
        held = ~np.isnan(prescribed[scene.place(traction.surface)]).any(axis=0) & (np.array(traction.value) != 0)
        if held.any():
            component = "xyz"[int(held.argmax())]
            raise SceneError(
                f"the traction on {traction.surface!r} pulls along {component}, where a condition prescribes the "
                "displacement everywhere on it: one of the two must go"
            )
