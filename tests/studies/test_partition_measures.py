"""Measures of partitions into any number of parts: what a search through all leaves finds."""

import numpy as np
import pytest
from conftest import WORLD
from model_problems import (
    corner_scene,
    find_leaves,
    gathered,
    grown,
    place,
    pressed,
    roots,
    scramble,
    two_boxes,
    whole,
)

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.partition import KINDS, repartition
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.geometry.hexahedron import FACE_CORNERS
from fx_contact.geometry.lattice import SIDE, face_centres
from studies.partition.measures import BYTES, Judge


def random_parts(forest, parts, salt=5):
    return (scramble(place(forest), salt) % np.uint64(parts)).astype(np.int32)


@pytest.mark.parametrize("make", [lambda: pressed(two_boxes(margin=1)), corner_scene], ids=["boxes", "corner"])
@pytest.mark.parametrize("parts", [2, 5])
def test_quality_by_definition(make, parts):
    """All measures are what a search through all leaves finds, for parts that have nothing to do with the ranks."""
    forest = repartition(grown(roots(make()), 3, share=0.1), None)[0]
    octants = (forest.anchor.astype(np.int64) // (SIDE // 2)) @ [1, 3, 5] % parts
    for part in (random_parts(forest, parts), octants):
        found = Judge(forest, Prolongation(Space(forest, 1))).score(part, parts)
        total, everyone = whole(forest), gathered(WORLD, part)
        loads = np.bincount(everyone)
        assert found["imbalance"] == pytest.approx(loads.max() * parts / loads.sum(), rel=1e-14)
        assert found["cut_facets"] == cut_facets(total, everyone)
        needs, joined = by_search(total)
        split = sum(everyone[a] != everyone[b] for a, b in joined)
        assert found["split_pairs"] == split > 0
        users = {}
        for leaf, keys in enumerate(needs):
            for key in keys:
                users.setdefault(key, set()).add(everyone[leaf])
        several = [sorted(who) for who in users.values() if len(who) > 1]
        assert found["halo_bytes"] == BYTES * sum(len(who) - 1 for who in several)
        assert found["halo_bytes"] / parts <= found["halo_bytes_max"] <= found["halo_bytes"]
        pairs = {(a, b) for who in several for a in who for b in who if a != b}
        degree = np.bincount([a for a, _ in pairs], minlength=parts)
        assert found["neighbours_max"] == degree.max()


@pytest.mark.parametrize("degree", [1, 2])
def test_quality_of_the_ranks(degree):
    """For the parts that the ranks are, the halo is that of the prolongation's index map, and the record agrees."""
    for kind in KINDS:
        forest, _ = repartition(grown(roots(pressed(two_boxes(margin=1))), 3), None, kind)
        prolongation = Prolongation(Space(forest, degree))
        found = Judge(forest, prolongation).score(np.full(len(forest), WORLD.rank), WORLD.size)
        assert found["halo_bytes"] == BYTES * WORLD.allreduce(prolongation.index_map.num_ghosts)
        short = PartitionSummary.of(forest, kind)
        names = "imbalance", "cut_facets", "split_pairs"
        assert [getattr(short, name) for name in names] == [found[name] for name in names]
        assert (found["cut_facets"] > 0) == (WORLD.size > 1)


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
        if not forest.pairing.second[forest.cell[leaf], face]:
            one = np.array([leaf]), np.array([face])
            points = forest.corners[one[0][:, None], FACE_CORNERS[one[1]]]
            cell, _, opposite = forest.pairing.opposite(forest.cell[one[0]], one[1], points)
            needs[leaf] |= set(lattice.keys(cell, opposite).ravel()) & conforming
            where = forest.pairing.partners(forest.cell[one[0]], forest.level[one[0]], forest.anchor[one[0]], one[1])
            joined.append((leaf, int(find_leaves(forest, *where)[0])))
    return needs, joined


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
