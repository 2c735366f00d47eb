"""Tables of the pages, made from the CSV files that the studies keep.

    python3 -m studies.tables                             # writes the tables into the pages
    python3 -m studies.tables results/cost/standard.csv   # keeps a new result first, with the revision of the program

A page has a table between `<!-- table: studies/cost/standard.csv -->` and `<!-- end of table -->`, a choice of its rows
with `#CHOICE` after the name. Above the rows of a CSV file stand the command which made it, the machine, and the
revision of the program; the page says them below the table.
"""

import argparse
import csv
import os
import re
import shlex
import subprocess
import sys
from functools import partial
from math import log
from pathlib import Path
from string import Formatter

from studies.partition.tables import KERNELS, MODEL, PARTITION, claims, in_milliseconds
from studies.stability.figures import named

TOP = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(str(page.relative_to(TOP)) for page in (TOP / "docs").rglob("*.md")))
#: Columns of tables with all rows: heading -> form of a cell; targets of the project stand beside what was measured.
COLUMNS = {
    "studies/cost/standard.csv": {
        "command": "`{command}`",
        "dofs": "{dofs:,}",
        "steps": "{steps:d}",
        "CPU": ("{cpu_s:.3g} s (target {target_cpu_s:.3g})", "{cpu_s:.3g} s"),
        "wall": "{wall_s:.1f} s",
        "CPU for a million dofs": (
            "{cpu_s_per_million_dofs:.0f} s (target {target_rate})",
            "{cpu_s_per_million_dofs:.0f} s",
        ),
        "peak memory for a dof": ("{kB_per_dof:.3g} kB (target {target_kB:.3g})", "{kB_per_dof:.3g} kB"),
    },
    "studies/cost/hertz.csv": {
        "command": "`{command}`",
        "cells": "{cells:,}",
        "dofs": "{dofs:,}",
        "force": "{force:+.3%}",
        "largest pressure": "{max_pressure:+.3%}",
        "contact radius": "{contact_radius:+.3%}",
        "seconds": "{wall_s:.1f}",
    },
    "studies/effectivity/table.csv": {
        "case": "{case}",
        "degree": "{degree:d}",
        "unknowns": "{dofs:,}",
        "estimated": "{estimate:.2%}",
        "true": "{true_error:.2%}",
        "effectivity": "{effectivity:.2f}",
    },
    "studies/effectivity/hertz_truth.csv": {
        "displacements": "{line}",
        "unknowns": "{dofs:,}",
        "estimated": "{estimate:.2%}",
        "true": "{true_error:.2%}",
        "effectivity": "{effectivity:.2f}",
        "$e N^{2/3}$": "{constant:.1f}",
        "cells at the edge": "{edge_cells:,}",
        "their share of $e^2$": "{edge_share:.0%}",
    },
    "studies/effectivity/cad.csv": {
        "scene": "{scene}",
        "tolerance": "{tolerance:.0%}",
        "solved": "{run}",
        "unknowns": "{unknowns:,}",
        "CPU": "{cpu_seconds:.1f} s",
        "estimated": "{estimate:.1%}",
        "force": "{force:.5g} N",
    },
    "studies/cost/preconditioners.csv": {
        "scene": "{scene}",
        "dofs": "{dofs:,}",
        "preconditioner": "{preconditioner}",
        "at the end": "{at_the_end}",
        "iterations": "{iterations:d}",
        "set-up": "{setup_us:.1f}",
        "solve": "{solve_us:.0f}",
    },
    "studies/cost/cad.csv": {
        "part": "{part}",
        "root cells": "{mesh}, {around:d} around",
        "number": "{root_cells:,}",
        "estimate": "{estimate:.1%}",
        "unknowns": "{dofs:,}",
        "CPU": "{cpu_s:.1f} s",
        "at the end": "{run_estimate:.1%}",
        "unknowns, end": "{run_dofs:,}",
        "iterations, last solve": "{iterations:d}",
        "preconditioner": "{at_the_end}",
        "CPU, run": "{run_cpu_s:.1f} s",
        "over transfinite (target 4)": "{run_cpu_s_ratio:.1f}",
    },
    "studies/cost/thin.csv": {
        "scene": "{scene}",
        "tolerance": "{tolerance:.0%}",
        "steps": "{steps:d}",
        "unknowns": "{dofs:,}",
        "fewest found": "{fewest:,}",
        "over these": "{ratio:.2f}",
        "iterations, last solve": "{iterations:d}",
        "preconditioner": "{preconditioner}",
    },
    "studies/cost/factors.csv": {
        "scene": "{scene}",
        "cells along a side": "{side:d}",
        "unknowns": "{dofs:,}",
        "kB an unknown": "{kB:.1f}",
        "with all memory": "{kB_of_memory:.1f}",
        "us an unknown": "{us:.0f}",
        "iterations of p-multigrid": "{iterations:d}",
        "price in iterations": "{price:.0f}",
    },
    "studies/cost/distorted.csv": {
        "scene": "{scene}",
        "unknowns": "{dofs:,}",
        "solver": "{solver}",
        "at the end": "{at_the_end}",
        "iterations": "{iterations:d}",
        "set-up and solve, CPU s": "{cpu_s:.1f}",
        "peak memory, kB an unknown": "{kB:.1f}",
    },
    "studies/layers/table.csv": {
        "contact radius over thickness, at ratio 1": "{width:g}",
        "modulus, coating over substrate": "{ratio:g}",
        "root cells": "{root}",
        "unknowns": "{dofs:,}",
        "estimate": "{estimate:.1%}",
        "force, estimated error": "{force_estimate:.2%}",
        "force, deviation": "{force:+.2%}",
        "PCG iterations, at most": "{iterations:d}",
        "at the end": "{at_the_end}",
        "CPU": "{cpu_s:.0f} s",
    },
    "studies/stability/without.csv": {
        "without": "{without}",
        "scenes": "{scenes:d}",
        "worse": "{worse:d}",
        "unknowns": "{unknowns:.2f}",
        "CPU": "{cpu:.2f}",
        "which": "{which}",
    },
    "studies/stability/iterations.csv": {
        "scene": "{scene}",
        "over": "{over}",
        "from": "{from_to}",
        "ranks": "{ranks:d}",
        "unknowns": "{dofs:,}",
        "iterations of the last solve": "{last}",
        "of all": "{of_all}",
    },
    "studies/goals/asked.csv": {
        "scene": "{scene}",
        "goal": "{goal}",
        "asked for": "{asked:.1%}",
        "steps": "{steps:d}",
        "unknowns": "{dofs:,}",
        "estimated error": "{estimated:.2%}",
        "true error": "{true:.2%}",
    },
    "studies/goals/forces.csv": {
        "scene": "{scene}",
        "degree": "{degree:d}",
        "tolerance": "{tolerance:.0%}",
        "unknowns": "{dofs:,}",
        "true error": "{true:.2%}",
        "estimated": "{estimated:.2%}",
        "estimated over true": "{effectivity:.1f}",
    },
    "studies/goals/rigid_twins.csv": {
        "nu": "{poisson:g}",
        "approach": "{approach:g}",
        "contact radius": "{radius:.3f}",
        "force, rigid ball": "{ball:+.2%}",
        "rigid surface": "{surface:+.4%}",
    },
    "studies/effectivity/stress.csv": {
        "problem": "{problem}",
        "degree": "{degree:d}",
        "unknowns": "{dofs:,}",
        "of the cells": "{raw:.2%}",
        "of the estimate": "{recovered:.2%}",
        "shown": "{projected:.2%}",
    },
    "studies/cost/sweeps.csv": {
        "tolerance": "{tolerance:.0%}",
        "points": "{points:d}",
        "solves": "{solves:d}",
        "unknowns of all solves": "{dofs:,}",
        "CPU": "{cpu_s:.1f} s",
        "solves, last point alone": "{alone_solves:d}",
        "unknowns": "{alone_dofs:,}",
        "CPU, alone": "{alone_cpu_s:.1f} s",
        "ratio (target 2)": "{ratio:.1f}",
    },
    "studies/cost/python.csv": {
        "command": "`{command}`",
        "CPU": "{cpu_s:.1f} s",
        "Python at most (target 5 %)": "{share_at_most:.1%}",
    },
    "studies/nonmatching/accuracy.csv": {
        "scene": "{scene}",
        "cells": "{cells}",
        "tolerance": "{tolerance:.0%}",
        "unknowns": "{dofs:,}",
        "iterations, last solve": "{iterations:d}",
        "CPU": "{cpu_s:.1f} s",
        "estimated": "{estimate:.2%}",
        "true": ("{true_error:.2%}", ""),
        "mean pressure or force": "{mean:+.3%}",
        "largest pressure": "{largest:+.2%}",
    },
    "studies/incompressible/table.csv": {
        "scene": "{scene}",
        "nu": "{nu}",
        "unknowns": "{dofs:,}",
        "iterations of the last solve": "{iterations:d}",
        "of all": "{all_iterations:d}",
        "set-up and solves, us an unknown": "{solver_us:.0f}",
        "whole step": "{cpu_us:.0f}",
        "kB an unknown": "{kB:.1f}",
        "force against the reference": ("{error_force:+.3%}", ""),
    },
    "studies/work_precision/promises.csv": {"promise": "{promise}", "measured": "{measured}"},
}
POINTS = {
    "displacements": "{line}",
    "unknowns": "{dofs:,}",
    "true energy error": ("failed, {failed}", "{true_error:.2%}", "({estimate:.2%})"),
    "force": "{error_force:+.3%}",
    "largest pressure": "{error_max_pressure:+.2%}",
    "CPU": "{cpu_s:.1f} s",
}


POINTS_OF_README = {name: POINTS[name] for name in ("unknowns", "true energy error", "force", "CPU")}
FLAT = {
    "scene": "{scene}",
    "aspect": "{aspect}",
    "nu": "{nu}",
    "iterations, point blocks": ("{point_blocks}",),
    "iterations": ("{iterations}",),
    "at the end": ("{at_the_end}", ""),
    "set-up and solves, us an unknown": ("{us:.0f}", ""),
}


GOALS = {
    "scene": "{scene}",
    "goal": "{goal}",
    "degree": "{degree:d}",
    "true errors": "{true}",
    "estimated over true": "{effectivities}",
}


FIRST_MESH = {
    "scene": "{scene}",
    "nu": "{poisson:g}",
    "cells": "{cells:d}",
    "estimated": "{estimate:.1%}",
    "true": "{true_error:.1%}",
    "effectivity": "{effectivity:.2f}",
}
ORDERS = {
    "geometry order": "{geometry_order}",
    "preconditioner": "{preconditioner}",
    "dofs": "{dofs:,}",
    "iterations, last step": "{krylov_iterations_last_step:d}",
    "CPU": "{cpu_s:.1f} s",
    "over order 1 (target 1.2)": "{cpu_over_order_1:.2f}",
    "memory over order 1": "{memory_over_order_1:.2f}",
}


def markdown(rows, columns):
    """A table in Markdown.

    Args:
        rows: dicts; a value that is missing is "" or None.
        columns: heading -> form of a cell, as for str.format, or several: the first whose values are all there.
    """
    lines = [list(columns), ["--:" if ":" in "".join(form) else "---" for form in columns.values()]]
    lines += [[_cell(form, row) for form in columns.values()] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(forms, row):
    for form in (forms,) if isinstance(forms, str) else forms:
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


def by_goal(rows):
    """A row for each goal and degree: relative true errors and effectivities, mesh by mesh."""
    groups = {}
    for row in rows:
        groups.setdefault((row["scene"], row["goal"], row["degree"]), []).append(row)
    for names, group in groups.items():
        yield dict(zip(("scene", "goal", "degree"), names)) | {
            "true": ", ".join(f"{row['true'] / abs(row['known']):.2%}" for row in group),
            "effectivities": ", ".join(f"{row['effectivity']:.2g}" for row in group),
        }


def lowest(rows):
    """The row with the lowest effectivity for each Poisson's ratio."""
    ratios = dict.fromkeys(row["poisson"] for row in rows)
    return [min((r for r in rows if r["poisson"] == nu), key=lambda r: r["effectivity"]) for nu in ratios]


def by_cells(rows):
    """A row for each leaf spring: linear solves, iterations and errors of forces by the number of cells."""
    groups = {}
    for row in rows:
        groups.setdefault((row["plates"], row["slenderness"], row["bent_by"]), []).append(row)
    for names, group in groups.items():
        listed = {name: ", ".join(f"{row[name]}" for row in group) for name in ("cells", "solves", "iterations")}
        yield dict(zip(("plates", "slenderness", "bent by"), names)) | {
            "cells along": listed["cells"],
            "linear solves": listed["solves"],
            "iterations": listed["iterations"],
            "force, less that of beams": ", ".join(f"{row['force']:+.2%}" for row in group),
        }


#: The CSV files that pages show, and what makes a table of their rows.
TABLES = {name: partial(markdown, columns=columns) for name, columns in COLUMNS.items()} | {
    "studies/work_precision/points.csv": lambda rows: markdown(shown(rows), POINTS),
    "studies/work_precision/points.csv#three": lambda rows: markdown(three(rows), POINTS_OF_README),
    "studies/cost/flat.csv": lambda rows: markdown(
        [row for row in rows if row["nu"] < 0.499 and row["aspect"] != "1:2"], FLAT
    ),
    "studies/partition/table.csv": partial(markdown, columns=PARTITION),
    "studies/partition/model.csv": lambda rows: markdown(in_milliseconds(rows), MODEL),
    "studies/partition/model.csv#claims": lambda rows: plain(claims(rows)),
    "studies/partition/kernels.csv": partial(markdown, columns=KERNELS),
    "studies/stability/scores.csv": named,
    "studies/effectivity/first_mesh.csv": lambda rows: markdown(lowest(rows), FIRST_MESH),
    "studies/cost/leaf_springs.csv": lambda rows: plain(list(by_cells(rows))),
    "studies/goals/table.csv": lambda rows: markdown(by_goal(rows), GOALS),
    "studies/cost/orders.csv": lambda rows: markdown([row for row in rows if row["ranks"] == 2], ORDERS),
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
        about, rows = read(TOP / found[2].partition("#")[0])
        origin = f"(`{about['command']}`; revision {about['revision']}; {about['machine']})"
        return f"{found[1]}\n{TABLES[found[2]](rows)}\n\n{origin}\n{found[3]}"

    return re.sub(r"(<!-- table: (\S+) -->)\n.*?(<!-- end of table -->)", table, text, flags=re.S)


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
