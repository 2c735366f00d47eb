"""Every command and every block of code in the README and the documentation runs, in the order of the pages.

What takes minutes is run in the smaller form that `SMALLER` tells: demos on coarse meshes; of studies, notebooks and
tests their options and names alone (`--help`, `--co`).  As it is printed, which takes hours:

    ./with-dolfinx python3 -m pytest tests/demos/test_readme.py --as-printed
"""

import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from conftest import WORLD, outside

import fx_contact

TOP = Path(__file__).parents[2]
PAGES = ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "demos/README.md", "studies/README.md")
PAGES += tuple(sorted(str(page.relative_to(TOP)) for page in (TOP / "docs").rglob("*.md")))
PAGES += tuple(sorted(str(page.relative_to(TOP)) for page in (TOP / "studies").glob("*/README.md")))

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="each command starts its own processes")

#: Programs that are not where the tests run, or that change the machine.
ELSEWHERE = "docker|apptainer|singularity|srun|sbatch|conda|pip|sudo|apt-get|apt|git|cd"
#: What is run, without the launcher.
RUN = (
    r"bash|jupyter notebook .*|(env .+ )?python3 notebooks/execute\.py .*|(mpirun -n \d )?python3 -m pytest .*"
    r"|(mpirun -n \d )?python3 demos/(hertz|indentation|patch|manufactured)\.py.*"
    r"|(mpirun -n \d )?python3 demos/(crossed_cylinders|shaft_in_bore)\.py.*"
    r"|(mpirun (--oversubscribe )?-n \d+ )?python3 -m studies\.\w+\.\w+.*"
    r"|(mpirun -n \d )?python3 (tests/mutations/run|studies/equivalence/(records|compare))\.py .*"
)
#: What is not.
SKIPPED = {
    r"tests/run.*|tests/launcher": "it runs this test too",
    r"docs/build": "it needs a root of its own",
    r"(mpirun -n \d )?python3 demos/own_gmsh_model\.py": "test_ready_scenes runs it",
    r"COMMAND|python3 program\.py|python3 -m mpi4py": "it stands for a user's own",
    r"python3 -m flake8 .*": "tests/run begins with it",
    r"jupytext .*": "test_notebooks sees that it has nothing to do",
    r"python3 -m studies\.tables.*": "test_tables sees that it has nothing to do",
    rf"(--suite|{ELSEWHERE}|python3 -m black) ?.*": "needs what is not here",
}
#: What is run instead: coarse meshes; fields and pictures of the plain command alone, several ranks of that and of what
#: keeps checkpoints, one of what goes on from them; of studies the help,
#: and results compared with themselves.
SMALLER = (
    (r"--tolerance \S+", "--tolerance 0.3"),
    (r"--true-error \S+", "--true-error 0.4"),
    (r"--only approach/punch/1e-6", "--only gap/stack/1e-2"),
    (r"--coarse \d --uniform \d", "--uniform 1"),
    (r"(demos/(hertz|indentation)\.py)", r"\1 --coarse 2"),
    (r"--order [126]", "--order 2"),
    (r"(demos/\w+\.py) (?!.*--tolerance)", r"\1 --tolerance 0.3 "),
    (r"(demos/(hertz|indentation)\.py) (?!.*--records-only)", r"\1 --records-only "),
    (r"mpirun -n \d (?=.*--records-only)(?!.*--checkpoint)|mpirun -n 3 (?=.*--restart)", ""),
    (r"(studies\.pictures\.run)(?=.*--only)", r"\1 --quick"),
    (r"(?:mpirun (?:--oversubscribe )?-n \d+ )?(python3 -m studies\.\w+\.(?!compare)\w+)(?!.*--only).*", r"\1 --help"),
    (r"(studies.*compare(\.py)?) (\S+) .*", r"\1 \3 \3"),
    (r"(mpirun -n \d )?python3 -m pytest", "python3 -m pytest --co -q"),
    (r"tests/mutations/run\.py .*", "tests/mutations/run.py --check"),
    (r"(mpirun -n \d )?python3 (studies/equivalence/records\.py) .*", r"python3 \2 --help"),
    (r"notebooks/\w+\.ipynb", "--help"),
    (r"jupyter notebook .*", "jupyter notebook --version"),
)


def commands(text):
    """Commands of a page: lines of `sh` blocks and code in a line that begins like one."""
    blocks = "\n".join(re.findall(r"^```sh\n(.*?)^```", text, flags=re.M | re.S))
    found = [re.sub(r"\s+# .*", "", line).strip() for line in blocks.splitlines()]
    inline = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))
    starts = rf"(\./with-dolfinx|mpirun|python3|env|jupyter|jupytext|tests/run|demos/\w+\.py|{ELSEWHERE}) +[^ ]"
    found += [span for span in inline if re.match(starts, span)]
    return [command for command in dict.fromkeys(found) if command]


def bare(command):
    """A command without the launcher; a script with options alone runs on two ranks."""
    command = command.removeprefix("./with-dolfinx ")
    return f"mpirun -n 2 python3 {command}" if command.startswith("demos/") else command


def reason(command):
    """Why a command is not run, or None.

    Raises:
        LookupError: nobody has thought of it.
    """
    if re.fullmatch(RUN, bare(command)):
        return None
    for pattern, why in SKIPPED.items():
        if re.fullmatch(pattern, bare(command)):
            return why
    raise LookupError(f"no kind of command in this test: {command}")


def smaller(command):
    """What is run instead of a command."""
    text = bare(command)
    for pattern, replacement in SMALLER:
        text = re.sub(pattern, replacement, text)
    return text


def python_blocks(text):
    """Blocks of Python of a page, those that the documentation runs too among them."""
    return re.findall(r"^```(?:python|\{code-cell\} python)\n(.*?)^```", text, flags=re.M | re.S)


def programs(page, text):
    """Names and texts of the programs of a page: each block of the README, on other pages all blocks together."""
    blocks = python_blocks(text)
    if page == "README.md":
        return [(f"{page} {i}", block) for i, block in enumerate(blocks)]
    return [(page, "\n".join(blocks))] if blocks else []


def smaller_block(code):
    """The same code with tolerances of 30 % at best, and few root cells."""
    code = re.sub(r"\bhertz\((?![^)]*coarse)", "hertz(coarse=2, ", code)
    return re.sub(r"tolerance=0\.[0-2]\d*", "tolerance=0.3", code)


TEXTS = {page: (TOP / page).read_text() for page in PAGES}
COMMANDS = [command for text in TEXTS.values() for command in commands(text)]
BLOCKS = [program for page, text in TEXTS.items() for program in programs(page, text)]
#: The first program of the README, and what it prints.
FIRST, PRINTED = re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", TEXTS["README.md"], flags=re.S).groups()


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """The project in a folder of its own, for the results."""
    folder = tmp_path_factory.mktemp("clone")
    for path in TOP.iterdir():
        if path.is_dir() and path.name in ("src", "tests", "demos", "studies", "notebooks"):
            (folder / path.name).mkdir()
            for inner in path.iterdir():
                (folder / path.name / inner.name).symlink_to(inner)
        elif path.is_file():
            (folder / path.name).symlink_to(path)
    return folder


@cache
def run(words, folder):
    """Exit code and what was said; the same command is run once."""
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    done = subprocess.run(words, cwd=folder, env=outside(), timeout=14400, **streams)
    return done.returncode, done.stdout.decode(errors="replace")


def ends_well(command, clone, request):
    """Run a command, once, and what makes the checkpoint that it goes on from before it."""
    kept = next(c for c in COMMANDS if "--checkpoint results/kept" in c)
    if "--restart" in command:
        ends_well(kept, clone, request)
    text = bare(command) if request.config.getoption("--as-printed") else smaller(command)
    code, said = run(("./with-dolfinx", "sh", "-c", text), clone)
    assert code == 0, f"{text}\n{said[-3000:]}"


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_command(command, clone, request):
    """It ends well."""
    if why := reason(command):
        pytest.skip(why)
    ends_well(command, clone, request)


@pytest.mark.slow
@pytest.mark.parametrize("code", [pytest.param(code, id=name) for name, code in BLOCKS])
def test_block(code, clone, request):
    """It runs by itself; the README's first program prints what the README says."""
    as_printed = code == FIRST or request.config.getoption("--as-printed")
    text = code if as_printed else smaller_block(code)
    status, said = run((sys.executable, "-c", text), clone)
    assert status == 0, f"{text}\n{said[-3000:]}"
    if code == FIRST:
        assert said == PRINTED


def test_pages_are_short():
    """A page can be read; the README in a minute."""
    lines = {page: len(text.splitlines()) for page, text in TEXTS.items()}
    assert lines["README.md"] <= 150 and max(lines.values()) <= 300, lines


def test_options_exist():
    """Options that stand alone in a line are those of some program here, or PETSc's."""
    sources = [
        *(TOP / "demos").glob("*.py"),
        *(TOP / "studies").glob("*/*.py"),
        *(TOP / "notebooks").glob("*.py"),
        *(TOP / "tests").rglob("*.py"),
    ]
    known = set(re.findall(r'"(--[\w-]+)"', "".join(path.read_text() for path in sources)))
    for script in ("with-dolfinx", "tests/run"):
        known |= set(re.findall(r"--[\w-]+", (TOP / script).read_text()))
    known |= {"--build-arg", "--co"}  # Docker's and pytest's
    spans = re.findall(r"`(--[\w-]+)[^`]*`", "".join(TEXTS.values()))
    assert len(spans) > 5 and set(spans) <= known, set(spans) - known


def test_links_lead_somewhere():
    """Files and pictures that the pages point at are there."""
    for page, text in TEXTS.items():
        for target in re.findall(r"\]\((?!http|#)([^)#]+)", text):
            assert ((TOP / page).parent / target).exists(), f"{page}: {target}"


def test_citation():
    """CITATION.cff has the keys of its format, and the version of the package."""
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((TOP / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors", "license"} <= set(citation)
    assert citation["version"] == fx_contact.__version__
    assert f"## {fx_contact.__version__}" in (TOP / "CHANGELOG.md").read_text()
    assert all({"type", "title", "authors"} <= set(reference) for reference in citation["references"])


def test_the_test_can_fail():
    """Unknown commands are noticed; comments, prose and file names are no commands; all is found."""
    page = (
        "Use `demos/hertz.py`, or `demos/hertz.py --order 6`.\n```sh\n./with-dolfinx rm -rf x   # no\n\n```\n`a = 1`"
    )
    assert commands(page) == ["./with-dolfinx rm -rf x", "demos/hertz.py --order 6"]
    for unknown in ("./with-dolfinx rm -rf x", "mpirun -n 2 python3 demos/none.py"):
        with pytest.raises(LookupError):
            reason(unknown)
    assert (
        smaller("demos/hertz.py --order 6")
        == "python3 demos/hertz.py --records-only --tolerance 0.3 --coarse 2 --order 2"
    )
    assert len(COMMANDS) > 15 and len(BLOCKS) >= 3
    assert sum(reason(command) is None for command in COMMANDS) > len(COMMANDS) / 2
