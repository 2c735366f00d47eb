"""Penetration where no contact acts: outside of the contact and tied surfaces, of bodies and of obstacles."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.validity import ModelWarning, Point
from fx_contact.contact.settling import approaches
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array
from fx_contact.parallel.box_search import Boxes, meeting_boxes
from fx_contact.parallel.exchange import Exchange
from fx_contact.problem import hexahedron
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.leaf_facets import LeafFacets
from fx_contact.problem.obstacles import RigidSurface
from fx_contact.problem.scene import Scene

#: Least penetration, relative to the largest displacement, as accurate as that is at a loose tolerance; at most
#: relative to the side of the leaf facet, as bodies may move by many of them [-].
_LEAST, _OF_FACET = 0.01, 0.1


class _Facets(NamedTuple):
    """Facets of this rank's leaves on the boundary, beside the contact and tied surfaces.

    Attributes:
        leaf, body: (n,).
        before, now: (n, 3), points below the middle of each, undeformed and deformed [m].
    """

    leaf: Int64Array
    body: Int64Array
    before: FloatArray
    now: FloatArray


def penetrations(state: SolvedState) -> list[ModelWarning]:
    """Bodies and obstacles inside of which a body has moved, the same on all ranks.  Collective on state.forest.comm.

    The middle of a boundary facet counts, less 1 % of the largest displacement along the inward normal, at most a tenth
    of the side of the facet.
    """
    scene, comm = state.scene, state.forest.comm
    displacement = state.solution.displacement
    largest = comm.allreduce(float(np.linalg.norm(displacement, axis=1).max(initial=0.0)), op=MPI.MAX)
    near = _near(scene, largest)
    obstacles = [pair for pair in scene.contact if pair.obstacle is not None]
    if not largest or not (near.any() or obstacles):
        return []
    prolongation = state.elasticity.prolongation
    nodal = prolongation.prolong(displacement)
    facets = _facets(state, nodal, _LEAST * largest)
    found: dict[str, tuple[int, Point]] = {}
    for names, inside in (*_in_bodies(state, nodal, facets, near), *_in_obstacles(state, facets)):
        if inside.any():
            here = facets.now[inside]
            x, y, z = here[np.lexsort(here.T[::-1])[0]].tolist()
            found[names] = len(here), (x, y, z)
    return _warnings(comm.allgather(found))


def _near(scene: Scene, largest: float) -> BoolArray:
    """Root cells (ncells,) near those of another body, displaced by `largest` at most [m]."""
    mesh = scene.mesh
    result = np.zeros(len(mesh.cells), dtype=bool)
    if len(mesh.bodies) == 1:
        return result
    nodal = mesh.points[mesh.cells]
    low, high = nodal.min(axis=1) - largest, nodal.max(axis=1) + largest
    of = [np.flatnonzero(mesh.body == body) for body in range(len(mesh.bodies))]
    lows, highs = np.stack([low[c].min(axis=0) for c in of]), np.stack([high[c].max(axis=0) for c in of])
    for one, two in combinations(range(len(of)), 2):
        both = np.maximum(lows[one], lows[two]), np.minimum(highs[one], highs[two])
        if (both[0] <= both[1]).all():
            for cells in (of[one], of[two]):
                result[cells] |= ((low[cells] <= both[1]) & (both[0] <= high[cells])).all(axis=1)
    return result


def _facets(state: SolvedState, nodal: FloatArray, depth: float) -> _Facets:
    """Boundary facets, with points at most a depth [m] below their middles, from displacements (m, 3) at the nodes."""
    scene, forest, space = state.scene, state.forest, state.elasticity.prolongation.space
    mesh, surfaces = scene.mesh, scene.contact_surfaces
    joined = (surfaces.contact >= 0) & (surfaces.contact < scene.joins)
    leaf, face = forest.boundary_faces(np.argwhere((mesh.face_neighbours == 1) & ~joined))
    cell = forest.cell[leaf]
    at = LeafFacets.of_leaves(mesh, cell, forest.level[leaf], forest.anchor[leaf], face).at(
        np.full((len(leaf), 1, 2), 0.5)
    )
    sides = np.sqrt(at.jacobian[:, 0])
    before = at.position[:, 0] - np.minimum(depth, _OF_FACET * sides)[:, None] * at.normal[:, 0]
    middle = hexahedron.lagrange(space.degree, np.array([0.5]))[0]
    moved = np.einsum("k,nkd->nd", np.kron(middle, middle), nodal[space.on_faces(leaf, face)])
    return _Facets(leaf, mesh.body[cell].astype(np.int64), before, before + moved)


def _in_bodies(
    state: SolvedState, nodal: FloatArray, facets: _Facets, near: BoolArray
) -> list[tuple[str, BoolArray]]:
    """Names of two bodies, and the facets (n,) of one that are inside of the other, and were not before."""
    forest, space, bodies = state.forest, state.elasticity.prolongation.space, state.scene.mesh.bodies
    comm, inside = forest.comm, np.zeros((2, len(facets.leaf)), dtype=bool)
    if not near.any():
        return []
    cells = np.flatnonzero(near[forest.cell])
    before = leaf_positions(forest, cells, 1)
    now = before + nodal[space.cells[cells][:, hexahedron.corner_nodes(space.degree)]]
    rows = np.flatnonzero(near[forest.cell[facets.leaf]])
    points = np.stack([facets.before[rows], facets.now[rows]], axis=1)
    names = np.column_stack([np.full(len(cells), comm.rank), np.arange(len(cells))])
    query, name = meeting_boxes(comm, _around(points), _around(np.concatenate([before, now], axis=1)), names)
    away = Exchange(comm, name[:, 0])
    there, point, own = away.forward(name[:, 1]), away.forward(points[query]), away.forward(facets.body[rows[query]])
    body = state.scene.mesh.body[forest.cell[cells]][there]
    within = np.stack([_within(corners[there], point[:, i]) for i, corners in enumerate((before, now))], axis=1)
    within, body = away.backward(within & (body != own)[:, None]), away.backward(body)
    for time in range(2):
        inside[time, rows[query[within[:, time]]]] = True
    fresh = rows[query[within[:, 1]]], body[within[:, 1]].astype(np.int64)
    other: Int64Array = np.full(len(facets.leaf), -1, dtype=np.int64)
    other[fresh[0]] = fresh[1]
    other[inside[0]] = -1
    pairs = np.sort(np.stack([facets.body, other], axis=1), axis=1)
    return [
        (f"bodies {bodies[a]!r} and {bodies[b]!r}", (pairs == (a, b)).all(axis=1))
        for a, b in np.unique(pairs[other >= 0], axis=0)
    ]


def _around(points: FloatArray) -> Boxes:
    """Boxes around points (n, k, 3)."""
    return Boxes(points.min(axis=1), points.max(axis=1))


def _within(corners: FloatArray, points: FloatArray) -> BoolArray:
    """True for points (n, 3) below the mean planes of all faces of hexahedra with corners (n, 8, 3)."""
    faces = corners[:, hexahedron.FACE_CORNERS]
    outward = np.cross(faces[:, :, 3] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 1])
    outward *= hexahedron.FACE_ORIENTATION[:, None]
    heights = np.einsum("nfd,nfd->nf", points[:, None] - faces.mean(axis=2), outward)
    return np.asarray((heights < 0).all(axis=1))


def _in_obstacles(state: SolvedState, facets: _Facets) -> list[tuple[str, BoolArray]]:
    """Names of a body and an obstacle below it, and the facets (n,) that are inside, and were not before.

    Without surfaces given by functions, which may be defined near the contact surface only.
    """
    scene, result = state.scene, []
    moved = scene.approached(approaches(scene, state.solution.rows) or [None] * len(scene.interfaces)).contact
    for begin, pair in zip(scene.contact, moved):
        if not isinstance(begin, ContactPair) or not isinstance(pair, ContactPair):
            continue
        if pair.obstacle is None or isinstance(pair.obstacle, RigidSurface):
            continue
        inside = (pair.distances(facets.now)[0] < 0) & (begin.distances(facets.before)[0] >= 0)
        for body in np.unique(scene.mesh.body[scene.mesh.surface(pair.first)[:, 0]]):
            names = f"body {scene.mesh.bodies[body]!r} and the {pair.obstacle.name} below {pair.first!r}"
            result.append((names, inside & (facets.body == body)))
    return result


def _warnings(found: list[dict[str, tuple[int, Point]]]) -> list[ModelWarning]:
    """One warning for each names, from the counts and places of each rank."""
    warnings = []
    for names in sorted({names for one in found for names in one}):
        here = [one[names] for one in found if names in one]
        count, place = sum(number for number, _ in here), min(place for _, place in here)
        where = ", ".join(f"{x:.4g}" for x in place)
        message = (
            f"{names} penetrate each other at {count} leaf facets outside of the contact and tied surfaces, near "
            f"({where}): no contact acts there; define a pair, or let its surfaces be larger"
        )
        warnings.append(ModelWarning("penetration", float(count), 0.0, place, message))
    return warnings
