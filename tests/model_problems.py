"""Model problems that several tests share: meshes, forests, scenes, and what is gathered of them to all ranks."""

from contextlib import contextmanager
from dataclasses import MISSING, fields, replace
from itertools import permutations, product

import numpy as np
from conftest import WORLD, everywhere
from mpi4py import MPI
from scipy.sparse import coo_matrix

from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.adaptive.step_solver import elasticity_of
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.leaf_mesh import create_leaf_mesh
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.geometry import hexahedron
from fx_contact.geometry.hexahedron import CORNERS
from fx_contact.geometry.lattice import BITS, SIDE
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import join, root_mesh_from_shapes, rotation
from fx_contact.geometry.solids import BACK, BOTTOM, FRONT, LEFT, RIGHT, TOP, block
from fx_contact.items.boundary_conditions import Dirichlet, SymmetryPlane, Traction
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.law.contact_solver import solve_contact
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.timing import Stages
from fx_contact.scene.scene import Scene
from fx_contact.surfaces.facet_pairing import leaf_code

#: Sides of a block along x, y, z.
SIDES = LEFT, RIGHT, FRONT, BACK, BOTTOM, TOP
STEEL, RUBBER = Material(young=3.0, poisson=0.3), Material(young=1.0, poisson=0.2)


def step_record(step, **entries):
    """A record with nothing in it but a number and what is given."""
    known = {entry.name: 0 for entry in fields(StepRecord) if entry.default is entry.default_factory is MISSING}
    return StepRecord(**known | {"step": step, "partition": PartitionSummary("sfc", 1.0, 0, 0)} | entries)


def scramble(numbers, salt=0):
    """A well-mixed uint64 of each integer: the same on any number of ranks."""
    with np.errstate(over="ignore"):
        mixed = np.asarray(numbers, dtype=np.int64).astype(np.uint64) + np.uint64(salt + 1) * np.uint64(
            0x9E3779B97F4A7C15
        )
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            mixed = (mixed ^ mixed >> np.uint64(shift)) * np.uint64(factor)
        return mixed ^ mixed >> np.uint64(31)


def rotations():
    """The 24 ways to turn a cube, as (axes of the node array (z, y, x), flips of them)."""
    result = []
    for axes, flips in product(permutations(range(3)), product((1, -1), repeat=3)):
        if np.linalg.det(np.eye(3)[list(axes)] * flips) > 0:
            result.append((axes, flips))
    return result


def turned(nodes, which):
    """Nodes of one cell, tensor order, seen in another local frame."""
    axes, flips = rotations()[which]
    side = round(len(nodes) ** (1 / 3))
    return nodes.reshape(side, side, side).transpose(axes)[tuple(slice(None, None, f) for f in flips)].ravel()


def _distorted(points, inside, amount):
    """Cell corners moved by a random vector that depends on their position alone."""
    codes = np.rint(points + 100).astype(np.int64) @ [1, 1 << 10, 1 << 20]
    shift = np.stack([scramble(codes, axis) / 2.0**64 - 0.5 for axis in range(3)], axis=1)
    return points + 2 * amount * inside * shift


def _bent(points, amount):
    """A smooth, not polynomial map of space, the same for both bodies."""
    x, y, z = points.T
    return points + amount * np.stack([np.sin(y + 0.7 * z), np.sin(0.9 * x - z), np.sin(0.8 * x + 1.1 * y)], axis=1)


def two_boxes(upper=(2, 2, 2), depth=1, margin=0, order=1, distortion=0.15, bend=0.0, flat_contact=True, seed=1):
    """A box on a block, meshed alike where they touch; cells in random local frames, nodes in random order.

    Args:
        upper: cells of the box `upper`; it lies on z = 0, the block `lower` beneath.
        depth: layers of cells of the block.
        margin: cells by which the block is wider than the box, on all sides.
        order: of the cell maps.
        distortion: largest shift of cell corners inside the bodies along each axis [cell sizes].
        bend: amplitude of a smooth bend of everything [cell sizes].
        flat_contact: whether corners on the outside and on the contact surface stay; else those on the contact surface
            are shifted in the plane.
        seed: of the local frames.
    """
    wide = np.array(upper[:2]) + 2 * margin
    boxes = {
        "lower": ((*wide, depth), np.array([-margin, -margin, -depth]), TOP),
        "upper": (upper, np.zeros(3, dtype=int), BOTTOM),
    }
    points, cells, body, surfaces, count = [], [], [], {}, 0
    for index, (name, (counts, low, face)) in enumerate(boxes.items()):
        high = low + counts
        shape = block(low, high, counts, order).named(
            "contact", face, where=lambda x: ((x[:2].T > -1e-9) & (x[:2].T < np.add(upper[:2], 1e-9))).all(axis=1)
        )
        x, c, first = shape.points, shape.cells, sum(map(len, cells))
        names = zip(SIDES, (f"{axis} {end}" for axis in "xyz" for end in ("low", "high")))
        for side, place in (*names, ("contact", "contact")):
            surfaces[f"{name} {place}"] = shape.sides[side] + [first, 0]
        corner = c[:, hexahedron.corner_nodes(order)]
        inside = ((x > low + 1e-9) & (x < high - 1e-9)).astype(float)
        if flat_contact:
            inside *= inside.all(axis=1)[:, None]
        else:
            # In the plane z = 0 the corners within the patch move alike in both bodies, those on its edge along it.
            on, patch = np.abs(x[:, 2]) < 1e-9, (x > 1e-9) & (x < np.array([*upper[:2], 0]) - 1e-9)
            inside[on] = patch[on]
        moved = _distorted(x, inside, distortion)
        exact = hexahedron.lagrange(1, np.linspace(0, 1, order + 1))
        x[c.ravel()] = hexahedron.tensor_evaluate((exact,) * 3, moved[corner]).reshape(-1, 3)
        points.append(x)
        cells.append(c + count)
        body += [index] * len(c)
        count += len(x)
    points, cells = np.concatenate(points), np.concatenate(cells)
    frames = scramble(np.arange(len(cells)), seed) % 24
    faces = {}
    for number, frame in enumerate(frames):
        before = cells[number, hexahedron.corner_nodes(order)][hexahedron.FACE_CORNERS]
        cells[number] = turned(cells[number], int(frame))
        after = cells[number, hexahedron.corner_nodes(order)][hexahedron.FACE_CORNERS]
        sets = [frozenset(face.tolist()) for face in after]
        faces[number] = [sets.index(frozenset(face.tolist())) for face in before]
    surfaces = {
        name: np.array([(cell, faces[cell][face]) for cell, face in rows], dtype=np.int32)
        for name, rows in surfaces.items()
    }
    # Numbers without order, so that the canonical frames of facing root faces differ.
    order_of = np.argsort(scramble(np.arange(count), seed))
    number = np.empty_like(order_of)
    number[order_of] = np.arange(count)
    points, cells = points[order_of], number[cells]
    name_points = np.flatnonzero((np.abs(points) < 1e-12).all(axis=1))
    points = _bent(points, bend) if bend else points
    return RootMesh(
        points, cells, ("lower", "upper"), np.array(body, dtype=np.int32), surfaces, {"lower corner": name_points[:1]}
    )


def pressed(mesh, approach=0.02, materials=(STEEL, RUBBER), contact=True, direction=(0.0, 0.0, 1.0)):
    """Scene of two boxes of which the outer faces are held, the upper one lowered."""
    return Scene(
        name="two boxes",
        mesh=mesh,
        materials=dict(zip(("lower", "upper"), materials)),
        dirichlet=(
            Dirichlet("lower z low", x=0.0, y=0.0, z=0.0),
            Dirichlet("upper z high", x=0.0, y=0.0, z=-approach),
        ),
        contact=(ContactPair("lower contact", "upper contact", direction=direction),) if contact else (),
    )


def corner_scene(one_pair=False):
    """A cube in the corner of an L: their surfaces meet in a concave edge, in one contact pair or in two."""
    ell = join(block((0, 0, 0), (2, 2, 1), (2, 2, 1), 1), block((0, 0, 1), (1, 2, 2), (1, 2, 1), 1))
    ell = ell.named("floor", TOP, where=lambda x: x[2] < 1.5).named("wall", RIGHT, where=lambda x: x[0] < 1.5)
    cube = block((1, 0, 1), (2, 2, 2), (1, 2, 1), 1)
    surfaces = {"floor": "ell floor", "wall": "ell wall", "under": "cube bottom", "side": "cube left"}
    surfaces |= {"inner": ("ell floor", "ell wall"), "outer": ("cube bottom", "cube left")}
    surfaces |= {"fixed": "ell bottom", "top": "cube top"}
    mesh = root_mesh_from_shapes({"ell": ell, "cube": cube}, surfaces)
    two = (ContactPair("floor", "under", direction=(0, 0, 1)), ContactPair("wall", "side", direction=(1, 0, 0)))
    contact = (ContactPair("inner", "outer"),) if one_pair else two
    held = Dirichlet("fixed", x=0.0, y=0.0, z=0.0), Dirichlet("top", x=-0.01, y=0.0, z=-0.01)
    return Scene("corner", mesh, {"ell": STEEL, "cube": STEEL}, contact=contact, dirichlet=held)


def roots(scene, comm=WORLD):
    """The unrefined forest of a scene."""
    return Forest.of_roots(comm, scene.mesh, scene.pairing, scene.contact_surfaces)


def refined_around(scene, point, bodies=None):
    """A Beginning with hanging nodes: leaves of some bodies, or of all, around a point are halved twice."""
    forest = roots(scene)
    numbers = [scene.mesh.bodies.index(body) for body in (scene.mesh.bodies if bodies is None else bodies)]
    for reach in (0.6, 0.35):
        near = np.linalg.norm(forest.centres - point, axis=1) < reach
        forest, _ = forest.refined(near & np.isin(scene.mesh.body[forest.cell], numbers))
    return Beginning.at_rest(forest)


def place(forest):
    """A number for each leaf that depends on its place alone, alike for leaves down to level 12: (n,) int64."""
    x, y, z = forest.anchor.T.astype(np.int64) >> BITS - 12
    return ((forest.cell.astype(np.int64) << 12 | x) << 12 | y) << 12 | z


def chosen(forest, share, salt):
    """Random marks that do not depend on the number of ranks."""
    return scramble(place(forest) * 16 + forest.level, salt) % np.uint64(1000) < np.uint64(1000 * share)


def grown(forest, rounds, share=0.15, salt=7):
    """A forest refined at random, round by round.  Collective."""
    for number in range(rounds):
        forest, _ = forest.refined(chosen(forest, share, salt + number))
    return forest


def split(forest, marked):
    """The forest with exactly the marked leaves refined, whatever the rules of balance say.  Local."""
    parent = np.repeat(np.arange(len(forest)), np.where(marked, 8, 1))
    child = np.concatenate([np.empty(0, int), *(range(8) if m else [0] for m in marked)]).astype(int)
    level = (forest.level + marked)[parent].astype(np.int8)
    side = (SIDE >> level.astype(np.int32)).astype(np.int32)
    anchor = forest.anchor[parent] + side[:, None] * CORNERS[child].astype(np.int32)
    return replace(forest, cell=forest.cell[parent], level=level, anchor=anchor)


def strewn(forest, salt=3):
    """The same leaves on random ranks, facing leaves apart.  Collective."""
    return forest.moved(scramble(place(forest), salt) % np.uint64(forest.comm.size))[0]


def lopsided(forest):
    """The same leaves, all that have contact on the last rank and nothing else there.  Collective."""
    touching = np.isin(np.arange(len(forest)), forest.contact_faces()[0])
    if not forest.comm.allreduce(int(touching.sum())):
        return forest
    last = forest.comm.size - 1
    return forest.moved(np.where(touching, last, forest.comm.rank % max(last, 1)))[0]


#: Ways to distribute the leaves: as they were refined, at random, along the contact-aware curve, contact apart.
DISTRIBUTIONS = {
    "roots": lambda forest: forest,
    "strewn": strewn,
    "contact-sfc": lambda forest: repartition(forest, None)[0],
} | ({"lopsided": lopsided} if WORLD.size > 1 else {})

# ------------------------------------------------------------------------------------ all of a forest on each rank


def gathered(comm, rows):
    """The rows of all ranks on every rank.  Collective on comm."""
    return np.concatenate(comm.allgather(np.asarray(rows)))


def leaves(forest):
    """Codes and levels of all leaves, sorted: (n, 2).  Collective."""
    mine = np.stack([leaf_code(forest.cell, forest.anchor), forest.level.astype(np.int64)], axis=1)
    rows = gathered(forest.comm, mine)
    return rows[np.lexsort(rows.T[::-1])]


def whole(forest):
    """The same forest on this rank alone.  Collective."""
    columns = [gathered(forest.comm, c) for c in (forest.cell, forest.level, forest.anchor)]
    return Forest(MPI.COMM_SELF, forest.mesh, forest.lattice, forest.pairing, forest.contact_surfaces, *columns)


def numbered(prolongation):
    """Keys of the conforming vertices of all ranks by their global number.  Collective."""
    own = (prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned)
    number = prolongation.index_map.local_to_global(prolongation.conforming[own])
    keys = np.full(prolongation.index_map.size_global, -1, dtype=np.int64)
    keys[gathered(prolongation.comm, number)] = gathered(prolongation.comm, prolongation.space.keys[own])
    return keys


def gathered_prolongation(prolongation):
    """P with rows and columns in ascending order of keys, and both keys.  Ranks that share a row agree.  Collective."""
    comm, by_number = prolongation.comm, numbered(prolongation)
    rows = np.unique(gathered(comm, prolongation.space.keys))
    columns = np.sort(by_number)
    local = prolongation.matrix.tocoo()
    reach = prolongation.index_map.size_local + prolongation.index_map.num_ghosts
    number = prolongation.index_map.local_to_global(np.arange(reach, dtype=np.int32))
    row = np.searchsorted(rows, prolongation.space.keys)[local.row]
    column = np.searchsorted(columns, by_number[number])[local.col]
    shape = len(rows), len(columns)
    total = coo_matrix((gathered(comm, local.data), (gathered(comm, row), gathered(comm, column))), shape).tocsr()
    copies = np.bincount(gathered(comm, np.searchsorted(rows, prolongation.space.keys)), minlength=len(rows))
    mean = total.multiply(1 / copies[:, None]).tocsr()
    mine = coo_matrix((local.data, (row, column)), shape).tocsr()
    here = np.unique(np.searchsorted(rows, prolongation.space.keys))
    everywhere(
        abs(mine[here] - mean[here]).max() < 1e-15 if len(here) else True, "ranks disagree on a row of P", comm
    )
    return mean, rows, columns


def shortest(nodes):
    """The least mean length of the four edges along an axis of cells, (n,) float64, from nodes (n, k^3, 3)."""
    side = round(nodes.shape[1] ** (1 / 3))
    corners = nodes.reshape(-1, side, side, side, 3)[:, :: side - 1, :: side - 1, :: side - 1]
    edges = [np.linalg.norm(np.diff(corners, axis=axis), axis=-1).reshape(-1, 4) for axis in (1, 2, 3)]
    return np.min([length.mean(axis=1) for length in edges], axis=0)


def vertex_positions(forest):
    """Positions (m, 3) of this rank's vertices on the true curved geometry, as in `forest.vertices`.  Local."""
    leaf, corner = forest.vertices.example.T
    points = forest.corners[leaf, corner] / SIDE
    return forest.mesh.evaluate(forest.cell[leaf], points[:, :, None])[:, 0]


def discrete(scene, forest, order=1, degree=1):
    """Elasticity of a scene on a forest."""
    cells = create_leaf_mesh(forest, order)
    return elasticity_of(scene, cells, forest.cell[cells.leaf], prolongation_of(scene, forest, degree), Stages())


def prolongation_of(scene, forest, degree=1):
    """Prolongation with the nodes of the rows of a scene."""
    prolongation = Prolongation(Space(forest, degree))
    return create_rows(scene, prolongation, Enforcement()).prolongation if scene.contact else prolongation


def with_rows(scene, forest, enforcement=None):
    """Elasticity of a scene on a forest, the rows of its contact, and its supports."""
    elasticity = discrete(scene, forest)
    rows = create_rows(scene, elasticity.prolongation, enforcement or Enforcement())
    return elasticity, rows, find_supports(scene, forest, elasticity.prolongation)


def side_by_side():
    """Two boxes whose contact is two pairs in one plane, which share the vertices of a seam at x = 1."""
    mesh = two_boxes()
    surfaces = dict(mesh.surfaces)
    for body in mesh.bodies:
        facets = mesh.surface(f"{body} contact")
        left = mesh.facet_points(facets, 1).mean(axis=1)[:, 0] < 1
        surfaces[f"{body} left"], surfaces[f"{body} right"] = facets[left], facets[~left]
    mesh = replace(mesh, surfaces=surfaces)
    contact = tuple(ContactPair(f"lower {side}", f"upper {side}", direction=(0, 0, 1)) for side in ("left", "right"))
    return replace(pressed(mesh), contact=contact)


EXACT = Solver(tolerance=1e-13, loose_tolerance=1e-6)


def conforming_positions(forest, prolongation):
    """Positions of the owned conforming nodes, and of which body they are."""
    own = (prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned)
    position, body = np.empty((prolongation.owned, 3)), np.empty(prolongation.owned, dtype=int)
    place = prolongation.conforming[own]
    position[place] = prolongation.space.positions(own)
    body[place] = forest.mesh.body[forest.cell[prolongation.space.example[own, 0]]]
    return position, body


def solved(elasticity, pairs, supports, enforcement=None, forces=None, start=None):
    """ContactSolution, from zero displacement on if there is no start, as exact as rounding permits."""
    zero = np.zeros_like(supports.prescribed)
    start, forces = zero if start is None else start, zero if forces is None else forces
    matrix = elasticity.stiffness(pairs, supports=supports)
    problem = ContactProblem(matrix, forces, supports, elasticity.energy_norm, pairs)
    return solve_contact(problem, start, SolveOptions(EXACT, enforcement or Enforcement()), Stages())


DEPTH, THICKNESS, WIDTH, PULL = 1e-5, 0.05, 10.0, 1e-2


def plates(pressed=False, stretched=0.0, joined=False):
    """Two wide thin plates pressed into each other, and a rod apart that stores a thousand times their energy.

    Or a rod in two halves, pressed into each other: a contact pair of its own, or one with the plates.  The lower plate
    may be stretched too.
    """
    bodies = {
        "lower": block((0, 0, -THICKNESS), (WIDTH, WIDTH, 0), (2, 2, 1), 1),
        "upper": block((0, 0, 0), (WIDTH, WIDTH, THICKNESS), (2, 2, 1), 1),
        "rod": block((-3, 0, 0), (-2, 1, 5), (1, 1, 5), 1),
    }
    surfaces = {"bottom": "lower bottom", "top": "upper top", "left": "lower left", "right": "lower right"}
    surfaces |= {"lower face": "lower top", "upper face": "upper bottom", "foot": "rod bottom", "head": "rod top"}
    held = {"bottom": 0.0, "top": -DEPTH, "foot": 0.0}
    pairs, loads = [ContactPair("lower face", "upper face", direction=(0, 0, 1))], [Traction("head", (0, 0, PULL))]
    if pressed:
        bodies["rest"] = block((-3, 0, 5), (-2, 1, 10), (1, 1, 5), 1)
        surfaces |= {"below": "rest bottom", "end": "rest top"}
        held, loads = held | {"end": -10 * PULL}, []
        pairs.append(ContactPair("head", "below", direction=(0, 0, 1)))
    if joined:
        surfaces |= {"up": ("lower top", "rod top"), "down": ("upper bottom", "rest bottom")}
        pairs = [ContactPair("up", "down", direction=(0, 0, 1))]
    return Scene(
        "plates",
        root_mesh_from_shapes(bodies, surfaces),
        dict.fromkeys(bodies, Material(1.0, 0.0)),
        (
            *(Dirichlet(surface, None if surface == "bottom" else 0.0, 0.0, z) for surface, z in held.items()),
            *(Dirichlet(surface, x=x) for surface, x in (("left", 0.0), ("right", stretched))),
        ),
        tuple(pairs),
        tuple(loads),
    )


def of_kind(record, kind):
    """Name -> Resultant of one kind."""
    return {one.name: one for one in record.resultants if one.kind == kind}


@contextmanager
def some(count):
    """A communicator of the first ranks, None on the others, which wait."""
    comm = WORLD.Split(0 if WORLD.rank < count else MPI.UNDEFINED)
    yield None if comm == MPI.COMM_NULL else comm
    WORLD.Barrier()


def find_leaves(forest, cell, anchor):
    """Positions (m,) of leaves (m,), (m, 3) among this rank's leaves, -1 where they are not.  Local."""
    code = leaf_code(forest.cell, forest.anchor)
    order = np.argsort(code)
    if not len(code):
        return np.full(len(cell), -1, dtype=np.int64)
    wanted = leaf_code(cell, anchor)
    slot = np.minimum(np.searchsorted(code[order], wanted), len(code) - 1)
    return np.where(code[order[slot]] == wanted, order[slot], -1)


#: Unit vectors along the sides of a wedge of 30 degrees and along its edge, oblique to the axes: columns.
ALONG = rotation((1.0, 2.0, 3.0), 20.0) @ np.array([[1.0, np.sqrt(0.75), 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]])


PLANES = SymmetryPlane("left"), SymmetryPlane("front"), SymmetryPlane("bottom")


def wedge(material=STEEL, held=PLANES, distortion=0.1, **parts):
    """A wedge from the origin, `ALONG` times the unit cube, inner nodes out of place; its planes meet at its edges."""
    shape = block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (3, 3, 3), 1)
    shape = shape.placed(lambda x: ALONG @ (x + distortion * np.sin(np.pi * x).prod(axis=0)))
    mesh = root_mesh_from_shapes({"wedge": shape}, {side: f"wedge {side}" for side in shape.sides})
    return Scene("wedge", mesh, {"wedge": material}, tuple(held), **parts)
