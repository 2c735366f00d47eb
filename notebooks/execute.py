"""Execute notebooks and print the seconds of their cells.

    python3 notebooks/execute.py notebooks/hertz_in_five_minutes.ipynb

With another XDG_CACHE_HOME there are no compiled kernels of FFCx, as on a new machine. The notebooks on disk do not
change; --output DIR saves executed copies.
"""

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")  # else the debugger of the kernel warns

import nbformat  # noqa: E402
from nbclient import NotebookClient  # noqa: E402


def execute(path, limit=600):
    """Run a notebook in its own folder.

    Args:
        path: Path of the .ipynb.
        limit: most seconds of a cell.

    Returns:
        the notebook with its outputs, and rows (seconds since the start of the kernel, whether the cell shows a
        picture), one for each cell of code.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    start, rows = time.perf_counter(), []

    def done(cell, cell_index, execute_reply):
        pictures = [out for out in cell.outputs if "image/png" in out.get("data", {})]
        rows.append((time.perf_counter() - start, bool(pictures)))

    folder = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=limit, resources=folder, on_cell_executed=done).execute()
    return notebook, rows


def main():
    """Execute the notebooks of the command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("notebook", type=Path, nargs="+")
    options.add_argument("--output", type=Path, help="folder for the executed notebooks")
    arguments = options.parse_args()
    for path in arguments.notebook:
        notebook, rows = execute(path)
        picture = next((f"{seconds:.1f} s" for seconds, shows in rows if shows), "never")
        said = f"first picture after {picture}, all {len(rows)} cells {rows[-1][0]:.1f} s"
        print(f"{path.name}: {said}, start of Python included")
        if arguments.output:
            arguments.output.mkdir(parents=True, exist_ok=True)
            nbformat.write(notebook, arguments.output / path.name)


if __name__ == "__main__":
    main()
