"""Medians of the work-precision study, and what they say about its promises."""

from dataclasses import dataclass
from statistics import median

import numpy as np

from studies.work_precision.points import DEFAULT, Point

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
    "max_penetration",
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


def medians(points, runs):
    """One Result for each point that has been run.

    Args:
        points: Points.
        runs: records of `runs.jsonl`.
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
            last, true = good[0]["last"], good[0]["last"].get("true_error")
            true = true["relative"] if isinstance(true, dict) else true
            if point.same and true is None:
                true = _same_true(last, by_command.get(point.same.command, []))
            wall, cpu = (median(record[name] for record in good) for name in ("wall", "cpu"))
            found.append(Result(point, len(good), None, wall, cpu, last, good[0]["history"], true))
    return found


def _same_true(last, others):
    """The true error of the same discrete solution, if its force shows that it is the same."""
    for other in others:
        if "failed" not in other and abs(other["last"]["force"] / last["force"] - 1) < 1e-6:
            return other["last"]["true_error"]["relative"]
    return None


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
            **{name: r.last.get(name) for name in FIGURES},
            **{f"error_{name}": errors.get(name) for name in ERRORS},
        }


def _signed(value):
    return f"{value:+.2%}" if abs(value) >= 5e-5 else f"{value:+.1e}"


def slope(x, y):
    """Slope of the logarithms of y over those of x, by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def promises(found):
    """What the study promises, beside what was measured: dicts."""
    good = [r for r in found if not r.failed]
    for promise, measured in (*_manufactured(good), *_trust(good), *_against_uniform(good), *_promised(good)):
        yield {"promise": promise, "measured": measured}


def _line(good, name):
    return [r for r in good if r.point.line == name]


def _manufactured(good):
    for r in _line(good, "manufactured, uniform")[-1:]:
        steps = r.history[-2:]
        if len(steps) < 2:
            continue
        dofs, energy, l2 = ([step[name] for step in steps] for name in ("dofs", "true_error", "l2_error"))
        orders = f"{-3 * slope(dofs, energy):.2f} and {-3 * slope(dofs, l2):.2f}"
        yield "manufactured, uniform: order 1 in energy, 2 in L2", orders
    lasts = [r.last for r in _line(good, "manufactured, adaptive")]
    if len(lasts) > 1:
        rate = slope([last["dofs"] for last in lasts], [last["true_error"] for last in lasts])
        yield "manufactured, adaptive: energy error like N^(-1/3)", f"N^({rate:.2f})"


def _trust(good):
    """Effectivity at e <= 8 % where the geometry is curved and the enforcement hard: the whole error is estimated."""
    lines = (DEFAULT, "order 2", "order 6", "uniform, order 3", "penalty c = 1e4", "penalty c = 1e8")
    hertz = [r.effectivity for r in good if r.point.line in lines and r.true and r.last["estimate"] <= 0.08]
    ring = [
        step["effectivity"]
        for r in good
        if r.point.line.startswith("manufactured")
        for step in r.history
        if step["estimate"] <= 0.08
    ]
    for name, values in (("manufactured", ring), ("Hertz", hertz)):
        if values:
            yield f"effectivity at e <= 8 %, {name}: 0.9 to 1.1", f"{min(values):.3f} to {max(values):.3f}"


def _against_uniform(good):
    """Adaptive at 4 % against uniform: as measured on the largest uniform mesh, and extrapolated to the same error."""
    best = [r for r in _line(good, DEFAULT) if r.last["tolerance"] == 0.04]
    uniform = sorted(_line(good, "uniform, order 3"), key=lambda r: r.last["dofs"])
    if not best or len(uniform) < 2:
        return
    best, largest = best[0], uniform[-1]
    yield (
        "adaptive reaches 4 % with 10 x fewer dofs and 5 x less time than uniform",
        f"uniform is at {largest.error:.1%} with {largest.last['dofs'] / best.last['dofs']:.1f} x the dofs and "
        f"{largest.wall / best.wall:.1f} x the time; extrapolated by N^(-1/3) to {best.error:.1%}: "
        f"{largest.last['dofs'] / best.last['dofs'] * (largest.error / best.error) ** 3:.0f} x the dofs",
    )


def _promised(good):
    for r in _line(good, DEFAULT):
        if r.true and r.last["tolerance"] == 0.04:
            yield "true error at e = 4 %: 2 to 4.4 %", f"{r.true:.2%}"
    for name in (DEFAULT, "order 6"):
        rows = [r for r in _line(good, name) if r.true and r.last["tolerance"] <= 0.08]
        if len(rows) > 1:
            rate = slope([r.true for r in rows], [abs(r.last["errors"]["force"]) for r in rows])
            signed = ", ".join(_signed(r.last["errors"]["force"]) for r in rows)
            yield f"force error like the square of the energy error, {name}", f"power {rate:.2f} ({signed})"
        rows = [r for r in _line(good, name) if r.true]
        if rows:
            shares = ", ".join(f"{abs(r.last['errors']['force']) / r.true**2:.2f}" for r in rows)
            yield f"the same, force error over the square of the true energy error, {name}: bounded", shares


def digits(error):
    """Digits of accuracy: -log10 of the relative error."""
    return -np.log10(error)


def efficacy(result):
    """Digits of error times time: -log10(error x wall seconds); more is better."""
    return -np.log10(result.error * result.wall)
