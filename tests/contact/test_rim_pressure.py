"""Pressures at the rim of the second surface, which crosses facets of the first."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, discrete, grown, roots, scramble

from fx_contact import (
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    Pressure,
    Scene,
    SymmetryPlane,
    Tie,
    block,
    ring,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.contact.rim_pressure import RimPressure
from fx_contact.contact.row_kinds import create_rows
from fx_contact.plot import draw_contact

pytestmark = pytest.mark.ranks(1, 2, 3)

INSIDE, OUTSIDE, MEAN = 5.5, 12.0, 10.0


def ring_on(plates, ties=()):
    """A quarter of a steel ring below a pressure on plates of aluminium, by name, the first of them in contact."""
    shapes = plates | {"ring": ring(INSIDE, OUTSIDE, 3, (3, 6, 2), quarters=1)}
    sides = [("left", "front") if "left" in shape.sides else ("x = 0", "y = 0") for shape in shapes.values()]
    planes = [SymmetryPlane(f"{name} {side}") for name, both in zip(shapes, sides) for side in both]
    materials = dict.fromkeys(plates, Material(70e3, 0.33)) | {"ring": Material(210e3, 0.3)}
    floor = [Dirichlet(f"{name} bottom", z=0.0) for name in plates]
    pair = ContactPair("ring bottom", f"{next(iter(plates))} top")
    mesh = root_mesh_from_shapes(shapes)
    return Scene("ring on a plate", mesh, materials, (*floor, *planes), pair, Pressure("ring top", MEAN), ties=ties)


def on_plate(cells):
    """On a plate of so many cells, whose facets the rims of the ring cross."""
    return ring_on({"plate": block((0, 0, -6), (15, 15, 0), (cells, cells, 2), 6)})


def alike():
    """The same on a round plate in three parts, whose facets are those of the ring."""
    radii = {"middle": (INSIDE, OUTSIDE, 3), "hub": (0.5, INSIDE, 2), "outer": (OUTSIDE, 17, 2)}
    parts = {name: ring(low, high, 6, (n, 6, 2), quarters=1).shifted(z=-6) for name, (low, high, n) in radii.items()}
    return ring_on(parts, (Tie("hub outside", "middle inside"), Tie("middle outside", "outer inside")))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_linear_map(degree, distribution):
    """A constant pressure stays, and the transpose is that of the change."""
    scene = on_plate(4)
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2, share=0.2))
    rows = create_rows(scene, discrete(scene, forest, degree).prolongation, Enforcement())
    everywhere(np.abs(RimPressure(rows, np.ones(len(rows)), 0).change()).max(initial=0.0) < 1e-12, "constant")
    noise = [scramble(np.arange(len(rows)) + 7919 * WORLD.rank, salt).astype(float) / 2**63 for salt in (1, 2)]
    change = RimPressure(rows, noise[0], 0).change()
    transposed = RimPressure(rows, noise[0], 0).transposed(noise[1])
    products = WORLD.allreduce(np.array([noise[1] @ change, transposed @ noise[0], change @ change]))
    assert abs(products[0] - products[1]) < 1e-10 * products[2] and products[2] > 0.1


@pytest.mark.parametrize("cells", [3, 5, 8])
def test_a_ring_on_a_plate(cells):
    """Forces balance and lie within the ring; pressures are means of those at the sharp edges of like meshes."""
    step = solve(on_plate(cells), 0.3, max_steps=2)
    radius = np.hypot(*step.contact.points[step.contact.active, :2].T)
    everywhere(((radius > INSIDE - 0.1) & (radius < OUTSIDE + 0.1)).all(), "forces outside of the ring")
    assert step.record.force == pytest.approx(MEAN * np.pi * (OUTSIDE**2 - INSIDE**2) / 4, rel=1e-5)
    assert 0.6 < step.record.max_pressure / solve(alike(), 0.3, max_steps=1).record.max_pressure < 1.0


def test_map_ends_at_the_rim():
    """Pieces of facets that face nothing are not drawn."""
    pyvista = pytest.importorskip("pyvista")
    step = solve(on_plate(3), 0.9, max_steps=1)
    plotter = pyvista.Plotter(off_screen=True) if WORLD.rank == 0 else None
    draw_contact(step, zoom=None, plotter=plotter)
    if plotter is not None:
        surface = next(mesh for mesh in plotter.meshes if "value" in mesh.array_names)
        radius = np.hypot(*surface.cell_centers().points[:, :2].T)
        assert INSIDE - 0.1 < radius.min() < 7 and 11 < radius.max() < OUTSIDE + 0.1
        plotter.close()
