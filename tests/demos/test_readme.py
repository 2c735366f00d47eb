"""Every command and every block of code in the README and the documentation runs, in the order of the pages.

What takes minutes is run in the smaller form that `SMALLER` tells: demos on coarse meshes, studies on a scene or two.
Of what is in `LONG` the command line alone is read, by its own parser, as are the command lines of all other studies
and demos as they are printed; of tests the names are collected (`--co`).  As it is printed, which takes hours:

    ./with-dolfinx python3 -m pytest tests/demos/test_readme.py --as-printed
"""

import json
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
ELSEWHERE = "docker|apptainer|singularity|srun|sbatch|conda|pip|sudo|apt-get|apt|git|cd|export"
#: Demos with shapes of their own.
SHAPES = r"demos/(crossed_cylinders|fretting|shaft_in_bore|rigid_stamp|roller_on_block)\.py"
#: What is run, without the launcher.
RUN = (
    r"bash|jupyter notebook .*|(env .+ )?python3 notebooks/execute\.py .*|(mpirun -n \d )?python3 -m pytest .*"
    r"|(mpirun -n \d )?python3 demos/(hertz|indentation|patch|manufactured)\.py.*"
    rf"|mpirun -n \d python3 {SHAPES}.*"
    r"|(mpirun (--oversubscribe )?-n \d+ )?python3 -m studies\.\w+\.\w+.*"
    r"|(mpirun -n \d )?python3 -m fx_contact info"
)
#: What is not.
SKIPPED = {
    r"tests/run.*|tests/launcher": "it runs this test too",
    r"docs/build": "it needs a root of its own",
    r"python3\.12 -m venv env|env/bin/.*": "gigabytes from the package index: a job of the workflow",
    r"(mpirun -n \d )?python3 demos/own_gmsh_model\.py": "test_ready_scenes runs it",
    r"(mpirun -n \d )?python3 demos/step_part\.py": "test_own_shapes runs it",
    rf"python3 {SHAPES}.*": "test_own_shapes runs it",
    r"python3 -m fx_contact( run .*)?": "test_command does it",
    r"COMMAND|python3 program\.py|python3 -m mpi4py": "it stands for a user's own",
    r"python3 -m flake8 .*": "tests/run begins with it",
    r"jupytext .*": "test_notebooks sees that it has nothing to do",
    r"python3 -m studies\.tables.*": "test_tables sees that it has nothing to do",
    rf"(--suite|{ELSEWHERE}|python3 -m black) ?.*": "needs what is not here",
}
#: What is run instead: coarse meshes; fields and pictures of the plain command alone, several ranks of that and of what
#: keeps checkpoints, one of what goes on from them; studies of a scene or two, and results compared with themselves.
SMALLER = (
    (r"(demos/(hertz|indentation)\.py) (?!.*--records-only)", r"\1 --records-only "),
    (r"--tolerance \S+", "--tolerance 0.3"),
    (r"--true-error \S+", "--true-error 0.4"),
    (r"--coarse \d --uniform \d", "--uniform 1"),
    (r"(demos/(hertz|indentation)\.py)", r"\1 --coarse 2"),
    (r"--order [126]", "--order 2"),
    (r"(demos/\w+\.py) (?!.*--tolerance)", r"\1 --tolerance 0.3 "),
    (r"mpirun -n \d (?=.*--records-only)(?!.*--checkpoint)|mpirun -n 3 (?=.*--restart)", ""),
    (r"(studies\.pictures\.run)(?=.*--only)", r"\1 --quick"),
    (r"(studies\.pictures\.run)$", r"\1 --quick --only stack"),
    (r"(studies\.goals\.run).*", r"\1 --only square --degree 1"),
    (r"(studies\.goals\.axisymmetric_punch).*", r"\1 --size 0.1"),
    (r"(studies\.effectivity\.run).*", r"\1 --only indentation --degree 1 --most 5000"),
    (r"(studies\.incompressible\.axisymmetric).*", r"\1 --cells 5"),
    (r"(studies\.stability\.run).*", r"\1 --only gap/stack/1e-2"),
    (r"(studies\.stability\.compare) (\S+) .*", r"\1 \2 \2"),
    (r"(studies\.mutations\.run).*", r"\1 --count 2 --list"),
    (r"jupyter notebook .*", "jupyter notebook --version"),
)
#: Studies that take minutes even in their smallest form, demos that differ in their options, tests;
#: `test_notebooks` executes the notebooks.
LONG = r"studies\.partition\.|studies\.(work_precision|incompressible)\.run|studies\.cost\."
LONG += (
    r"|studies\.stability\.(without|iterations|friction)|studies\.goals\.(forces|rigid_twins|pressures|load_steps)"
)
LONG += r"|studies\.effectivity\.(stress|first_mesh|hertz_truth|friction)|studies\.(nonmatching|layers)"
LONG += r"|notebooks/execute\.py|-m pytest|demos/.*--(degree|symmetry|order|partition|enforcement)"
#: Programs that read their command line with argparse, and a module or file and the words after it.
PARSED = r"(?:env \S+ )?(?:mpirun (?:--oversubscribe )?-n \d+ )?python3 (?:-m )?"
PARSED += r"((?:demos|studies|tests|notebooks)[./](?!tables|.*compare|.*own_gmsh|.*step_part)\S+)(.*)"
#: Reads command lines, one on each line of standard input, and says which one its program does not take.
READER = """
import argparse, runpy, shlex, sys
from pathlib import Path

class Taken(BaseException):
    pass

def taken(*words, reads=argparse.ArgumentParser.parse_known_args):
    if unknown := reads(*words)[1]:
        sys.exit(f" unrecognized arguments: {unknown}")
    raise Taken

argparse.ArgumentParser.parse_known_args = taken
for line in sys.stdin:
    sys.argv = shlex.split(line)
    sys.modules.pop("common", None)  # of the demos, which reads the command line
    start = runpy.run_path if sys.argv[0].endswith(".py") else runpy.run_module
    sys.path.insert(0, str(Path(sys.argv[0]).parent))  # as of a script
    try:
        start(sys.argv[0], run_name="__main__")
        sys.exit(f"it reads no arguments: {line}")
    except Taken:
        pass
    except SystemExit as end:
        if end.code:
            sys.exit(f"{line}{end}")
"""
#: Collects the tests that command lines of pytest select, and prints its exit codes.
COLLECTOR = """
import shlex, sys, pytest
codes = [int(pytest.main(["--co", "-q", "-p", "no:cacheprovider", *shlex.split(line)])) for line in sys.stdin]
print("\\n", *codes)
"""


def commands(text):
    """Commands of a page: lines of `sh` blocks, with those that go on after a backslash, and code in a line that
    begins like one."""
    blocks = "\n".join(re.findall(r"^ *```sh\n(.*?)^ *```", text, flags=re.M | re.S))
    found = [re.sub(r"(^|\s+)# .*", "", line).strip() for line in re.sub(r"\\\n *", "", blocks).splitlines()]
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
    """What is run instead of a command; None: nothing, for that takes minutes too."""
    text = bare(command)
    if re.search(LONG, text):
        return None
    for pattern, replacement in SMALLER:
        text = re.sub(pattern, replacement, text)
    return text


def parsed(commands):
    """Command lines of studies and other programs, as `READER` takes them: module or file, and its words."""
    found = (re.fullmatch(PARSED, bare(command)) for command in commands)
    return [one[1] + one[2] for one in found if one]


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
#: Pages whose programs `test_examples` runs, as printed.
EXAMPLES = "docs/examples/", "docs/howto/preload.md"
#: Programs by page.
BLOCKS = [p for page, text in TEXTS.items() for p in programs(page, text) if not page.startswith(EXAMPLES)]
#: Most characters of a line of code that the documentation shows without scrolling.
WIDTH = 88
#: Programs of the README that show what they print, and what that is.
PRINTED = dict(re.findall(r"```python\n(.*?)```\n\n```text\n(.*?)```", TEXTS["README.md"], flags=re.S))


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


#: Parts of commands, and of those that make the files which they need.
MAKERS = {"--restart": "--checkpoint results/kept", "compare.py": "records.py after.json"}


def ends_well(command, clone, request):
    """Run a command, once, and before it the one that makes the files it needs."""
    if maker := next((made for need, made in MAKERS.items() if need in command), None):
        ends_well(next(c for c in COMMANDS if maker in c), clone, request)
    text = bare(command) if request.config.getoption("--as-printed") else smaller(command)
    if text is None:
        pytest.skip("minutes: test_arguments has its command line read")
    code, said = run(("./with-dolfinx", "sh", "-c", text), clone)
    assert code == 0, f"{text}\n{said[-3000:]}"


@pytest.mark.parametrize("command", COMMANDS)
def test_command(command, clone, request):
    """It ends well."""
    if why := reason(command):
        pytest.skip(why)
    ends_well(command, clone, request)


def outcome_of(program, lines):
    """A program that has read lines, at the top of the project."""
    words, env = (sys.executable, "-c", program), outside()
    return subprocess.run(words, input="\n".join(lines), capture_output=True, text=True, env=env, cwd=TOP)


def refused(lines):
    """What the programs say of command lines that they do not take; "" if they take all."""
    done = outcome_of(READER, lines)
    return done.stderr if done.returncode else ""


def test_arguments():
    """Studies, demos and other programs take the options and values that the pages give them."""
    lines = parsed(dict.fromkeys(COMMANDS))
    assert len(lines) > 30 and len({line.split()[0] for line in lines}) > 12
    assert not refused(dict.fromkeys(lines))


@pytest.mark.parametrize("words", ["--onyl hertz", "--degree 3", "hertz"])
def test_wrong_arguments_are_noticed(words):
    """Another option, value or word than the program takes."""
    (line,) = parsed([f"./with-dolfinx mpirun -n 2 python3 -m studies.goals.run {words}"])
    assert "unrecognized arguments" in refused([line]) or "invalid choice" in refused([line])


def test_selected_tests():
    """Command lines of pytest select tests; a name or an option that is not there is noticed."""
    found = (re.fullmatch(r"(?:mpirun -n \d )?python3 -m pytest (.*)", bare(command)) for command in COMMANDS)
    lines = [one[1] for one in found if one]
    wrong = [f"tests/adaptive/test_checkpoint.py {words}" for words in ("-k no_such_test", "--kils 20")]
    done = outcome_of(COLLECTOR, lines + wrong)
    codes = [int(code) for code in done.stdout.splitlines()[-1].split()]
    assert codes == [0] * len(lines) + [5, 4] and len(lines) > 3, "nothing collected: 5; usage error: 4"


@pytest.mark.parametrize("code", [pytest.param(code, id=name) for name, code in BLOCKS])
def test_block(code, clone, request):
    """It runs by itself, and prints what the README says."""
    as_printed = code in PRINTED or request.config.getoption("--as-printed")
    text = code if as_printed else smaller_block(code)
    status, said = run((sys.executable, "-c", text), clone)
    assert status == 0, f"{text}\n{said[-3000:]}"
    assert said == PRINTED.get(code, said)


def test_pages_are_short():
    """A page can be read; the README in a minute."""
    lines = {page: len(text.splitlines()) for page, text in TEXTS.items()}
    assert lines["README.md"] <= 150 and max(lines.values()) <= 300, lines


def code_lines(text):
    """Lines of the blocks of code of a page, each with its number."""
    fence = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("```"):
            fence = not fence
        elif fence:
            yield number, line


def test_code_is_narrow():
    """Blocks of code, and cells of notebooks, have the width that the documentation shows without scrolling."""
    lines = [(page, *line) for page, text in TEXTS.items() for line in code_lines(text)]
    for path in (TOP / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text())["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        lines += [(path.name, i, line) for i, text in enumerate(code) for line in text.splitlines()]
    wide = [f"{page} {number}: {line}" for page, number, line in lines if len(line) > WIDTH]
    assert len(lines) > 500 and not wide, "\n".join(wide)


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


@pytest.mark.parametrize("name", [".pre-commit-config.yaml", ".github/workflows/tests.yml"])
def test_automation(name):
    """Hooks and workflows are YAML, and the programs and folders of the project that they name are there."""
    yaml = pytest.importorskip("yaml")
    text = (TOP / name).read_text()
    assert yaml.safe_load(text)
    named = re.findall(r"\./[\w-]+|(?<![\w/])(?:tests|docs|packages|environment)\b[\w./-]*", text)
    named = {path for path in named if "/" in path or "." in path}
    assert "./with-dolfinx" in named
    assert all((TOP / path).exists() for path in named), named


def test_citation():
    """CITATION.cff has the keys of its format, and the version of the package."""
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((TOP / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors", "license"} <= set(citation)
    assert citation["version"] == fx_contact.__version__
    assert f"## [{fx_contact.__version__}]" in (TOP / "CHANGELOG.md").read_text()
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
    assert smaller("demos/hertz.py --order 6") is None, "options alone"
    assert smaller("demos/hertz.py") == "mpirun -n 2 python3 demos/hertz.py --tolerance 0.3 --coarse 2"
    assert len(COMMANDS) > 15 and len(BLOCKS) >= 3 and len(PRINTED) == 2
    assert sum(reason(command) is None for command in COMMANDS) > len(COMMANDS) / 2
