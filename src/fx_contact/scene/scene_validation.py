"""Consistency of a scene: one system of units, small strains, no unconstrained body.  All is local."""

from dataclasses import replace

import numpy as np

from fx_contact.geometry.hexahedral_mesh import PLANE
from fx_contact.geometry.hexahedron import face_nodes, grid_points
from fx_contact.geometry.lattice import SIDE
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import COMPONENTS, SymmetryPlane
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Orthotropic
from fx_contact.items.obstacles import RigidSurface
from fx_contact.items.ties import Preload, Tie
from fx_contact.items.units import pascals
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.scene_items import SceneItems

#: Largest ratios of the moduli and of the sizes of two bodies in double precision [-].
_STIFFEST, _SMALLEST = 1e15, 1e6
#: Largest modulus in named units, a hundred times that of diamond [Pa].
_HARDEST = 1e14
#: Largest ratio of k L and E, and of E and k L, of springs below a body [-].  A cube on springs of k L = 1e-10 E has
#: their force to 2e-5, on those of 1e-12 E to 1e-3, by the rounding of its rigid motion.
_SPRINGS = 1e10
#: Largest difference of two prescribed displacements relative to the size of all bodies, for small strains [-].
_LARGEST_STRAIN = 1.0
#: Largest distance of tied surfaces, over the diagonal of the larger of two facets [-].  The chords of a circle in four
#: facets are 0.207 of their length away from it.
_APART = 0.25
#: Largest part of a body's volume inside an obstacle: with the wrong sign of a radius, or the wrong normal, all but an
#: interference is inside, else the interference.
_INSIDE = 0.5
#: Step for the slope of a rigid surface's gap, over the size of all bodies, and largest deviation of that from 1 [-]:
#: slopes of heights over a tilted surface, instead of distances, are 1.1 at 25 degrees.
_STEP, _SLOPE = 1e-6, 0.1
#: Positions relative to the size of all bodies that are rounding [-].
_ROUNDING = 1e-9
#: Relative differences of stiffness and strain that are rounding [-].
_SAME = 1e-6


def check_units(scene: SceneItems) -> None:
    """Raises SceneError for moduli, sizes, clearances or displacements that cannot be in one system of units."""
    mesh = scene.mesh
    young = {name: scene.materials[name].isotropic.young for name in mesh.regions}
    soft, hard = min(young, key=young.__getitem__), max(young, key=young.__getitem__)
    if young[hard] > _STIFFEST * young[soft]:
        raise SceneError(
            f"{hard!r} is {young[hard] / young[soft]:.2g} times as stiff as {soft!r}, more than double "
            "precision holds: check the units of the moduli, or make it 1e6 times as stiff, which is as good as rigid"
        )
    if young[hard] * pascals(scene.units) > _HARDEST:
        raise SceneError(
            f"the modulus of {hard!r}, {young[hard] * pascals(scene.units):.3g} Pa, is beyond any material: check it, "
            "or the names of the units"
        )
    size = np.ptp(mesh.points, axis=0).max()
    for index, name in enumerate(mesh.bodies):
        own = np.ptp(mesh.points[mesh.corners[mesh.body == index]].reshape(-1, 3), axis=0).max()
        if size > _SMALLEST * own:
            raise SceneError(
                f"body {name!r} is {own:.3g} large, all bodies together {size:.3g}: check the units "
                "and the place of each body"
            )
    for contact in scene.contact:
        if abs(contact.clearance) > _LARGEST_STRAIN * size:
            raise SceneError(
                f"the clearance {contact.clearance:.3g} of {contact.name!r} is more than the size of all bodies, "
                f"{size:.3g}: check its units"
            )
    prescribed = scene.prescribed(mesh.points)
    for component, name in enumerate(COMPONENTS):
        known = prescribed[~np.isnan(prescribed[:, component]), component]
        if len(known) and np.ptp(known) > _LARGEST_STRAIN * size:
            raise SceneError(
                f"prescribed displacements along {name} differ by {np.ptp(known):.3g}, and all bodies together "
                f"are {size:.3g} large: strains must be small, check the units"
            )


def check_springs(scene: SceneItems) -> None:
    """Raises SceneError for springs that double precision does not hold beside the body that they are on."""
    mesh, size = scene.mesh, np.ptp(scene.mesh.points, axis=0).max()
    for support in scene.springs:
        facets = mesh.surface(support.surface)
        stiffness = support.stiffness(mesh.outward_normals(facets)).max() * size
        regions = [mesh.regions[region] for region in np.unique(mesh.region[facets[:, 0]])]
        young = [scene.materials[name].isotropic.young for name in regions]
        for ratio, how in ((stiffness / min(young), "stiff"), (max(young) / stiffness, "soft")):
            if ratio > _SPRINGS:
                raise SceneError(
                    f"{support.what} is {ratio:.2g} times as {how} as its body, k L / E with the size L of all bodies, "
                    f"limit {_SPRINGS:g}: check the units of stiffness per area"
                )


def check_loads(scene: SceneItems) -> None:
    """Raises SceneError for equal loads, and those that conditions hold entirely; tries functions of position."""
    known: list[list[object]] = []
    for load in (*scene.tractions, *scene.springs, *scene.body_forces, *scene.strains):
        value = [type(load), *(v if callable(v) else np.asarray(v).tolist() for v in vars(load).values())]
        if value in known:
            raise SceneError(f"{load.what} is given twice with one value, and would double: leave one of them out")
        known.append(value)
    for load, share in zip((*scene.tractions, *scene.springs), scene.held_shares):
        if share > 1 - _ROUNDING:
            raise SceneError(
                f"{load.what} moves nothing: conditions prescribe the displacement of this surface along the whole of "
                "it; name another surface, or leave one of them out"
            )
    for force in scene.body_forces:
        force.at(scene.mesh.samples(force.body))


def check_mirrored(scene: SceneItems) -> None:
    """Raises SceneError for an orthotropic material, constant strain or body force that a mirror changes."""
    normals = scene.mirrors.normals  # raises an error for an impossible number of copies
    for force in scene.body_forces:
        across = np.zeros(0) if callable(force.value) else normals @ np.array(force.value, dtype=np.float64)
        for normal in normals[np.flatnonzero(across)]:
            raise SceneError(
                f"{force.what} changes in the mirror of the symmetry plane across {normal.round(6)}: model the whole, "
                "or leave out the component across the plane"
            )
    for condition in scene.dirichlet:
        if isinstance(condition, SymmetryPlane):
            table, plane = scene.contact_surfaces.table, scene.mesh.surface(condition.surface)
            for index in table[np.isin(table[:, 2:] @ [6, 1], plane @ [6, 1]), 0][:1]:
                raise SceneError(
                    f"{condition.surface!r} has facets of the symmetry plane and of {scene.interfaces[index].label}: "
                    "contact with the mirror image is that with a RigidPlane; else name these facets once"
                )
    for normal in [plane.normal for plane in scene.symmetry_planes] if scene.symmetry > 1 else ():
        turn = np.eye(3) - 2 * np.outer(normal, normal)
        changes = f"changes in the mirror of the symmetry plane across {normal.round(6)}"
        for name, material in scene.materials.items():
            if not isinstance(material, Orthotropic):
                continue
            one, other = np.array(material.axes) @ turn
            mirrored = replace(material, axes=(tuple(one), tuple(other))).stiffness
            if np.abs(mirrored - material.stiffness).max() > _SAME * np.abs(mirrored).max():
                raise SceneError(
                    f"the material of {name!r} {changes}: let one of its axes lie along this "
                    "normal, or model the whole"
                )
        for strain in scene.strains:
            if not callable(strain.value):
                (tensor,) = strain.at(np.zeros((1, 3)))
                if np.abs(turn @ tensor @ turn - tensor).max() > _SAME * np.abs(tensor).max():
                    raise SceneError(f"{strain.what} {changes}: model the whole")


def check_strains(scene: SceneItems) -> None:
    """Raises SceneError for a stress-free strain that is not small; tries functions of position."""
    for strain in scene.strains:
        largest = np.linalg.norm(strain.at(scene.mesh.samples(strain.part)), axis=(1, 2)).max()
        if largest > _LARGEST_STRAIN:
            raise SceneError(
                f"{strain.what} gives a strain of {largest:.3g}: strains must be small, check the units (an expansion "
                "is about 1e-5 / K)"
            )


def check_obstacles(scene: SceneItems) -> None:
    """Raises SceneError for an obstacle with a body inside it, behind the surface, too far away, or not pressed."""
    mesh = scene.mesh
    size = np.ptp(mesh.points, axis=0).max()
    for contact in scene.contact:
        if contact.obstacle is None or not isinstance(contact, ContactPair):
            continue
        (name,) = contact.surfaces
        facets = mesh.surface(name)
        distance, towards = contact.distances(scene.mesh.samples(name))
        nearest = distance.min()
        if nearest > _LARGEST_STRAIN * size:
            raise SceneError(
                f"{contact.name!r}: the obstacle is {nearest:.3g} away from the surface, and all bodies together are "
                f"{size:.3g} large: check its place and units"
            )
        for body in np.unique(mesh.body[facets[:, 0]]):
            inside = _inside(mesh, contact, body)
            if inside > _INSIDE:
                raise SceneError(
                    f"{contact.name!r}: {inside:.0%} of body {mesh.bodies[body]!r} is inside the obstacle; turn the "
                    "normal of a plane out of the obstacle, change the sign of a radius (negative: the body is "
                    "inside), point the axis of a cone into the obstacle, with the angle from there to its surface "
                    "(above 90 degrees for a seat), or move it"
                )
        if (np.einsum("nmi,ni->nm", towards.reshape(len(facets), -1, 3), mesh.outward_normals(facets)) <= 0).all():
            raise SceneError(
                f"{contact.name!r}: the surface looks away from the obstacle; name the side that may touch it"
            )
        if isinstance(contact.obstacle, RigidSurface):
            _check_slope(contact, scene.mesh.samples(name), _STEP * size)
        if contact.force is not None:
            _check_force(scene, contact, towards)


def _check_slope(contact: ContactPair, points: FloatArray, step: float) -> None:
    """Raises SceneError unless the gap at points (n, 3) grows by a step [m] along the normal."""
    distance, towards = contact.distances(points)
    slope = float(np.median((contact.distances(points - step * towards)[0] - distance) / step))
    if abs(slope - 1) > _SLOPE:
        raise SceneError(
            f"{contact.name!r}: its gap grows by {slope:.3g} per unit length along the rigid surface's normal "
            "(median over the contact surface), and should by 1: the gap is the distance along the normal, which "
            "points out of the obstacle"
        )


def _inside(mesh: RootMesh, contact: ContactPair, body: int) -> float:
    """Part of the volume of a body that is inside an obstacle where it is given, and where it is moved to [-]."""
    cells = np.flatnonzero(mesh.body == body)
    points = mesh.evaluate(cells, np.tile([0.25, 0.75], (len(cells), 3, 1))).reshape(-1, 3)
    corners = mesh.points[mesh.corners[cells]].reshape(-1, 2, 2, 2, 3)
    sides = [np.diff(corners, axis=axis).mean(axis=(1, 2, 3)) for axis in (1, 2, 3)]
    volume = np.abs(np.linalg.det(np.stack(sides, axis=1)))
    places = points, points + np.array(contact.moved)
    farthest = np.max([contact.distances(place)[0] for place in places], axis=0)
    return float(volume @ (farthest <= 0).reshape(len(cells), -1).mean(axis=1) / volume.sum())


def _check_force(scene: SceneItems, contact: ContactPair, towards: FloatArray) -> None:
    """Raises SceneError for a force across a symmetry plane, or along all directions (n, 3) into the obstacle."""
    against = contact.unit_direction
    assert against is not None, "of a pair with a force"
    for given, condition in zip(scene.dirichlet, scene.conditions):
        if isinstance(given, SymmetryPlane) and np.abs(condition.across @ against).max() > PLANE:
            raise SceneError(
                f"{contact.name!r}: the force on the obstacle crosses the symmetry plane {given.surface!r}, where its "
                "mirror image would cancel it; give the force of all symmetric parts, along the plane"
            )
    if (towards @ against <= _ROUNDING).all():
        raise SceneError(f"{contact.name!r}: the force pulls the obstacle away from the surface; reverse it")


def check_ties(scene: SceneItems) -> None:
    """Raises SceneError for a tie among the contacts, and for tied surfaces that lie apart."""
    if any(isinstance(contact, Tie) for contact in scene.contact):
        raise SceneError(
            "contact must be a tuple of contact pairs: ties are an argument of their own, ties=(Tie(...),)"
        )
    for index, tie in enumerate(scene.ties, len(scene.contact)):
        if isinstance(tie, Preload):
            _check_section(scene.mesh, tie)
        distance, size = _between(scene, index)
        part = np.nan_to_num(np.abs(distance)) / size
        worst = np.unravel_index(part.argmax(), part.shape)
        if part[worst] > _APART:
            place = scene.mesh.middle(scene.mesh.surface(scene.oriented[index].surfaces[0])[worst[0] :])
            raise SceneError(
                f"{tie.label}: the surfaces are {abs(distance[worst]):.3g} apart near {place}, {part[worst]:.2g} of "
                f"the diagonal of their facets, limit {_APART:g}; move one, or name those parts only that face each "
                "other"
            )


def _check_section(mesh: RootMesh, section: Preload) -> None:
    """Raises SceneError unless the first side of a preloaded section is plane, and the axis points out of it."""
    cosines = mesh.outward_normals(mesh.surface(section.surfaces[0])) @ section.unit_axis
    if cosines.min() < 1 - PLANE:
        raise SceneError(
            f"{section.label}: the axis must point out of the first side, which must be plane across it; a normal "
            f"there has a cosine of {cosines.min():.4g} with the axis"
        )


def _between(scene: SceneItems, index: int) -> tuple[FloatArray, FloatArray]:
    """Distances (n, 9) of tied surfaces at points of the first, nan where none faces it, and facet diagonals [m]."""
    mesh, pair = scene.mesh, scene.contact_surfaces.nonmatching.get(index)  # an error for a facet in two of them
    first = mesh.surface(scene.oriented[index].surfaces[0])
    here = mesh.facet_points(first, order=2)
    size = np.linalg.norm(np.ptp(here, axis=1), axis=1)[:, None]
    if pair is None:
        points = grid_points(2)[face_nodes(2)[first[:, 1]]] * (SIDE // 2)
        cell, _, opposite = scene.pairing.opposite(first[:, 0], first[:, 1], points)
        there = mesh.evaluate(np.repeat(cell, 9), opposite.reshape(-1, 3, 1) / SIDE).reshape(here.shape)
        return np.linalg.norm(there - here, axis=2), np.broadcast_to(size, here.shape[:2])
    other = np.linalg.norm(np.ptp(pair.second.corners, axis=1), axis=1)
    found = pair.faced(here.reshape(-1, 3), np.repeat(mesh.outward_normals(first), 9, axis=0))
    facet, distance = found.facet.reshape(here.shape[:2]), found.distance.reshape(here.shape[:2])
    return distance, np.maximum(size, np.where(facet >= 0, other[facet], 0.0))
