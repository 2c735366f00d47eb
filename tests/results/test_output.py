"""Files for ParaView: curved contact surfaces with their fields, bodies."""

from functools import cache

import numpy as np
import pytest
import pyvista
from conftest import WORLD, everywhere
from model_problems import gathered
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact import ErrorControl, Material, adapt
from fx_contact.parallel.errors import OutputError
from fx_contact.results import write_fields
from fx_contact.results.analytic import Hertz
from fx_contact.results.contact_surface import contact_grid
from fx_contact.scenes import hertz

MATERIAL = Material(young=1.0, poisson=0.3)
ENERGY = ErrorControl("energy")


@cache
def last_step(degree=1):
    """Hertz to 16 %, curved leaves with hanging contact nodes."""
    *_, step = adapt(hertz(material=MATERIAL, order=3), 0.16, WORLD, degree=degree, geometry_order=3, control=ENERGY)
    return step


@cache
def first_step(degree, order):
    """The first of Hertz on coarse leaves of an order."""
    scene = hertz(material=MATERIAL, order=order, coarse=2)
    return next(adapt(scene, 0.5, WORLD, degree=degree, geometry_order=order, control=ENERGY))


def shared(tmp_path):
    """Rank 0's folder."""
    return WORLD.bcast(tmp_path, root=0)


@pytest.mark.parametrize("degree", [1, 2])
def test_contact_surface(degree):
    """Points on both spheres, pressures of the record, and open gaps beside the contact."""
    step = last_step(degree)
    everywhere(step.elasticity.prolongation.hanging_global > 0, "nothing hangs")
    grid = contact_grid(step)
    everywhere(grid.n_cells == len(step.forest.contact_faces()[0]), "other facets")
    points, rank, level = (gathered(WORLD, x) for x in (grid.points, grid["rank"], grid["level"]))
    values = {name: gathered(WORLD, grid[name]) for name in ("pressure", "closed", "gap")}
    assert set(rank) <= set(range(WORLD.size)) and level.max() == step.record.max_level
    nodes = grid.n_points // max(grid.n_cells, 1)
    lower = gathered(WORLD, np.repeat(grid["body"], nodes)) == step.scene.mesh.bodies.index("lower")
    centre = np.where(lower[:, None], [0, 0, -1.0], [0, 0, 1.0])
    assert np.abs(np.linalg.norm(points - centre, axis=1) - 1).max() < 1e-5, "points off the spheres"
    assert np.isclose(values["pressure"].max(), step.record.max_pressure)
    radius, exact = np.linalg.norm(points[:, :2], axis=1), Hertz.of_equal_spheres(1.0, MATERIAL, step.record.force)
    inside, far = radius < 0.6 / degree * exact.contact_radius, radius > 2 * exact.contact_radius
    assert inside.any() and np.allclose(values["closed"][inside], 1)
    assert np.allclose(values["gap"][inside], 0, atol=1e-9)
    closed, pressure, gap = (values[name][far] for name in ("closed", "pressure", "gap"))
    assert (closed == 0).all() and (pressure == 0).all() and (gap > 0).all()


@pytest.mark.parametrize("order", [1, 2])
def test_nine_nodes_of_a_facet(order):
    """At degree 2 facets are quadratic at least, and each node pair's pressure and gap are at one of their nodes."""
    step = first_step(2, order)
    grid = contact_grid(step)
    assert grid.n_points == 9 * grid.n_cells and step.record.active_pairs
    contact = step.contact
    distance, node = cKDTree(grid.points).query(contact.points)
    everywhere(order == 1 or distance.max(initial=0) < 1e-12, "node pairs off the nodes")  # order 1 is flat
    for name in ("pressure", "gap"):
        off = np.abs(grid[name][node] - getattr(contact, name)).max(initial=0)
        everywhere(off < 1e-12, f"{name} is another")


@pytest.mark.parametrize("degree", [1, 2])
def test_line_through_the_contact(degree):
    """A cut of the facets of all ranks beside the plane of symmetry has the pressures of the nodes on it."""
    step = last_step() if degree == 1 else first_step(2, 2)  # facets with the nodes of the displacement
    parts, table = WORLD.gather(contact_grid(step)), step.contact.gathered()
    if WORLD.rank:
        return
    grid = pyvista.merge(parts, merge_points=False)
    line = grid.extract_cells(grid["body"] == 0).slice("y", origin=(0, 1e-9, 0))
    on = np.flatnonzero(np.abs(table.points[:, 1]) < 1e-12)
    distance, at = cKDTree(line.points).query(table.points[on])
    assert len(on) >= 5 and distance.max() < 1e-8
    for name in ("pressure", "gap"):
        known = getattr(table, name)
        assert np.abs(line[name][at] - known[on]).max() < 1e-6 * np.abs(known).max()


def test_both_sides_have_the_same_pressure():
    """Each side carries the whole force, and nothing is counted twice where ranks meet."""
    step = last_step()
    grid = contact_grid(step)
    nodes = grid.n_points // max(grid.n_cells, 1)
    x = grid.points.reshape(-1, nodes, 3)[:, :4]  # corners come first, around the facet
    pressure = grid["pressure"].reshape(-1, nodes)[:, :4].mean(axis=1)
    area = np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1) / 2
    force = np.array([(pressure * area)[grid["body"] == b].sum() for b in (0, 1)])
    force = WORLD.allreduce(force, op=MPI.SUM) * step.scene.symmetry
    assert np.isclose(*force, rtol=1e-4)
    assert np.isclose(force[0], step.record.force, rtol=0.05)  # facet means, not the exact quadrature


@pytest.mark.parametrize("degree, order", [(1, 1), (2, 1), (2, 3)])
def test_contact_file(degree, order, tmp_path):
    """VTK reads the pieces of all ranks as one, also where it is replaced: facets of their order, and the fields."""
    step, folder = first_step(degree, order), shared(tmp_path)
    write_fields(step, folder)
    write_fields(step, folder)
    WORLD.Barrier()
    grid = contact_grid(step)
    area = grid.tessellate(max_n_subdivide=3).compute_cell_sizes()["Area"].sum() if grid.n_cells else 0.0
    cells, area = WORLD.allreduce(grid.n_cells), WORLD.allreduce(area)
    largest = WORLD.allreduce(grid["pressure"].max(initial=0.0), op=MPI.MAX)
    if WORLD.rank == 0:
        assert abs(area / (np.pi / 3) - 1) < (0.15 if order == 1 else 0.01), "two thirds of octants: nodes in order"
        names = [f"contact_{rank}.vtu" for rank in range(WORLD.size)] + ["contact.pvtu"]
        assert sorted(path.name for path in folder.glob("contact*")) == sorted(
            names if WORLD.size > 1 else ["contact.vtu"]
        )
        read = pyvista.read(folder / (names[-1] if WORLD.size > 1 else "contact.vtu"))
        assert read.n_cells == cells and set(grid.array_names) <= set(read.array_names)
        assert len(read.get_cell(0).point_ids) == (max(degree, order) + 1) ** 2
        assert np.isclose(read["pressure"].max(), largest)


def read_again(path, parallel):
    """A grid as ParaView reads it, by VTK's reader of its format; checked by VTK."""
    from vtkmodules.vtkIOXML import vtkXMLPUnstructuredGridReader, vtkXMLUnstructuredGridReader

    reader = vtkXMLPUnstructuredGridReader() if parallel else vtkXMLUnstructuredGridReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    return pyvista.wrap(reader.GetOutput())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("degree, order", [(1, 1), (2, 1), (2, 3)])
def test_bodies_file(degree, order, tmp_path):
    """Two readers find the leaves of all ranks as hexahedra of their order: bodies filled, nodes with their values."""
    step, folder = first_step(degree, order), shared(tmp_path)
    (folder / "bodies_99.vtu").touch()  # of a run on more ranks
    write_fields(step, folder)
    write_fields(step, folder)
    WORLD.Barrier()
    parts, highest = WORLD.gather(step.to_pyvista()), degree
    if WORLD.rank:
        return
    parallel, known = WORLD.size > 1, pyvista.merge(parts)
    names = ["bodies.pvtu"] * parallel + [
        f"bodies_{rank}.vtu" if parallel else "bodies.vtu" for rank in range(WORLD.size)
    ]
    assert sorted(path.name for path in folder.glob("bodies*")) == sorted(names)
    for read in (pyvista.read(folder / names[0]), read_again(folder / names[0], parallel)):
        assert read.n_cells == known.n_cells == step.record.cells
        assert (read.celltypes == pyvista.CellType[f"{'LAGRANGE_' * (highest > 1)}HEXAHEDRON"]).all()
        assert len(read.get_cell(0).point_ids) == (highest + 1) ** 3
        assert set(known.array_names) == set(read.array_names)
        fine = read.tessellate(max_n_subdivide=3) if highest > 1 else read
        volume = fine.compute_cell_sizes(length=False, area=False)["Volume"]
        assert (volume > 0).all(), "cells inside out: nodes in another order"
        assert abs(volume.sum() / (np.pi / 3) - 1) < (0.15 if order == 1 else 0.01), "two quarters of half-balls"
        corners = known.points[known.cells.reshape(known.n_cells, -1)[:, 1:9].ravel()]
        at = cKDTree(read.points).query(corners)
        of = cKDTree(known.points).query(corners)
        assert max(at[0].max(), of[0].max()) < 1e-12
        for name in ("displacement", "stress"):
            assert np.allclose(read[name][at[1]], known[name][of[1]], atol=1e-9 * np.abs(known[name]).max())


def test_folder_that_cannot_be_written(tmp_path):
    """An error on all ranks, from a folder that is a file."""
    folder = shared(tmp_path) / "file"
    folder.touch()
    WORLD.Barrier()
    with pytest.raises(OutputError):
        write_fields(first_step(1, 1), folder / "fields")
