"""Plots of the work-precision study: logarithmic, and readable without colour by markers and line styles."""

import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from studies.work_precision.tables import slope

plt.rcParams |= {"svg.hashsalt": "fx_contact", "font.size": 10}

#: Colour (Okabe and Ito), marker and line style of each line.
_STYLES = {
    line: dict(color=color, marker=marker, ls=ls)
    for line, color, marker, ls in (
        ("degree 2", "#000000", "o", "-"),
        ("degree 1", "#D55E00", "s", "-"),
        ("uniform, degree 2", "#0072B2", "D", "--"),
        ("uniform, degree 1", "#009E73", "^", "--"),
        ("straight cells, degree 2", "#CC79A7", "v", ":"),
    )
}


#: What is to be known of all panels.
_ABOUT = """Triangles: rates of theory for the energy error,
N$^{-2/3}$ at degree 2 and N$^{-1/3}$ at degree 1;
at degree 2 N$^{-1/2}$, where the cube's edges are
singular: cells there are not stretched.

Numbers at the lines: slopes fitted to all points
but the first.

A white dot: the estimate, where the true error
would cost too much."""


def draw(found, folder, told):
    """Energy error against unknowns, with the slopes of theory, and against CPU seconds; force error of HERTZ-A.

    Args:
        found: Results, some of both benchmarks.
        folder: Path, for work_precision.png and .svg.
        told: machine and versions, written below.
    """
    hertz, indentation = (_lines(found, group) for group in ("HERTZ-A", "INDENT-A"))
    figure, panels = plt.subplots(2, 3, figsize=(13.5, 8.2), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.025, 1, 0.975))
    for row, lines, name in ((panels[0], hertz, "HERTZ-A"), (panels[1], indentation, "INDENT-A")):
        for axes, x in zip(row, (_dofs, _cpu)):
            _draw(axes, lines, x, _energy)
            axes.set_title(f"{name}: energy error", fontsize=11)
    _triangle(panels[0, 0], 3e4, 0.6, "-2/3")
    _triangle(panels[0, 0], 4.5e4, 8, "-1/3", above=True)
    _triangle(panels[1, 0], 6e4, 4.2, "-1/2")
    _triangle(panels[1, 0], 3e5, 6.5, "-1/3", above=True)
    _draw(panels[0, 2], hertz, _cpu, _force)
    panels[0, 2].set_title("HERTZ-A: force error", fontsize=11)
    panels[1, 2].axis("off")
    shown = {label: line for axes in panels.flat for line, label in zip(*axes.get_legend_handles_labels())}
    panels[1, 2].legend(shown.values(), shown.keys(), loc="upper left", frameon=False)
    panels[1, 2].text(0.04, 0.58, _ABOUT, va="top", linespacing=1.5, fontsize=9.5)
    figure.text(0.005, 0.005, told, fontsize=6.5, color="#555555", ha="left", va="bottom")
    for kind in ("png", "svg"):
        figure.savefig(folder / f"work_precision.{kind}", dpi=110)
    plt.close(figure)


def _triangle(axes, x, y, fraction, above=False):
    """A right-angled triangle over a third of a decade from (x, y), whose longest side has a slope, a fraction."""
    over, under = map(float, fraction.split("/"))
    far, low = 2.5 * x, y * 2.5 ** (over / under)
    corner = (far, y) if above else (x, low)
    axes.fill(*zip((x, y), (far, low), corner), facecolor="#eeeeee", edgecolor="#555555", lw=0.8, zorder=0)
    middle = ((x * far) ** 0.5, (y * 1.08 if above else low / 1.08))
    axes.text(*middle, fraction, ha="center", va="bottom" if above else "top", fontsize=9, color="#333333")


def _lines(found, group):
    """Results by line, those that failed with them."""
    lines = {}
    for result in found:
        if result.point.group == group:
            lines.setdefault(result.point.line, []).append(result)
    return lines


def _draw(axes, lines, x, y):
    """One panel, slopes over a decade at the ends of lines; hollow: the estimate, not the true error."""
    for name, rows in lines.items():
        good = sorted((r for r in rows if not r.failed and y(r) is not None), key=x)
        at, values = [x(r) for r in good], [y(r) for r in good]
        label = name + (f", {len(rows) - len(good)} failed" if len(good) < len(rows) else "")
        axes.loglog(at, values, label=label, ms=6, lw=1.4, **_STYLES[name])
        if y is _energy and len(good) > 2 and at[-1] > 10 * at[0] and "straight" not in name:
            told, colour = f"{slope(at[1:], values[1:]):.2f}", _STYLES[name]["color"]
            place = {"xytext": (8, 0), "textcoords": "offset points", "va": "center"}
            axes.annotate(told, (at[-1], values[-1]), color=colour, fontsize=9, annotation_clip=False, **place)
        if y is _energy:
            hollow = [r for r in good if not r.true]
            axes.plot([x(r) for r in hollow], [y(r) for r in hollow], "o", ms=3, mfc="white", mec="white", zorder=5)
    axes.set(xlabel=x.__doc__, ylabel=y.__doc__)
    for axis in (axes.xaxis, axes.yaxis):
        _plain(axis)
    axes.grid(which="major", color="#e4e4e4", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _plain(axis):
    """Plain numbers at 1, 2, 5, 10, ..., long ones at powers of ten alone."""
    low, high = sorted(axis.get_data_interval())
    axis.set_major_locator(LogLocator(subs=(1,) if high / low > 300 or high > 1e4 else (1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.7g}"))
    axis.set_minor_formatter(NullFormatter())


def _cpu(result):
    """CPU seconds of all ranks and steps"""
    return result.cpu


def _dofs(result):
    """unknowns"""
    return result.last["dofs"]


def _energy(result):
    """true relative energy error [%]"""
    return 100 * result.error


def _force(result):
    """force error [%]"""
    return 100 * abs(result.last["errors"]["force"])
