"""Runs of the demos as anyone would start them, for the studies: each a process of its own, kept once it is done."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

#: The project: demos run there.
TOP = Path(__file__).parents[1]
#: Stages that a study counts: compilation and pictures are apart.
STAGES = ("partition", "mesh", "hanging", "assemble", "system", "setup", "solve", "estimate", "refine", "other")


class RunFailed(Exception):
    """A demo did not end well; its message is the demo's last line."""


@dataclass(frozen=True)
class Case:
    """A run of a demo.

    Attributes:
        demo: name of its script.
        options: of its command line.
        ranks: MPI ranks.
    """

    demo: str
    options: str
    ranks: int = 2

    @property
    def command(self):
        """As a user would type it."""
        return f"mpirun -n {self.ranks} python3 demos/{self.demo}.py {self.options}".rstrip()

    @property
    def name(self):
        """For a folder."""
        return re.sub(r"[^\w.]+", "-", f"{self.demo} {self.options} on {self.ranks}")


def run(case, place, limit=None, extra=""):
    """Run a case; the results go to a folder.

    Args:
        case: Case.
        place: Path of the folder.
        limit: seconds after which it is stopped, or None.
        extra: options that say nothing about the results.

    Returns:
        list of step records, and the seconds that the whole process took.

    Raises:
        RunFailed: it ends with an error, or not in time.
    """
    words = [*shlex.split(case.command), *extra.split(), "--output", str(place.resolve())]
    start = time.perf_counter()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # as Ctrl-C: the run is stopped below
    # A session of its own, so that what mpirun has started can be stopped with it.
    process = subprocess.Popen(
        words, cwd=TOP, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        _, said = process.communicate(timeout=limit)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGTERM)
        process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            raise RunFailed(f"not done after {limit:.0f} s") from None
        raise
    if process.returncode:
        raise RunFailed(_what_it_said(said) or f"exit code {process.returncode}")
    lines = (place / "steps.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines], time.perf_counter() - start


def _what_it_said(text):
    """The line of standard error that names the error, without what mpirun adds; the last one if none does."""
    lines = [line for line in text.splitlines() if line.strip()]
    named = [line for line in lines if re.match(r"\w*Error: ", line)]
    return (named or lines or [""])[0 if named else -1]


def records(case, folder):
    """Step records of a case, run now if they are not there.

    Args:
        case: Case.
        folder: Path below which each case has a folder.

    Raises:
        RunFailed: it ends with an error.
    """
    place = folder / case.name
    done = place / "done"
    if done.exists():
        return [json.loads(line) for line in (place / "steps.jsonl").read_text().splitlines()]
    print(case.command, file=sys.stderr)
    try:
        steps, _ = run(case, place, extra="--records-only")
    except RunFailed as error:
        raise RunFailed(f"{case.command}: {error}") from None
    done.touch()
    return steps


def at_once(case, folder, copies=2):
    """Step records of independent runs of a case at the same time, each a single process.

    Args:
        case: Case, whose ranks do not count.
        folder: Path below which the runs have folders.
        copies: how many.

    Raises:
        RunFailed: one ends with an error.
    """
    places = [folder / f"{case.name} copy {number} of {copies}" for number in range(1, copies + 1)]
    if not all((place / "done").exists() for place in places):
        words = [sys.executable, f"demos/{case.demo}.py", *shlex.split(case.options), "--records-only"]
        streams = {"cwd": TOP, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        processes = [subprocess.Popen([*words, "--output", str(place.resolve())], **streams) for place in places]
        said = [process.communicate()[1] for process in processes]
        if any(process.returncode for process in processes):
            raise RunFailed(f"{shlex.join(words)}: {' '.join(map(_what_it_said, said))}")
        for place in places:
            (place / "done").touch()
    return [[json.loads(line) for line in (place / "steps.jsonl").read_text().splitlines()] for place in places]


def cpu(steps, stages=STAGES):
    """CPU seconds of all ranks in some stages of all steps; those of a demo without output, compilation apart."""
    return sum(step["cpu_seconds"][name] for step in steps for name in stages)


def wall(steps):
    """Wall seconds of all steps, compilation and pictures apart."""
    return sum(step["seconds"]["total"] - step["seconds"]["compile"] - step["seconds"]["output"] for step in steps)
