"""Contact of surfaces whose meshes do not match: patch test, node pairs as a special case, cover, order, ranks."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, conforming_positions, gathered, grown, leaves, refined_around, roots
from mpi4py import MPI

from fx_contact import (
    Beginning,
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    Pressure,
    Scene,
    SolveError,
    Solver,
    SymmetryPlane,
    adapt,
    block,
    cylinder,
    ring,
    root_mesh_from_shapes,
)
from fx_contact.contact.gram import Gram
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.scenes import hertz

SIDES = ("left", "front", "right", "back", "bottom", "top")


def boxes(
    upper, lower, tilt=(0.0, 0.0), twist=0.0, moduli=(1.0, 1.0), order=("upper bottom", "lower top"), **options
):
    """Two unit cubes with cells (x, y) under hydrostatic pressure, the upper one's mesh twisted, on a tilted plane."""

    def place(x):
        angle = np.radians(twist) * np.prod(np.sin(np.pi * x[:2]), axis=0)
        dx, dy = x[0] - 0.5, x[1] - 0.5
        turned = 0.5 + np.cos(angle) * dx - np.sin(angle) * dy, 0.5 + np.sin(angle) * dx + np.cos(angle) * dy
        return tilted(np.stack([*turned, x[2]]))

    def tilted(x):
        return x[0], x[1], x[2] + (1 - np.abs(x[2] - 1)) * (tilt[0] * x[0] + tilt[1] * x[1])

    bodies = {
        "upper": block((0, 0, 1), (1, 1, 2), (*upper, 2), 1).placed(place),
        "lower": block((0, 0, 0), (1, 1, 1), (*lower, 1), 1).placed(tilted),
    }
    scene = Scene(
        name="boxes",
        mesh=root_mesh_from_shapes(bodies),
        materials={name: Material(young, 0.3) for name, young in zip(bodies, moduli)},
        dirichlet=(
            Dirichlet("lower bottom", z=0.0),
            *(
                Dirichlet(f"{body} {side}", **{axis: 0.0})
                for body in bodies
                for side, axis in (("left", "x"), ("front", "y"))
            ),
        ),
        contact=(ContactPair(*order),),
        tractions=(
            Pressure("upper top", 0.01),
            *(Pressure(f"{body} {side}", 0.01) for body in bodies for side in ("right", "back")),
        ),
    )
    return replace(scene, **options)


def first_step(scene, degree, beginning=None, tolerance=1e-13, **options):
    """The first step of a run, solved accurately."""
    solver = Solver(tolerance=tolerance)
    return next(adapt(scene, 1e-3, WORLD, degree=degree, solver=solver, beginning=beginning, **options))


def largest(values):
    """Largest absolute value of all ranks."""
    return np.abs(gathered(WORLD, values)).max()


class TestPatch:
    """Hydrostatic pressure passes to 1e-10: the pressure is uniform, and the estimated error 0."""

    @pytest.mark.parametrize("degree", [1, 2])
    @pytest.mark.parametrize("twist", [0.0, 20.0, 45.0])
    @pytest.mark.parametrize("refined", [None, "upper", "lower"])
    def test_tilted(self, degree, twist, refined):
        """On a tilted plane, meshes 3:4, twisted by up to 45 degrees, hanging nodes on either side."""
        scene = boxes((3, 3), (4, 4), (0.3, 0.2), twist)
        beginning = None if refined is None else refined_around(scene, (0, 0, 1), [refined])
        step = first_step(scene, degree, beginning)
        assert step.record.hanging_nodes > 0 or refined is None
        assert largest(step.contact.pressure / 0.01 - 1) < 1e-10
        assert step.record.estimate < 1e-9

    @pytest.mark.parametrize("moduli", [(1.0, 1e6), (1e6, 1.0), (1.0, 1e3), (1e3, 1.0), (3.0, 1.0), (1.0, 3.0)])
    def test_moduli(self, moduli):
        """The softer body has the rows; PCG takes at most 1.3 times the iterations of matching meshes."""
        steps = [first_step(boxes(upper, (4, 4), moduli=moduli), 2, tolerance=1e-8) for upper in ((3, 3), (4, 4))]
        here, there = (max(step.record.krylov_iterations) for step in steps)
        assert steps[0].scene.oriented[0].first == ("upper bottom" if moduli[0] < moduli[1] else "lower top")
        assert largest(steps[0].contact.pressure / 0.01 - 1) < 1e-6
        assert here <= 1.3 * there + 1

    @pytest.mark.parametrize("ratio", [2, 4])
    def test_ratios(self, ratio):
        """Facets of one side that are several times as large are of the second surface, whichever is given first."""
        one = first_step(boxes((2, 2), (2 * ratio, 2 * ratio)), 2)
        other = first_step(boxes((2, 2), (2 * ratio, 2 * ratio), order=("lower top", "upper bottom")), 2)
        for step in (one, other):
            assert step.scene.oriented[0].first == "lower top"
            assert largest(step.contact.pressure / 0.01 - 1) < 1e-10

    def test_penalty(self):
        """With springs instead of projection the pressure is uniform too."""
        step = first_step(boxes((3, 3), (4, 4)), 2, enforcement=Enforcement("penalty", factor=1e4))
        assert largest(step.contact.pressure / 0.01 - 1) < 1e-6


def taken_for_nonmatching(scene):
    """The scene with mortar rows on surfaces that match."""
    scene.pairing.nonmatching[0] = "for a test"
    for known in ("nonmatching", "contact_surfaces"):
        vars(scene).pop(known, None)
    return scene


class TestMatching:
    """On surfaces meshed alike mortar rows are the node pairs."""

    @pytest.mark.parametrize("degree", [1, 2])
    def test_rows(self, degree):
        """Entries, gaps, areas and normals, on surfaces of the degree of the displacement with hanging nodes."""
        scene = hertz(coarse=2, order=degree)
        forest = grown(Beginning.uniform(scene, 1, WORLD).forest, 1, share=0.2, salt=3)
        prolongation = Prolongation(Space(forest, degree))
        pairs = create_rows(scene, prolongation, Enforcement())
        twin = taken_for_nonmatching(hertz(coarse=2, order=degree))
        prolongation = Prolongation(Space(replace(forest, contact_surfaces=twin.contact_surfaces), degree))
        rows = create_rows(twin, prolongation, Enforcement())
        size = np.abs(scene.mesh.points).max()
        # Areas of curved facets are those of two rules of integration.
        for name, off in (("gap", 1e-12 * size), ("normal", 1e-12), ("area", 1e-4 * largest(pairs.area))):
            one, other = (
                dict(zip(gathered(WORLD, r.node_keys), gathered(WORLD, getattr(r, name)))) for r in (pairs, rows)
            )
            assert one.keys() == other.keys()
            assert max(np.abs(one[key] - other[key]).max() for key in one) < off, name
        u = prolongation.injected(np.sin(prolongation.space.positions() * [3, 5, 7]))
        one, other = (dict(zip(gathered(WORLD, r.node_keys), gathered(WORLD, r.jump(u)))) for r in (pairs, rows))
        assert max(abs(one[key] - other[key]) for key in one) < 1e-10

    def test_run(self):
        """The whole run has the same leaves and force."""
        scenes = hertz(coarse=2, order=2), taken_for_nonmatching(hertz(coarse=2, order=2))
        pairs, mortar = (list(adapt(scene, 0.1, WORLD)) for scene in scenes)
        assert len(pairs) == len(mortar)
        for one, other in zip(pairs, mortar):
            everywhere(np.array_equal(leaves(one.forest), leaves(other.forest)), "other leaves")
        assert [s.record.force for s in mortar] == pytest.approx([s.record.force for s in pairs], rel=1e-7)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_rows_anywhere(distribution):
    """Weights of a row add up to 1 and -1, B u of two translations is their jump, areas that of the surface."""
    scene = boxes((3, 3), (4, 4))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2, share=0.2))
    prolongation = Prolongation(Space(forest, 2))
    rows = create_rows(scene, prolongation, Enforcement())
    entries, prolongation = rows.entries, rows.prolongation
    for side, total in ((0, 1.0), (1, -1.0)):
        sums = np.bincount(entries.row[entries.side == side], entries.weight[entries.side == side], len(rows))
        everywhere(np.abs(sums - total).max(initial=0.0) < 1e-12, "weights")
    per_row = np.bincount(entries.row, minlength=len(rows))
    assert WORLD.allreduce(int(per_row.max(initial=0)), op=MPI.MAX) > 8 and rows.kinds[0].contact.first == "lower top"
    _, body = conforming_positions(forest, prolongation)
    u = np.where(body[:, None] == scene.mesh.bodies.index("lower"), [0.1, 0.2, 0.7], [0.3, 0.0, -0.2])
    everywhere(np.abs(rows.jump(u) - 0.9).max(initial=0.0) < 1e-12, "B u")
    everywhere(np.abs(rows.closing(u) - [-0.2, 0.2, 0.9]).max(initial=0.0) < 1e-12, "jump")
    assert abs(WORLD.allreduce(float(rows.area.sum())) - 1) < 1e-12


def test_projection_that_does_not_converge(monkeypatch):
    """It is an error on all ranks, not a wrong force."""
    monkeypatch.setattr(Gram, "_ITERATIONS", 2)
    with pytest.raises(SolveError, match="projection .* has not converged in 2 iterations"):
        first_step(boxes((3, 3), (4, 4)), 1)


def overhanging(upper, lower, width, poisson=0.3):
    """A block 1 x 1.3 x 1 under a pressure of 0.01, of which a width lies on another one."""
    bodies = {
        "upper": block((0, 0, 1), (1, 1.3, 2), (upper, upper, 2), 1),
        "lower": block((width - 1, -0.1, 0), (width, 1.4, 1), (lower, lower, 1), 1),
    }
    walls = ("upper left", "upper right")
    return Scene(
        name="overhanging",
        mesh=root_mesh_from_shapes(bodies),
        materials={name: Material(1.0, poisson) for name in bodies},
        dirichlet=(
            Dirichlet("lower bottom", 0.0, 0.0, 0.0),
            *(Dirichlet(wall, x=0.0) for wall in walls),
            Dirichlet("upper front", y=0.0),
        ),
        contact=(ContactPair("upper bottom", "lower top"),),
        tractions=(Pressure("upper top", 0.01),),
    )


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("upper, lower, width", [(4, 3, 0.6), (3, 5, 1 / 3), (2, 2, 0.5 + 1e-14)])
def test_overhanging_block(degree, upper, lower, width):
    """The force is the load, and moments balance, where the rim of one surface crosses facets of the other."""
    for step in adapt(overhanging(upper, lower, width), 0.15, WORLD, degree=degree, max_steps=2):
        assert step.record.force == pytest.approx(0.013, rel=1e-7)
        contact = step.record.resultants[0]
        assert contact.kind == "contact" and contact.force == pytest.approx((0, 0, -0.013), abs=1e-9)
        for one in step.record.resultants:
            if one.kind == "balance":
                assert np.abs([*one.force, *one.moment]).max() < 1e-8


def disk_in_ring(disk, outer):
    """A disk in a ring, both with R = 0.6 at the contact, under pressure 1e7 + 1e6 cos 2t; plane strain, a quarter."""
    bodies = {
        "disk": cylinder(0.6, 0.2, (disk, 1), 6, quarters=1),
        "ring": ring(0.6, 1, 0.2, (1, 2 * outer, 1), 6, quarters=1),
    }
    names = {plane: [f"{body} {plane}" for body in bodies] for plane in ("x = 0", "y = 0")}
    names["ends"] = [f"{body} {end}" for body in bodies for end in ("bottom", "top")]
    names |= {name: name for name in ("disk outside", "ring inside", "ring outside")}
    return Scene(
        name="disk in ring",
        mesh=root_mesh_from_shapes(bodies, names),
        materials={body: Material(1e9, 0.2) for body in bodies},
        dirichlet=(SymmetryPlane("x = 0"), SymmetryPlane("y = 0"), Dirichlet("ends", z=0.0)),
        contact=(ContactPair("disk outside", "ring inside"),),
        tractions=(
            Pressure("ring outside", lambda x: 1e7 + 1e6 * (x[0] ** 2 - x[1] ** 2) / (x[0] ** 2 + x[1] ** 2)),
        ),
    )


@pytest.mark.parametrize("disk, outer", [(2, 3), (3, 2)])
def test_pressure_converges(disk, outer):
    """Of a disk in a ring, meshed 3:2: errors fall by 3.6 a halving, and are no larger than on matching meshes."""
    errors = {}
    for cells in ((disk, outer), (2, 2)):
        scene, errors[cells] = disk_in_ring(*cells), []
        for level in (0, 1):
            step = first_step(scene, 2, Beginning.uniform(scene, level, WORLD), tolerance=1e-8)
            x, y, _ = step.rows.position.T
            exact = 1e7 + 1.479263e6 * np.cos(2 * np.arctan2(y, x))
            area, off = gathered(WORLD, step.rows.area), gathered(WORLD, step.contact.pressure - exact)
            errors[cells].append(np.sqrt((area * off**2).sum() / area.sum()) / 1e7)
    here, there = errors.values()
    assert here[0] / here[1] > 3.6 and np.all(np.array(here) < np.array(there))


def pressed(bodies, down=0.01, order=1, **options):
    """A block "upper" pressed onto one "lower", which is clamped below."""
    return Scene(
        name="pressed",
        mesh=root_mesh_from_shapes(bodies),
        materials=dict.fromkeys(bodies, Material(1.0, 0.3)),
        dirichlet=(Dirichlet("lower bottom", 0, 0, 0), Dirichlet("upper top", 0, 0, -down)),
        contact=(ContactPair(*("upper bottom", "lower top")[::order], **options),),
    )


def area_of_rows(scene, degree):
    """The areas of the rows of all ranks."""
    prolongation = Prolongation(Space(Beginning.uniform(scene, 0, WORLD).forest, degree))
    return gathered(WORLD, create_rows(scene, prolongation, Enforcement()).area)


def test_which_surface_has_the_rows():
    """The finer one where they face each other, said by the scene; not the one with more facets elsewhere."""
    bodies = {"upper": block((1, 0, 1), (2, 1, 2), (3, 3, 1), 1), "lower": block((0, 0, 0), (3, 1, 1), (2, 1, 1), 1)}
    scene = pressed(bodies, order=-1, direction=(0, 0, 1))
    assert scene.oriented[0] == ContactPair("upper bottom", "lower top", direction=(0, 0, -1))
    assert "rows on 'upper bottom'" in repr(scene) and "2 facets face 9" in repr(scene)
    record = first_step(scene, 1).record
    assert record.force > 0 and record.resultants[0].force[2] == pytest.approx(record.force)  # of lower on upper


@pytest.mark.parametrize(
    "moduli, first", [((1, 1.9), "lower"), ((1.9, 1), "lower"), ((1, 2.1), "upper"), ((2.1, 1), "lower")]
)
def test_moduli_that_are_alike(moduli, first):
    """Up to a factor of 2 the finer surface has the rows, here the lower one, beyond it that of the softer body."""
    assert boxes((3, 3), (4, 4), moduli=moduli).oriented[0].first.split()[0] == first


@pytest.mark.parametrize("order", [1, -1])
def test_a_surface_smaller_than_a_sample(order):
    """No sample of the large facet faces the small one, which has the rows in any case."""
    plate, pin = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1), block((0.5, 0.5, 1), (0.6, 0.6, 2), (1, 1, 1), 1)
    assert pressed({"upper": pin, "lower": plate}, order=order).oriented[0].first == "upper bottom"


@pytest.mark.parametrize("degree", [1, 2])
def test_a_strip_from_afar(degree):
    """The rim crosses facets at a tenth, where no sample faces the other surface, at a distance of 1.6 facets."""
    bodies = {
        "upper": block((0, 0, 1.4), (1, 1, 2), (4, 4, 1), 1),
        "lower": block((-1, -0.1, 0), (0.525, 1.1, 1), (3, 3, 1), 1),
    }
    scene = pressed(bodies, down=0.5)
    assert scene.oriented[0].first == "upper bottom" and abs(area_of_rows(scene, degree).sum() - 0.525) < 1e-12


def test_facets_between_clamped_sides():
    """All their nodes are held, and they keep their rows."""
    bodies = {"upper": block((0, 0, 1), (1, 1, 2), (1, 5, 1), 1), "lower": block((0, 0, 0), (1, 1, 1), (2, 2, 1), 1)}
    held = tuple(Dirichlet(f"{body} {side}", 0, 0, 0) for body in bodies for side in ("left", "right"))
    scene = replace(pressed(bodies), dirichlet=held)
    area = area_of_rows(scene, 1)
    assert scene.oriented[0].first == "upper bottom" and len(area) == 12 and abs(area.sum() - 1) < 1e-12


def test_two_contacts_along_one_normal():
    """Nodes on their common edge have a row of the first contact; that of the second yields."""
    upper = block((0, 0, 1), (2, 1, 2), (8, 4, 1), 1)
    for name, side in (("one", 1), ("two", -1)):
        upper = upper.named(name, "bottom", where=lambda x, side=side: side * (x[0] - 1) < 1e-9)
    low = {name: block((x, 0, 0), (x + 1, 1, 1), (3, 3, 1), 1) for x, name in ((0, "left"), (1, "right"))}
    mesh = root_mesh_from_shapes({"upper": upper, **low})
    scene = Scene(
        name="two bodies below one",
        mesh=mesh,
        materials=dict.fromkeys(mesh.bodies, Material(1.0, 0.3)),
        dirichlet=tuple(Dirichlet(f"{body} bottom", 0, 0, 0) for body in low)
        + (Dirichlet("upper top", 0, 0, -0.01),),
        contact=(ContactPair("upper one", "left top"), ContactPair("upper two", "right top")),
    )
    rows = create_rows(scene, Prolongation(Space(Beginning.uniform(scene, 0, WORLD).forest, 1)), Enforcement())
    x, contact = gathered(WORLD, rows.position)[:, 0], gathered(WORLD, rows.contact)
    assert len(x) == 9 * 5 and np.array_equal(contact, x > 1 + 1e-9) and WORLD.allreduce(rows.yielded) == 5


def test_facets_that_face_nothing_hold_nothing():
    """A surface around a corner: its left side faces nothing, so that the body is free along x."""
    bodies = {"upper": block((0, 0, 1), (1, 1, 2), (5, 5, 1), 1), "lower": block((0, 0, 0), (1, 1, 1), (4, 4, 1), 1)}
    corner = {"corner": ["upper bottom", "upper left"]}
    names = {f"{body} {side}": [f"{body} {side}"] for body in bodies for side in ("bottom", "top", "front")}
    scene = Scene(
        name="corner",
        mesh=root_mesh_from_shapes(bodies, {**names, **corner}),
        materials={body: Material(1.0, 0.3) for body in bodies},
        dirichlet=(Dirichlet("lower bottom", 0, 0, 0), Dirichlet("upper front", y=0.0)),
        contact=(ContactPair("corner", "lower top"),),
        tractions=Pressure("upper top", 0.01),
    )
    *_, step = adapt(scene, 0.3, solver=Solver(tolerance=1e-12))
    record = step.record
    assert record.free_motions == {"upper": "along x"} and record.force == pytest.approx(0.01, rel=1e-9)
