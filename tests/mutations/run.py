"""Do the tests notice small mistakes in the code?

    ./with-dolfinx python3 tests/mutations/run.py [--only WORD] [--check]

`table.tsv` has one mutation a line: a piece of a file of `src/fx_contact`, what it becomes, on how many ranks which
tests must notice, and a remark.  Each mutation is made in a copy of the tree; one that no test notices survives.
"""

import argparse
import csv
import difflib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("table.tsv")
#: Seconds after which tests that do not end count as failed, for a mutation and for all tests without any.
PATIENCE, ALL = 600, 7200
#: Tests in a line of the table; what is in brackets may have spaces.
TESTS = re.compile(r"[^\s[]+(?:\[[^]]*\])?")


@dataclass(frozen=True)
class Mutation:
    """One line of the table.

    Attributes:
        file: below `src/fx_contact`.
        old, new: pieces of one line; `old` occurs once in the file.
        ranks: on how many ranks the tests run; 0: not at all, for the change costs time and changes no result.
        tests: below `tests`, files or `file::test`, of which one must fail.
        remark: what the mistake is.
    """

    file: str
    old: str
    new: str
    ranks: int
    tests: tuple
    remark: str

    def __str__(self):
        return f"{self.file}: {self.old.strip()!r} -> {self.new.strip()!r} ({self.remark})"

    @property
    def line(self):
        """The line of the table."""
        return "\t".join((self.file, self.old, self.new, str(self.ranks), " ".join(self.tests), self.remark))

    def place(self, root):
        """The mutated file in a tree."""
        return root / "src" / "fx_contact" / self.file


def mutations():
    """The table: list of Mutation."""
    with TABLE.open(newline="") as lines:
        rows = list(csv.reader(lines, delimiter="\t", quoting=csv.QUOTE_NONE))[1:]
    return [Mutation(*row[:3], int(row[3]), tuple(TESTS.findall(row[4])), row[5]) for row in rows]


def alike(piece):
    """The three lines of the code that have most of a piece in them: list of str."""
    found = []
    for file in sorted((ROOT / "src").rglob("*.py")):
        for line in file.read_text().splitlines():
            blocks = difflib.SequenceMatcher(None, line, piece, autojunk=False).get_matching_blocks()
            found.append((sum(block.size for block in blocks if block.size > 2), f"{file.name}: {line.strip()}"))
    return [line for _, line in sorted(found, reverse=True)[:3]]


def faults(mutation):
    """What is wrong with a line of the table: list of str.  A piece that is lost is looked for in all files."""
    path = mutation.place(ROOT)
    text = path.read_text() if path.exists() else ""
    result = []
    if text.count(mutation.old) != 1:
        near = "".join(f"\n    {line}" for line in alike(mutation.old))
        result.append(f"occurs {text.count(mutation.old)} times; like it:{near}")
    else:
        try:
            compile(text.replace(mutation.old, mutation.new), path.name, "exec")
        except SyntaxError as error:
            result.append(f"mutated, it is no Python: {error}")
    if mutation.new == mutation.old:
        result.append("nothing changes")
    if bool(mutation.ranks) != bool(mutation.tests):
        result.append("a number of ranks needs tests, and tests a number of ranks")
    for test in mutation.tests:
        file, _, name = test.partition("::")
        path, name = ROOT / "tests" / file, name.partition("[")[0]
        if not path.exists() or (
            name and not re.search(rf"^def {re.escape(name)}\(", path.read_text(), re.MULTILINE)
        ):
            result.append(f"there is no test {test}")
    return result


def passes(tree, ranks, tests, patience=PATIENCE):
    """Whether all of some tests pass in a tree on a number of ranks, and the last lines of what they say."""
    command = ["mpirun", "-n", str(ranks), sys.executable, "-m", "pytest", "-x", "-q", "--color=no"]
    command += ["-p", "no:cacheprovider", *(f"tests/{test}" for test in tests)]
    environment = os.environ | {"PYTHONPATH": str(tree / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    process = subprocess.Popen(
        command,
        cwd=tree,
        env=environment,
        text=True,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        said, _ = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return False, "no end"
    return process.returncode == 0, "\n".join(said.splitlines()[-20:])


def survives(mutation, tree):
    """Whether no test notices a mutation, made in a tree and taken back."""
    path = mutation.place(tree)
    text = path.read_text()
    path.write_text(text.replace(mutation.old, mutation.new))
    try:
        return passes(tree, mutation.ranks, mutation.tests)[0]
    finally:
        path.write_text(text)


def copied(folder):
    """A copy of code and tests in a folder."""
    for name in ("src", "tests", "demos", "studies"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def study(chosen, jobs):
    """Make mutations one by one, several at a time, each in a tree of its own: list of those that survive."""
    with tempfile.TemporaryDirectory() as folder:
        trees = SimpleQueue()
        for job in range(jobs):
            trees.put(copied(Path(folder) / str(job)))

        def borrowed(action):
            tree = trees.get()
            try:
                return action(tree)
            finally:
                trees.put(tree)

        def judged(mutation):
            start = time.monotonic()
            result = borrowed(lambda tree: survives(mutation, tree))
            print(f"{'SURVIVES' if result else 'noticed '} {time.monotonic() - start:4.0f} s  {mutation}", flush=True)
            return result

        with ThreadPoolExecutor(jobs) as pool:
            for ranks in sorted({mutation.ranks for mutation in chosen}):
                tests = {test: None for mutation in chosen if mutation.ranks == ranks for test in mutation.tests}
                right, said = borrowed(lambda tree: passes(tree, ranks, tests, ALL))
                if not right:
                    sys.exit(f"{said}\nwithout any mutation tests fail on {ranks} rank(s)")
            return [mutation for mutation, lives in zip(chosen, pool.map(judged, chosen)) if lives]


def main():
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", metavar="WORD", help="mutations in whose line of the table WORD is")
    parser.add_argument("--check", action="store_true", help="see that the table fits the code, and make no mutation")
    parser.add_argument("--jobs", type=int, default=1, help="mutations at a time (default 1)")
    options = parser.parse_args()
    table = mutations()
    wrong = [f"{mutation}\n  {fault}" for mutation in table for fault in faults(mutation)]
    if wrong:
        sys.exit("\n".join(wrong))
    if options.check:
        return
    chosen = [mutation for mutation in table if mutation.ranks and (options.only or "") in mutation.line]
    if not chosen:
        sys.exit(f"no mutation has {options.only!r} in its line")
    lives = study(chosen, options.jobs)
    print(f"{len(chosen)} mutations, {len(lives)} survive")
    sys.exit(bool(lives))


if __name__ == "__main__":
    main()
