"""Tables of the pages, made from the CSV files that the studies keep.

    python3 -m studies.tables                             # writes the tables into the pages
    python3 -m studies.tables results/cost/standard.csv   # keeps a new result first, with the revision of the program

A page has a table between `<!-- table: studies/cost/thin.csv | {scene} | {ratio:.2f} -->` and `<!-- end of table -->`.
The mark has the form of the cells of each column, as for str.format, or several with "or" between them, the first whose
values are all there; without forms the table has all columns.  The headings are those of the page.  A choice of rows
has `#CHOICE` after the name. Above the rows of a CSV file stand the command which made it, the machine, and the
revision of the program; the page says them below the table.
"""

import argparse
import csv
import os
import re
import shlex
import subprocess
import sys
from math import log
from pathlib import Path
from string import Formatter

from studies.partition.tables import claims, in_milliseconds
from studies.stability.figures import named

TOP = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(str(page.relative_to(TOP)) for page in (TOP / "docs").rglob("*.md")))
#: A table of a page: its mark, the file with the choice, forms of cells, headings, the end.
TABLE = r"(<!-- table: (\S+)(.*) -->)\n(.*)(?s:.*?)(<!-- end of table -->)"


def markdown(rows, columns):
    """A table in Markdown.

    Args:
        rows: dicts; a value that is missing is "" or None.
        columns: heading -> form of a cell, as for str.format, or several with "or" between them: the first whose
            values are all there.
    """
    lines = [list(columns), ["--:" if ":" in form else "---" for form in columns.values()]]
    lines += [[_cell(form, row) for form in columns.values()] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(forms, row):
    for form in forms.split(" or "):
        if all(row.get(name) not in ("", None) for _, name, _, _ in Formatter().parse(form) if name):
            return form.format(**row)
    return ""


def plain(rows):
    """A table with all columns, floats to three digits."""
    columns = {name: f"{{{name}:.3g}}" if isinstance(rows[0][name], float) else f"{{{name}}}" for name in rows[0]}
    return markdown(rows, columns)


def shown(rows):
    """Points of the work-precision study that the page shows: HERTZ-A, adaptive."""
    return [r for r in rows if r["group"] == "HERTZ-A" and r["line"].startswith("degree")]


def three(rows):
    """Of these the points of degree 2 whose true errors are nearest to 5, 1 and 0.1 %."""
    points = [r for r in shown(rows) if r["line"] == "degree 2" and r["true_error"] != ""]
    return [min(points, key=lambda r: abs(log(r["true_error"] / wanted))) for wanted in (0.05, 0.01, 0.001)]


def grouped(rows, *names):
    """Groups of rows that agree in some columns: these, dict, and the rows."""
    groups = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return [(dict(zip(names, values)), group) for values, group in groups.items()]


def by_goal(rows):
    """A row for each goal and degree: relative true errors and effectivities, mesh by mesh."""
    for common, group in grouped(rows, "scene", "goal", "degree"):
        yield common | {
            "true": ", ".join(f"{row['true'] / abs(row['known']):.2%}" for row in group),
            "effectivities": ", ".join(f"{row['effectivity']:.2g}" for row in group),
        }


def lowest(rows):
    """The row with the lowest effectivity for each Poisson's ratio."""
    return [min(group, key=lambda row: row["effectivity"]) for _, group in grouped(rows, "poisson")]


def by_cells(rows):
    """A row for each leaf spring: linear solves, iterations and errors of forces by the number of cells."""
    for common, group in grouped(rows, "plates", "slenderness", "bent_by"):
        listed = {name: ", ".join(f"{row[name]}" for row in group) for name in ("cells", "solves", "iterations")}
        yield {name.replace("_", " "): value for name, value in common.items()} | {
            "cells along": listed["cells"],
            "linear solves": listed["solves"],
            "iterations": listed["iterations"],
            "force, less that of beams": ", ".join(f"{row['force']:+.2%}" for row in group),
        }


#: Rows that pages show, or a table, where these are not all rows of a file.
CHOSEN = {
    "studies/work_precision/points.csv": shown,
    "studies/work_precision/points.csv#three": three,
    "studies/cost/flat.csv": lambda rows: [row for row in rows if row["nu"] < 0.499 and row["aspect"] != "1:2"],
    "studies/cost/leaf_springs.csv": by_cells,
    "studies/cost/orders.csv": lambda rows: [row for row in rows if row["ranks"] == 2],
    "studies/partition/model.csv": in_milliseconds,
    "studies/partition/model.csv#claims": claims,
    "studies/stability/scores.csv": named,
    "studies/effectivity/first_mesh.csv": lowest,
    "studies/goals/table.csv": by_goal,
}


def write(path, rows, command=None):
    """Write rows, dicts, to a CSV file, above them a command, None: of this program, and the machine."""
    command = command or shlex.join(["python3", *sys.orig_argv[1:]])
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        file.write(f"# command: ./with-dolfinx {command}\n# machine: {machine()}\n")
        names = list(dict.fromkeys(name for row in rows for name in row))
        writer = csv.DictWriter(file, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def tabulate(rows, path):
    """Rows as they come: each is printed, and written with those before; at the end they are printed as a table.

    Collective, on the ranks of MPI; only of one rank they are kept.
    """
    from mpi4py import MPI  # not at the top: what reads tables may start ranks of its own

    known, comm = [], MPI.COMM_WORLD
    for row in rows:
        known.append(row)
        if comm.rank == 0:
            print(*(f"{v:.5g}" if isinstance(v, float) else v for v in row.values()), sep="  ", flush=True)
        if comm.size == 1:
            write(path, known)
    if known and comm.rank == 0:
        print(f"\n{plain(known)}")


def options(text, study):
    """A parser of the command line of a study, with its text and the folder of its results."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("results", study), help="folder (%(default)s)")
    return parser


def machine():
    """Processor, cores and memory, in a few words."""
    models = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{models[0] if models else os.uname().machine}, {os.cpu_count()} cores, {memory:.0f} GiB"


def read(path):
    """The first lines of a CSV file (command, machine, revision) as a dict, and its rows: dicts, numbers as numbers."""
    lines = Path(path).read_text().splitlines()
    about = [line[2:].split(": ", 1) for line in lines if line.startswith("# ")]
    return dict(about), [{k: _number(v) for k, v in row.items()} for row in csv.DictReader(lines[len(about) :])]


def _number(text):
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def keep(path):
    """Copy a result from results/STUDY/TABLE.csv to studies/STUDY, with the revision of the program."""
    git = ["git", "-C", str(TOP), "describe", "--always", "--dirty"]
    revision = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    (TOP / "studies" / path.parent.name / path.name).write_text(f"# revision: {revision}\n{path.read_text()}")


def with_tables(text):
    """The text of a page with its tables as the CSV files have them."""

    def table(found):
        mark, name, forms, headings, end = found.groups()
        about, rows = read(TOP / name.partition("#")[0])
        rows = CHOSEN.get(name, list)(rows)
        if not isinstance(rows, str):
            forms, headings = ([cell.strip() for cell in line.split("|")[1:]] for line in (forms, headings))
            rows = markdown(rows, dict(zip(headings, forms))) if forms else plain(list(rows))
        origin = f"(`{about['command']}`; revision {about['revision']}; {about['machine']})"
        return f"{mark}\n{rows}\n\n{origin}\n{end}"

    return re.sub(TABLE, table, text)


def main():
    """Keep the results that are named, and write the tables into the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="*", help="a CSV file in results/STUDY, to keep in studies/STUDY")
    for path in parser.parse_args().results:
        if not path.is_file():
            parser.error(f"there is no file {str(path)!r}")
        keep(path)
    for page in PAGES:
        path = TOP / page
        path.write_text(with_tables(path.read_text()))


if __name__ == "__main__":
    main()
