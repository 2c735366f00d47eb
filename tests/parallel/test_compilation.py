"""Compilation of forms and functions in C: one error on all ranks, also where a killed run has left something."""

import re
from pathlib import Path

import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx import fem, jit
from dolfinx.mesh import create_unit_cube

from fx_contact import adapt
from fx_contact.parallel import compilation
from fx_contact.parallel.compilation import compiled, library
from fx_contact.parallel.errors import CompilationError
from fx_contact.scenes import patch


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache folder; FFCx waits a second in it for what another process compiles."""
    folder = WORLD.bcast(tmp_path)
    for name, value in (("cache_dir", folder), ("timeout", 1)):
        monkeypatch.setitem(jit.DOLFINX_DEFAULT_JIT_OPTIONS, name, (value, ""))
    return folder


def volume():
    """Volume of a cube, by a form."""
    form = compiled(WORLD, fem.Constant(create_unit_cube(WORLD, 2, 2, 2), 1.0) * ufl.dx)
    return WORLD.allreduce(fem.assemble_scalar(form))


def test_left_by_a_killed_run(cache):
    """A file without its mark is named on all ranks; once it is removed, the form is compiled."""
    assert abs(volume() - 1) < 1e-12
    (mark,) = cache.glob("*.c.cached")
    source = Path(str(mark).removesuffix(".cached"))
    WORLD.Barrier()
    if WORLD.rank == 0:
        mark.unlink()
        source.write_text("")
    WORLD.Barrier()
    with pytest.raises(CompilationError, match=rf"timed out.*{re.escape(str(source))}.*remove the file") as caught:
        volume()
    assert len(set(WORLD.allgather(str(caught.value)))) == 1
    if WORLD.rank == 0:
        source.unlink()
    WORLD.Barrier()
    assert abs(volume() - 1) < 1e-12


def test_library(cache):
    """A function in C, compiled once; what is no C, and a file that is no library, are the same error on all ranks."""
    source = "int twice(int number) { return 2 * number; }"
    assert [library(WORLD, source).twice(21) for _ in range(2)] == [42, 42]
    everywhere(len(list(cache.iterdir())) == 1, "one file")
    with pytest.raises(CompilationError, match="cannot be compiled .*exit status 1.*source.c.*there is a C compiler"):
        library(WORLD, source.replace(";", ""))
    broken = source.replace("twice", "double_")
    file = compilation._built(WORLD, broken)
    WORLD.Barrier()
    if WORLD.rank == 0:
        file.write_text("")
    WORLD.Barrier()
    with pytest.raises(CompilationError, match="OSError.*too short.*noexec"):
        library(WORLD, broken)


@pytest.mark.parametrize("cause", ["no compiler", "no folder"])
def test_what_cannot_be_compiled(cache, monkeypatch, cause):
    """No compiler, or no folder for what it makes: the same error on all ranks, also within a run."""
    if cause == "no compiler":
        monkeypatch.setenv("CC", "/bin/false")
    else:
        monkeypatch.setitem(jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (Path("/proc/nope"), ""))
    for action in (
        volume,
        lambda: library(WORLD, "int one() { return 1; }"),
        lambda: next(adapt(patch(cells=(1, 1, 2)), 0.1)),
    ):
        with pytest.raises(CompilationError, match="cannot be compiled .*there is a C compiler") as caught:
            action()
        assert len(set(WORLD.allgather(str(caught.value)))) == 1
    assert caught.value.forest is not None
