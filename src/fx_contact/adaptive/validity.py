"""Whether a problem is one that linear elasticity and contact between facing nodes describe: doubts beside the error.

An estimate compares a solution with that of the same linear problem on a finer mesh, so that it knows nothing of this.

Strain and rotation. Of E = (grad u + grad u^T + grad u^T grad u) / 2 linear elasticity keeps the linear part: it leaves
out |grad u| / 2 of it. Strains are unbounded at the edge of a punch, so that none of their largest values on a mesh
means anything. Their mean, weighted by the strain energy, does: it is the part of the energy that is left out, and
does not depend on the mesh. Weighted by the volume, the rotation is that of a body as a whole, or of one that bends.

Sliding. Nodes face each other as long as they have moved past each other by little against the length on which the
gap changes: the radius of the contact, or where surfaces are parallel that of the surfaces.  The pressure acts on both
bodies where they were.  That normals turn is not looked at: a body that slides in another of its own curvature turns,
and is doubtful as a large rotation first.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.contact.row_kinds import kinds_of
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.cell_strain import cell_strains
from fx_contact.fem.external_forces import finer_totals
from fx_contact.forest.forest import Forest
from fx_contact.parallel.errors import SceneError, ValidityError
from fx_contact.parallel.validation import check_name, shown
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import BodyForce, Dirichlet
from fx_contact.problem.lattice import SIDE

#: Strain and rotation from which on there is a doubt: 2.5 % of it, or of the stress, is left out.
DOUBTFUL = 0.05
#: Kinds of doubts that are errors unless they are allowed, and the values from which on they are: 25 % is left out.
REFUSED = {"large strain": 0.5, "large rotation": 0.5, "no load": 0.0}
#: Sliding of closed rows that is a doubt, relative to the radius of the contact [-].
SLIDING = 0.1
#: Initial overlap that is a doubt, relative to the thinner of the two bodies: as much strain as `DOUBTFUL` [-].
INITIAL_OVERLAP = 0.05
#: Part of a load that the mesh may miss [-].
MISSED = 0.01
#: Initial overlap up to which bodies do not load each other, relative to the size of all [-]; spheres of order 3 that
#: just touch have 2.5e-9.
_TOUCHING = 1e-8
#: Standard deviation of the initial gap in a contact, relative to the approach that its force takes, up to which
#: surfaces are parallel there [-]; of spheres it is 0.14.
_PARALLEL = 0.01
#: Order of the lattice on root facets at which initial overlaps are looked for.
_SAMPLES = 8
#: Relative difference up to which values are the same but for rounding.
_SAME = 1e-6


@dataclass(frozen=True)
class Doubt:
    """What makes a solution doubtful.

    Attributes:
        kind: "large strain", "large rotation", "sliding", "no contact", "initial overlap", "unresolved load" or
            "no load".
        value: what was found, in the unit that the message says.
        limit: the doubt is there because the value is above it, for "no contact" and "no load" not below it.
        place: a point, undeformed [m], or the name of a body, a surface or the scene.
        message: a sentence with all of it.
    """

    kind: str
    value: float
    limit: float
    place: tuple[float, float, float] | str
    message: str

    @classmethod
    def from_json(cls, entries):
        """A doubt from what JSON makes of it: dict.  Local."""
        place = entries["place"]
        return cls(**entries | {"place": place if isinstance(place, str) else tuple(place)})


def check_allowed(allow):
    """See that kinds of doubts can be allowed.

    Local.

    Args:
        allow: tuple or list of keys of `REFUSED`.

    Raises:
        SceneError: it is none, or has another name.
    """
    if not isinstance(allow, (tuple, list)):
        advice = f": write ({allow!r},)" if isinstance(allow, str) else ""
        raise SceneError(f"allow must be a tuple of kinds of doubts, got {shown(allow)}{advice}")
    for kind in allow:
        check_name("kind of doubts to allow", kind, REFUSED)


def check_doubts(doubts, allow):
    """See that no doubt is so large that there is no valid solution.

    Local.

    Args:
        doubts: list of Doubt.
        allow: kinds that are allowed.

    Raises:
        ValidityError: one is at or above its value in `REFUSED`, and its kind is not allowed.
    """
    for doubt in doubts:
        if doubt.kind not in allow and doubt.value >= REFUSED.get(doubt.kind, np.inf):
            raise ValidityError(
                f"{doubt.message}; allow=({doubt.kind!r},), or --allow {doubt.kind!r} of a demo, goes on all the same"
            )


def doubts_of_scene(scene):
    """Whether something loads a scene: a displacement, a force, a function of position, or an initial overlap.

    Local.

    Args:
        scene: Scene.

    Returns:
        list of Doubt, the same on all ranks.
    """
    prescribed = (value for c in scene.conditions if isinstance(c, Dirichlet) for value in (c.x, c.y, c.z))
    applied = (force.value for force in (*scene.tractions, *scene.body_forces))
    if any(callable(value) or np.any(value) for value in (*applied, *prescribed) if value is not None):
        return []
    if scene.contact and _initial_overlap(scene) > _TOUCHING * np.ptp(scene.mesh.points, axis=0).max():
        return []
    message = (
        f"nothing loads the scene {scene.name!r}: its prescribed displacements and forces are zero, and no bodies "
        "penetrate each other, so that the solution is zero; prescribe a displacement or a force"
    )
    return [Doubt("no load", 0.0, 0.0, scene.name, message)]


def _initial_overlap(scene):
    """Largest penetration of root facets, at a lattice of points on each [m].  Local."""
    forest = Forest.of_roots(MPI.COMM_SELF, scene.mesh, scene.pairing, scene.contact_surfaces)
    deepest = 0.0
    for kind in kinds_of(scene):
        cell, face = kind.facets(forest)
        nodes = hexahedron.grid_points(_SAMPLES)[hexahedron.face_nodes(_SAMPLES)[face]] * (SIDE // _SAMPLES)
        apart = kind.apart(forest, cell, face, nodes.astype(np.int32))
        across = scene.contact_directions(np.stack([cell, face], axis=1))
        deepest = max(deepest, float(-np.einsum("nmi,ni->nm", apart, across).min(initial=0.0)))
    return deepest


def find_doubts(state, load_totals):
    """All doubts about a solution.

    Collective on state.forest.comm.

    Args:
        state: SolvedState, its estimate with the energies of the cells.
        load_totals: (k, nbodies, 6) float64, of the loads, as from `load_and_totals`.

    Returns:
        list of Doubt, the same on all ranks.

    Raises:
        SceneError: a load that is a function fails, or is not finite somewhere.
    """
    doubts = [*doubts_of_scene(state.scene), *_large_deformations(state)]
    if state.pairs is not None:
        closed = state.forest.comm.allreduce(bool(state.solution.active.any()), op=MPI.LOR)
        doubts += [*_sliding(state), *_initial_overlaps(state)] if closed else [_no_contact(state)]
    return doubts + _unresolved_loads(state, load_totals)


def _large_deformations(state):
    """Doubts about the body that is strained most, and the one that turns most, in the mean."""
    forest, names = state.forest, state.forest.mesh.bodies
    body = forest.mesh.body[forest.cell[state.elasticity.leaf_mesh.leaf]]
    strain, rotation, volume = cell_strains(state.field.function)
    energy = state.estimate.energy
    columns = energy, energy * strain, volume, volume * rotation
    sums = np.stack([np.bincount(body, column, len(names)) for column in columns]).astype(float)
    forest.comm.Allreduce(MPI.IN_PLACE, sums)
    strains = np.divide(sums[1], sums[0], out=np.zeros(len(names)), where=sums[0] > 0)
    rotations = sums[3] / sums[2]
    doubts = []
    for kind, values in (("large strain", strains), ("large rotation", rotations)):
        value = float(values.max())
        if value > DOUBTFUL:
            name = names[int(np.argmax(values >= (1 - _SAME) * value))]
            if kind == "large strain":
                did, limit = f"has a strain of {value:.2g}, the mean over its strain energy", f"{DOUBTFUL:g}"
            else:
                did = f"turns by {np.degrees(value):.2g} degrees, the mean over its volume"
                limit = f"{np.degrees(DOUBTFUL):.2g} degrees"
            message = (
                f"body {name!r} {did}: linear elasticity is for small ones, and leaves out about {value / 2:.2g} of "
                f"it; doubtful from {limit} on"
            )
            doubts.append(Doubt(kind, value, DOUBTFUL, name, message))
    return doubts


def _sliding(state: SolvedState) -> list[Doubt]:
    """Doubts about contacts whose closed rows have moved past each other."""
    rows, force, contacts = state.pairs, state.solution.force, state.scene.contact
    count, comm = len(contacts), rows.prolongation.comm
    apart = rows.separation(state.solution.displacement)
    along = apart - np.einsum("ni,ni->n", apart, rows.normal)[:, None] * rows.normal
    slid, area = np.linalg.norm(along, axis=1), np.where(state.solution.active, rows.area, 0.0)

    def sums(*columns: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Of each column over the rows of each contact: (columns, contacts)."""
        return comm.allreduce(np.array([np.bincount(rows.contact, column, count) for column in columns], float))

    pressed, moved, gap, closed, whole = sums(force, force * slid, area * rows.gap, area, rows.area)
    moved = np.divide(moved, pressed, out=np.zeros(count), where=pressed > 0)
    gap = np.divide(gap, closed, out=np.zeros(count), where=closed > 0)
    (varies,) = sums(area * (rows.gap - gap[rows.contact]) ** 2)
    _, approach = rows.force_and_approach(force, rows.contact, count)
    doubts = []
    for index in np.flatnonzero(pressed > 0):
        shaped = np.sqrt(varies[index] / closed[index]) > _PARALLEL * approach[index]
        radius = np.sqrt(state.scene.symmetry * (closed[index] if shaped else whole[index]) / np.pi)
        value, limit = float(moved[index]), float(SLIDING * radius)
        if value > limit:
            place = _place_of_largest(comm, np.where(force > 0, slid, 0.0), rows.position)[0]
            names, what = " and ".join(map(repr, contacts[index].surfaces)), "contact" if shaped else "surface"
            message = (
                f"closed nodes of {names} have moved past each other by {value:.3g} in the mean, and their {what} has "
                f"a radius of {radius:.3g}: they act on each other as if they still faced each other; doubtful from "
                f"{limit:.3g} on, in units of the mesh"
            )
            doubts.append(Doubt("sliding", value, limit, place, message))
    return doubts


def _no_contact(state):
    """The doubt that bodies do not touch."""
    pairs = state.pairs
    distance = np.linalg.norm(pairs.separation(state.solution.displacement), axis=1)
    place, largest, _ = _place_of_largest(pairs.prolongation.comm, -distance, pairs.position)
    gap = 0.0 - largest
    message = (
        f"no node pair is closed: the bodies do not touch; the smallest gap is {gap:.3g}, in units of the mesh, at "
        f"{_shown(place)}"
    )
    return Doubt("no contact", gap, 0.0, place, message)


def _initial_overlaps(state):
    """The doubt about the deepest initial overlap at a closed pair, if it is deep against the bodies."""
    pairs, mesh = state.pairs, state.forest.mesh
    depth = np.where(state.solution.active, np.maximum(-pairs.gap, 0.0), 0.0)
    more = np.column_stack([pairs.normal, pairs.bodies])
    place, value, (*normal, first, second) = _place_of_largest(pairs.prolongation.comm, depth, pairs.position, more)
    corners, bodies = mesh.points[mesh.corners], [int(body) for body in (first, second) if body >= 0]
    extents = [float(np.ptp(corners[mesh.body == body] @ normal)) for body in bodies]
    thinner = int(extents[-1] < (1 - _SAME) * extents[0])
    name, extent = mesh.bodies[bodies[thinner]], extents[thinner]
    if not value > INITIAL_OVERLAP * extent:
        return []
    message = (
        f"bodies penetrate each other by {value:.3g} before anything moves, {value / extent:.0%} of the extent of "
        f"{name!r} along the normal, at {_shown(place)}; doubtful from {INITIAL_OVERLAP * extent:.3g} on, in units of "
        "the mesh"
    )
    return [Doubt("initial overlap", value, INITIAL_OVERLAP * extent, place, message)]


def _unresolved_loads(state, load_totals):
    """Doubts about loads that are functions with features inside leaves."""
    scene, doubts = state.scene, []
    loads = *scene.tractions, *scene.body_forces
    if not any(callable(force.value) for force in loads):
        return doubts
    sums = np.column_stack([load_totals[:, :, :3].sum(axis=1), finer_totals(scene, state.elasticity)])
    state.forest.comm.Allreduce(MPI.IN_PLACE, sums)
    for force, (applied, finer, (magnitude,)) in zip(loads, (np.split(row, [3, 6]) for row in sums)):
        value, limit = float(np.linalg.norm(applied - finer)), float(MISSED * magnitude)
        if callable(force.value) and value > limit:
            total, known = np.linalg.norm(applied), np.linalg.norm(finer)
            message = (
                f"{force.what} has a total of {total:.4g} on this mesh, and of {known:.4g} by a finer rule of "
                f"integration: they differ by {value:.3g}, doubtful from {limit:.3g} on; refine where it varies, or "
                "let cells end where it jumps"
            )
            place = force.body if isinstance(force, BodyForce) else force.surface
            doubts.append(Doubt("unresolved load", value, limit, place, message))
    return doubts


def _place_of_largest(comm, values, positions, more=None):
    """Where the largest value of all ranks is, the first place by its coordinates of those that have it.

    Collective on comm.

    Args:
        comm: MPI communicator.
        values: (n,) float64.
        positions: (n, 3) float64.
        more: (n, k) float64, what else is known there; None: nothing.

    Returns:
        the position, a tuple of three floats, the value, and a list of the k others.
    """
    largest = comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
    size = comm.allreduce(float(np.abs(positions).max(initial=0.0)), op=MPI.MAX)
    near = np.flatnonzero(values >= largest - _SAME * max(abs(largest), _SAME * size))
    rows = np.column_stack([positions] + ([] if more is None else [more]))[near]
    rows = rows[np.lexsort(rows.T[2::-1])][:1].tolist()
    first = min(row for one in comm.allgather(rows) for row in one)
    return tuple(first[:3]), largest, first[3:]


def _shown(place):
    """A point as it stands in a message, without rounding."""
    least = _SAME * max(map(abs, place))
    return f"({', '.join(f'{x if abs(x) > least else 0:.4g}' for x in place)})"
