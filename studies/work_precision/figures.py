"""Plots of the work-precision study: logarithmic, and readable without colour by markers and line styles."""

from pathlib import Path

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
    for name, draw in (("work_precision", _main), ("geometry", _geometry)):
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
    """Energy and force error against CPU seconds, and energy error of the indentation against seconds and unknowns."""
    hertz, indentation = (_lines(found, group) for group in ("HERTZ-A", "INDENT-A"))
    if not any(hertz.values()) or not any(indentation.values()):
        return None
    figure, panels = plt.subplots(2, 2, figsize=(10, 8.6), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.025, 1, 0.975))
    for axes, lines, x, y, title in (
        (panels[0, 0], hertz, _cpu, _energy, "HERTZ-A: energy error (theory: slopes -2/3 and -1/3)"),
        (panels[0, 1], hertz, _cpu, _force, "HERTZ-A: force error"),
        (panels[1, 0], indentation, _cpu, _energy, "INDENT-A: energy error (theory: slopes -1/2 and -1/3)"),
        (panels[1, 1], indentation, _dofs, _energy, "INDENT-A: energy error"),
    ):
        _draw(axes, lines, x, y)
        axes.set_title(title, fontsize=11)
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


def _lines(found, group):
    """Results by line, those that failed with them."""
    lines = {}
    for result in found:
        if result.point.group == group:
            lines.setdefault(result.point.line, []).append(result)
    return lines


def _draw(axes, lines, x, y):
    """One panel, slopes over a decade in its legend; hollow: the estimate stands for a true error that is not known."""
    for name, rows in lines.items():
        good = sorted((r for r in rows if not r.failed and y(r) is not None), key=x)
        at, values = [x(r) for r in good], [y(r) for r in good]
        label = name
        if y is _energy and len(good) > 2 and at[-1] > 10 * at[0] and "straight" not in name:
            label += f": slope {slope(at[1:], values[1:]):.2f}"
        if len(good) < len(rows):
            label += f", {len(rows) - len(good)} failed"
        axes.loglog(at, values, label=label, ms=6, lw=1.4, **_STYLES[name])
        if y is _energy:
            hollow = [r for r in good if not r.true]
            axes.plot([x(r) for r in hollow], [y(r) for r in hollow], "o", ms=3, mfc="white", mec="white", zorder=5)
    axes.set(xlabel=x.__doc__, ylabel=y.__doc__)
    for axis in (axes.xaxis, axes.yaxis):
        _plain(axis)
    axes.grid(which="major", color="#e4e4e4", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8.5)


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
