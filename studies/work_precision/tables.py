"""Medians of the work-precision study, and what they say about its promises."""

from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from studies.tables import read
from studies.work_precision.points import Point, true_error_of_indentation

#: True errors of HERTZ-A.
TRUTH = Path(__file__).parents[1] / "effectivity/hertz_truth.csv"
#: Errors of a contact, and other figures, by their name in the records.
ERRORS = ("force", "max_pressure", "contact_radius", "pressure", "axis_stress")
FIGURES = (
    "cells",
    "dofs",
    "hanging_nodes",
    "geometry_order",
    "estimate",
    "force",
    "contact_radius",
    "max_pressure",
    "l2_error",
    "peak_memory_bytes",
)


@dataclass(frozen=True)
class Result:
    """A point and what its runs gave.

    Attributes:
        point: Point.
        runs: number of runs that ended well.
        failed: why it failed, or None.
        wall, cpu: medians [s].
        last: record of the last step.
        history: of all steps, in short.
        true: relative energy error, or None where it is not known.
    """

    point: Point
    runs: int
    failed: str | None
    wall: float
    cpu: float
    last: dict
    history: list
    true: float | None

    @property
    def error(self):
        """The true error, or the estimate where that is not known [-]."""
        return self.true or self.last["estimate"]

    @property
    def effectivity(self):
        """Estimate over true error, or None."""
        return self.last["estimate"] / self.true if self.true else None

    @property
    def kilobytes(self):
        """Peak memory of all ranks for an unknown [kB]."""
        return self.last["peak_memory_bytes"] / self.last["dofs"] / 1e3

    @property
    def iterations(self):
        """PCG iterations of the last solve in each step."""
        return [step["krylov_iterations"][-1] for step in self.history]


def medians(points, runs, of_hertz):
    """One Result for each point that has been run.

    Args:
        points: Points.
        runs: records of `runs.jsonl`.
        of_hertz: as from `true_errors_of_hertz`.
    """
    by_command = {}
    for record in runs:
        by_command.setdefault(record["command"], []).append(record)
    found = []
    for point in points:
        mine = by_command.get(point.case.command, [])
        good = [record for record in mine if "failed" not in record]
        if mine and not good:
            found.append(Result(point, 0, mine[-1]["failed"], np.nan, np.nan, {}, [], None))
        elif good:
            wall, cpu = (median(record[name] for record in good) for name in ("wall", "cpu"))
            last = good[0]["last"]
            found.append(
                Result(point, len(good), None, wall, cpu, last, good[0]["history"], _true(point, last, of_hertz))
            )
    return found


def _true(point, last, of_hertz):
    """The relative energy error of a run's last record, or None."""
    if point.group.startswith("INDENT-A"):
        return true_error_of_indentation(last["force"])
    if point.group == "HERTZ-A":
        return of_hertz.get((point.line, last["dofs"]))
    return last.get("true_error")


def true_errors_of_hertz(path=TRUTH):
    """Relative energy errors by line and unknowns, as `studies.effectivity.hertz_truth` has found them."""
    return {(row["line"], row["dofs"]): row["true_error"] for row in read(path)[1]}


def rows(found):
    """All points with all figures: dicts, a line of the CSV file each.

    Args:
        found: Results.
    """
    for r in found:
        errors = r.last.get("errors") or {}
        yield {
            "group": r.point.group,
            "line": r.point.line,
            "ranks": r.point.case.ranks,
            "command": r.point.case.command,
            "failed": r.failed,
            "runs": r.runs,
            "wall_s": r.wall,
            "cpu_s": r.cpu,
            "true_error": r.true,
            "effectivity": None if r.failed else r.effectivity,
            "kB_per_dof": None if r.failed else r.kilobytes,
            "iterations": None if r.failed else r.iterations[-1],
            **{name: r.last.get(name) for name in FIGURES},
            **{f"error_{name}": errors.get(name) for name in ERRORS},
        }


def slope(x, y):
    """Slope of the logarithms of y over those of x, by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def promises(found):
    """What is promised of degree 2, beside what was measured: dicts.

    Args:
        found: Results.
    """
    good = [r for r in found if not r.failed]
    for rows_of in (_energy, _forces, _rates, _indentation, _estimate, _solver):
        for promise, measured in rows_of(good):
            yield {"promise": promise, "measured": measured}


def _line(good, group, name):
    return [r for r in good if (r.point.group, r.point.line) == (group, name)]


def _cost(r):
    size = f"{r.last['dofs']:,} dofs, {r.cpu:.1f} CPU s, {r.last['peak_memory_bytes'] / 1e9:.1f} GB"
    return f"{r.true:.2%} with {size}"


def _energy(good):
    reached = sorted((r for r in _line(good, "HERTZ-A", "degree 2") if r.true), key=lambda r: r.cpu)
    wanted = (0.01, "130,000 dofs and 15 CPU s"), (0.003, "150 CPU s and 24 GB"), (0.001, "120 CPU s and 24 GB")
    for error, limits in wanted:
        best = next((r for r in reached if r.true <= error), None)
        if best:
            yield f"HERTZ-A: true error {error:.1%} with at most {limits}", _cost(best)


def _forces(good):
    for r in (r for r in good if r.point.group == "defaults"):
        errors = f"{r.last['errors']['force']:+.3%}, {r.last['errors']['max_pressure']:+.2%}, {r.cpu:.1f} CPU s"
        what = f"force to 0.02 %, largest pressure to 0.3 %, e = {r.last['tolerance']:.0%}"
        yield f"HERTZ-A by default: {what}: at most 8 CPU s", errors


def _rates(good):
    for group, range_, limit in (("HERTZ-A", (2e4, 4.5e5), -0.62), ("INDENT-A", (1e4, 1e6), -0.45)):
        within = [r for r in _line(good, group, "degree 2") if r.true and range_[0] < r.last["dofs"] < range_[1]]
        if len(within) > 2:
            rate = slope([r.last["dofs"] for r in within], [r.true for r in within])
            yield f"{group}: energy error like N^({limit})", f"N^({rate:.2f})"
    for degree in (2, 1):
        lasts = [r.last for r in _line(good, "manufactured", f"adaptive, degree {degree}")]
        if len(lasts) > 1:
            rate = slope([last["dofs"] for last in lasts], [last["true_error"] for last in lasts])
            yield f"manufactured, adaptive, degree {degree}: N^(-{degree}/3)", f"N^({rate:.2f})"
        for r in _line(good, "manufactured", f"uniform, degree {degree}"):
            steps = r.history[-2:]
            if len(steps) == 2:
                dofs, *errors = ([step[name] for step in steps] for name in ("dofs", "true_error", "l2_error"))
                orders = " and ".join(f"{-3 * slope(dofs, values):.2f}" for values in errors)
                yield f"manufactured, uniform, degree {degree}: order {degree} in energy, {degree + 1} in L2", orders


def _indentation(good):
    """CPU seconds for a true error of 3 %, between the points of each degree."""
    seconds = {}
    for degree in (1, 2):
        line = sorted(_line(good, "INDENT-A", f"degree {degree}"), key=lambda r: -r.true)
        if len(line) < 2:
            return
        seconds[degree] = float(np.exp(_logarithmic(np.log(0.03), *np.log([(r.true, r.cpu) for r in line]).T)))
    told = ", ".join(f"degree {degree} {value:.0f} CPU s" for degree, value in seconds.items())
    yield "INDENT-A: true error 3 % in a quarter of degree 1's CPU", f"{told}: {seconds[2] / seconds[1]:.2f}"
    for r in _line(good, "INDENT-A full", "degree 2"):
        yield "the same, all four quarters", _cost(r)


def _logarithmic(x, known_x, known_y):
    """Linear interpolation, and extrapolation by all points; x descends."""
    if known_x[-1] <= x <= known_x[0]:
        return np.interp(-x, -known_x, known_y)
    return np.polyval(np.polyfit(known_x, known_y, 1), x)


def _estimate(good):
    for group in ("HERTZ-A", "INDENT-A", "manufactured"):
        for degree in (2, 1):
            lines = [f"degree {degree}", f"adaptive, degree {degree}"]
            values = [r.effectivity for name in lines for r in _line(good, group, name) if r.true]
            if values:
                yield f"effectivity, {group}, degree {degree}: 0.8 to 1.25", f"{min(values):.2f} to {max(values):.2f}"


def _solver(good):
    for group in ("HERTZ-A", "INDENT-A"):
        line = _line(good, group, "degree 2")
        if line:
            largest = max(line, key=lambda r: r.last["dofs"])
            told = ", ".join(map(str, largest.iterations))
            yield f"{group}: at most 25 PCG iterations of the last solve, in each step", told
            nearest = min(line, key=lambda r: abs(np.log(r.last["dofs"] / 3e5)))
            if 2e5 < nearest.last["dofs"] < 4.5e5:
                told = f"{nearest.kilobytes:.2f} kB at {nearest.last['dofs']:,} dofs"
                yield f"{group}: at most 3 kB a dof at 300,000", told
    orders = {r.point.case.options.split("--order ")[1]: r for r in good if r.point.group == "orders"}
    if {"2", "6"} <= set(orders):
        step = orders["6"].history[-1]
        share = step["krylov_iterations"][-1] / sum(step["krylov_iterations"])
        told = 1e6 * (step["cpu"]["setup"] + share * step["cpu"]["solve"]) / step["dofs"]
        yield "set-up and one solve on one core: at most 20 microseconds a dof", f"{told:.0f}"
        yield "order 6 at most 1.3 times order 2", f"{orders['6'].cpu / orders['2'].cpu:.2f} in CPU seconds"
