"""What the demos share: their options, a line on the screen for each step, records, fields and pictures on disk."""

import argparse
import os
import sys
import traceback
from contextlib import contextmanager
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from itertools import pairwise
from pathlib import Path

import petsc4py
from mpi4py import MPI

COMM = MPI.COMM_WORLD


def split(words):
    """The words of a command line that are the demo's, and PETSc's: those with one dash, and one word after each."""
    own, petsc, room = [], [], False
    for word in words:
        option = word[:1] == "-" and word[1:2].isalpha()
        (petsc if option or room and not word.startswith("--") else own).append(word)
        room = option  # for the value of a PETSc option
    return own, petsc


OWN, PETSC = split(sys.argv[1:])
_given = pairwise([*PETSC, *os.environ.get("PETSC_OPTIONS", "").split(), ""])
_files = [path.removesuffix(":yaml") for option, path in _given if option == "-options_file"]
if _missing := COMM.bcast([path for path in _files if not Path(path).is_file()]):  # PETSc would show its own depths
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
    Material,
    Solver,
    adapt,
)
from fx_contact.adaptive.settings import DEGREE  # noqa: E402
from fx_contact.plot import draw_mesh, draw_pressure, draw_stress  # noqa: E402
from fx_contact.results import (  # noqa: E402
    RecordWriter,
    doubt_lines,
    force_warnings,
    table_head,
    table_row,
    total_seconds,
    true_error,
    undirected,
    write_fields,
)

#: Choices of options; the library checks them, and knows the nearest.
METHODS, CONTROLS = "{exact,penalty}", "{contact,energy}"
PARTITIONS, PRECONDITIONERS = "{contact-sfc,equidistributed,sfc,graph}", "{boomeramg,ilu,cholesky,p-multigrid}"


class RankZeroParser(argparse.ArgumentParser):
    """A parser whose messages come from rank 0 alone."""

    def _print_message(self, message, file=None):
        if COMM.rank == 0:
            super()._print_message(message, file)


def shown(default):
    """A default for the help, by degree where it depends on it."""
    return ", ".join(f"{one} at degree {p}" for p, one in default.items()) if isinstance(default, dict) else default


def parser(description, *, tolerance, order, coarse, output, whole=False):
    """Options that all demos have.

    Args:
        description: the demo's docstring.
        tolerance, order, coarse, output: defaults of these options, {degree: value} where they depend on it.
        whole: whether the whole bodies can be modelled too (`--symmetry full`).
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
    add("--geometry-order", type=int, help="order of the leaves' geometry (the lowest that is good enough)")
    add("--max-steps", type=int, default=20, help="most adaptive steps (%(default)s)")
    add("--enforcement", metavar=METHODS, help="(exact; penalty where one of the next two is given)")
    add("--penalty", type=float, help="c of the surface stiffness c E*/h (100)")
    add("--node-stiffness", type=float, help="k_N of every node pair, instead of --penalty")
    add("--control", metavar=CONTROLS, default="contact", help="of the error; energy: the paper's (%(default)s)")
    add("--allow", metavar="KIND", action="extend", nargs="+", default=[], help="of doubts: 'large strain', ...")
    add("--partition", metavar=PARTITIONS, default="contact-sfc", help="kind of partition (%(default)s)")
    add("--preconditioner", metavar=PRECONDITIONERS, help="of PCG (boomeramg at degree 1, p-multigrid at 2)")
    if whole:
        add("--symmetry", metavar="{quarter,full}", default="quarter", help="what is modelled (%(default)s)")
    add("--coarse", type=int, default=coarse, help=f"root cells along a block ({shown(coarse)})")
    add("--young", type=float, default=1.0, help="Young's modulus (%(default)s)")
    add("--poisson", type=float, default=0.3, help="Poisson's ratio (%(default)s)")
    add("--uniform", type=int, metavar="N", help="refine all root cells N times and solve once, instead of adapting")
    add("--true-error", type=float, metavar="E", help="go on to this tolerance to measure the true energy error")
    add("--records-only", action="store_true", help="write steps.jsonl alone: no fields, no pictures")
    add("--quiet", action="store_true", help="say nothing but errors")
    add("--checkpoint", type=Path, help="folder that keeps the last step, to restart from")
    add("--restart", action="store_true", help="go on from the step in that folder, on any number of ranks")
    add("--output", type=Path, default=Path(output), help="folder for the results (%(default)s)")
    return result


def main(options, make_scene, exact=None, *, best_scene=None, errors=None, beginning=None, across="y"):
    """Parse, run, write; errors of the package end in one line and exit code 1 on all ranks.

    Args:
        options: ArgumentParser.
        make_scene: function of the arguments and a Material that makes the Scene.
        exact: function of the arguments, the Material and the force that makes a Hertz to compare with, or None.
        best_scene: like make_scene, with the best geometry of the same root cells, for `--true-error`; None: the same.
        errors: function of the arguments and the last Step that gives deviations from what is known, by name; or None.
        beginning: function of the arguments, the Scene and the communicator that gives the Beginning, or None for the
            root cells; None: `uniform`.
        across: axis that the picture of the stress is cut across.
    """
    arguments = _parsed(options)
    with plain_errors(COMM):
        show, progress = _voice(arguments.quiet)
        material = Material(young=arguments.young, poisson=arguments.poisson)
        scene = make_scene(arguments, material)
        last, steps, file = _adapted(arguments, scene, beginning or uniform, show, progress)
        record = last.record
        compared = exact(arguments, material, record.force) if exact and record.force > 0 else None
        results = "steps.jsonl"
        if not arguments.records_only:
            results += ", fields.bp, cells.bp and contact.pvtu (for ParaView), mesh.png, "
            results += _draw(last, arguments.output, bool(exact), compared, across)
            record = replace(record, **last.stages.costs(COMM))
        if errors:
            record = replace(record, errors=errors(arguments, last))
        if arguments.true_error:
            true = true_error(last, arguments.true_error, (best_scene or make_scene)(arguments, material))
            record = replace(record, true_error=true, effectivity=record.estimate / true.relative)
        if last.record is steps[-1]:  # else it is one of the run before
            file.write(record)
        show(total_seconds([r.seconds for r in [*steps[:-1], record]]))
        for line in _summary(arguments, record, compared):
            show(line)
        show(f"results in {arguments.output}: {results}")


def _parsed(options):
    """The arguments; a word that neither the demo nor PETSc knows ends the program with the nearest option."""
    arguments, unknown = options.parse_known_args(OWN)
    names = [word for word in options.format_help().split() if word.startswith("--")]
    unknown += [word for word in PETSC if f"-{word}" in names and word != "-help"]
    if unknown:
        near = get_close_matches(f"--{unknown[0].lstrip('-').partition('=')[0]}", names, 1)
        advice = f"did you mean {near[0]!r}?" if near else "--help lists them, all with two dashes"
        options.error(f"unknown option {unknown[0]!r}; {advice}")
    for name, value in vars(arguments).items():
        if isinstance(value, dict):  # a default by degree; another degree is refused later
            setattr(arguments, name, value.get(arguments.degree, value[DEGREE]))
    if arguments.restart and not arguments.checkpoint:
        options.error("--restart needs --checkpoint DIR, where the run has kept its last step")
    if arguments.restart and arguments.uniform is not None:
        options.error("--restart goes on from the last step of a run, --uniform begins anew: give one of them")
    return arguments


@contextmanager
def plain_errors(comm):
    """Errors of the package end in one line and exit code 1 on all ranks; any other ends all ranks at once."""
    try:
        yield
    except FxContactError as error:
        if comm.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(1)
    except Exception:
        traceback.print_exc()
        comm.Abort(1)


def uniform(arguments, scene, comm):
    """The Beginning that `--uniform` asks for, or None."""
    return None if arguments.uniform is None else Beginning.uniform(scene, arguments.uniform, comm)


def _adapted(arguments, scene, beginning, show, progress):
    """Run to the end: the last Step, the records of all, those before a restart included, and their RecordWriter."""
    before = Checkpoint(arguments.checkpoint, scene, COMM) if arguments.restart else None
    steps, stiffness = list(before.records) if before else [], (arguments.penalty, arguments.node_stiffness)
    method = arguments.enforcement or ("exact" if stiffness == (None, None) else "penalty")
    run = adapt(
        scene,
        arguments.tolerance,
        COMM,
        degree=arguments.degree,
        max_steps=arguments.max_steps if arguments.uniform is None else 1,
        geometry_order=arguments.geometry_order,
        enforcement=Enforcement(method, *stiffness),
        solver=Solver(arguments.preconditioner),
        control=ErrorControl(arguments.control),
        partition_kind=arguments.partition,
        allow=arguments.allow,
        beginning=None if before else beginning(arguments, scene, COMM),
        checkpoint=arguments.checkpoint,
        restart=before,
        progress=progress,
    )
    file = RecordWriter(arguments.output, COMM, steps)
    show("\n".join([table_head(), *map(table_row, steps)]))
    for step in run:
        if step.record.step == len(steps):  # else the last one again, for its fields
            file.write(step.record)
            steps.append(step.record)
            show(table_row(step.record))
    return step, steps, file


def _draw(step, folder, round_contact, compared, across):
    """Write fields and pictures; the name of the second picture."""
    with step.stages("output"):
        write_fields(step, folder)
        draw_mesh(step, folder / "mesh.png")
        if round_contact:
            draw_pressure(step, folder / "pressure.png", compared)
            return "pressure.png"
        draw_stress(step, folder / "stress.png", across=across)
        return "stress.png"


def _summary(arguments, record, compared):
    """Lines on the result, below the table."""
    if not record.reached and arguments.uniform is None:
        yield f"The tolerance was not reached in {arguments.max_steps} steps."
    yield from doubt_lines(record)
    yield from force_warnings(record)
    yield from undirected(record)
    yield f"force {record.force:.6g}, largest pressure {record.max_pressure:.5g}"
    if compared:
        found = f"contact radius {record.contact_radius:.5g}; " if record.contact_radius is not None else ""
        known = f"contact radius {compared.contact_radius:.5g}, largest pressure {compared.max_pressure:.5g}"
        yield f"{found}Hertz at this force: {known}"
    for name, value in (record.errors or {}).items():
        yield f"{name.replace('_', ' ')}: {value:.3%} from the reference"
    if arguments.true_error:
        yield f"true energy error {record.true_error.relative:.2%}, effectivity {record.effectivity:.3f}"


def _voice(quiet):
    """What prints a line on rank 0, and on a terminal the progress for `adapt`: the stage at work, overwritten."""
    if quiet or COMM.rank:
        return (lambda _: None), None
    # A terminal shows the standard error directly, or through the mpirun that has started this rank.
    above = str(Path(f"/proc/{os.getppid()}/fd/2").resolve())
    if not sys.stderr.isatty() and not ("PMIX_RANK" in os.environ and above.startswith("/dev/pts/")):
        return partial(print, flush=True), None

    def stage(text=""):
        print(f"\r{text:40}", end="\r", file=sys.stderr, flush=True)

    def show(line):
        stage()
        print(line, flush=True)

    return show, lambda number, name: stage(f"step {number}: {name}")
