"""What the parameters of `ErrorControl` do: each halved and doubled, as far as it may be, the others as they are.

    python3 -m studies.parameters.run [--only PARAMETER ...] [--scene NAME ...]

Displacements have degree 2, on one rank.  `true_error` is that
of the last step in the energy norm, by a solution with half of the tolerance; `error_force` is against the reference of
`SCENES`.  It leaves table.csv and summary.csv in results/parameters.
"""

import argparse
from functools import partial
from pathlib import Path

from fx_contact import ErrorControl, adapt
from fx_contact.results import true_error
from fx_contact.scenes import hertz, indentation
from studies.runs import STAGES
from studies.stability.references import HERTZ_A
from studies.stability.shapes import beam, films, four_supports
from studies.tables import plain, write
from studies.work_precision.points import INDENT_A, true_error_of_indentation

#: Scenes: how one is made, its tolerance, and its force [N]: of references that do not use this program, of a bar, or
#: this program's on uniform meshes (tests/estimate/test_contact_goals.py); None: nothing closes.
SCENES = {
    "hertz": (partial(hertz, 1.0, 0.01, order=6), 0.04, HERTZ_A.force),
    "hertz, closer": (partial(hertz, 1.0, 0.01, order=6), 0.02, HERTZ_A.force),
    "indentation": (indentation, 0.06, INDENT_A),
    "film, whose weight is the load": (partial(films, order=1, weight=4.0), 0.2, 1e-3),
    "wavy film beside a pressure": (partial(films, 1e-4, pressure=0.1), 0.3, 1.16e-3),
    "beam on four supports": (four_supports, 0.07, 9e-4),
    "beam, gap that closes late": (partial(beam, 0.98), 0.2, 1.04e-6),
    "beam, wide gap beside the wall": (partial(beam, 0.9, tension=3e-3, near=1e-3), 0.3, 3.98e-6),
    "beam, a heavier load far away": (partial(beam, 0.8, beside=0.1), 0.1, 2.29e-5),
    "beam, gap that stays open": (partial(beam, 1.01), 0.3, None),
}
#: Values that are tried; a share is at most 1.
VALUES = {"target": (0.45, 1.0), "least_effectivity": (0.2, 0.8)}


#: Unknowns with which a run ends at the latest.
MOST = 300_000


def solved(scene, tolerance, **parameters):
    """The last step of a run, and the records of all."""
    records = []
    for last in adapt(scene, tolerance, control=ErrorControl(**parameters)):
        records.append(last.record)
        if last.record.dofs > MOST:
            break
    return last, records


def energy_error(last, tolerance):
    """The true error in the energy norm of the last step of the two benchmarks; None: the estimate has to do."""
    if last.scene.name == "indentation":
        return true_error_of_indentation(last.record.force)
    return true_error(last, tolerance / 2).relative if last.scene.name == "hertz" else None


def figures(scene, tolerance, force, known, **parameters):
    """Figures of a run.

    Args:
        scene, tolerance, force: as in `SCENES`.
        known: dict, what was found before of runs with the same steps; more is written to it.
        parameters: of the ErrorControl.
    """
    last, steps = solved(scene, tolerance, **parameters)
    alike = tuple((step.dofs, f"{step.force:.6e}") for step in steps)
    if alike not in known:
        known[alike] = {
            "steps": len(steps),
            "dofs": last.record.dofs,
            "dofs_of_all_steps": sum(step.dofs for step in steps),
            "cpu_s": sum(step.cpu_seconds[name] for step in steps for name in STAGES),
            "reached": int(last.record.reached),
            "estimate": last.record.estimate,
            "true_error": energy_error(last, tolerance),
            "error_force": last.record.force / force - 1 if force else last.record.force,
        }
    return known[alike]


def measured(only, names):
    """Rows of the table."""
    for name in names:
        make, tolerance, force = SCENES[name]
        scene, known = make(), {}
        base = figures(scene, tolerance, force, known)
        yield {"scene": name, "tolerance": tolerance, "parameter": "", "value": "", "same": "", **base}
        for parameter, values in VALUES.items():
            for value in values if parameter in (only or VALUES) else ():
                found = figures(scene, tolerance, force, known, **{parameter: value})
                same = "same" if found is base else ""
                about = {"scene": name, "tolerance": tolerance, "parameter": parameter, "value": value, "same": same}
                yield about | found


def summary(rows):
    """What each value does to all scenes: rows."""
    base = {row["scene"]: row for row in rows if not row["parameter"]}
    for parameter, values in VALUES.items():
        for value in values:
            some = [row for row in rows if (row["parameter"], row["value"]) == (parameter, value)]
            other = [row for row in some if not row["same"]]
            result = {"parameter": parameter, "default": getattr(ErrorControl, parameter), "value": value}
            result |= {"changed": len(other), "not_reached": sum(not row["reached"] for row in some)}
            for figure in ("dofs_of_all_steps", "cpu_s"):
                ratios = [row[figure] / base[row["scene"]][figure] for row in other] or [1.0]
                result |= {f"{figure}_least": min(ratios), f"{figure}_most": max(ratios)}
            for figure in ("true_error", "error_force"):
                errors = [abs(row[figure]) / row["tolerance"] for row in some if row[figure] is not None]
                result[figure] = max(errors, default=None)
            yield result


def main():
    """Measure; print the summary and keep both tables."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--only", nargs="+", choices=VALUES, help="parameters (all)")
    options.add_argument("--scene", nargs="+", choices=SCENES, default=SCENES, metavar="NAME", help=", ".join(SCENES))
    options.add_argument("--output", type=Path, default=Path("results/parameters"), help="folder (%(default)s)")
    given, rows = options.parse_args(), []
    for row in measured(given.only, given.scene):
        rows.append(row)
        print(plain([row]).splitlines()[-1], flush=True)
    write(given.output / "table.csv", rows)
    table = list(summary(rows))
    write(given.output / "summary.csv", table)
    print(plain(table))


if __name__ == "__main__":
    main()
