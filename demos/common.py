"""Common parts of the demos: command line, keyword arguments of `adapt`, table of steps and records."""

import argparse
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import petsc4py
from mpi4py import MPI

COMM = MPI.COMM_WORLD


def split(words: list[str]) -> tuple[list[str], list[str]]:
    """Arguments of the demo, and those of PETSc: options with one dash, each with at most one value."""
    own: list[str] = []
    petsc: list[str] = []
    value = False
    for word in words:
        option = word[:1] == "-" and word[1:2].isalpha()
        (petsc if option or value and not word.startswith("--") else own).append(word)
        value = option  # may be next
    return own, petsc


OWN, PETSC = split(sys.argv[1:])
_given = pairwise([*PETSC, *os.environ.get("PETSC_OPTIONS", "").split(), ""])
_files = [path.removesuffix(":yaml") for option, path in _given if option == "-options_file"]
if _missing := COMM.bcast([path for path in _files if not Path(path).is_file()]):  # PETSc would print its call stack
    if COMM.rank == 0:
        print(f"there is no file {_missing[0]!r} of PETSc options, as -options_file says", file=sys.stderr)
    sys.exit(2)
petsc4py.init([sys.argv[0], *PETSC])  # before anything else imports PETSc

from fx_contact import (  # noqa: E402
    Beginning,
    Checkpoint,
    Enforcement,
    ErrorControl,
    FxContactError,
    Scene,
    SceneError,
    Solver,
    Step,
    StepRecord,
    adapt,
)
from fx_contact.adaptive.settings import DEGREE, check_tolerance  # noqa: E402
from fx_contact.adaptive.step_record import TrueError  # noqa: E402
from fx_contact.adaptive.step_record import undirected  # noqa: E402
from fx_contact.adaptive.step_report import table_head, table_row  # noqa: E402
from fx_contact.path.load_path import LoadPath, SweepPoint  # noqa: E402
from fx_contact.path.sweep_record import SweepRecord  # noqa: E402
from fx_contact.results import RecordWriter  # noqa: E402
from fx_contact.results.analytic import Hertz  # noqa: E402
from fx_contact.results.report import force_warnings, model_warnings, total_seconds  # noqa: E402

#: A default of an option, {degree: value} where it depends on the degree.
Default = Any

#: Choices of options; the library checks them and suggests the nearest.
METHODS, CONTROLS = "{exact,penalty}", "{contact,energy}"
PARTITIONS, PRECONDITIONERS = "{contact-sfc,equidistributed,sfc,graph}", "{boomeramg,gamg,ilu,cholesky,p-multigrid}"


class RankZeroParser(argparse.ArgumentParser):
    """A parser that prints on rank 0 only."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if COMM.rank == 0:
            super()._print_message(message, file)


def shown(default: Default) -> Default:
    """A default in the help."""
    return ", ".join(f"{one} at degree {p}" for p, one in default.items()) if isinstance(default, dict) else default


def parser(
    description: str | None,
    *,
    tolerance: Default,
    order: Default,
    coarse: Default,
    output: str,
    symmetric: bool = False,
) -> argparse.ArgumentParser:
    """A parser with the options of all demos.

    Args:
        description: the demo's docstring.
        tolerance, order, coarse, output: defaults of these options.
        symmetric: add `--symmetry`.
    """
    result = RankZeroParser(
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        add_help=False,  # -help is PETSc's
        epilog="PETSc's options work too, those of the solver under the prefix -fx_: -fx_ksp_monitor, -log_view; "
        "-help lists them all while the demo runs.",
    )

    add = result.add_argument
    add("--help", action="help", help="show this message and exit")
    add("--tolerance", type=float, default=tolerance, help=f"relative error in the energy norm ({shown(tolerance)})")
    add("--degree", type=int, metavar="{1,2}", default=DEGREE, help="of displacements (%(default)s)")
    add("--order", type=int, default=order, help=f"order of the root mesh's geometry, 1 to 6 ({shown(order)})")
    add("--geometry-order", type=int, help="order of the leaves' geometry (the lowest of sufficient accuracy)")
    add("--max-steps", type=int, default=20, help="maximum number of adaptive steps (%(default)s)")
    add("--enforcement", metavar=METHODS, help="(exact; penalty where one of the next two is given)")
    add("--penalty", type=float, help="c of the surface stiffness c E*/h (100)")
    add("--node-stiffness", type=float, help="k_N of every node pair, instead of --penalty")
    add("--control", metavar=CONTROLS, default="contact", help="of the error; energy: the paper's (%(default)s)")
    warnings = "of model warnings that are no errors: 'large strain', ..."
    add("--allow", metavar="KIND", action="extend", nargs="+", default=[], help=warnings)
    add("--partition", metavar=PARTITIONS, default="contact-sfc", help="kind of partition (%(default)s)")
    add("--preconditioner", metavar=PRECONDITIONERS, help="of PCG (boomeramg at degree 1, p-multigrid at 2)")
    if symmetric:
        add("--symmetry", metavar="{quarter,full}", default="quarter", help="modelled part (%(default)s)")
    add("--coarse", type=int, default=coarse, help=f"root cells along a block ({shown(coarse)})")
    add("--young", type=float, default=1.0, help="Young's modulus (%(default)s)")
    add("--poisson", type=float, default=0.3, help="Poisson's ratio (%(default)s)")
    add("--uniform", type=int, metavar="N", help="refine all root cells N times and solve once, instead of adapting")
    add("--true-error", type=float, metavar="E", help="continue to this tolerance to measure the true energy error")
    add("--records-only", action="store_true", help="write steps.jsonl alone: no fields, no pictures")
    add("--quiet", action="store_true", help="print errors only")
    add("--checkpoint", type=Path, help="folder for the last step, to restart from")
    add("--restart", action="store_true", help="continue from the step in that folder, on any number of ranks")
    add("--output", type=Path, default=Path(output), help="folder for the results (%(default)s)")
    return result


def parse(options: argparse.ArgumentParser) -> argparse.Namespace:
    """The parsed command line.  An unknown option ends the program with a message that names the nearest one."""
    given, unknown = options.parse_known_args(OWN)
    names = [word for word in options.format_help().split() if word.startswith("--")]
    unknown += [word for word in PETSC if f"-{word}" in names and word != "-help"]
    if unknown:
        near = get_close_matches(f"--{unknown[0].lstrip('-').partition('=')[0]}", names, 1)
        advice = f"did you mean {near[0]!r}?" if near else "--help lists them, all with two dashes"
        options.error(f"unknown option {unknown[0]!r}; {advice}")
    for name, value in vars(given).items():
        if isinstance(value, dict):  # a default by degree; another degree is refused later
            setattr(given, name, value.get(given.degree, value[DEGREE]))
    if given.restart and not given.checkpoint:
        options.error("--restart needs --checkpoint DIR, where the run has kept its last step")
    if given.restart and given.uniform is not None:
        options.error("--restart goes on from the last step of a run, --uniform begins anew: give one of them")
    return given


def settings(given: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Keyword arguments of `adapt` from a command line.

    Collective on COMM.  Raises SceneError for a `--true-error` that is no tolerance, before the run.
    """
    if given.true_error is not None:
        check_tolerance("--true-error", given.true_error)
    stiffness = given.penalty, given.node_stiffness
    method = given.enforcement or ("exact" if stiffness == (None, None) else "penalty")
    return {
        "tolerance": given.tolerance,
        "degree": given.degree,
        "max_steps": given.max_steps if given.uniform is None else 1,
        "geometry_order": given.geometry_order,
        "enforcement": Enforcement(method, *stiffness),
        "solver": Solver(given.preconditioner),
        "control": ErrorControl(given.control),
        "partition_kind": given.partition,
        "allow": given.allow,
        "beginning": None if given.uniform is None else Beginning.uniform(scene, given.uniform, COMM),
        "checkpoint": given.checkpoint,
        "restart": Checkpoint(given.checkpoint, scene, COMM) if given.restart else None,
        "progress": _voice(given.quiet)[1],
    }


def path_settings(given: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Keyword arguments of `increments` from a command line: as `settings`, with the checkpoint as folder.

    Collective on COMM.  Raises SceneError as `settings`, and for `--true-error`, which neglects history.
    """
    if given.true_error is not None:
        raise SceneError("--true-error is for single scenes: the results of a load path depend on its history")
    options = settings(argparse.Namespace(**vars(given) | {"checkpoint": None, "restart": False}), scene)
    del options["checkpoint"], options["restart"]
    adapt(scene, **options)  # a wrong option is found before the records of another run are replaced
    return options | {"folder": given.checkpoint, "restart": given.restart}


@contextmanager
def plain_errors(comm: MPI.Comm) -> Iterator[None]:
    """Errors of the package end the program with one line and exit code 1; any other aborts all ranks."""
    try:
        yield
    except FxContactError as error:
        if comm.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(1)
    except Exception:
        traceback.print_exc()
        comm.Abort(1)


def _record(record: StepRecord | SweepRecord) -> StepRecord:
    """A record of the table; in that of a load path `step` is the load step."""
    return replace(record.record, step=record.point) if isinstance(record, SweepRecord) else record


class Report:
    """The table of steps on the screen, and the records on disk; of a load path the last steps of its points.

    Collective on COMM, and so are its methods.

    Args:
        given: parsed command line.
        before: Checkpoint to restart from, or load path, with the first records of the table.
    """

    def __init__(self, given: argparse.Namespace, before: Checkpoint | LoadPath | None) -> None:
        self._given, self._steps = given, [_record(one) for one in before.records] if before else []
        self._show = _voice(given.quiet)[0]
        self._file = RecordWriter(given.output, COMM, self._steps)
        self._show("\n".join([table_head(), *map(table_row, self._steps)]))

    def add(self, step: Step | SweepPoint) -> None:
        """Show and write the record of a step, or of a point."""
        record = _record(step.record)
        if record.step == len(self._steps):  # else the last one once more, with its fields
            self._file.write(record)
            self._steps.append(record)
            self._show(table_row(record))

    def end(
        self,
        step: Step | SweepPoint,
        pictures: str,
        *,
        lines: Sequence[str] = (),
        hertz: Hertz | None = None,
        errors: dict[str, float] | None = None,
        true: TrueError | None = None,
    ) -> None:
        """Complete the record of the last step, and print the result.

        Args:
            step: the last one, or point.
            pictures: names of their files.
            lines: below the table.
            hertz: solution to compare with.
            errors: relative deviations from known values by name.
            true: against a solution on a finer mesh.
        """
        record, files = _record(step.record), "steps.jsonl"
        known = record == self._steps[-1]
        stages = step.step.stages if isinstance(step, SweepPoint) else step.stages
        if not self._given.records_only:
            ending = "vtu" if COMM.size == 1 else "pvtu"
            files += f", bodies.{ending}, contact.{ending}, {pictures}"
            record = replace(record, **stages.costs(COMM))
        if true:
            record = replace(record, true_error=true, effectivity=record.estimate / true.relative)
        record = replace(record, errors=errors)
        if known:  # else it is of the run before a restart
            self._file.write(record)
        self._show(total_seconds([r.seconds for r in [*self._steps[:-1], record]]))
        for line in [*lines, *_summary(self._given, record, hertz)]:
            self._show(line)
        self._show(f"results in {self._given.output}: {files}")


def _summary(given: argparse.Namespace, record: StepRecord, hertz: Hertz | None) -> Iterator[str]:
    """Lines below the table."""
    if not record.reached and given.uniform is None:
        yield f"The tolerance was not reached in {given.max_steps} steps."
    yield from model_warnings(record)
    yield from force_warnings(record)
    yield from undirected(record)
    yield f"force {record.force:.6g}, largest pressure {record.max_pressure:.5g}"
    if hertz:
        found = f"contact radius {record.contact_radius:.5g}; " if record.contact_radius is not None else ""
        known = f"contact radius {hertz.contact_radius:.5g}, largest pressure {hertz.max_pressure:.5g}"
        yield f"{found}Hertz at this force: {known}"
    for name, value in (record.errors or {}).items():
        yield f"{name.replace('_', ' ')}: {value:.3%} from the reference"
    if record.true_error:
        yield f"true energy error {record.true_error.relative:.2%}, effectivity {record.effectivity:.3f}"


def _voice(quiet: bool) -> tuple[Callable[[str], None], Callable[[int, str], None] | None]:
    """Functions that print a line on rank 0, and the present stage on a terminal; the latter may be None."""
    if quiet or COMM.rank:
        return (lambda _: None), None
    # A terminal shows the standard error directly, or through the mpirun that has started this rank.
    above = str(Path(f"/proc/{os.getppid()}/fd/2").resolve())
    if not sys.stderr.isatty() and not ("PMIX_RANK" in os.environ and above.startswith("/dev/pts/")):
        return partial(print, flush=True), None

    def stage(text: str = "") -> None:
        print(f"\r{text:40}", end="\r", file=sys.stderr, flush=True)

    def show(line: str) -> None:
        stage()
        print(line, flush=True)

    return show, lambda number, name: stage(f"step {number}: {name}")
