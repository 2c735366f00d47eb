"""Proposal of contact pairs: surfaces of different bodies near each other.  All is local."""

from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import ContactPair
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.validation import check_kind, check_number
from fx_contact.surfaces.nonmatching import SAMPLES, NonmatchingSurfaces
from fx_contact.surfaces.surface_projection import SurfaceProjection

#: Cosine of unit normals below which they are opposite: 95 degrees.
_OPPOSITE = -0.1


def contacts_between(mesh: RootMesh, within: float) -> tuple[ContactPair, ...]:
    """Pairs of surfaces of different bodies that face each other within a distance, to be judged and used.

    Distances are along the normals, at 16 samples of each root facet.  Pairs are in the order of the areas within
    the distance; a pair all of whose facets face the same body in earlier pairs is left out.

    Local; the same on all ranks.

    Args:
        within: largest distance of the undeformed surfaces, or depth of their interference [m].

    Raises SceneError for what is no RootMesh, and a distance that is not positive.
    """
    check_kind("the mesh", mesh, RootMesh)
    check_number("the distance of surfaces in contact", within, positive=True)
    bodies = {name: np.unique(mesh.body[facets[:, 0]]) for name, facets in mesh.surfaces.items()}
    boxes = {name: _box(mesh.facet_points(facets)) for name, facets in mesh.surfaces.items()}
    trees, found = dict[str, SurfaceProjection](), []
    for one, two in combinations(mesh.surfaces, 2):
        apart = np.maximum(boxes[one][0] - boxes[two][1], boxes[two][0] - boxes[one][1]).max() > within
        if apart or np.isin(bodies[one], bodies[two]).any():
            continue
        trees |= {name: SurfaceProjection(mesh, mesh.surface(name)) for name in {one, two} - trees.keys()}
        pair = NonmatchingSurfaces(mesh, ContactPair(one, two), (trees[one], trees[two]))
        if not _turned_towards(pair, within):
            continue
        (near, faced), count = _near(pair, within), len(pair.first) + len(pair.second)
        if near.any():
            facets = pair.first.facets[near > 0], pair.second.facets[faced]
            found.append((float(near @ pair.first.size**2), count, (one, two), facets))
    taken, result = np.zeros((len(mesh.cells), 6, len(mesh.bodies)), dtype=bool), []
    largest = max((area for area, *_ in found), default=1.0)
    # Of equal areas, to rounding, that with fewer facets.
    found.sort(key=lambda candidate: (-round(candidate[0] / largest, 9), candidate[1]))
    for _, _, (one, two), facets in found:
        sides = [(*own.T[:, :, None], bodies[other]) for own, other in zip(facets, (two, one))]
        if not taken[sides[0]].all():
            result.append(ContactPair(one, two))
        for side in sides:
            taken[side] = True
    return tuple(result)


def _box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest coordinates (3,) of points (n, k, 3) [m]."""
    return points.min(axis=(0, 1)), points.max(axis=(0, 1))


def _turned_towards(surfaces: NonmatchingSurfaces, within: float) -> bool:
    """True if normals of near samples are opposite, unlike those of sides of bodies that touch along an edge."""
    one, two = (facets.at(np.arange(len(facets)), SAMPLES) for facets in (surfaces.first, surfaces.second))
    tree = cKDTree(two.position.reshape(-1, 3))
    distance, nearest = tree.query(one.position, distance_upper_bound=within + surfaces.depth)
    near = np.isfinite(distance)
    facing = two.normal.reshape(-1, 3)[nearest[near]]
    return bool((one.normal[near] * facing).sum(axis=1).min(initial=0.0) < _OPPOSITE)


def _near(surfaces: NonmatchingSurfaces, within: float) -> tuple[FloatArray, IntArray]:
    """(n,), parts of facets of the first surface near the second one, within a distance, and facets (m,) of that."""
    at = surfaces.first.at(np.arange(len(surfaces.first)), SAMPLES)
    found = surfaces.faced(at.position, at.normal)
    near = found.found & (np.abs(found.distance) <= within)
    return near.mean(axis=1), np.unique(found.facet[near])
