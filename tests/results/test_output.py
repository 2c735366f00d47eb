"""What is written for ParaView: VTK's own reader finds the curved contact surfaces and what happens on them."""

import shutil
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import Material, adapt
from fx_contact.parallel.errors import OutputError
from fx_contact.results.analytic import Hertz
from fx_contact.results.contact_surface import contact_facets
from fx_contact.results.output import write_fields
from fx_contact.scenes import hertz, indentation

MATERIAL = Material(young=1.0, poisson=0.3)


@cache
def last_step():
    """Hertz to 25 %, curved leaves with hanging contact vertices."""
    *_, step = adapt(hertz(material=MATERIAL, order=3), 0.16, WORLD, geometry_order=3)
    return step


def read(path):
    """A VTK file on rank 0, None elsewhere."""
    if WORLD.rank:
        return None
    import pyvista

    return pyvista.read(path)


def shared(tmp_path):
    """Rank 0's folder."""
    return WORLD.bcast(tmp_path, root=0)


def test_contact_surface_opens(tmp_path):
    """Points on both spheres, forces that add up, and fields with the names that are told."""
    step, folder = last_step(), shared(tmp_path)
    everywhere(step.elasticity.prolongation.hanging_global > 0, "nothing hangs")
    write_fields(step, folder)
    write_fields(step, folder)  # replaces what is there
    points = contact_facets(step)[0]
    facets = WORLD.allreduce(len(points))
    grid = read(folder / "contact.pvtu")
    if grid is None:
        return
    assert grid.n_cells == facets and set(grid.celltypes) == {70}
    assert set(grid.point_data) == {"displacement", "pressure", "closed", "gap"}
    assert set(grid.cell_data) == {"body", "level", "rank", "indicator"}
    assert set(grid["rank"]) <= set(range(WORLD.size)) and grid["level"].max() == step.record.max_level
    body = np.repeat(grid["body"], 16)
    centre = np.where(body[:, None] == list(step.scene.mesh.bodies).index("lower"), [0, 0, -1.0], [0, 0, 1.0])
    assert np.abs(np.linalg.norm(grid.points - centre, axis=1) - 1).max() < 1e-5, "points off the spheres"
    assert np.isclose(grid["pressure"].max(), step.record.max_pressure)
    exact = Hertz.of_equal_spheres(1.0, MATERIAL, step.record.force)
    inside = np.linalg.norm(grid.points[:, :2], axis=1) < 0.6 * exact.contact_radius
    assert inside.any() and np.allclose(grid["closed"][inside], 1)
    assert np.allclose(grid["gap"][inside], 0, atol=1e-9)
    far = np.linalg.norm(grid.points[:, :2], axis=1) > 2 * exact.contact_radius
    assert (grid["closed"][far] == 0).all() and (grid["pressure"][far] == 0).all() and (grid["gap"][far] > 0).all()


def test_facets_are_curved_for_vtk(tmp_path):
    """VTK's subdivision of the facets stays on the sphere: inner nodes are where it expects them."""
    step, folder = last_step(), shared(tmp_path)
    write_fields(step, folder)
    grid = read(folder / "contact.pvtu")
    if grid is None:
        return
    lower = list(step.scene.mesh.bodies).index("lower")

    def off(level):
        # The body is chosen last: VTK 9.3 crashes now and then where it extracts cells of any .pvtu, its own too.
        skin = grid.extract_surface(nonlinear_subdivision=level).triangulate()
        middle = skin.cell_centers().points[skin["body"] == lower]
        return np.abs(np.linalg.norm(middle + [0, 0, 1.0], axis=1) - 1).max()

    assert off(3) < 0.05 * off(0), "straight between its corners, or twisted"


def test_both_sides_have_the_same_pressure():
    """Each side carries the whole force, and nothing is counted twice where ranks meet."""
    step = last_step()
    points, at_points, at_cells = contact_facets(step)
    corner = [0, 3, 12, 15]
    x, pressure = points[:, corner], at_points["pressure"][:, corner, 0]
    area = np.linalg.norm(np.cross(x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]), axis=1) / 2
    force = np.array([(pressure.mean(axis=1) * area)[at_cells["body"] == b].sum() for b in (0, 1)])
    force = WORLD.allreduce(force, op=MPI.SUM) * step.scene.symmetry
    assert np.isclose(*force, rtol=1e-4)
    assert np.isclose(force[0], step.record.force, rtol=0.05)  # facet means, not the exact quadrature


def test_straight_facets(tmp_path):
    """Order 1: plain quadrilaterals in a plane."""
    step, folder = next(adapt(indentation(), 0.5, WORLD)), shared(tmp_path)
    write_fields(step, folder)
    grid = read(folder / "contact.pvtu")
    if grid is not None:
        assert grid.n_points == 4 * grid.n_cells > 0
        assert np.ptp(grid.points[:, 2]) == 0


@pytest.mark.parametrize("name, field", [("fields.bp", "displacement"), ("cells.bp", "indicator")])
def test_adios_files_name_their_fields(tmp_path, name, field):
    """The schema inside names cells of Lagrange type and the fields."""
    step, folder = last_step(), shared(tmp_path)
    write_fields(step, folder)
    if WORLD.rank == 0:
        index = b"".join(path.read_bytes() for path in (folder / name).iterdir())
        assert b"connectivity" in index and field.encode() in index


def test_disk_full(tmp_path, monkeypatch):
    """A file that does not fit is refused on all ranks, and the one before kept; what fits is not refused."""
    step, folder = last_step(), shared(tmp_path)
    write_fields(step, folder)
    WORLD.Barrier()
    sizes = {
        name: sum(path.stat().st_size for path in (folder / name).iterdir()) for name in ("fields.bp", "cells.bp")
    }
    for free, full in ((-(2**15) * WORLD.size, True), (2**15 * WORLD.size, False)):
        monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
        if full:
            with pytest.raises(OutputError, match="'fields.bp' takes .* MB are free: make room"):
                write_fields(step, folder)
        else:
            write_fields(step, folder)
        WORLD.Barrier()
        for name, size in sizes.items():
            again = sum(path.stat().st_size for path in (folder / name).iterdir())
            everywhere(abs(again - size) < 100 * WORLD.size, f"{name} is not what it was")
