"""Programs and demos, run so that all ranks end when one fails.

Without it the others wait for a rank that ends before its import of this package, or during MPI calls of their own.
mpi4py's runner, `python3 -m mpi4py`, aborts too late: PETSc is finalised before, which is collective.
"""

import ast
import runpy
import sys
import traceback
from pathlib import Path

from mpi4py import MPI

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import calling, leave
from fx_contact.parallel.validation import check_name

#: Modules beside the demos that these import.
_MODULES = ("common", "manufactured_solution")


def run_program(path: str, words: list[str]) -> None:
    """Run a program with its arguments, as Python does.

    Collective on the world.

    Raises:
        SceneError: there is no such file.
        SystemExit: the program exits, alike on all ranks.
    """
    if not Path(path).exists():
        raise SceneError(f"there is no program {path!r}, and no command of this name; fx-contact --help lists them")
    sys.argv[:] = [path, *words]
    sys.path[0] = str(Path(path).resolve().parent)
    with calling(MPI.COMM_WORLD, "python3 -m fx_contact"):
        pass  # from now on the end of a rank is announced to the others
    try:
        runpy.run_path(path, run_name="__main__")
    except SystemExit as error:
        if error.code:
            leave(error)
        raise
    except Exception:
        traceback.print_exc()
        MPI.COMM_WORLD.Abort(1)


def demos() -> dict[str, Path]:
    """Demos by name, of the checkout that this package is in, or of that in the current folder.

    Local.  Raises SceneError if there is none: the package alone has no demos.
    """
    for top in (Path(__file__).parents[3], Path.cwd()):
        if (top / "demos" / "common.py").is_file():
            files = sorted((top / "demos").glob("*.py"))
            return {file.stem: file for file in files if file.stem not in _MODULES}
    raise SceneError(
        "the demos are in the project's folder `demos`, not in the installed package: call this in a clone of the "
        "project, or pass a program of your own to fx-contact run"
    )


def demo(name: str) -> Path:
    """Path of a demo.  Local.  Raises SceneError if there is none of this name."""
    known = demos()
    check_name("demo", name.removesuffix(".py"), known)
    return known[name.removesuffix(".py")]


def summary(path: Path) -> str:
    """First sentence of the docstring of a program.  Local."""
    text = ast.get_docstring(ast.parse(path.read_text())) or ""
    return text.split("\n\n")[0].replace("\n", " ")
