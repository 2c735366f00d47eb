"""The stage profile adds up."""

import mmap
import time

import numpy as np
import pytest
from conftest import WORLD, everywhere

from fx_contact import adapt
from fx_contact.parallel import timing
from fx_contact.parallel.timing import STAGES, Stages
from fx_contact.scenes import hertz


def test_nested_stages_add_up():
    """An inner stage is taken out of the outer one, and what no stage explains is `other`."""
    stages = Stages()
    with stages("assemble"):
        time.sleep(0.02)
        with stages("compile"):
            time.sleep(0.05)
    time.sleep(0.03)
    costs = stages.costs(WORLD)
    seconds = costs["seconds"]
    assert seconds["compile"] >= 0.05 and seconds["assemble"] >= 0.02 and seconds["other"] >= 0.03
    assert seconds["assemble"] < seconds["total"] - 0.08 + 1e-9, "the inner stage was counted twice"
    for clock in ("seconds", "cpu_seconds"):
        assert list(costs[clock]) == [*STAGES, "total"]
    cpu = costs["cpu_seconds"]
    assert abs(sum(cpu[name] for name in STAGES) - cpu["total"]) < 1e-9
    everywhere(costs == WORLD.bcast(costs), "the ranks have different costs")


def test_costs_of_all_ranks(monkeypatch):
    """Wall seconds are those of the slowest rank in each stage, CPU seconds those of all ranks together."""
    now = np.zeros(2)
    monkeypatch.setattr(timing, "_clocks", now.copy)
    stages = Stages()
    for name, spent in (("mesh", WORLD.rank + 1.0), ("solve", 2.0 * (WORLD.size - WORLD.rank))):
        with stages(name):
            now += spent, 3.0 * spent
    costs, ranks = stages.costs(WORLD), WORLD.size
    for clock, expected in (
        ("seconds", (ranks, 2 * ranks)),
        ("cpu_seconds", 3 * np.array([1, 2]) * sum(range(ranks + 1))),
    ):
        assert [costs[clock][name] for name in ("mesh", "solve")] == list(expected)
    assert costs["seconds"]["total"] == 2 * ranks + 1 and costs["cpu_seconds"]["total"] == 9 * sum(range(ranks + 1))


def test_who_watches_hears_of_every_stage():
    """When one begins, and when work goes back to the outer one; also where a stage fails."""
    heard = []
    stages = Stages(heard.append)
    with pytest.raises(ValueError):
        with stages("assemble"):
            with stages("compile"):
                pass
            raise ValueError
    with stages("solve"):
        pass
    assert heard == ["assemble", "compile", "assemble", "solve"]


@pytest.mark.ranks(1, 2)
def test_progress_of_a_run():
    """The steps in order, on every rank, from what leads to the first one to the last estimate."""
    heard = []
    steps = list(adapt(hertz(order=2, coarse=2), 0.1, WORLD, max_steps=2, progress=lambda *told: heard.append(told)))
    numbers = [number for number, _ in heard]
    everywhere(numbers == sorted(numbers) and set(numbers) == {0, 1}, f"told of steps {numbers}")
    everywhere(heard[0] == (0, "partition") and heard[-1][1] == "estimate", heard)
    everywhere({name for _, name in heard} <= set(STAGES) and len(steps) == 2, heard)


def test_memory_by_stage():
    """A stage that keeps memory ends with more of it than the one before; a stage not entered has none."""
    stages = Stages()
    with stages("refine"):
        pass
    with stages("mesh"):
        kept = mmap.mmap(-1, 1 << 27)  # new pages for certain; an array might lie on pages that were freed before
        kept.write(b"x" * (1 << 27))
    costs = stages.costs(WORLD)
    memory = costs["memory_bytes"]
    assert memory["mesh"] - memory["refine"] > 0.9 * WORLD.size * len(kept)
    assert memory["solve"] == 0 and memory["mesh"] <= costs["peak_memory_bytes"]
