"""Pictures of the partition study."""

import matplotlib
import numpy as np

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

from studies.pictures.files import with_few_colours  # noqa: E402

STYLES = {
    "contact-sfc": dict(color="#0072B2", marker="o"),
    "contact-sfc, curve only": dict(color="#56B4E9", marker=".", ls=":"),
    "sfc": dict(color="#009E73", marker="s"),
    "graph": dict(color="#000000", marker="^"),
    "equidistributed": dict(color="#D55E00", marker="v"),
}
STAGE_COLOURS = dict(
    zip(("tree", "assemble", "setup", "solve", "estimate"), ("#009E73", "#E69F00", "#CC79A7", "#0072B2", "#999999"))
)


def draw_cuts(rows, path):
    """Cut facets of each kind against the number of parts, one panel a benchmark.

    Args:
        rows: Scores.
        path: of the PNG.
    """
    scenes = list(dict.fromkeys(row.scene for row in rows))
    figure, panels = plt.subplots(
        1, len(scenes), figsize=(5.2 * len(scenes), 4.2), layout="constrained", squeeze=False
    )
    for axes, scene in zip(panels[0], scenes):
        here = [row for row in rows if row.scene == scene]
        for kind, style in STYLES.items():
            chosen = [row.quality for row in here if row.kind == kind and row.quality.cut_facets]
            axes.loglog([q.parts for q in chosen], [q.cut_facets for q in chosen], label=kind, ms=5, lw=1.4, **style)
        axes.set_title(f"{scene}, {here[0].leaves:,} leaves", fontsize=11)
        _axes(axes, "parts", "cut facets", here)
    panels[0][0].legend(frameon=False, fontsize=9)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def side_by_side(pictures, title, path):
    """Pictures that are there already, two in a row, with their titles.

    Args:
        pictures: title -> path of a PNG.
        title: of all.
        path: of the new PNG.
    """
    rows = -(-len(pictures) // 2)
    figure, panels = plt.subplots(rows, 2, figsize=(10, 3.9 * rows), layout="constrained", squeeze=False)
    for axes, (name, picture) in zip(panels.flat, pictures.items()):
        axes.imshow(plt.imread(picture))
        axes.set_title(name, fontsize=12)
    for axes in panels.flat:
        axes.axis("off")
    figure.suptitle(title, fontsize=13)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    with_few_colours(path)


def draw_prediction(predictions, dofs, path):
    """Predicted seconds of an adaptive step against the number of processors, beside the ideal slope.

    Args:
        predictions: kind -> {parts: seconds by stage}.
        dofs: of the mesh, by benchmark name: a title.
        path: of the PNG.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.4), layout="constrained")
    for kind in reversed(STYLES):  # contact-sfc on top
        by_parts = predictions[kind]
        parts = np.array(list(by_parts))
        left.loglog(parts, [s["total"] for s in by_parts.values()], label=kind, ms=5, lw=1.4, **STYLES[kind])
    best = predictions["contact-sfc"]
    parts = np.array(list(best))
    for stage, colour in STAGE_COLOURS.items():
        right.loglog(parts, [s[stage] for s in best.values()], color=colour, marker="o", ms=4, lw=1.4, label=stage)
    for axes, stage, what in ((left, "total", "all stages"), (right, "solve", "contact-sfc by stage")):
        axes.loglog(
            parts, best[parts[0]][stage] * parts[0] / parts, "--", color="#666666", lw=1, label=f"ideal ({stage})"
        )
        axes.set_title(f"MODEL: {dofs}, {what}", fontsize=11)
        axes.set_xticks(parts, [f"{p}" for p in parts], rotation=45, fontsize=8)
        axes.minorticks_off()
        axes.set_xlabel("processors")
        axes.set_ylabel("seconds of an adaptive step")
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=9)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _axes(axes, xlabel, ylabel, rows):
    ticks = sorted({row.quality.parts for row in rows})
    axes.set_xticks(ticks, [f"{p}" for p in ticks], rotation=45, fontsize=8)
    axes.minorticks_off()
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.spines[["top", "right"]].set_visible(False)
