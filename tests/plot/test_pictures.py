"""Pictures: what the section shows, and that something is seen on each."""

from contextlib import nullcontext
from functools import cache

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import ErrorControl, adapt, solve
from fx_contact.parallel.errors import OutputError, SceneError
from fx_contact.path.sweep_record import SweepRecord
from fx_contact.plot import draw_bodies, draw_convergence, draw_mesh, draw_pressure, draw_stress, draw_sweep
from fx_contact.plot.bodies import _colours, _on_faces
from fx_contact.plot.canvas import _LEFT, _SHOWN, add_legend, look, plotter_for
from fx_contact.plot.cut import _section
from fx_contact.plot.surfaces import visible_faces
from fx_contact.scenes import cylinders, hertz, shrink_fit, stack


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
    "partition": lambda step, records, path: draw_mesh(step, path, zoom=None),
    "bodies": lambda step, records, path: draw_bodies(step, path, cut=True, apart=0.1),
    "pressure": lambda step, records, path: draw_pressure(step, path),
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


@pytest.mark.parametrize("degree", [1, 2])
def test_sections(degree):
    """Each body has its own section; with quadratic leaves it bends; no line is inside a leaf."""
    step, _ = a_step(degree)
    centre = np.zeros(3)
    sections, outlines = _section(step, centre, np.inf, 1)
    everywhere(len(sections) == len(np.unique(step.forest.mesh.region[step.forest.cell])), "a body that is not cut")
    for section, lines in zip(sections, outlines):
        assert np.ptp(section.points[:, 1]) < 1e-9
        everywhere((section.points[:, 2] > -1e-9).all() or (section.points[:, 2] < 1e-9).all(), "two bodies in one")
        distance = np.linalg.norm(lines.points - [0, 0, 1], axis=1), np.linalg.norm(lines.points + [0, 0, 1], axis=1)
        assert np.minimum(*distance).max() < 1 + 1e-6, "lines outside of the balls"
    area = WORLD.allreduce(sum(section.compute_cell_sizes()["Area"].sum() for section in sections))
    assert abs(area / (np.pi / 2) - 1) < (0.06 if degree == 1 else 0.02), "two quarters of discs"


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", ["levels", "bodies near", "stress near"])
def test_legends_are_beside_the_bodies(name, tmp_path):
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
        edge = round((1 + _SHOWN - _LEFT) / 2 * width)
        below = pixels[int(0.8 * height) :]  # below the legends
        assert (below[:, edge + 3 : -1] == 1).all(), "bodies below the legend"  # the last column is smoothed by VTK
        assert (below[:, edge - 8 : edge - 3] < 1).any(), "the bodies end before it"


def test_zoom_is_about_the_contact(tmp_path):
    """The magnified picture is centred there; the other on all bodies."""
    step, _ = a_step()
    for zoom in (1, 8):
        with plotter_for(tmp_path / "a.png") if WORLD.rank == 0 else nullcontext() as plotter:
            draw_bodies(step, zoom=zoom, plotter=plotter)
            if plotter:
                found = np.allclose(plotter.camera.focal_point, step.record.contact_centre, atol=1e-9)
                assert found == (zoom == 8)


@pytest.mark.parametrize("size, units", [(1.0, None), (0.013, ("mm", "MPa"))])
def test_scale_bar(size, units, tmp_path, monkeypatch):
    """As long as it says, across the view, inside the picture."""
    import pyvista

    if WORLD.rank:
        return
    with plotter_for(tmp_path / "a.png", 800, 300) as plotter:
        plotter.add_mesh(pyvista.Cube().scale(size))
        look(plotter, (1, -2, 1))
        said = []
        monkeypatch.setattr(plotter, "add_point_labels", lambda _, texts, **__: said.extend(texts))
        add_legend(plotter, "it", units)
        (line,) = (mesh for mesh in plotter.meshes if mesh.n_cells == 1 and mesh.n_points == 2)
        length = float(np.linalg.norm(np.ptp(line.points, axis=0)))
        number, *unit = said[0].split()
        assert np.isclose(float(number), length) and unit == (["mm"] if units else [])
        towards = np.array(plotter.camera.position) - plotter.camera.focal_point
        assert abs(np.diff(line.points, axis=0) @ towards) < 1e-6 * length * np.linalg.norm(towards)
        assert 0.05 < length / (2 * plotter.camera.parallel_scale * 800 / 300) < 0.2


@pytest.mark.parametrize("scene", [cylinders(), shrink_fit(interference=1e-3), stack()], ids=lambda scene: scene.name)
def test_pressure_of_contact_that_is_not_round(scene):
    """Lines, rings and several contacts are drawn over the distance from the centre, as the axis says."""
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    draw_pressure(solve(scene, 0.5, max_steps=1, degree=1), ax=ax)
    everywhere(WORLD.rank > 0 or ax.get_xlabel() == "distance from the centre" and ax.lines, "another picture")


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


def test_numbers_have_colours_of_their_own():
    """Levels from light to dark, the same in all pictures; of 10 ranks no two have nearly the same colour."""
    from matplotlib.colors import to_rgb

    shades = np.array([to_rgb(colour) for colour in _colours("level", 8)])
    assert (np.diff(shades @ (0.299, 0.587, 0.114)) < -0.01).all() and _colours("level", 3) == _colours("level", 8)[
        :3
    ]
    assert len(set(_colours("rank", 20))) == 20
    colours = np.array([to_rgb(colour) for colour in _colours("rank", 10)])
    apart = np.linalg.norm(colours[:, None] - colours, axis=2) + 10 * np.eye(10)
    assert apart.min() > 0.25


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
