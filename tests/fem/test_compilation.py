"""Compilation of forms: what a killed run has left is removed, what fails is one sentence on all ranks."""

from pathlib import Path

import pytest
import ufl
from conftest import WORLD
from dolfinx import fem, jit
from dolfinx.mesh import create_unit_cube

from fx_contact import adapt
from fx_contact.fem.compilation import compiled
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
    """A file without its mark, half a form, is removed and the form compiled; a marked one is taken as it is."""
    assert abs(volume() - 1) < 1e-12
    (mark,) = cache.glob("*.c.cached")
    source = Path(str(mark).removesuffix(".cached"))
    made = source.stat().st_mtime_ns
    assert abs(volume() - 1) < 1e-12 and source.stat().st_mtime_ns == made
    WORLD.Barrier()
    if WORLD.rank == 0:
        mark.unlink()
        source.write_text("")
    WORLD.Barrier()
    assert abs(volume() - 1) < 1e-12
    assert mark.exists() and source.stat().st_size


def test_another_run_at_work(cache, monkeypatch):
    """What a run that lives may be compiling is not removed: others wait, and say so in the end."""
    import fcntl

    volume()
    (mark,) = cache.glob("*.c.cached")
    WORLD.Barrier()
    if WORLD.rank == 0:
        mark.unlink()
    monkeypatch.setattr("fx_contact.fem.compilation._ATTEMPTS", 2)
    with (cache / "fx_contact.lock").open("a") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        with pytest.raises(CompilationError, match="timed out.* remove what is in that folder"):
            volume()
        assert Path(str(mark).removesuffix(".cached")).exists()
        WORLD.Barrier()


@pytest.mark.parametrize("cause", ["no compiler", "no folder"])
def test_what_cannot_be_compiled(cache, monkeypatch, cause):
    """No compiler, or no folder for what it makes: the same error on all ranks, also within a run."""
    if cause == "no compiler":
        monkeypatch.setenv("CC", "/bin/false")
    else:
        monkeypatch.setitem(jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (Path("/proc/nope"), ""))
    for action in (volume, lambda: next(adapt(patch(cells=(1, 1, 2)), 0.1))):
        with pytest.raises(CompilationError, match="cannot be compiled .*there is a C compiler") as caught:
            action()
        assert len(set(WORLD.allgather(str(caught.value)))) == 1
    assert caught.value.forest is not None
