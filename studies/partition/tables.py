"""Tables of the partition study."""

from dataclasses import asdict

#: Kinds beside contact-sfc.
OTHERS = ("graph", "sfc", "equidistributed")
#: Parts that the short table shows.
SHOWN = (8, 32, 128, 512, 1024, 2048, 8192)


def quality(rows):
    """All measures of all partitions: a dict each, for a CSV file."""
    for row in rows:
        measures = {**vars(row), **asdict(row.quality), **asdict(row.partners)}
        yield {k: v for k, v in measures.items() if k not in ("quality", "partners")}


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
            others = {f"total_{kind}": kinds[kind][parts]["total"] for kind in OTHERS}
            dealt = kinds["equidistributed"][parts]["waiting"]
            yield {"benchmark": scene, "dofs": dofs[scene], "parts": parts, **ours, **others, "waiting_dealt": dealt}


def table(rows):
    """The short table: cuts over those of PT-SCOTCH, split pairs, imbalance of weights, partners, sums.

    Args:
        rows: Scores.

    Returns:
        list of dicts.
    """
    found = {(row.scene, row.quality.parts, row.kind): row for row in rows}
    result = []
    for scene, leaves in dict.fromkeys((row.scene, row.leaves) for row in rows):
        for parts in sorted({row.quality.parts for row in rows} & set(SHOWN)):
            here = {kind: found[scene, parts, kind] for kind in ("contact-sfc", *OTHERS)}
            best, talks = here["graph"].quality.cut_facets, here["contact-sfc"].partners
            result.append({"benchmark": scene, "parts": parts, "leaves_per_part": leaves // parts})
            result[-1]["cut_facets_graph"] = best
            for kind, row in here.items():
                result[-1] |= {
                    f"cut_{kind}": row.quality.cut_facets / best,
                    f"imbalance_{kind}": row.quality.imbalance,
                    f"partners_max_{kind}": row.partners.partners_max,
                    f"partners_mean_{kind}": row.partners.partners_mean,
                }
            result[-1] |= {
                "split_pairs_sfc": here["sfc"].quality.split_pairs,
                "reductions": talks.reductions,
                "summed": talks.summed / (parts - 1),  # numbers for each of the cuts
            }
    return result


def claims(rows):
    """Questions, what the paper says of strong scaling, and what the MODEL does.

    Args:
        rows: dicts, as `model` makes them, of both benchmarks up to 8192 processors.

    Returns:
        list of dicts: `question`, `paper`, `model`.
    """
    found = {(row["benchmark"], row["parts"]): row for row in rows}

    def gain(scene, start, what="total"):
        """Speed on twice as many processors."""
        return f"{found[scene, start][what] / found[scene, 2 * start][what]:.2f}"

    def blind(parts):
        """Time of the pair-blind curve over that of contact-sfc."""
        return f"{found['hertz', parts]['total_sfc'] / found['hertz', parts]['total']:.2f}"

    answers = {
        "`equidistributed` for Hertz past 512 processors": (
            "useless",
            f"1024 at {gain('hertz', 512, 'total_equidistributed')} times the speed of 512; messages take "
            f"{found['hertz', 512]['waiting_dealt']:.0%} of the solver there, the paper's profile says 70 %",
        ),
        "the curve for the indentation": ("to 8192", f"8192 at {gain('indentation', 4096)} times the speed of 4096"),
        "Hertz to 4096": (
            "scales",
            f"{gain('hertz', 2048)} times the speed of 2048, 8192 at {gain('hertz', 4096)} times that",
        ),
        "Hertz, whole pairs: time of `sfc` over that of `contact-sfc`": (
            "",
            f"{blind(512)} on 512, {blind(2048)} on 2048, {blind(4096)} on 4096",
        ),
    }
    return [{"question": question, "paper": paper, "model": found} for question, (paper, found) in answers.items()]


def in_milliseconds(rows):
    """Rows of the MODEL with milliseconds, and the speed over that of half as many processors.

    Args:
        rows: dicts, as `model` makes them.

    Yields:
        dict for each of them.
    """
    totals = {(row["benchmark"], row["parts"]): row["total"] for row in rows}
    for row in rows:
        milliseconds = {f"{k.removeprefix('total_')}_ms": 1e3 * v for k, v in row.items() if k.startswith("total")}
        half = totals.get((row["benchmark"], row["parts"] // 2))
        yield {**row, **milliseconds, "gain": half and half / row["total"]}
