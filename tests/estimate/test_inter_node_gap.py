"""Contact that no node sees is found between the nodes, on any number of ranks, and after a restart."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD
from model_problems import corner_scene, gathered, leaves, roots
from mpi4py import MPI

from fx_contact import ContactPair, Dirichlet, Enforcement, Material, Scene, adapt, block, root_mesh_from_shapes
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.contact.row_kinds import kinds_of
from fx_contact.estimate.inter_node_gap import GapBetweenNodes, _Facets
from fx_contact.fem.space import Space
from fx_contact.scenes import punch
from fx_contact.surfaces.facet_pairing import leaf_code
from studies.boxes import DOWN, LEFT, RIGHT, UP, Boxes
from studies.stability.shapes import bump, in_two, on_block, ring, waves

HIDDEN = {"cells": 5, "displacement": 0.003}
"""A bump whose pole is in the middle of a root facet, all of whose nodes of degree 1 stay apart."""
QUARTER = {"cells": 3, "pole": 1 / 6, "displacement": 0.006}
"""One whose pole is a quarter of a root facet from its middle, all of whose nodes of degree 2 stay apart."""


@pytest.mark.parametrize("degree, hidden", [(1, HIDDEN), (2, QUARTER)])
def test_a_pole_between_nodes(degree, hidden):
    """No node is in contact at first; the facet that overlaps is named and refined, and the run goes on."""
    first, *_, last = (step.record for step in adapt(bump(**hidden), 0.3, degree=degree))
    assert first.force == first.ratio == 0 and not first.reached
    assert first.penetrated_leaves > 0 and last.penetrated_leaves == 0
    alone = [step.record for step in adapt(bump(**hidden), 0.3, MPI.COMM_SELF, degree=degree)][-1]
    assert last.reached and last.force > 0 and abs(last.force / alone.force - 1) < 1e-7
    # Seen or not at first, the contact is the same: with a node at the pole.
    *_, seen = adapt(bump(**(hidden | {"cells": 6})), 0.3, degree=degree)
    assert abs(last.force / seen.record.force - 1) < 2 * 0.3**2


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("degree, start", [(1, 0.65), (2, 0.625), (2, 0.65)])
def test_a_rim_that_touches_between_nodes(degree, start):
    """The lower edge of a tilted block, the rim of the second surface, presses inside facets whose rows stay open."""

    def place(x):
        low = 1 + 0.05 * (x[0] - start)
        return x[0], x[1], low + (x[2] - 1) * (2 - low)

    bodies = {
        "base": block((0, 0, 0), (2, 1, 1), (8, 4, 4), 1),
        "block": block((start, 0, 1), (1.6, 1, 2), (1, 1, 1), 1).placed(place),
    }
    scene = Scene(
        "tilted",
        root_mesh_from_shapes(bodies),
        dict.fromkeys(bodies, Material(1.0, 0.3)),
        (Dirichlet("base bottom", 0.0, 0.0, 0.0), Dirichlet("block top", 0.0, 0.0, -0.002)),
        (ContactPair("base top", "block bottom"),),
    )
    assert scene.oriented[0].first == "base top"
    records = [step.record for step in adapt(scene, 0.3, degree=degree, max_steps=3 - degree)]
    assert records[0].active_pairs == 0 and records[0].penetrated_leaves == 4 and not records[0].reached
    assert degree == 2 or records[1].force > 0


@pytest.mark.parametrize(
    "degree, cells, pole, depth, radius", [(1, 3, 0.137, 2e-5, 4.0), (2, 2, 0.1141, 6e-5, 2.438)]
)
def test_a_touch_between_nodes(degree, cells, pole, depth, radius):
    """An overlap that is little of what the gap varies by on its facet is not missed; the force is Hertz's."""
    *_, last = adapt(bump(cells, pole, depth, radius), 0.25, degree=degree)
    hertz = 4 / 3 * 0.5 / (1 - 0.3**2) * radius**0.5 * depth**1.5
    assert last.record.reached and abs(last.record.force / hertz - 1) < 0.25**2


def test_what_is_unseen_is_refined_alone():
    """One facet in the middle of all overlaps; its leaf is marked, on the rank that has it."""
    step = next(adapt(bump(**HIDDEN), 0.3, degree=1, max_steps=1))
    centre = gathered(WORLD, step.forest.centres[step.contact_error.refine > 0])
    assert step.record.penetrated_leaves == len(centre) >= 1
    assert np.abs(centre[:, :2]).max() < 0.2, "another leaf"


def test_facets_around_closed_ones_are_judged_by_their_force():
    """They overlap a little on any mesh of a round body, also where the closed one is another rank's."""
    *_, step = adapt(bump(4, 9 / 32, 0.011), 0.3, degree=1, max_steps=2)
    between = GapBetweenNodes(step)
    assert step.record.active_pairs > 0 and step.record.penetrated_leaves == 0
    assert WORLD.allreduce(int(between.penetrated().sum())) == 0
    assert WORLD.allreduce(between.on_cells(step.solution.pressure).sum()) > 0


def bumps(depths, moduli):
    """Two pairs of a bump and a block, side by side, that have nothing to do with each other."""
    boxes, surfaces, materials, held, pairs = Boxes(2), {}, {}, [], []
    for number, (depth, modulus) in enumerate(zip(depths, moduli)):
        base, bump, x = f"base {number}", f"bump {number}", 10.0 * number
        boxes.add(base, (x - 1, -1.0, -1.0), (x + 1, 1.0, 0.0), (4, 4, 2))
        boxes.add(bump, (x - 1, -1.0, 0.0), (x + 1, 1.0, 1.0), (4, 4, 2))
        surfaces |= {f"{base} held": boxes.facets(DOWN, -1.0, base), f"{bump} held": boxes.facets(UP, 1.0, bump)}
        surfaces |= {base: boxes.facets(UP, 0.0, base), bump: boxes.facets(DOWN, 0.0, bump)}
        materials |= dict.fromkeys((base, bump), Material(modulus, 0.3))
        held += [Dirichlet(f"{base} held", 0.0, 0.0, 0.0), Dirichlet(f"{bump} held", 0.0, 0.0, -depth)]
        pairs.append(ContactPair(base, bump, direction=(0.0, 0.0, 1.0)))

    def place(name, x):
        height = ((x[:, 0] + 5) % 10 - 5) ** 2 + x[:, 1] ** 2
        return x + np.outer((1 - x[:, 2]) * height / 8 * name.startswith("bump"), [0, 0, 1])

    return Scene("bumps", boxes.mesh(surfaces, place=place), materials, tuple(held), tuple(pairs))


@pytest.mark.parametrize("modulus", [1.0, 1e-6])
def test_a_light_contact_beside_a_heavy_one(modulus):
    """What is little of the whole energy is resolved as contact all the same, in a contact pair of its own."""
    depths, moduli = (0.01, 1e-4), (1.0, modulus)
    scene = bumps(depths, moduli)
    *_, last = adapt(scene, 0.3)
    light = last.solution.force[last.rows.position[:, 0] > 5].sum()
    hertz = moduli[1] * 4 / 3 * 0.5 / (1 - 0.3**2) * 4**0.5 * depths[1] ** 1.5
    assert last.record.reached and abs(WORLD.allreduce(light) / hertz - 1) < 0.2


def beside_an_edge(swapped):
    """A cube with a soft block on its top, pressed hard, and a bump against its side, just below the edge."""
    boxes, radius, y, z = Boxes(2), 1.0, 0.44, 0.94
    boxes.add("cube", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2, 2))
    boxes.add("block", (0.0, 0.0, 1.0), (1.0, 1.0, 2.0), (2, 2, 2))
    boxes.add("bump", (1.0, 0.0, 0.0), (2.0, 1.0, 1.0), (2, 2, 2))

    def place(name, x):
        height = ((x[:, 1] - y) ** 2 + (x[:, 2] - z) ** 2) / 2 / radius
        return x + np.outer((2 - x[:, 0]) * height * (name == "bump"), [1, 0, 0])

    surfaces = {"bottom": boxes.facets(DOWN, 0.0, "cube"), "top": boxes.facets(UP, 2.0)}
    surfaces |= {"far": boxes.facets(RIGHT, 2.0), "up": boxes.facets(UP, 1.0, "cube")}
    surfaces |= {"down": boxes.facets(DOWN, 1.0, "block")}
    surfaces |= {"side": boxes.facets(RIGHT, 1.0, "cube"), "nose": boxes.facets(LEFT, 1.0, "bump")}
    names, direction = (("nose", "side"), (-1, 0, 0)) if swapped else (("side", "nose"), (1, 0, 0))
    return Scene(
        "beside an edge",
        boxes.mesh(surfaces, place=place),
        {"cube": Material(1.0, 0.0), "block": Material(1e-4, 0.0), "bump": Material(1.0, 0.0)},
        (Dirichlet("bottom", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, -0.3), Dirichlet("far", -0.003, 0.0, 0.0)),
        (ContactPair("up", "down", direction=(0, 0, 1)), ContactPair(*names, direction=direction)),
    )


def test_contact_around_the_edge_from_closed_pairs_of_others():
    """Closed pairs of one contact hide nothing of another that shares their vertices, whichever surface is first."""
    first, second = ([step.record for step in adapt(beside_an_edge(swapped), 0.3)] for swapped in (False, True))
    seen = [one.pair_forces[1] > 0 for one in first].index(True)
    assert [one.cells for one in first[: seen + 1]] == [one.cells for one in second[: seen + 1]]
    assert abs(first[seen].pair_forces[1] / second[seen].pair_forces[1] - 1) < 1e-6
    for last in (first[-1], second[-1]):  # their normals, and with these some leaves, are not quite the same
        assert last.reached and abs(last.pair_forces[0] / 3e-5 - 1) < 1e-3
        # At degree 2 7.111e-5 and 7.109e-5 at tolerances of 0.1 and 0.04, at degree 1 7.26e-5 at 0.05 and falling.
        assert abs(last.pair_forces[1] / 7.11e-5 - 1) < 0.3**2


def test_an_order_that_swings_between_its_nodes():
    """Polynomials of order 6 leave the range of their samples by many times that range."""
    scene = on_block("swinging", lambda x, _: 0.0324 - 0.01 * np.cos(3 * np.pi * x), 1, 6, 0.002)
    (step,) = adapt(scene, 0.4, MPI.COMM_SELF, max_steps=1)
    assert step.record.force == 0 and step.record.penetrated_leaves == 1


@pytest.mark.parametrize("facet", range(4))
def test_a_leaf_with_two_contact_facets(facet, monkeypatch):
    """A cell at an edge of its body has two facets in one contact surface: either of them is enough to mark it."""
    scene = corner_scene(one_pair=True)
    fixed, top = scene.dirichlet
    scene = replace(scene, contact=(ContactPair("outer", "inner"),), dirichlet=(fixed, replace(top, x=0.01, z=0.01)))
    monkeypatch.setattr(_Facets, "penetrate", lambda facets: np.arange(len(facets._area)) == facet)
    (step,) = adapt(scene, 0.3, MPI.COMM_SELF, max_steps=1)
    assert step.record.force == 0 and len(scene.mesh.surfaces["outer"]) == 4
    assert len(np.unique(scene.mesh.surfaces["outer"][:, 0])) == 2 and step.record.penetrated_leaves == 1


@pytest.mark.parametrize("displacement", [0.0, -0.01])
def test_bodies_that_come_close_are_not_in_contact(displacement):
    """Without an overlap nothing is marked, however close the pole is."""
    step = next(adapt(bump(5, displacement=displacement), 0.3, max_steps=1, allow=("no load",)))
    assert step.record.penetrated_leaves == 0 and not step.contact_error.refine.any()


def test_restart(tmp_path):
    """A run that stops where contact between nodes is known to be missed knows it after a restart."""
    folder, scene = WORLD.bcast(tmp_path), bump(**QUARTER)
    through = list(adapt(scene, 0.3, max_steps=2))
    list(adapt(scene, 0.3, max_steps=1, checkpoint=folder))
    before = Checkpoint(folder, scene, WORLD)
    state = before.load()
    assert WORLD.allreduce(int((state.refine > 0).sum())) == through[0].record.penetrated_leaves > 0
    found, expected = (
        np.sort(gathered(WORLD, leaf_code(forest.cell, forest.anchor)[refine > 0]))
        for forest, refine in ((state.forest, state.refine), (through[0].forest, through[0].contact_error.refine))
    )
    assert np.array_equal(found, expected)
    (again,) = adapt(scene, 0.3, max_steps=2, restart=before)
    assert np.array_equal(leaves(again.forest), leaves(through[1].forest))
    assert abs(again.record.force / through[1].record.force - 1) < 1e-7


@pytest.mark.parametrize("bodies", [5, 6, 8])
def test_ring(bodies):
    """Blocks around an axis, whose contact planes meet at odd angles, press each other alike."""
    *_, step = adapt(ring(bodies), 0.1)
    forces = np.array(step.record.pair_forces)
    assert len(forces) == bodies and forces.min() > 0
    assert np.ptp(forces) < 1e-6 * forces.mean()


@pytest.mark.parametrize(
    "stiffness, enforcement",
    [(1.0, Enforcement()), (1e3, Enforcement()), (1.0, Enforcement("penalty", node_stiffness=0.1))],
    ids=["alike", "unlike", "node_stiffness"],
)
def test_contact_cut_in_two(stiffness, enforcement):
    """Two contact pairs that continue each other share the nodes between them: nothing is counted twice."""
    scene = punch(order=2, displacement=0.1, punch=Material(stiffness, 0.3))
    halves = in_two(scene)
    (one,), (two,) = (
        adapt(s, 0.3, max_steps=1, degree=1, beginning=Beginning.uniform(s, 1), enforcement=enforcement)
        for s in (scene, halves)
    )
    assert one.record.cells == two.record.cells and min(two.record.pair_forces) > 0
    assert two.record.active_pairs > one.record.active_pairs, "no node is in both"
    for name in ("force", "max_pressure"):
        assert abs(getattr(two.record, name) / getattr(one.record, name) - 1) < 1e-6, name
    assert abs(sum(two.record.pair_forces) / two.record.force - 1) < 1e-12


def wave(height=0.03):
    """Blocks of few cells of order 6, the upper one wavy below: the gap is the same at all quarters of a facet."""

    def above(x, _):
        u = x % 1
        return (
            0.012 + height * u * (u - 0.25) * (u - 0.5) * (u - 0.75) * (u - 1) / 0.0035
        )  # about 1 in its first extremum

    return on_block("wave", above, 2, 6, 0.01)


def test_waves_between_quarters():
    """Cells of order 6 may touch where neither nodes nor quarters of their facets do."""
    first, *_, last = (step.record for step in adapt(wave(), 0.4, max_steps=4))
    assert first.force == 0 and first.penetrated_leaves > 0 and last.force > 0
    low = next(adapt(wave(height=0.001), 0.4, max_steps=1)).record
    assert low.force == low.penetrated_leaves == 0


@pytest.mark.parametrize("phase", [0.0, 0.75], ids=["mean height", "crests"])
def test_waves_that_seem_flat(phase):
    """Nodes of degree 1 touch all at once, the stress is uniform; what is between them is found, as on a finer mesh."""
    scene = waves(phase)
    first, *others, last = (step.record for step in adapt(scene, 0.3, degree=1))
    assert first.estimate < 0.3 and any(record.pair_leaves[0] for record in others) and last.reached
    *_, fine = (step.record for step in adapt(scene, 0.3, degree=1, beginning=Beginning.uniform(scene, 2)))
    assert abs(last.force / fine.force - 1) < 0.3**2 < abs(first.force / fine.force - 1)


def facet(bulge=0.0):
    """Kind, Forest, leaf and face of the contact of two cells 2 m wide, of which the upper one bulges."""
    scene = on_block("bump", lambda x, y: -bulge * (1 - x**2) * (1 - y**2), 1, 2, 0.0)
    (kind,), forest = kinds_of(scene), roots(scene, MPI.COMM_SELF)
    return kind, forest, *kind.facets(forest)


def test_work_between_nodes():
    """Of a facet that bulges by b beyond its nodes, by Simpson's rule: A p b 4/9, whatever gap the nodes have."""
    bulge, pressure = 0.01, np.full((1, 4), 3.0)
    kind, forest, *leaf_face = facet(bulge)
    for gap in (0.0, 0.6 * bulge, -bulge):
        nodal = np.tile([0.0, 0.0, -gap, 0.0, 0.0, 1.0], (1, 4, 1))
        work = _Facets(kind, Space(forest, 1), *leaf_face, nodal).work(pressure)
        assert abs(work[0] / (2.0**2 * 3.0 * bulge * 4 / 9) - 1) < 1e-6


def test_facets_of_degree_2():
    """Of the gaps 0, 0, g along x the parabola penetrates by up to g/8 between the first two nodes.

    Everywhere it is up to g/8 below the lines between the nodes, in the mean g/12; of 0, g/4, g half as much.
    """
    gap, pressure = 0.01, np.full((1, 9), 3.0)
    kind, forest, *leaf_face = facet()
    for middle, mean, penetrates in ((0.0, gap / 12, True), (gap / 4, gap / 24, False)):
        nodal = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (1, 9, 1))
        nodal[0, 1::3, 2], nodal[0, 2::3, 2] = -middle, -gap
        facets = _Facets(kind, Space(forest, 2), *leaf_face, nodal)
        assert abs(facets.work(pressure)[0] / (2.0**2 * 3.0 * mean) - 1) < 1e-5
        assert facets.penetrate().all() == penetrates
