"""Model warning of kinks in a contact surface: between root facets, and in a `RigidSurface`.

Root cells of order q follow a curved surface but for O(h^(q+1)), and meet at angles alpha.  On a surface with other
facets, or a smooth obstacle, they press like wedges, with pressures of about E* alpha / 8.  The samples of an obstacle
by linear interpolation press like cones, p = E* alpha / 4 arccosh(a / r), E* alpha / 2 at r = 0.27 a; their kinks are
found by second differences of the gap.  Source of the latter: I. N. Sneddon, Int. J. Eng. Sci. 3, 1965.
"""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.geometry.root_facets import RootFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import SMOOTH
from fx_contact.items.obstacles import RigidSurface
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import percent
from fx_contact.surfaces.nonmatching import EDGE_MIDDLES, edges_of
from fx_contact.verdict.model_warning import ModelWarning

#: Limit of E* alpha / 8 over the largest pressure: of press fits the pressures at nodes are then off by up to 10 %
#: (`studies.nonmatching.kinks`) [-].
KINKS = 0.05
#: Steps of a line across a leaf facet in which kinks of an obstacle are found, and divisions of 5 of them: the last
#: ones have 1/1300 of the facet.
_STEPS, _DIVISIONS = 32, 3
#: Distances beyond a box, relative to its size, that are rounding.
_ROUNDING = 1e-9
#: Advice, for root cells and for obstacles.
_FOR_CELLS = "take cells of order 4 or more (gmsh.model.mesh.setOrder(4)), smaller ones, or mesh both surfaces alike"
_FOR_OBSTACLES = "interpolate it with continuous slopes, as by scipy.interpolate.RectBivariateSpline"


def kink_warnings(state: SolvedState, rows: ConstraintRows) -> list[ModelWarning]:
    """A warning for each contact, at its largest kink at pressed root facets.  Collective."""
    found = (_worst(state, rows, kind) for kind in rows.kinds)
    return [warning for warning in found if warning is not None]


def _worst(state: SolvedState, rows: ConstraintRows, kind: RowKind) -> ModelWarning | None:
    forest, mesh, contact = state.forest, state.forest.mesh, kind.contact
    if kind.index not in state.scene.nonmatching and contact.obstacle is None:
        return None  # facets meshed alike have the same kinks
    ours = rows.contact == kind.index
    stiffest = np.where(ours, 1 / (1 / rows.modulus).sum(axis=1), 0.0)
    values = np.array([values.max(initial=0.0) for values in (stiffest, state.solution.pressure[ours])])
    forest.comm.Allreduce(MPI.IN_PLACE, values, op=MPI.MAX)
    modulus, largest = values
    roots, pressed = _pressed(state, rows, kind)
    of_cells = _largest(*_angles(mesh, np.argwhere(forest.contact_surfaces.on(kind.index)), roots))
    of_obstacle = 0.0, np.zeros(3)
    if isinstance(contact.obstacle, RigidSurface):
        surface = mesh.facet_points(mesh.surface(contact.surfaces[0])).reshape(-1, 3)
        box = np.stack([surface.min(axis=0), surface.max(axis=0)])
        with together(forest.comm):  # the user's function may raise on one rank
            found = _largest(*_slopes(pressed, contact.obstacle, box))
        of_obstacle = max(forest.comm.allgather(found), key=lambda one: one[0])
    (angle, position), part, what, advice = of_cells, 1 / 8, "root facets", _FOR_CELLS
    if of_obstacle[0] / 2 > angle / 8:
        (angle, position), part, what, advice = of_obstacle, 1 / 2, "planes of the obstacle", _FOR_OBSTACLES
    wedge = modulus * angle * part
    if wedge <= KINKS * largest:
        return None
    x, y, z = map(float, position)
    message = (
        f"at ({x:.4g}, {y:.4g}, {z:.4g}) {what} of {contact.label} meet at an angle of {angle:.2g} rad: pressures at "
        f"nodes are off by about {percent(wedge / largest)} of the largest one, limit {percent(KINKS)}; {advice}"
    )
    return ModelWarning("kinks", float(wedge / largest), KINKS, (x, y, z), message)


def _largest(position: FloatArray, angle: FloatArray) -> tuple[float, FloatArray]:
    """The largest of angles (k,), with its position, 0 of none."""
    return (float(angle.max()), position[angle.argmax()]) if len(angle) else (0.0, np.zeros(3))


def _slopes(facets: LeafFacets, obstacle: RigidSurface, box: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The largest change (n,) of the gap's slope on lines across each leaf facet, behind its position (n, 3) [m].

    The intervals with the largest second differences are divided again: these remain at a kink, and are O(s) elsewhere.
    Lines end a step beyond facets, but in the box (2, 3) around the surface.
    """
    across, steps = (np.arange(4) + 0.5) / 4, np.linspace(0, 1, _STEPS + 1)
    low: FloatArray = np.full((len(facets), 8, 1), -1 / _STEPS)
    high: FloatArray = 1 - low
    for _ in range(_DIVISIONS):
        along = low + (high - low) * steps
        lines = np.stack(np.broadcast_arrays(along, np.tile(across, 2)[:, None]), axis=-1)
        lines[:, 4:] = lines[:, 4:, :, ::-1]
        x = facets.at(lines.reshape(len(facets), 8 * (_STEPS + 1), 2)).position.reshape(*along.shape, 3)
        inside = np.clip(x, *box)
        gap = obstacle.distances(inside.reshape(-1, 3))[0].reshape(along.shape)
        gap[np.abs(inside - x).max(axis=3) > _ROUNDING * np.ptp(box)] = np.nan
        slope = np.diff(gap, axis=2) / np.linalg.norm(np.diff(x, axis=2), axis=3)
        change = np.abs(np.diff(slope, axis=2))
        both = np.nan_to_num(change[:, :, 1:] + change[:, :, :-1])  # of a kink inside a step
        largest = both.argmax(axis=2)[:, :, None]
        low = np.take_along_axis(along, np.maximum(largest - 1, 0), axis=2)
        high = np.take_along_axis(along, np.minimum(largest + 4, _STEPS), axis=2)
    kink = both.max(axis=2)
    return x.mean(axis=2)[np.arange(len(facets)), kink.argmax(axis=1)], kink.max(axis=1)


def _angles(mesh: RootMesh, facets: IntArray, pressed: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Middles (k, 3) [m] of the edges between two facets (n, 2), one of them pressed, and angles (k,).  Local.

    The angle is 0 at sharp edges.
    """
    edge, middles = edges_of(mesh, facets).ravel(), RootFacets(mesh, facets).at(np.arange(len(facets)), EDGE_MIDDLES)
    order, presses = np.argsort(edge, kind="stable"), np.repeat(pressed[tuple(facets.T)], 4)
    one, two = order[:-1], order[1:]
    some = (edge[one] == edge[two]) & (presses[one] | presses[two])
    one, two, normal = one[some], two[some], middles.normal.reshape(-1, 3)
    angle = np.linalg.norm(normal[one] - normal[two], axis=1)
    return middles.position.reshape(-1, 3)[one], np.where(1 - angle**2 / 2 > SMOOTH, angle, 0.0)


def _pressed(state: SolvedState, rows: ConstraintRows, kind: RowKind) -> tuple[BoolArray, LeafFacets]:
    """(ncells, 6), root facets of both surfaces where they press each other, of all ranks; leaf facets of the first.

    Collective.
    """
    forest, facing = state.forest, state.forest.facing.get(kind.index)
    leaf, face = kind.facets(forest) if facing is None else (facing.leaf, facing.face)
    pressure = rows.at_nodes(kind.index, state.solution.pressure[:, None])
    presses = (pressure[rows.prolongation.space.on_faces(leaf, face), 0] > 0).any(axis=1)
    marks = np.zeros((len(forest.mesh.cells), 6), dtype=bool)
    marks[forest.cell[leaf[presses]], face[presses]] = True
    if facing is not None:
        one, two = facing.pairs[facing.faced].T
        there = two[presses[one]]
        marks[facing.second.cell[there], facing.second.face[there]] = True
    forest.comm.Allreduce(MPI.IN_PLACE, marks, op=MPI.LOR)
    return marks, forest.facets(leaf[presses], face[presses])
