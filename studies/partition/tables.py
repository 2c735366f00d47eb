"""Tables of the partition study."""

#: Kinds beside contact-sfc.
OTHERS = ("graph", "sfc", "equidistributed")
#: Parts that the short table shows.
SHOWN = (8, 32, 128, 512, 1024, 2048, 8192)


def model(predictions, dofs):
    """Predicted seconds of an adaptive step, of contact-sfc by stage: a row each benchmark and number of processors.

    Args:
        predictions: (benchmark, parts, kind) -> seconds by stage.
        dofs: benchmark -> unknowns.
    """
    for (scene, parts, kind), ours in predictions.items():
        if kind == "contact-sfc":
            others = {f"total_{kind}": predictions[scene, parts, kind]["total"] for kind in OTHERS}
            dealt = predictions[scene, parts, "equidistributed"]["waiting"]
            yield {"benchmark": scene, "dofs": dofs[scene], "parts": parts, **ours, **others, "waiting_dealt": dealt}


def table(rows):
    """The short table of `quality.csv`: cuts over those of PT-SCOTCH, split pairs, imbalance.

    Yields:
        dict for each benchmark and number of parts.
    """
    found = {(row["benchmark"], row["parts"], row["kind"]): row for row in rows}
    for (scene, parts, kind), ours in found.items():
        if kind == "contact-sfc" and parts in SHOWN:
            best = found[scene, parts, "graph"]["cut_facets"]
            result = {"benchmark": scene, "parts": parts, "leaves_per_part": ours["leaves"] // parts}
            result["cut_facets_graph"] = best
            for other in ("contact-sfc", *OTHERS):
                here = found[scene, parts, other]
                result[f"cut_{other}"] = here["cut_facets"] / best
                result[f"imbalance_{other}"] = here["imbalance"]
            result["split_pairs_sfc"] = found[scene, parts, "sfc"]["split_pairs"]
            yield result


def claims(rows):
    """Questions, what the paper says of strong scaling, and what the MODEL does.

    Args:
        rows: those of `model`, of both benchmarks up to 8192 processors.
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
    """Rows of `model` with milliseconds, and the speed over that of half as many processors."""
    totals = {(row["benchmark"], row["parts"]): row["total"] for row in rows}
    for row in rows:
        milliseconds = {f"{k.removeprefix('total_')}_ms": 1e3 * v for k, v in row.items() if k.startswith("total")}
        half = totals.get((row["benchmark"], row["parts"] // 2))
        yield {**row, **milliseconds, "gain": half and half / row["total"]}
