"""The four kinds of partition: pairs, balance, the same result on any number of ranks; their quality by definition."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    chosen,
    corner_scene,
    find_leaves,
    gathered,
    grown,
    leaves,
    place,
    pressed,
    roots,
    scramble,
    strewn,
    two_boxes,
    whole,
)
from mpi4py import MPI

from fx_contact import Solver, adapt
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest import interface_smoothing
from fx_contact.forest.leaf_graph import create_leaf_graph
from fx_contact.forest.partition import KINDS, along_curve, assign, repartition
from fx_contact.forest.partition_quality import BYTES, Judge, brief
from fx_contact.forest.super_elements import Units, curve_keys
from fx_contact.parallel.errors import PartitionError
from fx_contact.problem.facet_pairing import leaf_code
from fx_contact.problem.hexahedron import FACE_CORNERS
from fx_contact.problem.lattice import SIDE, face_centres

KEEPING = [name for name, kind in KINDS.items() if kind.pairs]


def code_of(forest):
    return leaf_code(forest.cell, forest.anchor)


def rank_of(forest):
    """Rank of every leaf, in ascending order of the leaves' codes, on all ranks."""
    order = np.argsort(gathered(forest.comm, code_of(forest)))
    return gathered(forest.comm, np.full(len(forest), forest.comm.rank))[order]


@pytest.mark.parametrize("kind", list(KINDS))
def test_nothing_is_lost(kind):
    """A repartition keeps the leaves and what they carry, each rank's leaves in curve order."""
    forest = grown(roots(pressed(two_boxes(margin=1))), 3)
    moved, values = repartition(forest, code_of(forest), kind)
    everywhere(np.array_equal(values, code_of(moved)), "values do not follow their leaf")
    assert np.array_equal(leaves(moved), leaves(forest))
    everywhere((np.diff(curve_keys(moved, KINDS[kind].pairs)) >= 0).all(), "leaves are not in curve order")
    everywhere(len(moved) > 0, "a rank without leaves")


@pytest.mark.parametrize("make", [lambda: pressed(two_boxes(margin=1)), corner_scene], ids=["boxes", "corner"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_pairs_through_refinement(kind, make):
    """Under random refinement the kinds that keep pairs never split one, from leaves strewn over the ranks too."""
    forest = strewn(grown(roots(make()), 2))
    for salt in range(3):
        forest, _ = repartition(forest, None, kind)
        leaf, face = forest.contact_faces()
        cell, anchor = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
        first = forest.pairing.first[forest.cell[leaf], face]
        apart = WORLD.allreduce(int((find_leaves(forest, cell, anchor) < 0)[first].sum()))
        assert brief(forest, kind).split_pairs == apart
        assert apart == 0 or kind not in KEEPING
        forest, _ = forest.refined(chosen(forest, 0.1, salt))
    assert WORLD.allreduce(len(leaf)) > 30


def test_strewn_pairs_are_split():
    """The check above can fail."""
    if WORLD.size > 1:
        assert brief(strewn(grown(roots(pressed(two_boxes(margin=1))), 3)), "strewn").split_pairs > 10


@pytest.mark.parametrize("kind", ["contact-sfc", "sfc"])
@pytest.mark.parametrize("parts", [2, 7, 50])
def test_curve_partitions_are_balanced(kind, parts):
    """No part is heavier than 1.02 times the mean, or the mean and one super-element."""
    forest = grown(roots(pressed(two_boxes(margin=1)), MPI.COMM_SELF), 5)
    units, part = assign(forest, parts, kind)
    weights = np.bincount(part, weights=units.weights, minlength=parts)
    assert units.weights.max() == 1 + KINDS[kind].pairs and weights.min() > 0
    assert weights.max() <= max(1.02 * len(forest) / parts, len(forest) / parts + units.weights.max())


@pytest.mark.parametrize("parts", [2, 5, 40])
def test_straightening_pays(parts):
    """The cut is far shorter than the curve's while parts are large, and never longer."""
    forest = grown(roots(pressed(two_boxes(upper=(3, 3, 3), margin=1)), MPI.COMM_SELF), 4)
    units = Units(forest, True)
    curve, straight = along_curve(units, parts, None), assign(forest, parts, "contact-sfc")[1]
    assert units.graph.cut(straight) <= (0.9 if parts < 10 else 1) * units.graph.cut(curve)
    mean = len(forest) / parts
    assert np.bincount(straight, weights=units.weights).max() <= max(1.02 * mean, mean + units.weights.max())


@pytest.mark.parametrize("least", [interface_smoothing.LEAST, 1], ids=["", "finer graphs and shells"])
@pytest.mark.parametrize("kind", ["contact-sfc", "sfc", "equidistributed"])
def test_same_parts_in_serial(kind, least, monkeypatch):
    """A partition into as many parts as there are ranks, made by one rank, is the one that the ranks make."""
    if kind != "contact-sfc" and least == 1:
        pytest.skip("not straightened")
    monkeypatch.setattr(interface_smoothing, "LEAST", least)
    scene = pressed(two_boxes(upper=(3, 3, 3), margin=1))
    forest, alone = roots(scene), roots(scene, MPI.COMM_SELF)
    home = np.repeat(np.arange(WORLD.size), WORLD.allgather(len(forest)))
    # Facing leaves first meet on the lowest rank that has one of them.
    _, group = np.unique(alone.representatives, return_inverse=True)
    lowest = np.full(len(alone), WORLD.size)
    np.minimum.at(lowest, group, home)
    home = lowest[group]
    for salt in range(4):
        forest, _ = repartition(forest, None, kind)
        units, part = assign(alone, WORLD.size, kind, home)
        home = part[units.of_leaf]
        assert np.array_equal(rank_of(forest), home[np.argsort(code_of(alone))]), f"refined {salt} times"
        forest, _ = forest.refined(chosen(forest, 0.4, salt))
        alone, glue = alone.refined(chosen(alone, 0.4, salt))
        home = home[glue.parent]
    assert len(alone) > 1000 * WORLD.size, "parts too small to be straightened"
    assert least > 1 or interface_smoothing.graphs(WORLD.size, len(alone) / WORLD.size) == interface_smoothing.BOXES


def test_equidistributed_shares():
    """Contact leaves are on ranks of their own, about as many of them as their share of all leaves."""
    forest, _ = repartition(grown(roots(pressed(two_boxes(margin=1))), 4), None, "equidistributed")
    touching = len(np.unique(forest.contact_faces()[0]))
    rows = np.array(WORLD.allgather((touching, len(forest))))
    if WORLD.size > 1:
        assert ((rows[:, 0] == 0) | (rows[:, 0] == rows[:, 1])).all(), "contact leaves beside others"
        share = WORLD.size * rows[:, 0].sum() / rows[:, 1].sum()
        assert (rows[:, 0] > 0).sum() == min(max(round(share), 1), WORLD.size - 1)


@pytest.mark.parametrize("parts", [2, 10, 37])
def test_equidistributed_parts(parts):
    """The same of any number of parts, each of about the same weight as those beside it."""
    forest = grown(roots(pressed(two_boxes(margin=1)), MPI.COMM_SELF), 4)
    units, part = assign(forest, parts, "equidistributed")
    contact, others = (
        np.bincount(part[which], units.weights[which], parts) for which in (units.contact, ~units.contact)
    )
    assert not ((contact > 0) & (others > 0)).any()
    assert (contact > 0).sum() == min(max(round(parts * contact.sum() / len(forest)), 1), parts - 1)
    for weights in (contact, others):
        assert np.ptp(weights[weights > 0]) <= 2


@pytest.mark.parametrize("kind", list(KINDS))
def test_more_ranks_than_root_cells(kind):
    """Two root cells, once refined, can be spread over more ranks than two."""
    forest = roots(pressed(two_boxes(upper=(1, 1, 1))))
    for _ in range(2):
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
    moved, _ = repartition(forest, None, kind)
    assert moved.size_global == 128
    everywhere(len(moved) > 0, "a rank without leaves")


@pytest.mark.parametrize("kind", list(KINDS))
def test_adapt_on_more_ranks_than_root_cells(kind):
    """Two root cells: the run starts from a mesh of which every rank has a part, and solves it."""
    scene = pressed(two_boxes(upper=(1, 1, 1)))
    assert len(scene.mesh.cells) == 2
    (step,) = adapt(scene, 0.5, max_steps=1, partition_kind=kind)
    assert step.record.force > 0
    assert (step.record.max_level == 0) == (WORLD.size == 1 or (WORLD.size == 2 and kind == "sfc"))


@pytest.mark.parametrize("kind", list(KINDS))
def test_more_ranks_than_leaves(kind):
    """An error on all ranks that names the kind, and no hang."""
    forest = roots(pressed(two_boxes(upper=(1, 1, 1))))
    if WORLD.size > forest.size_global:
        with pytest.raises(PartitionError, match=f"2 leaves cannot be spread over {WORLD.size} ranks by '{kind}'"):
            repartition(forest, None, kind)
    with pytest.raises(PartitionError, match="2 leaves cannot be spread over 3 parts"):
        assign(roots(pressed(two_boxes(upper=(1, 1, 1))), MPI.COMM_SELF), 3, kind)


@pytest.fixture(scope="module")
def serial_solution():
    """Keys and displacements of the last of a few adaptive steps, computed by each rank for itself."""
    return solution(adapt(split_scene(), 0.01, MPI.COMM_SELF, max_steps=3, solver=Solver(tolerance=1e-9)))


def split_scene():
    """A scene of which the pair-blind curve splits pairs on two ranks and on more."""
    return pressed(two_boxes(upper=(3, 2, 2), depth=2))


def solution(steps):
    """Keys of the conforming vertices, ascending, and their displacements, on all ranks."""
    *_, last = steps
    prolongation = last.elasticity.prolongation
    own = np.flatnonzero((prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned))
    own = own[np.argsort(prolongation.conforming[own])]
    keys = gathered(last.forest.comm, prolongation.space.keys[own])
    order = np.argsort(keys)
    return keys[order], gathered(last.forest.comm, last.solution.displacement)[order], last.record


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(KINDS))
def test_same_solution(kind, serial_solution):
    """Every kind gives the serial solution to 1e-8, wherever the pairs are; the solver takes a tenth of that."""
    run = adapt(split_scene(), 0.01, max_steps=3, partition_kind=kind, solver=Solver(tolerance=1e-9))
    keys, displacement, record = solution(run)
    assert record.active_pairs > 20 and record.hanging_nodes > 50
    assert record.partition.kind == kind
    if kind == "sfc" and WORLD.size > 1:
        assert record.partition.split_pairs > 0, "no pair is split"
    everywhere(np.array_equal(keys, serial_solution[0]), "other unknowns")
    error = np.linalg.norm(displacement - serial_solution[1]) / np.linalg.norm(serial_solution[1])
    everywhere(error < 1e-8, f"displacements differ by {error}")


# ------------------------------------------------------------------------------------------- quality, by definition


def random_parts(forest, parts, salt=5):
    return (scramble(place(forest), salt) % np.uint64(parts)).astype(np.int32)


@pytest.mark.parametrize("make", [lambda: pressed(two_boxes(margin=1)), corner_scene], ids=["boxes", "corner"])
@pytest.mark.parametrize("parts", [2, 5])
def test_quality_by_definition(make, parts):
    """All measures are what a search through all leaves finds, for parts that have nothing to do with the ranks."""
    forest = repartition(grown(roots(make()), 3, share=0.1), None)[0]
    octants = (forest.anchor.astype(np.int64) // (SIDE // 2)) @ [1, 3, 5] % parts
    for part in (random_parts(forest, parts), octants):
        weights = 1.0 + forest.level
        found = Judge(forest, Prolongation(Space(forest, 1)), weights).score(part, parts)
        total = whole(forest)
        everyone, weight = gathered(WORLD, part), gathered(WORLD, weights)
        for value, loads in (
            (found.imbalance, np.bincount(everyone)),
            (found.weight_imbalance, np.bincount(everyone, weights=weight)),
        ):
            assert value == pytest.approx(loads.max() * parts / loads.sum(), rel=1e-14)
        assert found.cut_facets == cut_facets(total, everyone)
        needs, joined = by_search(total)
        split = sum(everyone[a] != everyone[b] for a, b in joined)
        assert found.split_pairs == split > 0
        users = {}
        for leaf, keys in enumerate(needs):
            for key in keys:
                users.setdefault(key, set()).add(everyone[leaf])
        several = [sorted(who) for who in users.values() if len(who) > 1]
        assert found.interface_vertices == len(several) > 0
        assert found.halo_bytes == BYTES * sum(len(who) - 1 for who in several)
        assert found.halo_bytes / parts <= found.halo_bytes_max <= found.halo_bytes
        pairs = {(a, b) for who in several for a in who for b in who if a != b}
        degree = np.bincount([a for a, _ in pairs], minlength=parts)
        assert (found.neighbours_max, found.neighbours_mean) == (degree.max(), degree.mean())
        graph = create_leaf_graph(total)
        joined += [(a, b) for a, b in zip(graph.rows, graph.matrix.indices)]
        pieces = np.bincount(everyone[components(joined, everyone)], minlength=parts)
        assert (found.pieces_max, found.pieces_mean) == (pieces.max(), pieces.mean())


def test_quality_of_the_ranks():
    """For the parts that the ranks are, the halo is that of the prolongation's index map, and brief() agrees."""
    for kind in KINDS:
        forest, _ = repartition(grown(roots(pressed(two_boxes(margin=1))), 3), None, kind)
        prolongation = Prolongation(Space(forest, 1))
        found = Judge(forest, prolongation).score(np.full(len(forest), WORLD.rank), WORLD.size)
        assert found.halo_bytes == BYTES * WORLD.allreduce(prolongation.index_map.num_ghosts)
        short = brief(forest, kind)
        assert (short.imbalance, short.cut_facets, short.split_pairs) == (
            found.imbalance,
            found.cut_facets,
            found.split_pairs,
        )
        assert (found.cut_facets > 0) == (WORLD.size > 1)


def by_search(forest):
    """For a serial forest the keys of the conforming vertices that each leaf needs, and the pairs of facing leaves."""
    prolongation, lattice = Prolongation(Space(forest, 1)), forest.lattice
    column = np.empty(prolongation.matrix.shape[1], dtype=np.int64)
    column[prolongation.conforming[~prolongation.hanging]] = prolongation.space.keys[~prolongation.hanging]
    masters = {key: set(column[row.indices]) for key, row in zip(prolongation.space.keys, prolongation.matrix)}
    keys = lattice.keys(forest.cell, forest.corners)
    needs = [set().union(*(masters[key] for key in row)) for row in keys]
    conforming, joined = set(column), []
    for leaf, face in zip(*forest.contact_faces()):
        if forest.pairing.first[forest.cell[leaf], face]:
            one = np.array([leaf]), np.array([face])
            points = forest.corners[one[0][:, None], FACE_CORNERS[one[1]]]
            cell, _, opposite = forest.pairing.opposite(forest.cell[one[0]], one[1], points)
            needs[leaf] |= set(lattice.keys(cell, opposite).ravel()) & conforming
            where = forest.pairing.partners(forest.cell[one[0]], forest.level[one[0]], forest.anchor[one[0]], one[1])
            joined.append((leaf, int(find_leaves(forest, *where)[0])))
    return needs, joined


def components(edges, part):
    """One leaf of each connected piece of the parts."""
    root = list(range(len(part)))

    def find(leaf):
        while root[leaf] != leaf:
            leaf = root[leaf]
        return leaf

    for a, b in edges:
        if part[a] == part[b]:
            root[find(a)] = find(b)
    return [leaf for leaf in range(len(part)) if root[leaf] == leaf]


def cut_facets(forest, part):
    """Leaf facets of a serial forest between parts, by definition: even ones once, hanging ones by each fine facet."""
    cell, corners = forest.cell, forest.corners
    centre = forest.lattice.keys(cell, face_centres(corners))
    owner = {}
    for leaf in range(len(cell)):
        for face in range(6):
            owner.setdefault(centre[leaf, face], set()).add(part[leaf])
    even = sum(len(parts) == 2 for parts in owner.values())
    # A leaf's face lies in one of its parent's if the parent's face centre is one of the corners of the leaf's face.
    vertex = forest.lattice.keys(cell, corners)
    hanging = 0
    for leaf in np.flatnonzero(forest.level > 0):
        for face in range(6):
            for key in vertex[leaf, FACE_CORNERS[face]]:
                if owner.get(key, {part[leaf]}) != {part[leaf]} and big(forest, cell, corners, leaf, face, key):
                    hanging += 1
    return even + hanging


def big(forest, cell, corners, leaf, face, key):
    """Whether a lattice point is the centre of the parent's face that holds a face of a leaf."""
    points = corners[leaf, FACE_CORNERS[face]]
    side = np.ptp(points, axis=0).max()
    low = points.min(axis=0) // (2 * side) * (2 * side)
    axis = int(np.argmin(np.ptp(points, axis=0)))
    centre = low + side
    centre[axis] = points[0, axis]
    if points[0, axis] % (2 * side):
        return False
    return forest.lattice.keys(cell[[leaf]], centre[None, None].astype(np.int32))[0, 0] == key
