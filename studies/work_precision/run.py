"""Error against run time: what do degree 2, adaptive refinement and curved cells buy, and is what was promised kept?

Every point is a command, printed in the tables. Times are those of all steps without compilation, medians of the
repetitions. Errors are true errors, against references that do not come from this program; energy errors of HERTZ-A are
those of `studies.effectivity.hertz_truth`, as kept. Runs that fail are shown as failed. An interrupted
study goes on where it stopped.

    python3 -m studies.work_precision.run              # all points: half an hour on two cores
    python3 -m studies.work_precision.run --quick      # the small ones, each once: 2 minutes
    python3 -m studies.work_precision.run --plot-only  # tables and plots of the runs that are there

Results go to results/work_precision: runs.jsonl (each run), points.csv, promises.csv and the plots as PNG and SVG.
"""

import json
import time

from studies.runs import RunFailed, cpu, run, wall
from studies.tables import machine, options, plain, write
from studies.work_precision.figures import draw
from studies.work_precision.points import points
from studies.work_precision.tables import medians, promises, rows, true_errors_of_hertz

REPEATS = 3
#: A run that took longer than this is not repeated; one that takes longer than the other is stopped [s].
_ONCE, _LIMIT = 12.0, 1800.0


def one_run(point, repeat, folder):
    """Run a point once: the line of runs.jsonl."""
    record = {"command": point.case.command, "repeat": repeat, "date": time.strftime("%Y-%m-%d %H:%M:%S")}
    record |= {"machine": machine()}
    try:
        steps, seconds = run(point.case, folder / "runs" / point.case.name, _LIMIT)
    except RunFailed as error:
        return record | {"failed": str(error)}
    last = {
        name: value for name, value in steps[-1].items() if name not in ("memory_bytes", "seconds", "cpu_seconds")
    }
    counted = {"wall": wall(steps), "cpu": cpu(steps), "steps": len(steps), "process_seconds": seconds}
    counted["compile"] = sum(step["seconds"]["compile"] for step in steps)
    history = [{name: s[name] for name in HISTORY if name in s} | {"cpu": s["cpu_seconds"]} for s in steps]
    return record | counted | {"last": last, "history": history}


#: Columns that are printed.
PRINTED = ("group", "line", "dofs", "failed", "true_error", "estimate", "error_force", "cpu_s", "promise", "measured")
#: What is kept of the steps before the last.
HISTORY = ("cells", "dofs", "krylov_iterations", "estimate", "true_error", "l2_error", "effectivity", "force")


def measure(wanted, folder, repeats):
    """Run what has not been run: runs.jsonl grows by a line a run."""
    path, known = folder / "runs.jsonl", {}
    for record in load(path):
        known.setdefault(record["command"], []).append(record)
    with path.open("a") as file:
        for number, point in enumerate(wanted, 1):
            runs = known.setdefault(point.case.command, [])
            while len(runs) < repeats and not any(_settled(r) for r in runs):
                print(f"{number} of {len(wanted)}: {point.case.command}", flush=True)
                runs.append(one_run(point, len(runs), folder))
                file.write(json.dumps(runs[-1]) + "\n")
                file.flush()


def _settled(record):
    """Whether a run is not to be repeated: it failed or took long."""
    return "failed" in record or record["wall"] > _ONCE


def load(path):
    """The runs in a file, none if it is not there; a line cut short by an interruption is dropped from it."""
    if not path.exists():
        return []
    records, good = [], ""
    for line in path.read_text().splitlines(keepends=True):
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
        good += line if line.endswith("\n") else line + "\n"
    path.write_text(good)
    return records


def main():
    """Run, write tables, draw."""
    parser = options(__doc__, "work_precision")
    parser.add_argument("--quick", action="store_true", help="few small points, each once: under 2 minutes")
    parser.add_argument(
        "--plot-only", action="store_true", help="run nothing: tables and plots of the runs there are"
    )
    parser.add_argument("--repeats", type=int, help=f"runs of a point that takes under {_ONCE:.0f} s ({REPEATS})")
    arguments = parser.parse_args()
    folder = arguments.output.resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        parser.error(f"cannot make {str(arguments.output)!r}: {error.strerror}")
    wanted = points(arguments.quick)
    if not arguments.plot_only:
        measure(wanted, folder, arguments.repeats or (1 if arguments.quick else REPEATS))
    runs = load(folder / "runs.jsonl")
    found = medians(wanted, runs, true_errors_of_hertz())
    if not found:
        parser.error(f"there are no runs in {folder}")
    made_by = None  # this command
    if arguments.plot_only:
        made_by = "python3 -m studies.work_precision.run" + " --quick" * arguments.quick
    for name, table in (("points", list(rows(found))), ("promises", list(promises(found)))):
        write(folder / f"{name}.csv", table, made_by)
        print(plain([{key: row[key] for key in row if key in PRINTED} for row in table]), end="\n\n")
    if {"HERTZ-A", "INDENT-A"} <= {r.point.group for r in found if not r.failed}:
        draw(found, folder, _told(runs))
    print(f"results in {arguments.output}")


def _told(runs):
    """Machine and versions in one line."""
    good = [record for record in runs if "failed" not in record]
    versions = good[-1]["last"].get("versions", {}) if good else {}
    parts = [f"{name} {version}" for name, version in versions.items()]
    return f"{runs[-1]['machine']}; {', '.join(parts)}; {runs[-1]['date'][:10]}"


if __name__ == "__main__":
    main()
