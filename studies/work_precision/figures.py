"""Plots of the work-precision study: logarithmic, and readable without colour by markers and line styles."""

from itertools import cycle
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from studies.work_precision.points import DEFAULT
from studies.work_precision.tables import digits, efficacy

plt.rcParams |= {"svg.hashsalt": "fx_contact", "font.size": 10}

#: Colour (Okabe and Ito), marker and line style, in the order of the lines; the default method is always the first.
_STYLES = [
    dict(color=color, marker=marker, ls=ls)
    for color, marker, ls in zip(
        ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999999"),
        "osD^vPX*",
        ("-", "--", "-.", ":", "-", "--", "-.", ":"),
    )
]


def draw_all(found, folder, told):
    """Draw what there are results for.

    Args:
        found: Results.
        folder: Path.
        told: machine and versions, written below each plot.

    Returns:
        names of the pictures.
    """
    names = []
    for name, draw in (
        ("work_precision", _main),
        ("settings", _settings),
        ("tas", _tas),
        ("estimate", _estimate),
        ("geometry", _geometry),
    ):
        figure = draw(found, folder)
        if figure is None:
            continue
        figure.text(0.005, 0.005, told, fontsize=6.5, color="#555555", ha="left", va="bottom")
        for kind in ("png", "svg"):
            figure.savefig(folder / f"{name}.{kind}", dpi=140)
        plt.close(figure)
        names.append(f"{name}.png")
    return names


def _main(found, _folder):
    """True energy error and force error against wall seconds: what adaptivity and geometry buy."""
    lines = _lines(found, ("adaptivity", "geometry"))
    lines |= {name: rows for name, rows in _lines(found, ("solver",)).items() if name.endswith("1 rank")}
    if not any(lines.values()):
        return None
    figure, panels = _figure(3)
    for axes, (x, y, xlabel, ylabel) in zip(
        panels,
        (
            (_wall, _error, "wall time of all steps [s]", "relative energy error [%]"),
            (_cpu, _error, "CPU time of all ranks and steps [s]", "relative energy error [%]"),
            (_wall, _of("force"), "wall time of all steps [s]", "force error [%]"),
        ),
    ):
        _draw(axes, lines, x, y, xlabel, ylabel)
    _legend(figure, panels[0])
    return figure


def _settings(found, _folder):
    """Enforcements by their pressure error, preconditioners by the energy error, both against time."""
    best = {DEFAULT: _lines(found, ("adaptivity",)).get(DEFAULT, [])}
    hard, solvers = ({**best, **_lines(found, (name,))} for name in ("enforcement", "solver"))
    if not any(hard.values()) or not any(solvers.values()):
        return None
    figure, panels = _figure(3)
    _draw(panels[0], hard, _wall, _of("pressure"), "wall time [s]", "pressure profile error, L2 [%]")
    _draw(panels[1], hard, _wall, _of("force"), "wall time [s]", "force error [%]")
    _draw(panels[2], solvers, _wall, _error, "wall time [s]", "relative energy error [%]")
    for axes, place, columns in ((panels[0], 0.31, 4), (panels[2], 0.81, 3)):
        _legend(figure, axes, place, columns)
    return figure


def _tas(found, _folder):
    """Time, accuracy and size: digits against digits of size and against time, dofs a second, efficacy."""
    lines = _lines(found, ("adaptivity", "geometry"))
    if not any(lines.values()):
        return None
    figure, panels = plt.subplots(2, 2, figsize=(10, 8.2), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.09, 1, 0.91))
    panels = panels.ravel()
    for axes, (x, y, xlabel, ylabel) in zip(
        panels,
        (
            (_dofs, lambda r: digits(r.error), "conforming dofs", "digits of accuracy"),
            (_wall, lambda r: digits(r.error), "wall time [s]", "digits of accuracy"),
            (
                _dofs,
                lambda r: r.last["dofs"] / r.wall,
                "conforming dofs",
                "dofs of the last mesh a wall second [1/s]",
            ),
            (_dofs, efficacy, "conforming dofs", "efficacy, -log10(error x wall seconds)"),
        ),
    ):
        for (name, rows), style in _styled(lines):
            axes.plot([x(r) for r in rows], [y(r) for r in rows], label=name, ms=6, lw=1.4, **style)
        axes.set(xlabel=xlabel, ylabel=ylabel, xscale="log")
        _finish(axes)
    panels[2].set_yscale("log")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", bbox_to_anchor=(0.5, 0.025), ncols=3, frameon=False, fontsize=9
    )
    return figure


def _estimate(found, _folder):
    """Can the estimate be trusted: effectivity against the true error; error against dofs on the manufactured case."""
    rings = {
        name: [step for r in rows for step in r.history] if "uniform" in name else [r.last for r in rows]
        for name, rows in _lines(found, ("references",)).items()
        if name.startswith("manufactured")
    }
    if not rings:
        return None
    figure, (left, right) = _figure(2, legends=True)
    lines = _lines(found, ("adaptivity", "geometry"))
    shown = [(name, [(r.true, r.effectivity) for r in rows if r.true]) for name, rows in lines.items()]
    shown += [(n, sorted({(s["true_error"], s["effectivity"]) for s in steps})) for n, steps in rings.items()]
    left.axhspan(0.9, 1.1, color="#dddddd", lw=0, label="0.9 to 1.1")
    for (name, pairs), style in zip(shown, cycle(_STYLES)):
        if pairs and "straight" not in name:
            left.plot(100 * np.array(pairs)[:, 0], np.array(pairs)[:, 1], label=name, ms=6, lw=1.4, **style)
    left.set(xscale="log", xlabel="true relative energy error [%]", ylabel="effectivity, estimate / true error")
    _plain_percent(left.xaxis)
    for (name, steps), style in zip(rings.items(), _STYLES):
        steps = sorted({step["dofs"]: step for step in steps}.values(), key=lambda step: step["dofs"])
        dofs = np.array([step["dofs"] for step in steps])
        for key, what, fill in (("true_error", "energy", style["color"]), ("l2_error", "L2", "white")):
            values = 100 * np.array([step[key] for step in steps])
            right.loglog(dofs, values, label=f"{name}, {what}", ms=6, lw=1.4, mfc=fill, **style)
            if "uniform" in name:
                order = 1 if what == "energy" else 2
                ideal = values[-1] * (dofs / dofs[-1]) ** (-order / 3) * 0.7
                right.loglog(
                    dofs, ideal, color="#888888", lw=0.9, label=f"order {order}", ls="-" if order == 1 else ":"
                )
    right.set(xlabel="dofs", ylabel="relative error [%]")
    _plain_percent(right.yaxis)
    for axes in (left, right):
        _finish(axes)
        axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    return figure


def _geometry(found, folder):
    """The paper's figure 1: meshes and pressures of straight and of curved cells side by side."""
    rows = [r for r in found if r.point.group == "picture" and not r.failed]
    places = [folder / "runs" / r.point.case.name for r in rows]
    if len(rows) < 2 or not all((place / "mesh.png").exists() for place in places):
        return None
    figure, panels = plt.subplots(2, 2, figsize=(10, 7.6), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.03, 1, 0.97))
    for column, (r, place) in enumerate(zip(rows, places)):
        title = f"{r.point.line}: {r.last['dofs']:,} dofs, estimated error {r.last['estimate']:.1%}"
        panels[0][column].set_title(title, fontsize=11)
        for axes, name in zip(panels[:, column], ("mesh.png", "pressure.png")):
            axes.imshow(plt.imread(Path(place) / name), interpolation="antialiased")
            axes.axis("off")
    return figure


def _figure(count, legends=False):
    figure, panels = plt.subplots(1, count, figsize=(4.4 * count, 4.6 + 0.5 * legends), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.04 if legends else 0.13, 1, 0.96 if legends else 0.87))
    return figure, panels


def _legend(figure, axes, place=0.5, columns=4):
    handles, labels = axes.get_legend_handles_labels()
    where = dict(loc="lower center", bbox_to_anchor=(place, 0.03), ncols=columns)
    figure.legend(handles, labels, frameon=False, fontsize=9, **where)


def _lines(found, groups):
    """Results by line, in the order of the points; those that failed have no place in a plot but its legend."""
    lines, failed = {}, {}
    for result in found:
        if result.point.group in groups:
            (failed if result.failed else lines).setdefault(result.point.line, []).append(result)
    for name, missing in failed.items():
        lines[f"{name}, {len(missing)} failed"] = lines.pop(name, [])
    return lines


def _styled(lines):
    return zip(lines.items(), cycle(_STYLES))


def _draw(axes, lines, x, y, xlabel, ylabel):
    """One panel; hollow markers: the estimate stands for a true error that is not known."""
    for (name, rows), style in _styled(lines):
        rows = [r for r in rows if y(r) is not None]
        axes.loglog([x(r) for r in rows], [y(r) for r in rows], label=name, ms=6, lw=1.4, **style)
        if y is _error:
            hollow = [r for r in rows if not r.true]
            axes.plot([x(r) for r in hollow], [y(r) for r in hollow], "o", ms=3, mfc="white", mec="white", zorder=5)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    for axis in (axes.xaxis, axes.yaxis):
        _plain_percent(axis)
    _finish(axes)


def _plain_percent(axis):
    """Plain numbers at 1, 2, 5, 10, ..."""
    low, high = sorted(axis.get_data_interval())
    wide = low > 0 and high / low > 300
    axis.set_major_locator(LogLocator(subs=(1,) if wide else (1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _finish(axes):
    axes.grid(which="major", color="#e4e4e4", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _wall(result):
    return result.wall


def _cpu(result):
    return result.cpu


def _dofs(result):
    return result.last["dofs"]


def _error(result):
    return 100 * result.error


def _of(name):
    """A function that gives a deviation from the reference in percent, or None where there is none."""
    return lambda r: 100 * abs(r.last["errors"][name]) if name in (r.last.get("errors") or {}) else None
