"""Model problems that several tests share, and what keeps tests collective: ranks pass and fail together."""

import os
import sys
import time
import traceback
from itertools import permutations, product

import numpy as np
import pytest
from mpi4py import MPI
from scipy.sparse import coo_matrix

from fx_contact import reference
from fx_contact.forest import Forest
from fx_contact.lattice import BITS, SIDE
from fx_contact.pairing import leaf_code
from fx_contact.partition import repartition
from fx_contact.reference import CORNERS
from fx_contact.rootmesh import RootMesh
from fx_contact.scene import ContactPair, Dirichlet, Material, Scene

WORLD = MPI.COMM_WORLD


def pytest_addoption(parser):
    """How often the runs of `test_checkpoint` are killed, and how what takes long is run."""
    parser.addoption("--kills", type=int, default=2, help="times that a run is killed and restarted (default 2)")
    parser.addoption("--as-printed", action="store_true", help="run what the README prints to the letter, for hours")
    parser.addoption("--in-turn", action="store_true", help="of whole runs, half on 2 and half on 3 ranks")


#: Modules whose tests are whole adaptive runs, most of the time on 2 and 3 ranks.
WHOLE_RUNS = {"test_accuracy", "test_contact_error", "test_enforcement", "test_hertz", "test_scenes", "test_unseen"}


def pytest_collection_modifyitems(config, items):
    """With `--in-turn` each test of `WHOLE_RUNS` runs on 1 rank and on 2 or 3, every other one on each."""
    if not config.getoption("--in-turn") or WORLD.size not in (2, 3):
        return
    long = [item for item in items if item.module.__name__ in WHOLE_RUNS]
    left = set(long[WORLD.size % 2 :: 2])
    config.hook.pytest_deselected(items=sorted(left, key=items.index))
    items[:] = [item for item in items if item not in left]


def pytest_sessionfinish(session, exitstatus):
    """Where the arguments of `tests/run` select no test, its run on a number of ranks has not failed."""
    if exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED:
        session.exitstatus = pytest.ExitCode.OK


# ---------------------------------------------------------------------------------------- ranks pass and fail together

_MEETING = WORLD.Dup()
_PATIENCE = 60.0
"""Seconds that a rank which failed alone waits for the others, which may be stuck in a collective call."""


def everywhere(condition, message, comm=WORLD):
    """Assert on all ranks what must hold on each.  Collective on comm."""
    assert comm.allreduce(bool(condition), op=MPI.LAND), message


def _meet(failure):
    """End a phase of a test together: the ranks that failed, or an abort if the others do not come."""
    failed = np.zeros(WORLD.size, dtype=np.int32)
    failed[WORLD.rank] = failure is not None
    total = np.empty_like(failed)
    request = _MEETING.Iallreduce(failed, total)
    deadline = time.monotonic() + _PATIENCE
    while not request.Test():
        if failure is not None and time.monotonic() > deadline:
            traceback.print_exception(failure, file=sys.__stderr__)
            sys.__stderr__.flush()
            WORLD.Abort(1)
        time.sleep(1e-4)
    return np.flatnonzero(total)


def _together():
    failure, result = None, None
    try:
        result = yield
    except pytest.skip.Exception:
        _meet(None)
        raise
    except BaseException as caught:
        failure = caught
    failed = _meet(failure)
    if failure is not None:
        raise failure
    assert not len(failed), f"failed on ranks {failed.tolist()}"
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    return (yield from _together())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    return (yield from _together())


def outside():
    """Environment for a program that is started from here, but does not belong to an mpirun above.  Local."""
    above = "OMPI_COMM", "OMPI_FILE", "OMPI_MCA_num", "OMPI_UNIVERSE", "OMPI_WORLD", "PMIX_", "PRTE_LAUNCHED"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(above)}
    # More ranks than cores, folders where those of the mpirun above are: it has taken the launcher's settings away.
    kept |= {"PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    if "PMIX_SERVER_TMPDIR" in os.environ:
        kept |= {"PRTE_MCA_prte_tmpdir_base": os.path.dirname(os.environ["PMIX_SERVER_TMPDIR"])}
    return kept


# ----------------------------------------------------------------------------------------------------- model problems

STEEL, RUBBER = Material(young=3.0, poisson=0.3), Material(young=1.0, poisson=0.2)


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


def _box(shape, low, order):
    """Points and cells (tensor order) of a box of unit cells."""
    n = np.array(shape) * order + 1
    points = np.stack(np.meshgrid(*(np.arange(k) / order for k in n[::-1]), indexing="ij")[::-1], axis=-1).reshape(
        -1, 3
    )
    first = np.array([(i, j, k) for k in range(shape[2]) for j in range(shape[1]) for i in range(shape[0])]) * order
    ijk = first[:, None] + reference.lattice(order)
    return points + low, ijk @ [1, n[0], n[0] * n[1]]


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
        "lower": ((*wide, depth), np.array([-margin, -margin, -depth])),
        "upper": (upper, np.zeros(3, dtype=int)),
    }
    points, cells, body, surfaces, count = [], [], [], {}, 0
    for index, (name, (shape, low)) in enumerate(boxes.items()):
        x, c = _box(shape, low, order)
        high = low + shape
        centres = x[c[:, reference.corner_nodes(order)][:, reference.FACE_CORNERS]].mean(axis=2)
        first = sum(map(len, cells))
        for axis, (start, end) in enumerate(zip(low, high)):
            for at, side in ((start, "low"), (end, "high")):
                surfaces[f"{name} {'xyz'[axis]} {side}"] = np.argwhere(np.abs(centres[:, :, axis] - at) < 1e-9) + [
                    first,
                    0,
                ]
        touching = (np.abs(centres[:, :, 2]) < 1e-9) & (
            (centres[:, :, :2] > 0) & (centres[:, :, :2] < upper[:2])
        ).all(axis=2)
        surfaces[f"{name} contact"] = np.argwhere(touching) + [first, 0]
        corner = c[:, reference.corner_nodes(order)]
        inside = ((x > low + 1e-9) & (x < high - 1e-9)).astype(float)
        if flat_contact:
            inside *= inside.all(axis=1)[:, None]
        else:
            # In the plane z = 0 the corners within the patch move alike in both bodies, those on its edge along it.
            on, patch = np.abs(x[:, 2]) < 1e-9, (x > 1e-9) & (x < np.array([*upper[:2], 0]) - 1e-9)
            inside[on] = patch[on]
        moved = _distorted(x, inside, distortion)
        exact = reference.lagrange(1, np.linspace(0, 1, order + 1))
        x[c.ravel()] = reference.tensor_evaluate((exact,) * 3, moved[corner]).reshape(-1, 3)
        points.append(x)
        cells.append(c + count)
        body += [index] * len(c)
        count += len(x)
    points, cells = np.concatenate(points), np.concatenate(cells)
    frames = scramble(np.arange(len(cells)), seed) % 24
    faces = {}
    for number, frame in enumerate(frames):
        before = cells[number, reference.corner_nodes(order)][reference.FACE_CORNERS]
        cells[number] = turned(cells[number], int(frame))
        after = cells[number, reference.corner_nodes(order)][reference.FACE_CORNERS]
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
    grid = (
        np.stack(np.meshgrid(range(3), range(3), range(3), indexing="ij")[::-1], axis=-1).reshape(-1, 3).astype(float)
    )
    cells = np.array(
        [
            [(i + x) + 3 * ((j + y) + 3 * (k + z)) for x, y, z in reference.CORNERS]
            for k in (0, 1)
            for j in (0, 1)
            for i in (0, 1)
        ]
    )
    cube = np.flatnonzero(grid[cells].mean(axis=1)[:, [0, 2]].min(axis=1) > 1)
    ell = np.setdiff1d(np.arange(8), cube)
    cells = np.concatenate([cells[ell], cells[cube] + len(grid)])
    points = np.concatenate([grid, grid])
    used, cells = np.unique(cells, return_inverse=True)
    cells, points = cells.reshape(8, 8), points[used]
    centres = points[cells[:, reference.FACE_CORNERS]].mean(axis=2)
    body = np.repeat([0, 1], [6, 2]).astype(np.int32)

    def rows(which, axis, at):
        near = (np.abs(centres[:, :, axis] - at) < 1e-9) & (body[:, None] == which)
        if at == 1:
            near &= centres[:, :, 2 - axis] > 1
        return np.argwhere(near).astype(np.int32)

    surfaces = {
        "floor": rows(0, 2, 1),
        "wall": rows(0, 0, 1),
        "under": rows(1, 2, 1),
        "side": rows(1, 0, 1),
        "fixed": rows(0, 2, 0),
        "top": rows(1, 2, 2),
    }
    surfaces["inner"] = np.concatenate([surfaces["floor"], surfaces["wall"]])
    surfaces["outer"] = np.concatenate([surfaces["under"], surfaces["side"]])
    mesh = RootMesh(points, cells, ("ell", "cube"), body, surfaces)
    two = (ContactPair("floor", "under", direction=(0, 0, 1)), ContactPair("wall", "side", direction=(1, 0, 0)))
    contact = (ContactPair("inner", "outer"),) if one_pair else two
    held = Dirichlet("fixed", x=0.0, y=0.0, z=0.0), Dirichlet("top", x=-0.01, y=0.0, z=-0.01)
    return Scene("corner", mesh, {"ell": STEEL, "cube": STEEL}, contact=contact, dirichlet=held)


def roots(scene, comm=WORLD):
    """The unrefined forest of a scene."""
    return Forest.of_roots(comm, scene.mesh, scene.pairing)


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
    return forest._with(
        forest.cell[parent], level, forest.anchor[parent] + side[:, None] * CORNERS[child].astype(np.int32)
    )


def strewn(forest, salt=3):
    """The same leaves on random ranks, facing leaves apart.  Collective."""
    return forest.moved(scramble(place(forest), salt) % np.uint64(forest.comm.size))[0]


#: Ways to distribute the leaves: as they were refined, at random, along the contact-aware curve.
DISTRIBUTIONS = {
    "roots": lambda forest: forest,
    "strewn": strewn,
    "contact-sfc": lambda forest: repartition(forest, None)[0],
}

# ------------------------------------------------------------------------------------ all of a forest on each rank


def nodes_of_cells(leaf_mesh):
    """Geometry nodes of the local cells of a LeafMesh: (ncells, (q + 1)^3) int32; from dolfinx 0.11 on in a list."""
    geometry = leaf_mesh.mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


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
    return Forest(MPI.COMM_SELF, forest.mesh, forest.lattice, forest.pairing, *columns)


def numbered(prolongation):
    """Keys of the conforming vertices of all ranks by their global number.  Collective."""
    own = (prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned)
    number = prolongation.index_map.local_to_global(prolongation.conforming[own])
    keys = np.full(prolongation.index_map.size_global, -1, dtype=np.int64)
    keys[gathered(prolongation.comm, number)] = gathered(prolongation.comm, prolongation.vertices.keys[own])
    return keys


def gathered_prolongation(prolongation):
    """P with rows and columns in ascending order of keys, and both keys.  Ranks that share a row agree.  Collective."""
    comm, by_number = prolongation.comm, numbered(prolongation)
    rows = np.unique(gathered(comm, prolongation.vertices.keys))
    columns = np.sort(by_number)
    local = prolongation.matrix.tocoo()
    reach = prolongation.index_map.size_local + prolongation.index_map.num_ghosts
    number = prolongation.index_map.local_to_global(np.arange(reach, dtype=np.int32))
    row = np.searchsorted(rows, prolongation.vertices.keys)[local.row]
    column = np.searchsorted(columns, by_number[number])[local.col]
    shape = len(rows), len(columns)
    total = coo_matrix((gathered(comm, local.data), (gathered(comm, row), gathered(comm, column))), shape).tocsr()
    copies = np.bincount(gathered(comm, np.searchsorted(rows, prolongation.vertices.keys)), minlength=len(rows))
    mean = total.multiply(1 / copies[:, None]).tocsr()
    mine = coo_matrix((local.data, (row, column)), shape).tocsr()
    here = np.unique(np.searchsorted(rows, prolongation.vertices.keys))
    everywhere(
        abs(mine[here] - mean[here]).max() < 1e-15 if len(here) else True, "ranks disagree on a row of P", comm
    )
    return mean, rows, columns


def vertex_positions(forest):
    """Positions of this rank's vertices on the true curved geometry.

    Local.

    Args:
        forest: Forest.

    Returns:
        (m, 3) float64 [m], in the order of `forest.vertices`.
    """
    leaf, corner = forest.vertices.example.T
    points = forest.corners[leaf, corner] / SIDE
    return forest.mesh.evaluate(forest.cell[leaf], points[:, :, None])[:, 0]
