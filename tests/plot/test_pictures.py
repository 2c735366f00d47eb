"""Pictures: what the section shows, and that something is seen on each."""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import ErrorControl, SweepRecord, adapt, solve
from fx_contact.parallel.errors import OutputError, SceneError
from fx_contact.plot import (
    draw_bodies,
    draw_convergence,
    draw_mesh,
    draw_partition,
    draw_pressure,
    draw_pressure_map,
    draw_stress,
    draw_sweep,
)
from fx_contact.plot.bodies import _on_faces
from fx_contact.plot.canvas import picture_size, plotter_for, view_axes
from fx_contact.plot.cells import _level_colour, _number_colour
from fx_contact.plot.cut import _outlines, cut_by_region
from fx_contact.plot.faces import visible_faces
from fx_contact.scenes import cylinders, hertz, shrink_fit, stack


def test_each_body_shows_its_own_stress():
    """Two cubes on each other, one stressed: the section jumps where they touch, and no point has both values."""
    z, y, x = (axis.ravel() for axis in np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"))
    cube = np.stack([x, y, z], axis=1)
    corners, values = np.stack([cube, cube + [0, 0, 1]]), np.repeat([[0.0], [1.0]], 8, axis=1)
    sections = cut_by_region(corners, values, np.array([0, 1]), 0.5)
    assert len(sections) == 2
    for section, stress, bottom in zip(sections, (0.0, 1.0), (0.0, 1.0)):
        assert (section.points[:, 2].min(), section.points[:, 2].max()) == (bottom, bottom + 1), "the bodies touch"
        assert (section["stress"] == stress).all()
    together = cut_by_region(corners, values, np.array([0, 0]), 0.5)[0]
    assert together.n_points < sum(s.n_points for s in sections), "what VTK does where they are one body"


def test_quadratic_leaves_bend():
    """A leaf of degree 2 is cut along its bent sides, with the stress of all its nodes."""
    z, y, x = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, 1, 3)] * 3, indexing="ij"))
    nodes = np.stack([x, y, z + x * (1 - x)], axis=1)
    (section,) = cut_by_region(nodes[None], (x * (1 - x))[None], np.zeros(1, dtype=int), 0.5)
    assert np.isclose(section.bounds[5], 1.25) and np.isclose(section["stress"].max(), 0.25)
    lines = _outlines(nodes[None], 0.5).points
    at_middle = np.isclose(lines[:, 0], 0.5)
    assert set(np.round(lines[at_middle, 2], 9)) == {0.25, 1.25}, "the sides are bent, and no line is inside"


@cache
def a_step(degree=1):
    """A coarse Hertz step and the records that led to it."""
    steps = list(adapt(hertz(order=2, coarse=2), 0.3, WORLD, degree=degree, control=ErrorControl("energy")))
    return steps[-1], [step.record for step in steps]


def _point(record):
    """A record as a point of a load path."""
    return SweepRecord(
        point=record.step, value=1.0 + record.step, begun="anew", solves=1, unknowns=0, cpu_seconds=0.0, record=record
    )


PICTURES = {
    "mesh": lambda step, records, path: draw_mesh(step, path),
    "levels": lambda step, records, path: draw_mesh(step, path, zoom=4, colour="level"),
    "partition": lambda step, records, path: draw_partition(step, path),
    "bodies": lambda step, records, path: draw_bodies(step, path, cut=True, apart=0.1),
    "pressure": lambda step, records, path: draw_pressure(step, path),
    "map": lambda step, records, path: draw_pressure_map(step, path),
    "stress": lambda step, records, path: draw_stress(step, path),
    "stress near": lambda step, records, path: draw_stress(step, path, zoom=3, across="z"),
    "convergence": lambda step, records, path: draw_convergence(records, path, WORLD),
    "sweep": lambda step, records, path: draw_sweep([*map(_point, records)], path, WORLD, quantity="dofs"),
}


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name, degree", [*((name, 1) for name in PICTURES), ("stress near", 2)])
def test_pictures(name, degree, tmp_path):
    """Something is drawn, in several colours, into a folder that is made; all ranks know where."""
    path = WORLD.bcast(tmp_path / "made" / f"{name}.png", root=0)
    everywhere(PICTURES[name](*a_step(degree), path) == path, "another path")
    if WORLD.rank == 0:
        from matplotlib.image import imread

        pixels = (imread(path)[..., :3] * 255).astype(np.uint8).reshape(-1, 3)
        colours, count = np.unique(pixels // 16, axis=0, return_counts=True)
        assert len(colours) > 4, "one colour"
        assert (pixels.std(axis=1) > 5).mean() > 1e-3, "no colour but grey"
        assert (pixels < 250).any(axis=1).mean() > 0.01, "next to nothing on white"


def test_on_what_the_user_gives(tmp_path):
    """Axes and plotters of rank 0 are drawn on and returned on each rank; without them and a path nothing is."""
    from matplotlib.figure import Figure

    step, records = a_step()
    left, right = Figure().subplots(1, 2)
    assert draw_pressure(step, ax=left) is left and draw_convergence(records, ax=right) is right
    everywhere(bool(left.lines and right.lines) == (WORLD.rank == 0), "drawn elsewhere than on rank 0")
    with plotter_for(tmp_path / "a.png") if WORLD.rank == 0 else nullcontext() as plotter:
        assert draw_mesh(step, plotter=plotter) is plotter
        everywhere(plotter is None or len(plotter.actors) > 3, "leaves, edges, scale")
    with pytest.raises(OutputError, match="must be a path, got None"):
        draw_mesh(step)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name, strip", [("levels", 0.11), ("bodies near", 0.22), ("stress near", 0.22)])
def test_legends_are_beside_the_bodies(name, strip, tmp_path):
    """In zoomed views nothing of the bodies is at the right, where the legends are; left of it they end sharply."""
    step, _ = a_step()
    path = WORLD.bcast(tmp_path / "a.png")
    draw = {
        "levels": lambda: draw_mesh(step, path, zoom=1, colour="level"),
        "bodies near": lambda: draw_bodies(step, path, "stress", zoom=20),
        "stress near": lambda: draw_stress(step, path, zoom=0.2),
    }
    draw[name]()
    if WORLD.rank == 0:
        from matplotlib.image import imread

        pixels = imread(path)[..., :3]
        height, width = pixels.shape[:2]
        edge = round((1 - strip) * width)
        below = pixels[int(0.8 * height) :]  # below the legends
        assert (below[:, edge + 3 : -1] == 1).all(), "bodies below the legend"  # the last column is smoothed by VTK
        assert (below[:, edge - 8 : edge - 3] < 1).any(), "the bodies end before it"


def test_zoom_is_about_the_contact(tmp_path):
    """The magnified picture is centred there, left of its legend; the other on all bodies."""
    step, _ = a_step()
    with plotter_for(tmp_path / "a.png") if WORLD.rank == 0 else nullcontext() as plotter:
        draw_bodies(step, zoom=8, plotter=plotter)
        if plotter:
            camera = plotter.camera
            width, height = picture_size(plotter)
            towards = np.array(camera.position) - camera.focal_point
            axes = view_axes(towards, np.array(camera.up))
            right, up, _ = axes @ (np.asarray(step.record.contact_centre) - camera.focal_point)
            assert np.allclose([right, up], [-0.22 * camera.parallel_scale * width / height, 0], atol=1e-9)


def test_map_of_a_contact():
    """Pressures of the nodes at their places on the modelled quarter, with units; lines between facets; the title."""
    from matplotlib.figure import Figure

    step, _ = a_step()
    ax = Figure().add_subplot()
    assert draw_pressure_map(step, ax=ax) is ax
    table = step.contact.gathered()
    if WORLD.rank:
        return
    coloured, edges = ax.collections
    pressure = coloured.get_array()
    assert np.isclose(pressure.max(), step.record.max_pressure) and pressure.min() == 0
    x, y = coloured._triangulation.x, coloured._triangulation.y
    at = np.column_stack([x, y])[np.argmax(pressure)]
    assert np.allclose(at, table.points[np.argmax(table.pressure), :2])
    assert min(x.min(), y.min()) > -1e-12, "a quarter"
    assert ax.get_title() == "lower pole on upper pole" and len(edges.get_segments())
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x", "y")
    assert ax.figure.axes[1].get_ylabel() == "contact pressure"


def test_units_on_a_map():
    """They are on both axes and on the colour bar; the surface is seen along its normal, wherever that leads."""
    from matplotlib.figure import Figure

    step = solve(replace(shrink_fit(interference=1e-3), units=("mm", "MPa")), 0.9, max_steps=1, degree=1)
    ax = Figure().add_subplot()
    draw_pressure_map(step, ax=ax, contact="shaft on hub")
    if WORLD.rank == 0:
        labels = [ax.get_xlabel(), ax.get_ylabel()]
        assert all(label.endswith(" [mm]") for label in labels) and labels[0] != labels[1], labels
        assert ax.figure.axes[1].get_ylabel() == "contact pressure [MPa]"
    with pytest.raises(SceneError, match="unknown contact 'shaft'; there are 'shaft on hub'"):
        draw_pressure_map(step, contact="shaft", ax=ax)


@pytest.mark.parametrize("scene", [cylinders(), shrink_fit(interference=1e-3), stack()], ids=lambda scene: scene.name)
def test_radius_of_contact_that_is_not_round(scene):
    """Lines, rings and several contacts have no radius: the error says what to call; with a known solution it goes."""
    step = solve(scene, 0.5, max_steps=1, degree=1)
    with pytest.raises(SceneError, match="not round.*draw_pressure_map"):
        draw_pressure(step, "a.png")


def test_scale_of_a_cut(tmp_path):
    """Nearer to the contact, where the stress is, the scale ends higher, for it is that of what is shown."""
    step, _ = a_step()
    tops = []
    for zoom in (None, 6, 1):
        with plotter_for(tmp_path / "a.png") if WORLD.rank == 0 else nullcontext() as plotter:
            draw_stress(step, zoom=zoom, plotter=plotter)
            bars = plotter.scalar_bars.values() if plotter else ()
            tops += [bar.GetLookupTable().GetRange()[1] for bar in bars] or [len(tops)]
    everywhere(tops[0] < tops[1] < tops[2], "the same scale")


@pytest.mark.parametrize("degree", [1, 2])
def test_grid_of_pyvista(degree):
    """Its cells are this rank's leaves, which fill the bodies; displacement and stress are of their points."""
    step, _ = a_step(degree)
    grid = step.to_pyvista()
    assert grid.n_cells == len(step.forest) and (grid["rank"] == WORLD.rank).all()
    assert (np.bincount(grid["level"]) == np.bincount(step.forest.level)).all()
    upper = grid["body"] == step.scene.mesh.bodies.index("upper")
    everywhere((upper == (grid.cell_centers().points[:, 2] > 0)).all(), "cells of the other body")
    volume = WORLD.allreduce(grid.compute_cell_sizes(length=False, area=False)["Volume"].sum())
    assert abs(volume / (2 * np.pi / 6) - 1) < (0.05 if degree == 1 else 0.02), "two quarters of half-balls"
    flat = np.abs(grid.points[:, 2]) > 1 - 1e-9
    approach = (grid["displacement"] * grid.points)[flat, 2]
    everywhere(np.allclose(approach, -0.005, atol=1e-9), "flat faces, at z = -1 and 1, approach by half of 0.01 each")
    s = grid["stress"].reshape(-1, 3, 3)
    deviator = s - np.trace(s, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    assert np.allclose(grid["von Mises stress"], np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))))


@pytest.mark.parametrize("degree", [1, 2])
def test_what_faces_show(degree):
    """Displaced points and the pressure of the nodes, nowhere below zero between them, on all ranks together."""
    step, _ = a_step(degree)
    leaf, face = visible_faces(step.forest, np.zeros(3), 100.0, cut=False)
    points, pressure = _on_faces(step, leaf, face, "pressure", 2.0)
    top = WORLD.allreduce(points[..., 2].max(initial=-1.0), op=MPI.MAX)
    assert abs(top - (1 - 2 * 0.005)) < 1e-9, "the upper flat face, at 1, comes down by twice 0.005"
    largest = WORLD.allreduce(pressure.max(initial=0.0), op=MPI.MAX)
    assert abs(largest / step.record.max_pressure - 1) < 1e-9
    everywhere(pressure.min(initial=0.0) >= 0, "pressure that pulls")


def test_levels_are_drawn_where_they_are():
    """Between the coarsest and the finest shown leaf each level has a shade of its own, the same in all pictures."""
    shades = np.array([_level_colour(level) for level in range(8)])
    assert (np.abs(np.diff(shades, axis=0)).max(axis=1) > 0.01).all()


def test_ranks_have_colours_of_their_own():
    """Of 21 ranks no two have nearly the same colour, neighbours least of all."""
    colours = np.array([_number_colour(number) for number in range(21)])
    apart = np.linalg.norm(colours[:, None] - colours, axis=2) + 10 * np.eye(21)
    assert apart.min() > 0.1 and np.diag(apart, 1).min() > 0.25


def test_wrong_requests():
    """A colouring that is not there, no records, a path that is none."""
    step, records = a_step()
    for draw, said in (
        (lambda: draw_mesh(step, "x.png", colour="levels"), "unknown colouring 'levels'; .*did you mean 'level'"),
        (lambda: draw_stress(step, "x.png", across="w"), "unknown axis 'w'"),
        (lambda: draw_bodies(step, "x.png", "level"), "unknown field 'level'"),
        (lambda: draw_convergence([], "x.png", WORLD), "no record"),
        (lambda: draw_convergence(records, None, WORLD), "must be a path"),
    ):
        with pytest.raises(SceneError if "unknown" in said else OutputError, match=said):
            draw()
