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


def by_itself(module, *words, ranks=1):
    """What a module prints in its last line, as JSON, run with some words in a process of its own."""
    start = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    said = subprocess.run(
        [*start, sys.executable, "-m", module, *words], stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(said.stdout.splitlines()[-1])


def cpu(steps, stages=STAGES):
    """CPU seconds of all ranks in some stages of all steps; those of a demo without output, compilation apart."""
    return sum(step["cpu_seconds"][name] for step in steps for name in stages)


def wall(steps):
    """Wall seconds of all steps, compilation and pictures apart."""
    return sum(step["seconds"]["total"] - step["seconds"]["compile"] - step["seconds"]["output"] for step in steps)
