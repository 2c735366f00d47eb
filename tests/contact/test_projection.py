"""The projection onto closed contact, and how a gap is shared by the two bodies that close it."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    DISTRIBUTIONS,
    corner_scene,
    gathered,
    grown,
    pressed,
    roots,
    scramble,
    two_boxes,
    with_rows,
)

from fx_contact import ContactPair, Dirichlet, Material, Scene, Tie, block, join, root_mesh_from_shapes, solve
from fx_contact.contact.gram import Gram
from fx_contact.contact.jump import Jump
from fx_contact.contact.projection import Projection

pytestmark = pytest.mark.ranks(1, 2, 3)


def noisy(shape, salt):
    """Numbers in (-1, 1) that differ from rank to rank."""
    numbers = scramble(np.arange(np.prod(shape)) + 7919 * WORLD.rank, salt).reshape(shape)
    return numbers.astype(float) / 2**63 - 1


def dot(a, b):
    """Scalar product over all ranks."""
    return WORLD.allreduce(float((a * b).sum()))


@pytest.mark.parametrize("patience", [Gram._PATIENCE, 0], ids=["iterations", "factors"])
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("contact", ["flat", "a corner, two pairs", "a corner, one pair"])
def test_projection(contact, distribution, patience, monkeypatch):
    """P keeps closed pairs as they are, is a projection, and P^T is its transpose; pairs may share vertices."""
    monkeypatch.setattr(Gram, "_PATIENCE", patience)
    scene = pressed(two_boxes(margin=1)) if contact == "flat" else corner_scene(contact.endswith("one pair"))
    scene = replace(scene, materials=dict(zip(scene.mesh.bodies, (Material(1e4, 0.3), Material(1.0, 0.2)))))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.1))
    _, pairs, supports = with_rows(scene, forest)
    jump, prolongation = Jump(pairs, supports), pairs.prolongation
    number = prolongation.index_map.local_to_global(pairs.entries.node.astype(np.int32)).reshape(-1, 2)
    shared = any(len(np.unique(column)) < len(column) for column in gathered(WORLD, number).T)
    assert shared == (contact == "a corner, two pairs"), "not the scene it should be"
    active = noisy(len(pairs), 5) > 0
    projection = Projection(jump).of(jump, active)
    everywhere((projection.closed == active & jump.movable).all(), "other pairs are closed")

    x, y = noisy((prolongation.owned, 3), 1), noisy((prolongation.owned, 3), 2)
    projected = x.copy()
    projection.apply(projected)
    everywhere(np.abs(jump.matrix.times(projected)[projection.closed]).max(initial=0) < 1e-12, "a closed pair moves")
    again, transposed = projected.copy(), y.copy()
    projection.apply(again)
    projection.apply_transpose(transposed)
    everywhere(np.abs(again - projected).max() < 1e-12, "not a projection")
    assert abs(dot(projected, y) - dot(x, transposed)) < 1e-10 * dot(x, x)
    assert dot(projected - x, projected - x) > 0.01
    held = ~supports.free
    everywhere((projected[held] == x[held]).all(), "a prescribed displacement is changed")
    closed = projection.onto_closed(x)
    everywhere(
        np.abs(jump.matrix.times(closed) - jump.gap)[projection.closed].max(initial=0) < 1e-12, "a gap is left"
    )


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("twice", [False, True], ids=["rows", "rows twice"])
def test_factors_of_rows_meshed_apart(twice, distribution, monkeypatch):
    """Forces by factors of each rank's rows are those by iterations; equal rows have none, and share their force."""
    shapes = {"lower": block((0, 0, 0), (1, 1, 1), (3, 3, 1), 1), "upper": block((0, 0, 1), (1, 1, 2), (4, 4, 1), 1)}
    pair = ContactPair("lower top", "upper bottom")
    scene = Scene("apart", root_mesh_from_shapes(shapes), dict.fromkeys(shapes, Material(1.0, 0.3)), contact=pair)
    _, rows, supports = with_rows(scene, DISTRIBUTIONS[distribution](roots(scene)))
    if twice:
        rows = replace(rows.taken(np.repeat(np.arange(len(rows)), 2)), node_area=2 * np.repeat(rows.area, 2))
    closed, values = noisy(len(rows), 5) > 0, noisy(len(rows), 6)
    if twice:
        closed, values = np.repeat(closed[::2], 2), np.repeat(values[::2], 2)
    found = {}
    for patience in (np.inf, 0):
        monkeypatch.setattr(Gram, "_PATIENCE", patience)
        jump = Jump(rows, supports)
        gram = Projection(jump).of(jump, closed)._gram
        found[patience] = gram.solve(values)
        factors = not twice and bool(closed.any()) and patience == 0
        everywhere((gram._factors is not None) == factors, "not the way it should be")
    everywhere(np.abs(found[0] - found[np.inf]).max(initial=0) < 1e-12 * np.abs(found[0]).max(initial=1), "forces")
    if twice:
        everywhere(np.abs(found[0][::2] - found[0][1::2]).max(initial=0) < 1e-12, "shares")


def test_the_softer_body_follows_the_stiffer():
    """Vertices of a pair close its gap in inverse proportion to their moduli, along the normal."""
    materials = Material(4.0, 0.3), Material(1.0, 0.3)
    scene = pressed(two_boxes(), materials=materials)
    forest = grown(roots(scene), 2, share=0.2)
    _, pairs, supports = with_rows(scene, forest)
    jump, prolongation = Jump(pairs, supports), pairs.prolongation
    projection = Projection(jump).of(jump.with_gap(np.full(len(pairs), 0.05)), np.ones(len(pairs), dtype=bool))
    u = prolongation.ghosted(projection.onto_closed(np.zeros((prolongation.owned, 3))))
    assert WORLD.allreduce(len(pairs)) > 9
    everywhere(np.allclose(u[pairs.first], [0.0, 0.0, 0.01], atol=1e-15), "the stiffer one goes another way")
    everywhere(
        np.allclose(u[pairs.entries.node[1::2]], [0.0, 0.0, -0.04], atol=1e-15), "the softer one goes another way"
    )


def bonded(kind, cells):
    """A cap pressed on two bonded parts of different moduli; two cells match theirs."""
    halves = [block((x, 0, -1), (x + 1, 2, 0), (1, 2, 1), 1).as_part(f"part {x}") for x in (0, 1)]
    bodies = {"base": join(*halves), "cap": block((0, 0, 0), (2, 2, 1), (cells, cells, 1), 1)}
    moduli = {"base part 0": 1.0, "base part 1": 100.0, "cap": 2.0}
    held = Dirichlet("base bottom", 0.0, 0.0, 0.0), Dirichlet("cap top", 0.0, 0.0, -0.01)
    joint = {"contact": ContactPair, "ties": Tie}[kind]("cap bottom", "base top")
    materials = {name: Material(young, 0.3) for name, young in moduli.items()}
    return Scene("bonded", root_mesh_from_shapes(bodies), materials, held, **{kind: joint})


@pytest.mark.parametrize("kind", ["contact", "ties"])
def test_bonded_parts_meshed_apart(kind):
    """Mortar rows on parts of different moduli share nodes, which have one weight each: P^T is the transpose."""
    scene = bonded(kind, 3)
    _, rows, supports = with_rows(scene, grown(roots(scene), 1))
    jump, prolongation = Jump(rows, supports), rows.prolongation
    projection = Projection(jump).of(jump, np.ones(len(rows), dtype=bool))
    x, y = (noisy((prolongation.owned, 3), salt) for salt in (1, 2))
    projected, transposed = x.copy(), y.copy()
    projection.apply(projected)
    projection.apply_transpose(transposed)
    everywhere(np.abs(jump.matrix.times(projected)[projection.closed]).max(initial=0) < 1e-11, "a closed row moves")
    assert abs(dot(projected, y) - dot(x, transposed)) < 1e-10 * dot(x, x)
    one, other = (solve(bonded(kind, cells), 0.3, max_steps=2).record.resultants[0].force for cells in (2, 3))
    assert one[2] == pytest.approx(other[2], rel=0.03)
