"""Model warnings of a solution: violated assumptions of linear elasticity and of contact between facing nodes.

Strain and rotation. Of E = (grad u + grad u^T + grad u^T grad u) / 2 linear elasticity keeps the linear part and omits
a share of |grad u| / 2. The largest strain grows without bound at the edge of a punch when the mesh is refined. The
mean strain, weighted by the strain energy, does not depend on the mesh and is twice the omitted share of the energy.
The rotation, weighted by the volume, is that of a rigid or a bent body.

Sliding. The pairing of nodes is valid for sliding that is small against the length on which the gap changes: the
radius of the contact, or of parallel surfaces.  A body that slides in another one of the same curvature turns: its
large rotation is found first.
"""

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.row_kinds import kinds_of
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.cell_strain import cell_strains
from fx_contact.fem.external_forces import finer_totals
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import SIDE
from fx_contact.items.boundary_conditions import BodyForce
from fx_contact.items.units import of_lengths
from fx_contact.law.tangents import tangential_vectors
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.validation import percent
from fx_contact.scene.scene import Scene
from fx_contact.verdict.kinks import kink_warnings
from fx_contact.verdict.model_warning import LARGE, MISSED, ModelWarning, Point

#: Limit of the sliding of closed rows, relative to the radius of the contact [-].
SLIDING = 0.1
#: Limit of the tangential forces of nodes that close in a load step, relative to the normal force of their contact: a
#: ball on a rigid plane has less from four load steps on (`studies.goals.load_steps`) [-].
LOAD_STEP = 0.05
#: Limit of the initial overlap, relative to the thinner of the two bodies: as much strain as `LARGE` [-].
INITIAL_OVERLAP = 0.05
#: Limit of the part of the smaller of two tied surfaces that faces nothing: the tied section is so much smaller [-].
UNCOVERED = 0.1
#: Largest initial overlap of touching bodies, relative to the size of all [-]; spheres of order 3 have 2.5e-9.
_TOUCHING = 1e-8
#: Largest standard deviation of the initial gap of parallel surfaces over the approach [-]; of spheres it is 0.14.
_PARALLEL = 0.01
#: Order of the sampling lattice for initial overlaps on root facets.
_SAMPLES = 8
#: Relative difference by rounding.
_SAME = 1e-6


def load_warnings(scene: Scene) -> list[ModelWarning]:
    """A warning if nothing loads a scene: no displacement, force, function of position, or initial overlap.  Local."""
    if any(callable(value) or np.any(value) for value in (*scene.data, *(pair.moved for pair in scene.contact))):
        return []
    if scene.contact and _initial_overlap(scene) > _TOUCHING * np.ptp(scene.mesh.points, axis=0).max():
        return []
    message = (
        f"nothing loads the scene {scene.name!r}: its prescribed displacements and forces are zero, and no bodies "
        "penetrate each other, so that the solution is zero; prescribe a displacement or a force"
    )
    return [ModelWarning("no load", 0.0, 0.0, scene.name, message)]


def _initial_overlap(scene: Scene) -> float:
    """Largest penetration of root facets, at a lattice of points on each [m]."""
    forest = Forest.of_roots(MPI.COMM_SELF, scene.mesh, scene.pairing, scene.contact_surfaces)
    deepest = 0.0
    for kind in (kind for kind in kinds_of(scene) if not kind.contact.EQUALITY):
        cell, face = kind.facets(forest)
        nodes = hexahedron.grid_points(_SAMPLES)[hexahedron.face_nodes(_SAMPLES)[face]] * (SIDE // _SAMPLES)
        apart = kind.apart(forest, cell, face, nodes.astype(np.int32))
        across = scene.contact_directions(kind.index, np.stack([cell, face], axis=1))
        gap = np.einsum("nmi,ni->nm", apart, across) + kind.contact.clearance
        deepest = max(deepest, float(-gap.min(initial=0.0)))
    return deepest


def warnings_of_state(state: SolvedState, load_totals: FloatArray) -> list[ModelWarning]:
    """All violated assumptions of a solution, the same on all ranks.

    Collective on state.forest.comm.  Raises SceneError for a function of a load that is not finite somewhere.

    Args:
        state: with the energies of the cells in `estimate`.
        load_totals: (k, nbodies, 6), resultants of the k loads on each body, as from `load_and_totals`.
    """
    warnings, rows = [*_large_deformations(state)], state.rows
    if rows is not None:
        if state.forest.comm.allreduce(bool(state.solution.active.any()), op=MPI.LOR):
            warnings += [*_sliding(state, rows), *_initial_overlaps(state, rows), *_giving_way(state)]
        else:
            warnings.append(_no_contact(state, rows))
        warnings += [*_large_load_steps(state, rows), *_cut_off(state, rows), *_oblique(state, rows)]
        warnings += kink_warnings(state, rows)
    return [*warnings, *_uncovered_ties(state.scene), *_unresolved_loads(state, load_totals)]


def _large_deformations(state: SolvedState) -> Iterator[ModelWarning]:
    """The largest mean strain and rotation of a body or part, if they exceed `LARGE`."""
    forest, names = state.forest, state.forest.mesh.regions
    region = forest.mesh.region[forest.cell[state.elasticity.leaf_mesh.leaf]]
    strain, rotation, volume = cell_strains(state.field.function)
    energy = state.estimate.energy
    assert energy is not None, "kept in a step"
    columns = energy, energy * strain, volume, volume * rotation
    sums = np.stack([np.bincount(region, column, len(names)) for column in columns]).astype(float)
    forest.comm.Allreduce(MPI.IN_PLACE, sums)
    strains = np.divide(sums[1], sums[0], out=np.zeros(len(names)), where=sums[0] > 0)
    rotations = sums[3] / sums[2]
    for kind, values in (("large strain", strains), ("large rotation", rotations)):
        value = float(values.max())
        if value > LARGE:
            name = names[int(np.argmax(values >= (1 - _SAME) * value))]
            if kind == "large strain":
                did, limit = f"has a strain of {value:.2g}, the mean over its strain energy", f"{LARGE:g}"
            else:
                did = f"turns by {np.degrees(value):.2g} degrees, the mean over its volume"
                limit = f"{np.degrees(LARGE):.2g} degrees"
            of = "part" if name in forest.mesh.parts else "body"
            message = (
                f"{of} {name!r} {did}: linear elasticity is for small ones, and omits about {value / 2:.2g} of it; "
                f"limit {limit}"
            )
            yield ModelWarning(kind, value, LARGE, name, message)


def _sliding(state: SolvedState, rows: ConstraintRows) -> Iterator[ModelWarning]:
    """Contacts whose closed rows have slid."""
    force, contacts = state.solution.force, state.scene.contact
    count, comm = len(contacts), rows.prolongation.comm
    slid, area = rows.sliding(state.solution.still), np.where(state.solution.active, rows.area, 0.0)
    columns = force, np.abs(force), force * slid, area * rows.gap, area, rows.area
    total, magnitude, moved, gap, closed, surface = _of_contacts(rows, *columns)
    moved = np.divide(moved, total, out=np.zeros(count), where=total > 0)
    gap = np.divide(gap, closed, out=np.zeros(count), where=closed > 0)
    (varies,) = _of_contacts(rows, area * (rows.gap - gap[rows.contact]) ** 2)
    _, approach = rows.force_and_approach(force, rows.contact, count)
    for index in np.flatnonzero(total > magnitude / 2):  # less is rounding
        shaped = np.sqrt(varies[index] / closed[index]) > _PARALLEL * approach[index]
        radius = np.sqrt(state.scene.symmetry * (closed[index] if shaped else surface[index]) / np.pi)
        value, limit = float(moved[index]), float(SLIDING * radius)
        if value > limit:
            place = _place_of_largest(comm, np.where(force > 0, slid, 0.0), rows.position)[0]
            names, kind = " and ".join(map(repr, contacts[index].surfaces)), "contact" if shaped else "surface"
            message = (
                f"closed nodes of {names} have moved past each other by {value:.3g} in the mean, and their {kind} has "
                f"a radius of {radius:.3g}: they act on each other as if they still faced each other; limit "
                f"{limit:.3g} {of_lengths(state.scene.units)}"
            )
            yield ModelWarning("sliding", value, limit, place, message)


def _large_load_steps(state: SolvedState, rows: ConstraintRows) -> Iterator[ModelWarning]:
    """Contacts with friction whose nodes have closed in this load step and carry tangential forces."""
    solution, contacts = state.solution, state.scene.contact
    if not any(pair.tangential is not None for pair in contacts):
        return
    assert solution.rows is not None
    along = np.linalg.norm(tangential_vectors(solution.rows, solution.row_force), axis=1)
    columns = solution.force, np.where(solution.closed_anew, along, 0.0)
    for pair, force, anew in zip(contacts, *_of_contacts(rows, *columns)):
        if anew > LOAD_STEP * force:
            message = (
                f"nodes of {pair.label} that close in this load step have tangential forces of {percent(anew / force)} "
                f"of the contact force; they stick from where the step begins, not from where they close; limit "
                f"{LOAD_STEP:.0%}; take more load steps, `LoadPath.repeated(2, unloaded)` tells their effect"
            )
            yield ModelWarning("load step", anew / force, LOAD_STEP, pair.name, message)


def _no_contact(state: SolvedState, rows: ConstraintRows) -> ModelWarning:
    """Bodies that do not touch."""
    distance = np.linalg.norm(rows.separation(state.solution.displacement), axis=1)
    place, largest, _ = _place_of_largest(rows.prolongation.comm, -distance, rows.position)
    gap = 0.0 - largest
    message = (
        "no node pair is closed: the bodies do not press each other; the smallest distance of points that face each "
        f"other is {gap:.3g} {of_lengths(state.scene.units)}, at {_shown(place)}"
    )
    return ModelWarning("no contact", gap, 0.0, place, message)


def _giving_way(state: SolvedState) -> list[ModelWarning]:
    """Bodies that contact moves and nothing holds: there is no stress."""
    names = ", ".join(map(repr, state.solution.free_motions))
    if not names or state.estimate.energy_norm or load_warnings(state.scene):
        return []
    message = (
        f"contact presses nothing: body {names} gives way, since nothing holds it; prescribe displacements that do"
    )
    return [ModelWarning("no contact", 0.0, 0.0, state.scene.name, message)]


def _initial_overlaps(state: SolvedState, rows: ConstraintRows) -> list[ModelWarning]:
    """Deepest initial overlap at a closed pair, if it is deep against the bodies."""
    mesh, gap = state.forest.mesh, rows.gap.copy()
    for index, pair in enumerate(state.scene.contact):
        if pair.obstacle is not None and np.any(pair.moved):
            of = rows.contact == index
            gap[of] = pair.obstacle.distances(rows.position[of])[0] + pair.clearance
    depth = np.where(state.solution.active, np.maximum(-gap, 0.0), 0.0)
    more = np.column_stack([rows.normal, rows.bodies])
    place, value, (*normal, first, second) = _place_of_largest(rows.prolongation.comm, depth, rows.position, more)
    corners, bodies = mesh.points[mesh.corners], [int(body) for body in (first, second) if body >= 0]
    extents = [float(np.ptp(corners[mesh.body == body] @ normal)) for body in bodies]
    thinner = int(extents[-1] < (1 - _SAME) * extents[0])
    name, extent = mesh.bodies[bodies[thinner]], extents[thinner]
    if not value > INITIAL_OVERLAP * extent:
        return []
    message = (
        f"bodies penetrate each other by {value:.3g} before anything moves, {value / extent:.0%} of the extent of "
        f"{name!r} along the normal, at {_shown(place)}; limit {INITIAL_OVERLAP * extent:.3g} "
        + of_lengths(state.scene.units)
    )
    return [ModelWarning("initial overlap", value, INITIAL_OVERLAP * extent, place, message)]


def _cut_off(state: SolvedState, rows: ConstraintRows) -> Iterator[ModelWarning]:
    """Contacts that reach a rim of the second surface beyond which the boundary of its body goes on smoothly."""
    forest = state.forest
    for kind in rows.kinds:
        surfaces = state.scene.nonmatching.get(kind.index)
        if surfaces is None or not surfaces.goes_on:
            continue
        leaf, face = kind.facets(forest)
        pressure = rows.at_nodes(kind.index, state.solution.pressure[:, None])
        mean = pressure[rows.prolongation.space.on_faces(leaf, face), 0].mean(axis=1)
        leaf, face, mean = leaf[mean > 0], face[mean > 0], mean[mean > 0]
        facets = forest.facets(leaf, face)
        load = mean * np.linalg.norm(facets.mean_outward, axis=1)
        missed = load * surfaces.cut_off(facets, state.scene.contact_surfaces.every)
        total, value = forest.comm.allreduce(np.array([load.sum(), missed.sum()]))
        if value > MISSED * total:
            place, part = _place_of_largest(forest.comm, missed, facets.corners.mean(axis=1))[0], float(value / total)
            message = (
                f"the contact of {kind.contact.label} reaches the rim of {kind.contact.surfaces[1]!r} near "
                f"{_shown(place)}, beyond which the boundary of the body goes on: it misses about {part:.2g} of the "
                f"force, limit {MISSED:g}; let the surface be larger"
            )
            yield ModelWarning("uncovered", part, MISSED, place, message)


def _oblique(state: SolvedState, rows: ConstraintRows) -> Iterator[ModelWarning]:
    """Contacts whose force is summed along a direction that is not that of their resultant."""
    scene = state.scene
    if scene.mirrors.parts < scene.symmetry:  # the resultant of the whole is not known
        return
    forces = state.solution.force[:, None] * rows.normal
    total = scene.mirrors.force(_of_contacts(rows, *forces.T).T)
    for pair, there, force in zip(scene.contact, scene.oriented, total):
        size, direction, of_rows = float(np.linalg.norm(force)), pair.unit_direction, there.unit_direction
        if direction is None or of_rows is None or pair.obstacle is not None or not size:
            continue
        x, y, z = map(float, np.sign(direction @ of_rows) * force)  # rows may lie on the second surface
        missed = 1 - float(of_rows @ force) / size
        if missed > MISSED:
            message = (
                f"the force of {pair.label} is its component along `direction`, {percent(missed)} less than the "
                f"resultant {_shown((x, y, z))}; limit {MISSED:.0%}; leave `direction` away, or "
                "turn it along the resultant"
            )
            yield ModelWarning("oblique direction", missed, MISSED, pair.name, message)


def _uncovered_ties(scene: Scene) -> Iterator[ModelWarning]:
    """Ties of which a large part of the smaller surface faces nothing."""
    ties = {i: surfaces.uncovered for i, surfaces in scene.nonmatching.items() if scene.interfaces[i].EQUALITY}
    for index, (part, name) in ties.items():
        if part > UNCOVERED:
            message = (
                f"{scene.interfaces[index].label}: {part:.0%} of the area of {name!r} faces nothing and is free, "
                f"limit {UNCOVERED:.0%}; name what is glued"
            )
            yield ModelWarning("uncovered", part, UNCOVERED, name, message)


def _unresolved_loads(state: SolvedState, load_totals: FloatArray) -> Iterator[ModelWarning]:
    """Loads that are functions with features inside leaves."""
    scene = state.scene
    loads = *scene.tractions, *scene.body_forces
    part = "" if scene.symmetry == 1 else ", the modelled part"
    if not any(callable(force.value) for force in loads):
        return
    sums = np.column_stack([load_totals[:, :, :3].sum(axis=1), finer_totals(scene, state.elasticity)])
    state.forest.comm.Allreduce(MPI.IN_PLACE, sums)
    for force, (applied, finer, (magnitude,)) in zip(loads, (np.split(row, [3, 6]) for row in sums)):
        value, limit = float(np.linalg.norm(applied - finer)), float(MISSED * magnitude)
        if callable(force.value) and value > limit:
            total, known = np.linalg.norm(applied), np.linalg.norm(finer)
            message = (
                f"{force.what} has a total of {total:.4g} on this mesh{part}, and of {known:.4g} by a finer rule of "
                f"integration, which may be wrong too: they differ by {value:.3g}, limit {limit:.3g}; refine where it "
                "varies, or let cells end where it jumps"
            )
            place = force.body if isinstance(force, BodyForce) else force.surface
            yield ModelWarning("unresolved load", value, limit, place, message)


def _of_contacts(rows: ConstraintRows, *columns: FloatArray) -> FloatArray:
    """Sums (columns, contacts) of columns (n,) over the rows of each contact, on all ranks.  Collective."""
    sums = np.stack([np.bincount(rows.contact, column, len(rows.kinds)) for column in columns]).astype(float)
    return rows.prolongation.comm.allreduce(sums)


def _place_of_largest(
    comm: MPI.Intracomm, values: FloatArray, positions: FloatArray, more: FloatArray | None = None
) -> tuple[Point, float, list[float]]:
    """Place of the largest value (n,) of all ranks, the first by its coordinates: position, value, row of `more`."""
    largest = comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
    size = comm.allreduce(float(np.abs(positions).max(initial=0.0)), op=MPI.MAX)
    near = np.flatnonzero(values >= largest - _SAME * max(abs(largest), _SAME * size))
    rows = np.column_stack([positions] + ([] if more is None else [more]))[near]
    rows = rows[np.lexsort(rows.T[2::-1])][:1].tolist()
    first = min(row for one in comm.allgather(rows) for row in one)
    return tuple(first[:3]), largest, first[3:]


def _shown(place: Point) -> str:
    """A point for messages, without rounding."""
    least = _SAME * max(map(abs, place))
    return f"({', '.join(f'{x if abs(x) > least else 0:.4g}' for x in place)})"
