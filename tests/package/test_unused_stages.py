"""Unused stages are skipped: shown by what is called, imported and recorded, not by time."""

import subprocess
import sys
from dataclasses import replace

import pytest
from conftest import WORLD, everywhere, outside

import fx_contact.adaptive.step_solver
import fx_contact.forest.partition
import fx_contact.law.contact_solver
import fx_contact.plot
import fx_contact.surfaces.facet_pairing
from fx_contact import ContactPair, Dirichlet, RigidPlane, adapt
from fx_contact.forest.forest import Forest
from fx_contact.scenes import indentation, patch


class Calls:
    """Counts the calls of functions, which still do their work."""

    def __init__(self, monkeypatch):
        self._monkeypatch, self.count = monkeypatch, {}

    def of(self, place, name):
        """Count calls of a function of a module or class."""
        function = getattr(place, name)

        def counted(*args, **kwargs):
            self.count[name] += 1
            return function(*args, **kwargs)

        self.count[name] = 0
        self._monkeypatch.setattr(place, name, counted)


@pytest.fixture
def calls(monkeypatch):
    """A counter of calls."""
    return Calls(monkeypatch)


def parted(scene):
    """The columns of a patch test without contact, each held at both ends."""
    held = Dirichlet("on block 0", z=0.001), Dirichlet("under block 1", z=0.001)
    return replace(scene, contact=(), dirichlet=scene.dirichlet + held)


def test_without_contact(calls):
    """One linear solve; no facets are matched, no pairs made, no active set kept, no contact stiffness reserved."""
    with_contact = patch(cells=(1, 1, 2))
    for place, name in (
        (fx_contact.surfaces.facet_pairing, "_match"),
        (fx_contact.adaptive.step_solver, "create_rows"),
        (fx_contact.law.contact_solver, "Unilateral"),
        (fx_contact.law.contact_solver, "Jump"),
        (fx_contact.law.contact_solver, "relax"),
        (fx_contact.law.contact_solver, "move_bodies"),
    ):
        calls.of(place, name)
    *_, step = adapt(parted(with_contact), 0.1)
    record = step.record
    assert record.contact_iterations == 1 and len(record.krylov_iterations) == 1 and step.rows is None
    assert record.force == record.max_pressure == record.active_pairs == 0
    assert set(calls.count.values()) == {0}
    *_, step = adapt(patch(cells=(1, 1, 2)), 0.1, degree=1)
    assert step.record.force > 0 and min(calls.count.values()) > 0


def test_obstacles_without_forces(calls):
    """Rows are made once, and no obstacle settles; below a force it does."""
    calls.of(fx_contact.adaptive.step_solver, "create_rows")
    calls.of(fx_contact.adaptive.step_solver, "touching")
    calls.of(fx_contact.law.contact_solver, "settle")
    columns = patch(cells=(1, 1, 2))
    platen = ContactPair("top", RigidPlane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)), moved=(0.0, 0.0, -0.001))
    held = tuple(condition for condition in columns.dirichlet if getattr(condition, "where", "") != "top")
    for force, settled in ((None, 0), ((0.0, 0.0, -1e-3), 1)):
        contact = *columns.contact, replace(platen, force=force)
        scene = replace(columns, dirichlet=held, contact=contact)
        before = dict(calls.count)
        next(adapt(scene, 0.1))
        made = {name: count - before[name] for name, count in calls.count.items()}
        assert made["settle"] == made["touching"] == settled
        assert (made["create_rows"] == 1) == (not settled)


def test_one_rank_is_not_partitioned(calls, monkeypatch):
    """On one rank no super-elements are built, no leaf is sent; on more they are."""
    for name in ("Units", "_moved"):
        calls.of(fx_contact.forest.partition, name)
    steps = [step.record.cells for step in adapt(indentation(coarse=2), 0.3)]
    assert len(steps) > 1
    everywhere((min(calls.count.values()) > 0) == (WORLD.size > 1), f"{calls.count} on {WORLD.size} ranks")
    everywhere(max(calls.count.values()) == 0 or WORLD.size > 1, f"{calls.count} on one rank")


def test_nothing_marked(calls):
    """A single solve refines nothing and carries nothing; without an error it is the whole run, at degree 1 half."""
    for name in ("refined", "_closure"):
        calls.of(Forest, name)
    (step,) = adapt(patch(cells=(2, 2, 4)), 0.1)
    record = step.record
    assert record.reached and record.max_level == 0 and record.hanging_nodes == 0
    assert record.memory_bytes["refine"] == record.memory_bytes["output"] == 0, "a stage was entered"
    assert set(calls.count.values()) == {0}
    steps = adapt(patch(cells=(2, 2, 4)), 0.1, degree=1)
    levels = [(step.record.max_level, step.record.hanging_nodes) for step in steps]
    assert levels == [(0, 0), (1, 0)] and min(calls.count.values()) > 0


def test_nothing_optional_is_imported():
    """A run without pictures, Gmsh and files imports nothing that is for these."""
    if WORLD.rank == 0:
        program = """
import sys
from fx_contact import adapt
from fx_contact.scenes import indentation
*_, step = adapt(indentation(coarse=2), 0.4)
optional = "gmsh", "matplotlib", "pyvista", "vtkmodules", "h5py", "adios4dolfinx", "adios2", "IPython", "numba"
print(step.record.step, *(name for name in optional if name in sys.modules), sep=",")
"""
        done = subprocess.run([sys.executable, "-c", program], env=outside(), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout == "1\n" or done.stdout.strip().isdigit(), done.stdout
