"""Pictures of the partition study."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

from studies.pictures.files import with_few_colours  # noqa: E402

STYLES = {
    "contact-sfc": dict(color="#0072B2", marker="o"),
    "sfc": dict(color="#009E73", marker="s"),
    "graph": dict(color="#000000", marker="^"),
    "equidistributed": dict(color="#D55E00", marker="v"),
}


def draw_cuts(rows, path):
    """Cut facets of each kind over those of PT-SCOTCH against the number of parts, one panel a benchmark.

    Args:
        rows: dicts, those of `tables.table`.
        path: of the PNG.
    """
    scenes = list(dict.fromkeys(row["benchmark"] for row in rows))
    figure, panels = plt.subplots(
        1, len(scenes), figsize=(5.2 * len(scenes), 4.2), layout="constrained", squeeze=False
    )
    for axes, scene in zip(panels[0], scenes):
        here = [row for row in rows if row["benchmark"] == scene]
        parts = [row["parts"] for row in here]
        for kind, style in STYLES.items():
            axes.loglog(parts, [row[f"cut_{kind}"] for row in here], label=kind, ms=5, lw=1.4, **style)
        axes.set_title(scene, fontsize=11)
        axes.set(xlabel="parts", ylabel="cut facets over those of graph")
        axes.set_xticks(parts, [f"{p}" for p in parts], rotation=45, fontsize=8)
        axes.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
        axes.minorticks_off()
        axes.spines[["top", "right"]].set_visible(False)
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


if __name__ == "__main__":
    from studies import tables

    draw_cuts(tables.read(tables.TOP / "studies/partition/table.csv")[1], tables.TOP / "studies/partition/cut.png")
