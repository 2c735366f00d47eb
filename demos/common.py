"""What the demos share: their options, the table on the screen, records, fields and pictures on disk."""

import argparse
import os
import sys
import traceback
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import petsc4py
from mpi4py import MPI
from tqdm import tqdm


def petsc_options(words):
    """The words of a command line that are PETSc's: options with one dash, and what follows them."""
    ours, result = False, []
    for word in words:
        if word.startswith("-") and word[1:2].isalpha() or word.startswith("--"):
            ours = word.startswith("--")
        if not ours:
            result.append(word)
    return result


def check_options_files(words):
    """End with a sentence where a file of options that PETSc is to read is not there: PETSc would show its own depths.

    Collective on MPI.COMM_WORLD; as PETSc does, rank 0 looks.
    """
    given = [*words, *os.environ.get("PETSC_OPTIONS", "").split()]
    named = [path for option, path in zip(given, [*given[1:], ""]) if option == "-options_file"]
    missing = [path for path in named if not Path(path.removesuffix(":yaml")).is_file()]
    missing = MPI.COMM_WORLD.bcast(missing)
    if missing:
        if MPI.COMM_WORLD.rank == 0:
            print(f"there is no file {missing[0]!r} of PETSc options, as -options_file says", file=sys.stderr)
        sys.exit(2)


check_options_files(petsc_options(sys.argv[1:]))
petsc4py.init([sys.argv[0], *petsc_options(sys.argv[1:])])  # before anything else imports PETSc

from fx_contact import Enforcement, ErrorControl, Material, Solver, adapt  # noqa: E402
from fx_contact.adaptive.adaptive_loop import Beginning  # noqa: E402
from fx_contact.adaptive.checkpoint import Checkpoint  # noqa: E402
from fx_contact.contact.enforcement import FACTOR, METHODS  # noqa: E402
from fx_contact.estimate.error_control import MODES  # noqa: E402
from fx_contact.forest.partition import KINDS  # noqa: E402
from fx_contact.linalg.petsc_options import unread_options  # noqa: E402
from fx_contact.linalg.solver_options import PRECONDITIONERS  # noqa: E402
from fx_contact.parallel.errors import FxContactError, SceneError  # noqa: E402
from fx_contact.parallel.validation import nearest  # noqa: E402
from fx_contact.plot import draw_mesh, draw_pressure, draw_stress  # noqa: E402
from fx_contact.results.accuracy import NORMS  # noqa: E402
from fx_contact.results.output import RecordWriter, write_fields  # noqa: E402
from fx_contact.results.overrefined_solution import true_error  # noqa: E402
from fx_contact.results.report import doubts, table_head, table_row, total_seconds  # noqa: E402


class RankZeroParser(argparse.ArgumentParser):
    """A parser whose messages come from rank 0 alone."""

    def _print_message(self, message, file=None):
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


def parser(description, *, tolerance, order, coarse, output):
    """Options that all demos have.

    Args:
        description: the demo's docstring.
        tolerance, order, coarse, output: defaults of these options.
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
    add("--tolerance", type=float, default=tolerance, help="relative error in the energy norm (%(default)s)")
    add("--order", type=int, default=order, help="order of the root mesh's geometry, 1 to 6 (%(default)s)")
    add("--geometry-order", type=int, help="order of the leaves' geometry (the lowest that is good enough)")
    add("--max-steps", type=int, default=20, help="most adaptive steps (%(default)s)")
    add("--enforcement", metavar=_either(METHODS), help=f"({METHODS[0]}; penalty where one of the next two is given)")
    add("--penalty", type=float, help=f"c of the surface stiffness c E*/h ({FACTOR:g})")
    add("--node-stiffness", type=float, help="k_N [N/m] of every node pair, instead of --penalty")
    add("--control", metavar=_either(MODES), default=MODES[0], help="of the error; energy: the paper's (%(default)s)")
    add("--partition", metavar=_either(KINDS), default="contact-sfc", help="kind of partition (%(default)s)")
    add("--preconditioner", metavar=_either(PRECONDITIONERS), default="boomeramg", help="of PCG (%(default)s)")
    add("--symmetry", metavar=_either(("quarter", "full")), default="quarter", help="what is modelled (%(default)s)")
    add("--coarse", type=int, default=coarse, help="root cells along a block (%(default)s)")
    add("--young", type=float, default=1.0, help="Young's modulus [Pa] (%(default)s)")
    add("--poisson", type=float, default=0.3, help="Poisson's ratio (%(default)s)")
    add("--uniform", type=int, metavar="N", help="refine all root cells N times and solve once, instead of adapting")
    add("--true-error", type=float, metavar="E", help="go on to this tolerance to measure the true energy error")
    add("--records-only", action="store_true", help="write steps.jsonl alone: no fields, no pictures")
    add("--quiet", action="store_true", help="say nothing but errors")
    add("--checkpoint", type=Path, help="folder that keeps the last step, to restart from")
    add(
        "--restart",
        action="store_true",
        help="go on from the step in the folder of --checkpoint, on any number of ranks",
    )
    add("--output", type=Path, default=Path(output), help="folder for the results (%(default)s)")
    return result


def _either(names):
    """Names to choose from, as the help shows them; the library checks, and knows the nearest."""
    return f"{{{','.join(names)}}}"


def enforcement(arguments):
    """The Enforcement that the arguments ask for."""
    stiffness = arguments.penalty, arguments.node_stiffness
    return Enforcement(arguments.enforcement or METHODS[0 if stiffness == (None, None) else -1], *stiffness)


def main(options, make_scene, exact=None, *, best_scene=None, errors=None, beginning=None):
    """Parse, run, write; errors of the package end in one line and exit code 1 on all ranks.

    Args:
        options: ArgumentParser.
        make_scene: function of the arguments and a Material that makes the Scene.
        exact: function of the arguments, the Material and the force that makes a Hertz to compare with, or None.
        best_scene: like make_scene, with the best geometry of the same root cells, for `--true-error`; None: the same.
        errors: function of the arguments and the last Step that gives deviations from what is known, by name; or None.
        beginning: function of the arguments, the Scene and the communicator that gives the Beginning, or None for the
            root cells; None: `uniform`.
    """
    arguments, others = options.parse_known_args()
    comm, theirs = MPI.COMM_WORLD, petsc_options(sys.argv[1:])
    names = [word for word in options.format_help().split() if word.startswith("--")]
    unknown = [word for word in others if word not in theirs]
    unknown += [word for word in theirs if f"-{word}" in names and word != "-help"]
    if unknown or (theirs and not theirs[0][1:2].isalpha()):
        word = (unknown + theirs)[0]
        near = nearest(f"--{word.lstrip('-').partition('=')[0]}", names) if word.startswith("-") else ""
        options.error(f"unknown option {word!r}{near or '; --help lists them, all with two dashes'}")
    if arguments.restart and not arguments.checkpoint:
        options.error("--restart needs --checkpoint DIR, where the run has kept its last step")
    if arguments.restart and arguments.uniform is not None:
        options.error("--restart goes on from the last step of a run, --uniform begins anew: give one of them")
    with plain_errors(comm):
        _run(comm, arguments, make_scene, exact, best_scene or make_scene, errors, beginning or uniform)


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


def _run(comm, arguments, make_scene, exact, best_scene, errors, beginning):
    material = Material(young=arguments.young, poisson=arguments.poisson)
    scene = make_scene(arguments, material)
    before = Checkpoint(arguments.checkpoint, scene, comm) if arguments.restart else None
    steps, once = list(before.records) if before else [], arguments.uniform is not None
    show, progress = _voice(comm, arguments.quiet)
    run = adapt(
        scene,
        arguments.tolerance,
        comm,
        max_steps=1 if once else arguments.max_steps,
        geometry_order=arguments.geometry_order,
        enforcement=enforcement(arguments),
        solver=Solver(arguments.preconditioner),
        control=ErrorControl(arguments.control),
        partition_kind=arguments.partition,
        beginning=beginning(arguments, scene, comm) if before is None else None,
        checkpoint=arguments.checkpoint,
        restart=before,
        progress=progress,
    )
    records = RecordWriter(arguments.output, comm, steps)
    show("\n".join([table_head(), *map(table_row, steps)]))
    for step in run:
        if unread := unread_options(comm, "fx_"):
            raise SceneError(f"PETSc knows no option -{unread[0]}; those of the solver begin with -fx_")
        if step.record.step == len(steps):  # else the last one again, for its fields
            records.write(step.record)
            steps.append(step.record)
            show(table_row(step.record))
    record = step.record
    compared = exact(arguments, material, record.force) if exact and record.force > 0 else None
    results = "steps.jsonl"
    if not arguments.records_only:
        results += ", fields.bp, cells.bp and contact.pvtu (for ParaView), " + _show(
            step, arguments.output, bool(exact), compared
        )
        record = replace(record, **step.stages.costs(comm))
    if errors:
        record = replace(record, errors=errors(arguments, step))
    if arguments.true_error:
        true = true_error(step, arguments.true_error, best_scene(arguments, material))
        record = replace(record, true_error=true, effectivity=record.estimate / true.relative)
    if step.record is steps[-1]:
        records.write(record)
        steps[-1] = record
    show(total_seconds([r.seconds for r in steps]))
    if not record.reached and not once:
        show(f"The tolerance was not reached in {arguments.max_steps} steps.")
    if not record.active_pairs:
        show("The bodies do not touch.")
    for line in doubts(record):
        show(line)
    show(f"force {record.force:.6g} N, largest pressure {record.max_pressure:.5g} Pa")
    if compared:
        radii = f"contact radius {record.contact_radius:.5g} m; Hertz: {compared.contact_radius:.5g} m"
        show(f"{radii}, {compared.max_pressure:.5g} Pa")
    for name, value in (record.errors or {}).items():
        sign = "" if name in NORMS else "+"
        show(f"{name.replace('_', ' ')}: {value:{sign}.3%} from the reference")
    if arguments.true_error:
        show(f"true energy error {true.relative:.2%}, effectivity {record.effectivity:.3f}")
    show(f"results in {arguments.output}: {results}")


def _voice(comm, quiet):
    """What says a line, and the progress that `adapt` tells: one line on a terminal, overwritten, of rank 0 alone."""
    if quiet or comm.rank:
        return (lambda _: None), None
    bar = tqdm(desc="starting", bar_format="{desc} {elapsed}", leave=False, disable=not _on_terminal())

    def show(line):
        bar.clear()
        print(line, flush=True)

    def progress(number, stage):
        bar.set_description_str(f"step {number}: {stage}")

    return show, None if bar.disable else progress


def _on_terminal():
    """Whether somebody sees the standard error: directly, or through the mpirun that has started this rank."""
    above = Path(f"/proc/{os.getppid()}/fd/2")
    return sys.stderr.isatty() or ("PMIX_RANK" in os.environ and str(above.resolve()).startswith("/dev/pts/"))


def _show(step, folder, round_contact, compared):
    """Write fields and pictures; the names of the pictures."""
    with step.stages("output"):
        write_fields(step, folder)
        draw_mesh(step, folder / "mesh.png")
        if round_contact:
            draw_pressure(step, folder / "pressure.png", compared)
            return "mesh.png, pressure.png"
        draw_stress(step, folder / "stress.png")
        return "mesh.png, stress.png"
