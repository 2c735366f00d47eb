"""Matrix, table and CSV of the stress study."""

from studies.pictures.files import with_few_colours

#: Scores from best to worst: letter in the matrix, colours of its cell and of its edge, what it means.
SCORES = {
    "right": ("", "#ffffff", "#9a9a9a", "agrees, as closely as the run says"),
    "refused": ("R", "#ffffff", "#0072B2", "refused, as it must be, by a typed error"),
    "noisy": ("d", "#e8e8e8", "#9a9a9a", "agrees, but solver and rounding promise no 2 digits"),
    "unreached": ("n", "#d0d0d0", "#E69F00", "accuracy not reached, and said so"),
    "error": ("E", "#a8a8a8", "#E69F00", "a typed error where there is a solution"),
    "hang": ("T", "#606060", "#D55E00", "not done in time"),
    "crash": ("X", "#606060", "#D55E00", "died without a typed error"),
    "wrong": ("W", "#000000", "#D55E00", "SILENT FAILURE: delivered as converged, and wrong"),
}


def rows(scores, command):
    """A row a scene, with the check that comes nearest to failing and what runs it again, for a CSV file.

    Args:
        scores: dicts.
        command: function of a name.
    """
    for one in scores:
        worst = max(one["checks"], key=nearest, default=("", "", ""))
        about = {"name": one["name"], "axis": one["axis"], "score": one["score"]}
        about |= dict(zip(("worst", "deviation", "allowed"), worst))
        about |= {k: v for k, v in one.items() if k not in ("checks", "row", "value")}
        yield about | {"command": command(one["name"])}


def nearest(check):
    """How near a check is to failing."""
    _, deviation, allowed, _ = check
    return deviation / (allowed or 1e-300)


def counts(scores):
    """Counts of scores for each axis: str, Markdown.

    Args:
        scores: dicts, those of `scores.jsonl` or rows of the CSV file.
    """
    kinds = [kind for kind in SCORES if any(one["score"] == kind for one in scores)]
    lines = [f"| axis | scenes | {' | '.join(kinds)} | iterations | CPU |", "|---|" + "--:|" * (len(kinds) + 3)]
    for axis in [*dict.fromkeys(one["axis"] for one in scores), None]:
        here = [one for one in scores if axis in (None, one["axis"])]
        numbers = [sum(one["score"] == kind for one in here) or "" for kind in kinds]
        effort = [one["iterations"] for one in here if one.get("iterations", "") != ""]
        effort = f"{min(effort)} to {max(effort)}" if effort else ""
        seconds = f"{sum(one['cpu_seconds'] for one in here):.0f} s"
        lines.append(f"| {axis or 'all'} | {len(here)} | {' | '.join(map(str, numbers))} | {effort} | {seconds} |")
    return "\n".join(lines)


def named(scores):
    """`counts`, and the names of the scenes that are not right: str, Markdown."""
    lines = [counts(scores), ""]
    for kind in SCORES:
        names = [f"`{one['name']}`" for one in scores if one["score"] == kind != "right"]
        lines += [f"- {kind}: {', '.join(names)}"] if names else []
    return "\n".join(lines)


def draw_matrix(scores, path, other):
    """A row for each family of each axis, a cell a scene: its value, and iterations as colour or the letter of a score.

    Args:
        scores: dicts.
        path: of the PNG, 960 pixels wide: text of a page's size.
        other: name -> score, of the other degree: a strip below each cell.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    rows, heat = {}, _heat()
    for one in scores:
        rows.setdefault((one["axis"], one["row"]), []).append(one)
    height = len(rows) + 0.9 * len({axis for axis, _ in rows})
    figure = Figure(figsize=(9.6, 1.6 + 0.205 * height), layout="constrained")
    axes, y, last = figure.add_subplot(), 0.0, None
    for (axis, row), here in rows.items():
        if axis != last:
            y, last = y + 0.9, axis
            axes.text(-0.1, y - 0.05, axis, ha="right", va="bottom", fontsize=9, weight="bold")
        axes.text(-0.1, y + 0.45, row.split(": ", 1)[1], ha="right", va="center", fontsize=8.5)
        width = -(-max(len(_told(one)) for one in here) // 7)
        for x, one in enumerate(here):
            _draw_cell(axes, width * x, y, width, one, heat)
            if one["name"] in other:
                _draw_strip(axes, width * x, y, width, other[one["name"]], heat)
        y += 1
    axes.set(xlim=(-6.2, 16), ylim=(height + 2.5, 0))  # with room for the scale
    axes.axis("off")
    handles = []
    for kind in (kind for kind in SCORES if any(one["score"] == kind for one in scores)):
        letter, grey, edge, meaning = SCORES[kind]
        count = sum(one["score"] == kind for one in scores)
        about = f"{letter or 'coloured'}: {meaning} ({count})"
        handles.append(Patch(facecolor=grey, edgecolor=edge, lw=1.5, label=about))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=8.5)
    scale = axes.inset_axes((0.62, 0.012, 0.36, 0.005))
    figure.colorbar(heat, cax=scale, orientation="horizontal", label="iterations of PCG and contact, all steps")
    below = "; strips: the other degree" * bool(other)
    figure.suptitle(f"{len(scores)} scenes by the value that varies{below}", fontsize=10)
    figure.savefig(path, dpi=100)
    with_few_colours(path)


def _told(one):
    """What a cell says: the value that varies along its row, and the letter of its score."""
    value = one["value"].replace(" about ", " ").replace("(1,2,3)", "xyz")
    return f"{value} {SCORES[one['score']][0]}".rstrip()


def _heat():
    """Colours of iterations, from few, light, to many, dark: a matplotlib ScalarMappable."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    return ScalarMappable(LogNorm(10, 2000, clip=True), "YlGnBu")


def _draw_cell(axes, x, y, width, one, heat):
    """A rectangle with the value of a scene, coloured by its iterations; or with the letter of its score."""
    from matplotlib.patches import Rectangle

    letter, face, edge, _ = SCORES[one["score"]]
    style = {"lw": 1.8}
    if not letter:
        face, style = heat.to_rgba(one["iterations"]), {"lw": 0.6}
    place = x + 0.03, y + 0.04
    axes.add_patch(Rectangle(place, width - 0.06, 0.7, facecolor=face, edgecolor=edge, **style))
    dark = face in ("#000000", "#606060") if letter else heat.norm(one["iterations"]) > 0.6
    ink = "white" if dark else "black"
    axes.text(x + width / 2, y + 0.39, _told(one), ha="center", va="center", fontsize=7.5, color=ink)


def _draw_strip(axes, x, y, width, one, heat):
    """The score of the other degree below that of a scene: iterations, or the colours of what went wrong."""
    from matplotlib.patches import Rectangle

    letter, face, edge, _ = SCORES[one["score"]]
    face = face if letter else heat.to_rgba(one["iterations"])
    style = {"facecolor": face, "edgecolor": edge if letter else "none", "lw": 1.2}
    axes.add_patch(Rectangle((x + 0.03, y + 0.78), width - 0.06, 0.14, **style))
