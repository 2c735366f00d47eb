"""Every command and every block of code in the README and its neighbours runs, in the order in which they are printed.

By default what takes minutes is run in the smaller form that `KINDS` tells; as it is printed, which takes hours:

    ./with-dolfinx python3 -m pytest tests/demos/test_readme.py --as-printed
"""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from conftest import WORLD, outside

TOP = Path(__file__).parents[2]
PAGES = [
    name
    for name in ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "demos/README.md", "studies/README.md")
    if (TOP / name).exists()
]

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="each command starts its own processes")

DEMO = r"python3 demos/(hertz|indentation|patch|manufactured|own_gmsh_model)\.py\b"
#: Coarser: what is left is starting, a few steps, and everything that comes after the last of them.
COARSER = (r"--tolerance \S+", "--tolerance 0.3"), (r"--true-error \S+", "--true-error 0.4")
#: Rows of tables without an option for the accuracy.
UNSAID = ((r"(demos/\w+\.py)(?!.*--tolerance)(.*)", r"\1\2 --tolerance 0.3"),)
#: Without fields and pictures, which other commands make.
PLAIN = ((r"(demos/(?:hertz|indentation)\.py)(?!.*--records-only)", r"\1 --records-only"),)
ALONE = ((r"mpirun -n \d ", ""),)
HELP = (*ALONE, (r"(-m [\w.]+).*", r"\1 --help"))

#: Programs that are not where the tests run, or that change the machine.
ELSEWHERE = "docker|apptainer|singularity|srun|sbatch|conda|pip|sudo|apt-get|apt|git|cd"


@dataclass(frozen=True)
class Kind:
    """Commands that are tested alike; the first kind whose pattern the whole command matches is its own.

    Attributes:
        pattern: of the command, without the launcher.
        why: it is not run as printed by default; empty: it is.
        smaller: what is replaced by what where it is not; None: it is not run.
        server: whether it runs until it is stopped.
        elsewhere: whether it needs what is not here, so that it is never run.
    """

    pattern: str
    why: str = ""
    smaller: tuple | None = ()
    server: bool = False
    elsewhere: bool = False


KINDS = (
    Kind(r"(mpirun -n 2 )?python3 demos/hertz\.py( --help)?"),
    Kind(r"python3 -m studies\.stability\.run --only \S+"),
    Kind(rf"mpirun -n \d {DEMO}.*--checkpoint.*", "some digits less take seconds", (*COARSER, *PLAIN)),
    Kind(
        rf"mpirun -n \d {DEMO}.*--(true-error|reference).*",
        "some digits less take seconds",
        (
            *COARSER,
            *UNSAID,
            *PLAIN,
            (r"--coarse \d --uniform \d", "--coarse 4 --uniform 1"),
            (r"--order [26]", "--order 2"),
        ),
    ),
    Kind(rf"mpirun -n \d {DEMO}.*", "minutes each: coarser, and on one rank", (*COARSER, *UNSAID, *PLAIN, *ALONE)),
    Kind(rf"{DEMO}.*", "coarser", (*COARSER, *UNSAID)),
    Kind(r"python3 -m studies\.tables.*", "test_tables sees that it has nothing to do", None),
    Kind(r"(mpirun -n \d )?python3 -m studies\.\w+\.\w+.*", "minutes", HELP),
    Kind(
        r"(env .+ )?python3 notebooks/execute\.py .*",
        "test_notebooks runs them",
        ((r"notebooks/\w+\.ipynb", "--help"),),
    ),
    Kind(r"jupyter notebook .*", server=True),
    Kind(r"bash"),
    Kind(r"tests/run.*|tests/launcher", "it runs this test too", None),
    Kind(
        r"(mpirun -n \d )?python3 -m pytest .*",
        "tests of this suite: only found",
        (*ALONE, (r"-m pytest", "-m pytest --co -q")),
    ),
    Kind(r"python3 -m flake8 .*", "tests/run begins with it", None),
    Kind(r"jupytext .*", "test_notebooks sees that it has nothing to do", None),
    Kind(rf"(--suite|{ELSEWHERE}|python3 -m black) ?.*", "needs what is not here", None, elsewhere=True),
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
    """A command without the launcher; a script with options alone, as tables have it, runs on two ranks."""
    command = command.removeprefix("./with-dolfinx ")
    return f"mpirun -n 2 python3 {command}" if command.startswith("demos/") else command


def kind_of(command):
    """The Kind of a command, None if nobody has thought of it."""
    return next((kind for kind in KINDS if re.fullmatch(kind.pattern, bare(command))), None)


def smaller(command):
    """What is run instead of a command where not all is run as printed."""
    text = bare(command)
    for pattern, replacement in kind_of(command).smaller:
        text = re.sub(pattern, replacement, text)
    return text


def python_blocks(text):
    """Blocks of Python of a page."""
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.M | re.S)


def smaller_block(code):
    """The same code with tolerances of 30 % at best."""
    return re.sub(r"tolerance=0\.[0-2]\d*", "tolerance=0.3", code)


TEXTS = {page: (TOP / page).read_text() for page in PAGES}
COMMANDS = [command for text in TEXTS.values() for command in commands(text)]
BLOCKS = [(f"{page} {i}", block) for page, text in TEXTS.items() for i, block in enumerate(python_blocks(text))]


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
    """Exit code and what was said; the same command is run once.  A group of its own, to stop all of it."""
    process = subprocess.Popen(
        words,
        cwd=folder,
        env=outside(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        said, _ = process.communicate(timeout=14400)
    except BaseException:
        os.killpg(process.pid, signal.SIGTERM)
        raise
    return process.returncode, said.decode(errors="replace")


def serves(words, folder):
    """Whether a server says its address within a minute; it is stopped then."""
    with open(folder / "server.log", "w+") as log:
        process = subprocess.Popen(
            words, cwd=folder, env=outside(), stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            for _ in range(600):
                if "http://" in (folder / "server.log").read_text() or process.poll() is not None:
                    break
                time.sleep(0.1)
        finally:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()
    return "http://" in (folder / "server.log").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_command(command, clone, request):
    """It ends well, or serves."""
    kind, literally = kind_of(command), request.config.getoption("--as-printed")
    assert kind is not None, "no kind of command in this test: add how to test it"
    if kind.elsewhere or (not literally and kind.smaller is None):
        pytest.skip(kind.why)
    text = bare(command) if literally else smaller(command)
    if kind.server:
        assert serves(("sh", "-c", f"exec {text}" + " --allow-root" * (os.geteuid() == 0)), clone)
        return
    code, said = run(("./with-dolfinx", "sh", "-c", text), clone)
    assert code == 0, f"{text}\n{said[-3000:]}"


@pytest.mark.slow
@pytest.mark.parametrize("code", [pytest.param(code, id=name) for name, code in BLOCKS])
def test_block(code, clone, request):
    """It runs by itself, after the commands above."""
    text = code if request.config.getoption("--as-printed") else smaller_block(code)
    status, said = run((sys.executable, "-c", text), clone)
    assert status == 0, f"{text}\n{said[-3000:]}"


def test_options_exist():
    """Options that stand alone in a line are those of some program here, or PETSc's."""
    sources = [
        *(TOP / "demos").glob("*.py"),
        *(TOP / "studies").glob("*/*.py"),
        *(TOP / "notebooks").glob("*.py"),
        *(TOP / "tests").glob("*.py"),
    ]
    known = set(re.findall(r'"(--[\w-]+)"', "".join(path.read_text() for path in sources)))
    known |= set(re.findall(r"--[\w-]+", (TOP / "with-dolfinx").read_text()))
    known.add("--build-arg")  # Docker's
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
    assert f'version = "{citation["version"]}"' in (TOP / "pyproject.toml").read_text()
    assert all({"type", "title", "authors"} <= set(reference) for reference in citation["references"])


def test_the_test_can_fail():
    """Unknown commands have no kind; comments, prose and file names are no commands; all is found."""
    page = (
        "Use `demos/hertz.py`, or `demos/hertz.py --order 6`.\n```sh\n./with-dolfinx rm -rf x   # no\n\n```\n`a = 1`"
    )
    assert commands(page) == ["./with-dolfinx rm -rf x", "demos/hertz.py --order 6"]
    assert kind_of("./with-dolfinx rm -rf x") is None and kind_of("mpirun -n 2 python3 demos/none.py") is None
    assert (
        smaller("mpirun -n 2 python3 demos/hertz.py --order 6")
        == "python3 demos/hertz.py --records-only --order 6 --tolerance 0.3"
    )
    assert len(COMMANDS) > 15 and len(BLOCKS) >= 3
    assert sum(kind_of(command).smaller is not None for command in COMMANDS) > len(COMMANDS) / 2
