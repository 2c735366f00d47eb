"""The command `fx-contact`, or `python3 -m fx_contact`; under mpirun rank 0 alone prints."""

import sys
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

from fx_contact.command.info import library_lines
from fx_contact.command.programs import run_program
from fx_contact.parallel.errors import FxContactError
from fx_contact.parallel.validation import nearest
from fx_contact.parallel.versions import project_version

_HELP = """usage: fx-contact COMMAND [ARGUMENT...]

  run PROGRAM [ARGUMENT...]   run a program of your own; all ranks end when one fails
  info                        versions of the libraries, and optional packages that are missing
  --version, --help

PROGRAM alone is the same as run PROGRAM.  On several ranks: mpirun -n 2 fx-contact run PROGRAM.
python3 -m fx_contact is the same command."""


def main() -> None:
    """Run the command line.

    Collective on the world.

    Raises:
        SystemExit: 2 for a wrong command line, 1 for an error of the package, each with a message; or the program
            exits, alike on all ranks.
    """
    command, words = (sys.argv[1], sys.argv[2:]) if sys.argv[1:] else ("", [])
    try:
        if command in _COMMANDS and not {"-h", "--help"} & {*words[:1]}:
            _COMMANDS[command](words)
        elif command in ("-h", "--help", *_COMMANDS):
            _say(_HELP)
        elif command == "--version":
            _say(f"fx_contact {project_version()}")
        elif not command or command.startswith("-"):
            _refuse(f"unknown option {command!r}" if command else "no command")
        elif not Path(command).exists() and nearest(command, _COMMANDS):
            _refuse(f"unknown command {command!r}{nearest(command, _COMMANDS)}")
        else:
            run_program(command, words)
    except FxContactError as error:
        _say(f"{type(error).__name__}: {error}", sys.stderr)
        sys.exit(1)


def _run(words: list[str]) -> None:
    if not words:
        _refuse("run needs a program")
    run_program(words[0], words[1:])


def _info(words: list[str]) -> None:
    if words:
        _refuse("info takes no arguments")
    _say("\n".join(library_lines()))


#: Commands by name.
_COMMANDS: dict[str, Callable[[list[str]], None]] = {"run": _run, "info": _info}


def _say(text: str, stream: object = None) -> None:
    """Print on rank 0, by default to standard output."""
    if MPI.COMM_WORLD.rank == 0:
        print(text, file=stream)  # type: ignore[call-overload]


def _refuse(why: str) -> None:
    """End the program with what is wrong about the command line."""
    _say(f"fx-contact: {why}\n{_HELP}", sys.stderr)
    sys.exit(2)


if __name__ == "__main__":
    main()
