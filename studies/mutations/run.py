"""The share of drawn small mistakes in the package that the tests notice.

    ./with-dolfinx python3 -m studies.mutations.run [--count N] [--seed N] [--only WORD ...] [--jobs N]

Each mistake is made in a copy of the tree.  The tests that run its line judge it, which `--map` notes: those of the
module's own room first, the fastest first, for a minute.  Results are appended to `results/mutations/draws.jsonl`; a
call goes on where the last one ended.
"""

import argparse
import difflib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from studies.mutations.operators import Mutation, mutations_of
from studies.mutations.table import table

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "src/fx_contact"
RESULTS = ROOT / "results" / "mutations"
#: Seconds of tests on a mistake, by the map; seconds that a test may take beside five times those of the map.
BUDGET, PATIENCE = 60.0, 40.0
_GONE = "no test has the names of the map"
#: A module with one of these words is judged on two ranks too.
_COMMUNICATES = re.compile(r"\bcomm\b|\bMPI\b")
_FAILED = re.compile(
    r"^(?:FAILED |ERROR )?(tests/\S+?\.py(?:::\w+(?:\[.*?\])?)?)(?= - | does not end|$)", re.MULTILINE
)


@dataclass(frozen=True)
class Map:
    """Tests that pass on a number of ranks, their seconds, and those that run each line."""

    tests: list[tuple[str, float]]
    lines: dict[str, dict[int, int]]

    @classmethod
    def load(cls, ranks: int) -> "Map":
        """The union of what all ranks saw."""
        lines: dict[str, dict[int, int]] = defaultdict(lambda: defaultdict(int))
        tests: list[tuple[str, float]] = []
        for path in sorted(RESULTS.glob(f"tests-{ranks}-*.json")):
            seen = json.loads(path.read_text())
            tests = [(name, seconds) for name, seconds in seen["tests"]]
            for file, of in seen["lines"].items():
                for line, bits in of.items():
                    lines[file][int(line)] |= int(bits, 16)
        return cls(tests, lines)

    def judges(self, mutation: Mutation) -> list[tuple[str, float]]:
        """Tests that run the lines of a mistake: those of its room first, the fastest first."""
        of = self.lines.get(mutation.file, {})
        first, last = mutation.lines or (0, sys.maxsize)
        bits = 0
        for line, tests in of.items():
            bits |= tests if first <= line <= last else 0
        room = f"tests/{mutation.file.split('/')[0]}/"
        found = [test for index, test in enumerate(self.tests) if bits >> index & 1]
        return sorted(found, key=lambda test: (not test[0].startswith(room), test[1]))


def draw(count: int, seed: int, only: Iterable[str]) -> list[Mutation]:
    """Mistakes: a statement of the package, a kind of mistake and one of that kind, each as likely as the others."""
    by_statement: dict[tuple[str, int], dict[str, list[Mutation]]] = defaultdict(lambda: defaultdict(list))
    texts = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        file = str(path.relative_to(ROOT / PACKAGE))
        texts[file] = path.read_text()
        if not only or any(file.startswith(word) for word in only):
            for mutation in mutations_of(path, file):
                by_statement[file, mutation.statement][mutation.operator].append(mutation)
    generator, statements, drawn = random.Random(seed), list(by_statement.values()), dict[Mutation, None]()
    while len(drawn) < min(count, len(statements)):
        kinds = generator.choice(statements)
        mutation = generator.choice(kinds[generator.choice(list(kinds))])
        if mutation.changes(texts[mutation.file]):
            drawn[mutation] = None
    return list(drawn)


def difference(mutation: Mutation) -> list[str]:
    """Lines that a mistake changes: -old, +new."""
    text = (ROOT / PACKAGE / mutation.file).read_text()
    lines = difflib.unified_diff(text.splitlines(), mutation.applied(text).splitlines(), n=0, lineterm="")
    return [line for line in lines if not line.startswith(("---", "+++"))]


def outcome(tree: Path, ranks: int, tests: list[tuple[str, float]]) -> tuple[bool, str]:
    """Whether a test fails in a tree, and its name or the last line of what pytest says.

    A wait without end that no limit of a test ends is not noticed.
    """
    if not tests:
        return False, "no test runs it"
    limit = PATIENCE + 5 * max(seconds for _, seconds in tests)
    command = ["mpirun", "-n", str(ranks), sys.executable, "-m", "pytest"]
    command += "-x -q --color=no --tb=no -rfE -p no:cacheprovider".split()
    command += [f"--limit={limit}", *(name for name, _ in tests)]
    environment = os.environ | {"PYTHONPATH": str(tree / "src")}
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            command, cwd=tree, env=environment, start_new_session=True, stdout=said, stderr=subprocess.STDOUT
        )
        try:
            code = process.wait(5 * limit + 5 * sum(seconds for _, seconds in tests))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return False, "no end, and no test says so"
        said.seek(0)
        text = said.read()
    if code and "no tests ran" in text:
        return False, _GONE
    names = _FAILED.findall(text)
    return code != 0, names[-1] if names else "\n".join(text.splitlines()[-3:])


def judged(mutation: Mutation, tree: Path) -> dict[str, Any]:
    """What comes of a mistake: an entry of the results."""
    path = tree / PACKAGE / mutation.file
    text, start = path.read_text(), time.monotonic()
    path.write_text(mutation.applied(text))
    noticed, by, ranks = False, "", 1
    try:
        for ranks in (1, 2) if _COMMUNICATES.search(text) else (1,):
            tests = Map.load(ranks).judges(mutation)
            before = accumulate((seconds for _, seconds in tests), initial=0.0)
            noticed, by = outcome(tree, ranks, [test for test, spent in zip(tests, before) if spent < BUDGET])
            if noticed:
                break
    finally:
        path.write_text(text)
    entry = {"mutation": str(mutation), "operator": mutation.operator, "file": mutation.file}
    entry |= {"noticed": noticed, "by": by, "ranks": ranks, "seconds": round(time.monotonic() - start, 1)}
    return entry | {"difference": difference(mutation)}


def known() -> dict[str, dict[str, Any]]:
    """Results by mistake, the last of each."""
    file = RESULTS / "draws.jsonl"
    lines = file.read_text().splitlines() if file.exists() else []
    return {entry["mutation"]: entry for entry in map(json.loads, lines)}


def _copy(folder: Path, example: list[Mutation]) -> Path:
    """A copy of the tree, in which the tests of a mistake pass without it."""

    def ignored(place: str, names: list[str]) -> list[str]:
        return [
            name for name in names if name == "__pycache__" or (place == str(ROOT) and name in (".git", "results"))
        ]

    tree = Path(shutil.copytree(ROOT, folder, ignore=ignored, symlinks=True))
    for mutation in example:
        fails, what = outcome(tree, 1, Map.load(1).judges(mutation)[:20])
        if fails or what == _GONE:
            sys.exit(f"without any mistake a test fails, or the map is out of date (--map): {what}")
    return tree


def study(mutations: list[Mutation], jobs: int) -> None:
    """Judge mistakes, several at a time, each in a tree of its own, and append the results."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        trees: SimpleQueue[Path] = SimpleQueue()
        for job in range(jobs):
            trees.put(_copy(Path(folder) / str(job), mutations[:1]))

        def one(mutation: Mutation) -> None:
            tree = trees.get()
            try:
                entry = judged(mutation, tree)
            finally:
                trees.put(tree)
            with (RESULTS / "draws.jsonl").open("a") as file:
                file.write(json.dumps(entry) + "\n")
            print(
                f"{'noticed ' if entry['noticed'] else 'SURVIVES'} {entry['seconds']:4.0f} s  {mutation}", flush=True
            )

        list(pool.map(one, mutations))


def note(arguments: list[str]) -> None:
    """Run the tests without any mistake on 1 and 2 ranks and note the lines that each runs."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    for ranks in (1, 2):
        command = ["mpirun", "-n", str(ranks), sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        command += ["-p", "studies.mutations.covered", "--covered", str(RESULTS / f"tests-{ranks}")]
        subprocess.run([*command, *(arguments or ["tests"])], cwd=ROOT)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="mistakes to draw (default 100)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (default 1)")
    parser.add_argument("--only", nargs="+", default=(), metavar="WORD", help="files below the package that begin so")
    parser.add_argument("--jobs", type=int, default=2, help="mistakes at a time (default 2)")
    parser.add_argument("--list", action="store_true", help="show the mistakes and make none")
    parser.add_argument("--map", nargs="*", metavar="ARGUMENT", help="run the tests and note the lines of each")
    options = parser.parse_args()
    if options.map is not None:
        return note(options.map)
    drawn, done = draw(options.count, options.seed, options.only), known()
    if options.list:
        for mutation in drawn:
            print(mutation.operator, mutation.file, *difference(mutation), sep="\n  ")
        return None
    if not list(RESULTS.glob("tests-1-*.json")):
        note([])
    study([one for one in drawn if str(one) not in done], options.jobs)
    done = known()
    print(table([done[str(one)] for one in drawn]))
    return None


if __name__ == "__main__":
    main()
