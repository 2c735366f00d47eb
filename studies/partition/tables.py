"""Tables of the partition study."""

from dataclasses import asdict

from studies.partition.scaling_model import STAGES

#: Short names of what contact-sfc is compared with.
SHORT = {
    "graph": "graph",
    "contact-sfc, curve only": "curve_only",
    "sfc": "sfc",
    "equidistributed": "equidistributed",
}
#: Parts that the short table shows.
SHOWN = (8, 32, 128, 512, 1024, 2048, 8192)


def all_of(row):
    """A Score with what its Quality and Partners hold: dict."""
    return {**vars(row), **asdict(row.quality), **asdict(row.partners)}


def quality(rows):
    """All measures of all partitions: a dict each, for a CSV file."""
    for row in rows:
        yield {k: v for k, v in all_of(row).items() if k not in ("quality", "partners")}


def model(predictions, dofs):
    """Predicted seconds of an adaptive step, of contact-sfc by stage.

    Args:
        predictions: benchmark -> kind -> {parts: seconds by stage}.
        dofs: benchmark -> unknowns.

    Yields:
        dict for each benchmark and number of processors.
    """
    for scene, kinds in predictions.items():
        for parts, ours in kinds["contact-sfc"].items():
            others = {f"total_{name}": kinds[kind][parts]["total"] for kind, name in SHORT.items()}
            dealt = kinds["equidistributed"][parts]["waiting"]
            yield {"benchmark": scene, "dofs": dofs[scene], "parts": parts, **ours, **others, "waiting_dealt": dealt}


def table(rows):
    """The short table: cuts over those of PT-SCOTCH, split pairs, imbalance of weights, neighbours and halo.

    Args:
        rows: Scores.

    Returns:
        list of dicts.
    """
    found = {(row.scene, row.quality.parts, row.kind): row.quality for row in rows}
    talks = {(row.scene, row.quality.parts, row.kind): row.partners for row in rows}
    names = {"contact-sfc": "contact_sfc", **SHORT}
    result = []
    for scene, leaves in dict.fromkeys((row.scene, row.leaves) for row in rows):
        for parts in sorted({row.quality.parts for row in rows} & set(SHOWN)):
            ours, graph, curve, blind, dealt = (found[scene, parts, kind] for kind in names)
            result.append(
                {
                    "benchmark": scene,
                    "parts": parts,
                    "leaves_per_part": leaves // parts,
                    "cut_facets_graph": graph.cut_facets,
                    "cut_contact_sfc": ours.cut_facets / graph.cut_facets,
                    "cut_curve_only": curve.cut_facets / graph.cut_facets,
                    "cut_sfc": blind.cut_facets / graph.cut_facets,
                    "cut_equidistributed": dealt.cut_facets / graph.cut_facets,
                    "split_pairs_sfc": blind.split_pairs,
                    "imbalance_contact_sfc": ours.weight_imbalance,
                    "imbalance_graph": graph.weight_imbalance,
                    "imbalance_equidistributed": dealt.weight_imbalance,
                    "imbalance_unknowns": ours.unknowns_imbalance,
                    "neighbours": ours.neighbours_mean,
                    "halo_KiB": ours.halo_bytes_max / 1024,
                    **{
                        f"partners_{end}_{name}": getattr(talks[scene, parts, kind], f"partners_{end}")
                        for kind, name in names.items()
                        for end in ("max", "mean")
                    },
                    "keys_KiB": talks[scene, parts, "contact-sfc"].key_bytes_max / 1024,
                    "keys_KiB_equidistributed": talks[scene, parts, "equidistributed"].key_bytes_max / 1024,
                    **{
                        f"{name}_{names[kind]}": number
                        for kind in ("contact-sfc, curve only", "contact-sfc")
                        for name, number in sums(talks[scene, parts, kind], parts).items()
                    },
                }
            )
    return result


def sums(partners, parts):
    """How many sums over the ranks a partition takes, and of how many numbers for each of its P - 1 cuts: dict."""
    return {"reductions": partners.reductions, "summed": partners.summed / (parts - 1)}


def targets(rows):
    """What must hold of contact-sfc, held against the scores.

    Args:
        rows: Scores.

    Returns:
        str, Markdown list: each target, the worst value found, and where.
    """
    found = {(row.scene, row.quality.parts, row.kind): row for row in rows}
    ours = [row for row in rows if row.kind == "contact-sfc"]
    large = [row for row in ours if row.leaves >= 1000 * row.quality.parts]

    def against(row, kind):
        other = found[row.scene, row.quality.parts, kind].quality
        return row.quality.cut_facets / other.cut_facets if other.cut_facets else float("inf")

    def with_pairs(row):
        blind = found[row.scene, row.quality.parts, "sfc"].quality
        return blind.cut_facets + blind.split_pairs

    def overweight(row):
        spare = max(0.02, 2 * row.quality.parts / row.leaves)
        return (row.quality.weight_imbalance - 1) / spare

    lines = []
    for text, limit, value, chosen in (
        ("split pairs", 0, lambda row: row.quality.split_pairs, ours),
        ("weight above the mean, of what is allowed (2 % or one super-element)", 1, overweight, ours),
        (
            "cut facets over those of PT-SCOTCH, parts of 1000 leaves and more",
            1.2,
            lambda r: against(r, "graph"),
            large,
        ),
        ("cut facets over those of the pair-blind curve, the same parts", 1.05, lambda r: against(r, "sfc"), large),
        (
            "the same where the curve's cuts through the contact count, a facet for each pair that it splits",
            1.05,
            lambda row: row.quality.cut_facets / with_pairs(row),
            large,
        ),
    ):
        missed = [f"{row.scene} in {row.quality.parts}: {value(row):.3f}" for row in chosen if value(row) > limit]
        worst = max(chosen, key=value)
        verdict = f"MISSED ({', '.join(missed)})" if missed else "held"
        lines.append(
            f"- {text}: at most {value(worst):.3f} ({worst.scene}, {worst.quality.parts} parts), "
            f"allowed {limit}: {verdict}"
        )
    return "\n".join(lines)


def prediction(scene, predictions):
    """Seconds by stage of contact-sfc and totals of the other kinds, and what follows.

    Args:
        scene: name of the benchmark.
        predictions: kind -> {parts: seconds by stage}.

    Returns:
        str, Markdown.
    """
    kinds = [kind for kind in predictions if kind != "contact-sfc"]
    lines = [
        f"| {scene}: parts | " + " | ".join(STAGES) + " | contact-sfc | " + " | ".join(kinds) + " |",
        "|--:|" + "--:|" * (len(STAGES) + 1 + len(kinds)),
    ]
    for parts, seconds in predictions["contact-sfc"].items():
        stages = " | ".join(f"{seconds[stage]:.3g}" for stage in STAGES)
        others = " | ".join(f"{predictions[kind][parts]['total']:.3g}" for kind in kinds)
        lines.append(f"| {parts} | {stages} | {seconds['total']:.3g} | {others} |")
    lines.append("")
    for kind, by_parts in predictions.items():
        start = next(iter(by_parts))
        first = by_parts[start]["total"] * start
        efficient = [p for p, s in by_parts.items() if first / (p * s["total"]) >= 0.5]
        fastest = min(by_parts, key=lambda p: by_parts[p]["total"])
        waiting = ", ".join(
            f"{100 * s['waiting']:.0f} % at {p}" for p, s in by_parts.items() if p in (256, 1024, 4096)
        )
        lines.append(
            f"- {kind}: efficiency of at least 50 % (against {start}) up to {max(efficient)} parts, shortest time at "
            f"{fastest}; messages and reductions take of the solver's time {waiting}"
        )
    solve = {p: s["solve"] for p, s in predictions["contact-sfc"].items()}
    gains = ", ".join(f"{p} to {2 * p}: {solve[p] / solve[2 * p]:.2f}" for p in solve if 2 * p in solve and p >= 256)
    lines.append(f"- gain of the solver by doubling, contact-sfc: {gains} (ideal 2)")
    return "\n".join(lines)
