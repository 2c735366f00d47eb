"""What is written for ParaView: curved contact surfaces and what happens on them, fields by name, room on the disk."""

import shutil
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
from conftest import WORLD, everywhere
from model_problems import gathered
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact import ErrorControl, Material, adapt
from fx_contact.parallel.compat import geometry_nodes
from fx_contact.parallel.errors import OutputError
from fx_contact.results import Hertz, output, write_fields
from fx_contact.results.contact_surface import contact_functions
from fx_contact.results.output import point_fields
from fx_contact.scenes import hertz, indentation

MATERIAL = Material(young=1.0, poisson=0.3)
FILES = ("fields.bp", "cells.bp")


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
    fields = contact_functions(step)
    space = fields["body"].function_space
    everywhere(space.mesh.topology.index_map(2).size_local == len(step.forest.contact_faces()[0]), "other facets")
    points = gathered(WORLD, space.tabulate_dof_coordinates())
    values = {name: gathered(WORLD, fields[name].x.array) for name in fields}
    assert set(values["rank"]) <= set(range(WORLD.size)) and values["level"].max() == step.record.max_level
    lower = values["body"] == step.scene.mesh.bodies.index("lower")
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
    fields = contact_functions(step)
    space = fields["pressure"].function_space
    assert geometry_nodes(space.mesh).shape[1] == 9 and step.record.active_pairs
    contact, nodes = step.contact, space.tabulate_dof_coordinates()
    distance, node = cKDTree(nodes).query(contact.points)
    everywhere(order == 1 or distance.max(initial=0) < 1e-12, "node pairs off the nodes")  # order 1 is flat
    for name in ("pressure", "gap"):
        found, known = fields[name].x.array[node], getattr(contact, name)
        everywhere(np.abs(found - known).max(initial=0) < 1e-12, f"{name} is another")


@pytest.mark.parametrize("degree, order, points", [(1, 2, 3), (2, 1, 3), (2, 2, 3), (2, 3, 4)])
def test_point_fields(degree, order, points):
    """Cells have the higher one of two orders, and the fields on them are those of the step."""
    step = first_step(degree, order)
    for field, given in zip(point_fields(step), (step.displacement, step.stress)):
        nodes = field.function_space.dofmap.list
        assert nodes.shape[1] == points**3
        x = field.function_space.tabulate_dof_coordinates()[nodes].reshape(-1, 3)
        exact = given.eval(x, np.repeat(np.arange(len(nodes), dtype=np.int32), points**3))
        off = np.abs(field.x.array.reshape(-1, exact.shape[1])[nodes.ravel()] - exact).max()
        everywhere(off < 1e-9 * np.abs(exact).max() > 0, f"{field.name} is another")


def test_both_sides_have_the_same_pressure():
    """Each side carries the whole force, and nothing is counted twice where ranks meet."""
    step = last_step()
    fields = contact_functions(step)
    nodes = fields["pressure"].function_space.dofmap.list[:, :4]  # corners come first
    x = fields["pressure"].function_space.tabulate_dof_coordinates()[nodes]
    pressure, body = fields["pressure"].x.array[nodes].mean(axis=1), fields["body"].x.array[nodes[:, 0]]
    area = np.linalg.norm(np.cross(x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]), axis=1) / 2
    force = np.array([(pressure * area)[body == b].sum() for b in (0, 1)])
    force = WORLD.allreduce(force, op=MPI.SUM) * step.scene.symmetry
    assert np.isclose(*force, rtol=1e-4)
    assert np.isclose(force[0], step.record.force, rtol=0.05)  # facet means, not the exact quadrature


def test_straight_facets():
    """Degree and order 1: plain quadrilaterals in a plane."""
    mesh = contact_functions(next(adapt(indentation(), 0.5, WORLD, degree=1)))["body"].function_space.mesh
    assert geometry_nodes(mesh).shape[1] == 4
    everywhere((mesh.geometry.x[:, 2] == 0).all(), "not in the plane")


@pytest.mark.parametrize("degree, order", [(2, 1), (2, 3)])
def test_files_hold_their_fields(degree, order, tmp_path):
    """Read back: names, cells, nodes and values of each rank, also where a file is replaced."""
    step, folder = first_step(degree, order), shared(tmp_path)
    for _ in "12":
        write_fields(step, folder)
    WORLD.Barrier()
    for name, field in zip(FILES, ("displacement", "indicator")):
        index = b"".join(path.read_bytes() for path in (folder / name).iterdir())
        assert b"connectivity" in index and field.encode() in index
    data = b"".join(path.read_bytes() for path in sorted((folder / "fields.bp").glob("data.*")))
    for field in point_fields(step):
        everywhere(field.x.array.tobytes() in data, f"no {field.name}")
    everywhere(field.function_space.tabulate_dof_coordinates().tobytes() in data, "no nodes")


@pytest.mark.parametrize("degree, order", [(1, 1), (2, 1), (2, 3)])
def test_contact_file(degree, order, tmp_path):
    """VTK reads the pieces of all ranks as one, also where it is replaced: facets of their order, and the fields."""
    step, folder = first_step(degree, order), shared(tmp_path)
    write_fields(step, folder)
    write_fields(step, folder)
    WORLD.Barrier()
    fields = contact_functions(step)
    mesh = fields["pressure"].function_space.mesh
    cells = WORLD.allreduce(mesh.topology.index_map(2).size_local)
    largest = WORLD.allreduce(fields["pressure"].x.array.max(initial=0.0), op=MPI.MAX)
    if WORLD.rank == 0:
        assert sorted(path.suffix for path in folder.glob("contact*")) == [".pvtu"] + WORLD.size * [".vtu"]
        read = pyvista.read(folder / "contact.pvtu")
        assert read.n_cells == cells and set(fields) <= set(read.point_data)
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
    parts, highest = WORLD.gather(step.to_pyvista()), max(degree, order)
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


@pytest.mark.ranks(1, 2)
def test_no_pyvista(tmp_path, monkeypatch):
    """The other files are written without it."""
    monkeypatch.setattr(output, "find_spec", lambda name: None)
    folder = shared(tmp_path)
    write_fields(first_step(1, 1), folder)
    everywhere(not [*folder.glob("bodies*")] and (folder / "contact.pvtu").exists(), "other files")


def test_disk_full(tmp_path, monkeypatch):
    """A file that does not fit is refused on all ranks, and the one before kept; what fits is not refused."""
    step, folder = last_step(), shared(tmp_path)
    write_fields(step, folder)
    WORLD.Barrier()
    sizes = {name: sum(path.stat().st_size for path in (folder / name).iterdir()) for name in FILES}
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
