"""Model warning of kinks between the root facets of a contact surface.

Root cells of order q follow a curved surface but for O(h^(q+1)), and meet at angles alpha.  On a surface with other
facets, or a smooth obstacle, they press like wedges, with pressures of about E* alpha / 8.
"""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.geometry.root_facets import RootFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import SMOOTH
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray
from fx_contact.parallel.validation import percent
from fx_contact.surfaces.nonmatching import EDGE_MIDDLES, edges_of
from fx_contact.verdict.model_warning import ModelWarning

#: Limit of E* alpha / 8 over the largest pressure: of press fits the pressures at nodes are then off by up to 10 %
#: (`studies.nonmatching.kinks`) [-].
KINKS = 0.05


def kinks(state: SolvedState, rows: ConstraintRows) -> list[ModelWarning]:
    """A warning for each contact, at its largest kink between pressed root facets.  Collective."""
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
    position, angle = _angles(mesh, np.argwhere(_pressed(state, rows, kind)))
    wedge = modulus * angle / 8
    if not len(wedge) or wedge.max() <= KINKS * largest:
        return None
    worst = int(wedge.argmax())
    x, y, z = map(float, position[worst])
    message = (
        f"at ({x:.4g}, {y:.4g}, {z:.4g}) root facets of {contact.label} meet at an angle of {angle[worst]:.2g} rad: "
        f"pressures at nodes are off by about {percent(wedge[worst] / largest)} of the largest one, limit "
        f"{percent(KINKS)}; take cells of order 4 or more (gmsh.model.mesh.setOrder(4)), smaller ones, or mesh both "
        "surfaces alike"
    )
    return ModelWarning("kinks", float(wedge[worst] / largest), KINKS, (x, y, z), message)


def _angles(mesh: RootMesh, facets: IntArray) -> tuple[FloatArray, FloatArray]:
    """Middles (k, 3) [m] of the edges between two of these facets (n, 2), angles (k,), 0 at sharp edges.  Local."""
    edge, middles = edges_of(mesh, facets).ravel(), RootFacets(mesh, facets).at(np.arange(len(facets)), EDGE_MIDDLES)
    order = np.argsort(edge, kind="stable")
    shared = edge[order[:-1]] == edge[order[1:]]
    one, two = order[:-1][shared], order[1:][shared]
    normal = middles.normal.reshape(-1, 3)
    angle = np.linalg.norm(normal[one] - normal[two], axis=1)
    return middles.position.reshape(-1, 3)[one], np.where(1 - angle**2 / 2 > SMOOTH, angle, 0.0)


def _pressed(state: SolvedState, rows: ConstraintRows, kind: RowKind) -> BoolArray:
    """(ncells, 6), root facets of both surfaces where they press each other, on all ranks.  Collective."""
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
    return marks
