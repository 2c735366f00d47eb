"""Penetration where no contact acts: outside of the contact and tied surfaces, of bodies and of obstacles.

Bodies are drawn without the clearance of their contact: only what is deeper counts.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry import hexahedron
from fx_contact.items.contact import ContactPair
from fx_contact.items.obstacles import RigidSurface
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.parallel.box_search import Boxes, meeting_boxes
from fx_contact.parallel.exchange import Exchange
from fx_contact.scene.scene import Scene
from fx_contact.verdict.model_warning import ModelWarning, Point

#: Least penetration, relative to the largest displacement, and at most relative to the side of the leaf facet, since
#: bodies may move by many of them [-].  The surface beside a sharp-edged punch that goes 0.05 deep is drawn below it by
#: less, as contact does not follow sliding (`test_edges_of_contact`).
_LEAST, _OF_FACET = 0.1, 0.1
#: Coordinates of the samples along a facet: near its corners, as the pole of a ball may be one, but not on edges, where
#: bodies in contact meet; beside contact surfaces the middle alone.
_SAMPLES = np.array([0.05, 0.5, 0.95])
#: Part of the extent of a root cell's corners by which a curved cell may go beyond them [-].
_MARGIN = 0.25
#: Lagrange nodes of order 2 in the middles of the faces of a hexahedron.
_MIDDLES = hexahedron.face_inner_nodes(2)[:, 0]


class _Samples(NamedTuple):
    """Points of this rank's leaf facets on the boundary.

    Attributes:
        facet, body: (n,), position of the facet among all of the rank, and its body.
        before, now: (n, 3), points below the facet, undeformed and deformed [m].
    """

    facet: Int64Array
    body: Int64Array
    before: FloatArray
    now: FloatArray

    def some(self, rows: IntArray | BoolArray) -> "_Samples":
        """Some of them."""
        return _Samples(self.facet[rows], self.body[rows], self.before[rows], self.now[rows])


def penetrations(state: SolvedState) -> list[ModelWarning]:
    """Bodies and obstacles inside of which a body has moved, the same on all ranks.  Collective on state.forest.comm.

    Samples of a boundary facet count if they are deeper than 10 % of the largest displacement, less the mean one, at
    most a tenth of the side of the facet.
    """
    scene, comm = state.scene, state.forest.comm
    displacement = state.solution.displacement
    sums = comm.allreduce(np.append(displacement.sum(axis=0), len(displacement)))
    moved = np.linalg.norm(displacement - sums[:3] / sums[3], axis=1)
    depth = _LEAST * comm.allreduce(float(moved.max(initial=0.0)), op=MPI.MAX)
    obstacles = [pair for pair in scene.contact if pair.obstacle is not None]
    near = _near(scene, comm.allreduce(float(np.linalg.norm(displacement, axis=1).max(initial=0.0)), op=MPI.MAX))
    if not depth or not (near.any() or obstacles):
        return []
    nodal = state.elasticity.prolongation.prolong(displacement)
    found: dict[str, tuple[int, Point]] = {}
    inside = _in_bodies(state, nodal, depth, near) if near.any() else []
    for names, samples in (*inside, *(_in_obstacles(state, nodal, depth) if obstacles else ())):
        if len(samples.facet):
            x, y, z = samples.now[np.lexsort(samples.now.T[::-1])[0]].tolist()
            found[names] = len(np.unique(samples.facet)), (x, y, z)
    return list(_warnings(comm.allgather(found)))


def _near(scene: Scene, largest: float) -> BoolArray:
    """Root cells (ncells,) near those of another body, displaced by `largest` at most [m]."""
    mesh = scene.mesh
    result, corners = np.zeros(len(mesh.cells), dtype=bool), mesh.points[mesh.corners]
    low, high = corners.min(axis=1), corners.max(axis=1)
    margin = _MARGIN * (high - low) + largest
    low, high = low - margin, high + margin
    of = [np.flatnonzero(mesh.body == body) for body in range(len(mesh.bodies))]
    lows, highs = np.stack([low[c].min(axis=0) for c in of]), np.stack([high[c].max(axis=0) for c in of])
    for one, two in combinations(range(len(of)), 2):
        both = np.maximum(lows[one], lows[two]), np.minimum(highs[one], highs[two])
        if (both[0] <= both[1]).all():
            for cells in (of[one], of[two]):
                result[cells] |= ((low[cells] <= both[1]) & (both[0] <= high[cells])).all(axis=1)
    return result


def _samples(state: SolvedState, nodal: FloatArray, depth: float, of: BoolArray) -> _Samples:
    """Samples at most a depth [m] below facets of root facets (ncells, 6), by displacements (m, 3) at the nodes."""
    forest, space, mesh = state.forest, state.elasticity.prolongation.space, state.scene.mesh
    leaf, face = forest.boundary_faces(np.argwhere(of & (mesh.face_neighbours == 1)))
    cell, count = forest.cell[leaf], len(_SAMPLES) ** 2
    uv = np.stack(np.meshgrid(_SAMPLES, _SAMPLES), axis=-1).reshape(count, 2)
    at = forest.facets(leaf, face).at(uv)
    before = at.position - np.minimum(depth, _OF_FACET * np.sqrt(at.jacobian))[:, :, None] * at.normal
    values = hexahedron.lagrange(space.degree, _SAMPLES)
    moved = np.einsum("gk,nkd->ngd", np.kron(values, values), nodal[space.on_faces(leaf, face)])
    facet, body = np.repeat([np.arange(len(leaf)), mesh.body[cell]], count, axis=1).astype(np.int64)
    kept = ~_beside(state.scene)[cell, face][:, None] | (np.arange(count) == count // 2)
    columns = facet, body, before.reshape(-1, 3), (before + moved).reshape(-1, 3)
    return _Samples(*(column[kept.ravel()] for column in columns))


def _beside(scene: Scene) -> BoolArray:
    """Root facets (ncells, 6) with a corner on contact or tied surfaces."""
    mesh = scene.mesh
    corners = mesh.corners[:, hexahedron.FACE_CORNERS]
    joined: BoolArray = np.zeros(len(mesh.points), dtype=bool)
    joined[corners[scene.contact_surfaces.every]] = True
    return np.asarray(joined[corners].any(axis=2))


def _in_bodies(state: SolvedState, nodal: FloatArray, depth: float, near: BoolArray) -> list[tuple[str, _Samples]]:
    """Names of two bodies, and the samples of one that are inside of the other, and were not before."""
    scene, forest, space = state.scene, state.forest, state.elasticity.prolongation.space
    comm, bodies = forest.comm, scene.mesh.bodies
    of_two = [index for index, interface in enumerate(scene.interfaces) if len(interface.surfaces) == 2]
    samples = _samples(state, nodal, depth, near[:, None] & ~scene.contact_surfaces.on(of_two))
    cells = np.flatnonzero(near[forest.cell])
    body_of = scene.mesh.body[forest.cell]
    before = leaf_positions(forest, cells, 1)
    now = before + nodal[space.cells[cells][:, hexahedron.corner_nodes(space.degree)]]
    points = np.stack([samples.before, samples.now, _less_play(scene, samples)], axis=1)
    around = np.concatenate([before, now], axis=1)
    kept = _near_others(comm, len(bodies), around, body_of[cells], points, samples.body)
    cells, before, now, around = cells[kept], before[kept], now[kept], around[kept]
    kept = _near_others(comm, len(bodies), points, samples.body, around, body_of[cells])
    points, samples = points[kept], samples.some(kept)
    middles = leaf_positions(forest, cells, 2)[:, _MIDDLES]
    names = np.column_stack([np.full(len(cells), comm.rank), np.arange(len(cells))])
    query, name = meeting_boxes(comm, _around(points), _around(around), names)
    away = Exchange(comm, name[:, 0])
    there, point, own = away.forward(name[:, 1]), away.forward(points[query]), away.forward(samples.body[query])
    body, hollow = body_of[cells][there], _hollow(before, middles)[there]
    within = np.stack([_within(c[there], hollow, point[:, i]) for i, c in enumerate((before, now, now))], axis=1)
    within, body = away.backward(within & (body != own)[:, None]), away.backward(body).astype(np.int64)
    fresh = within[:, 1] & within[:, 2] & ~np.isin(query, query[within[:, 0]])
    pairs = np.sort(np.stack([samples.body[query], body], axis=1), axis=1)
    result = []
    for a, b in np.unique(pairs[fresh], axis=0):
        rows = np.unique(query[fresh & (pairs == (a, b)).all(axis=1)])
        result.append((f"bodies {bodies[a]!r} and {bodies[b]!r}", samples.some(rows)))
    return result


def _less_play(scene: Scene, samples: _Samples) -> FloatArray:
    """Points (n, 3) deformed, drawn back from the nearest contact surface of their body by its clearance."""
    mesh, result = scene.mesh, samples.now.copy()
    pairs = [pair for pair in scene.contact if len(pair.surfaces) == 2 and pair.clearance > 0]
    facets = [mesh.surface(name) for pair in pairs for name in pair.surfaces]
    play = np.repeat(np.repeat([pair.clearance for pair in pairs], 2), [len(some) for some in facets])
    joined = np.concatenate([np.empty((0, 2), dtype=np.int64), *facets])
    for body in np.unique(mesh.body[joined[:, 0]]):
        own, rows = np.flatnonzero(mesh.body[joined[:, 0]] == body), np.flatnonzero(samples.body == body)
        nearest = own[cKDTree(mesh.facet_points(joined[own], order=1).mean(axis=1)).query(samples.before[rows])[1]]
        result[rows] -= play[nearest, None] * mesh.outward_normals(joined[nearest])
    return result


def _near_others(
    comm: MPI.Intracomm, bodies: int, points: FloatArray, body: IntArray, others: FloatArray, of: IntArray
) -> BoolArray:
    """True for groups (n, k, 3) whose boxes meet the box of all other groups (m, l, 3) of another body, on any rank.

    Collective.
    """
    boxes, around = _around(points), _around(others)
    low, high = np.full((bodies, 3), np.inf), np.full((bodies, 3), -np.inf)
    np.minimum.at(low, of, around.low)
    np.maximum.at(high, of, around.high)
    comm.Allreduce(MPI.IN_PLACE, low, MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, MPI.MAX)
    result: BoolArray = np.zeros(len(points), dtype=bool)
    for other in range(bodies):
        meet = ((boxes.low <= high[other]) & (low[other] <= boxes.high)).all(axis=1)
        result |= meet & (body != other)
    return result


def _around(points: FloatArray) -> Boxes:
    """Boxes around points (n, k, 3)."""
    return Boxes(points.min(axis=1), points.max(axis=1))


def _planes(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middles (n, 6, 3) and outward unit normals (n, 6, 3) of the mean planes of the faces of hexahedra (n, 8, 3)."""
    faces = corners[:, hexahedron.FACE_CORNERS]
    outward = np.cross(faces[:, :, 3] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 1])
    outward = outward * hexahedron.FACE_ORIENTATION[:, None]
    return faces.mean(axis=2), outward / np.linalg.norm(outward, axis=2)[:, :, None]


def _hollow(corners: FloatArray, middles: FloatArray) -> FloatArray:
    """Heights (n, 6) of the middles of curved faces (n, 6, 3) over their mean planes, negative in a bore, at most 0."""
    plane, normal = _planes(corners)
    return np.asarray(np.minimum(np.einsum("nfd,nfd->nf", middles - plane, normal), 0.0))


def _within(corners: FloatArray, hollow: FloatArray, points: FloatArray) -> BoolArray:
    """True for points (n, 3) below the planes of all faces of hexahedra (n, 8, 3), less `_hollow` (n, 6)."""
    plane, normal = _planes(corners)
    return np.asarray((np.einsum("nfd,nfd->nf", points[:, None] - plane, normal) < hollow).all(axis=1))


def _in_obstacles(state: SolvedState, nodal: FloatArray, depth: float) -> list[tuple[str, _Samples]]:
    """Names of a body and an obstacle, and samples of the body that are inside, and were not before.

    Without surfaces given by functions, which may be defined near the contact surface only.
    """
    scene, result = state.scene, []
    samples = _samples(state, nodal, depth, ~scene.contact_surfaces.every)
    moved = () if state.rows is None else (kind.contact for kind in state.rows.kinds)
    for begin, pair in zip(scene.contact, moved):
        if not isinstance(begin, ContactPair) or not isinstance(pair, ContactPair):
            continue
        if pair.obstacle is None or isinstance(pair.obstacle, RigidSurface):
            continue
        inside = pair.distances(samples.now)[0] + pair.clearance < 0
        inside &= begin.distances(samples.before)[0] + begin.clearance >= 0
        for body in np.unique(samples.body[inside]):
            names = f"body {scene.mesh.bodies[body]!r} and the {pair.obstacle.name} below {pair.surfaces[0]!r}"
            rows = inside & (samples.body == body)
            result.append((names, samples.some(rows)))
    return result


def _warnings(found: list[dict[str, tuple[int, Point]]]) -> Iterator[ModelWarning]:
    """One warning for each names, from the counts and places of each rank."""
    for names in sorted({names for one in found for names in one}):
        here = [one[names] for one in found if names in one]
        count, place = sum(number for number, _ in here), min(place for _, place in here)
        where = ", ".join(f"{x:.4g}" for x in place)
        message = (
            f"{names} penetrate each other at {count} leaf facets outside of the contact and tied surfaces, near "
            f"({where}): no contact acts there; define a pair, or let its surfaces be larger"
        )
        yield ModelWarning("penetration", float(count), 0.0, place, message)
