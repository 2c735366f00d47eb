"""What pages show of the MODEL: its times, and the paper's claims on strong scaling beside them."""


def claims(rows):
    """Questions, what the paper says, and what the MODEL does.

    Args:
        rows: dicts, as `tables.model` makes them, of both benchmarks up to 8192 processors.

    Returns:
        list of dicts: `question`, `paper`, `model`.
    """
    found = {(row["benchmark"], row["parts"]): row for row in rows}

    def gain(scene, start, end, what="total"):
        return f"{found[scene, start][what] / found[scene, end][what]:.2f}"

    def share(what, parts):
        row = found["hertz", parts]
        return f"{row[what] / row['total']:.0%}"

    def against(kind, parts):
        row = found["hertz", parts]
        return f"{row[f'total_{kind}'] / row['total']:.2f}"

    before, at, after = (gain("hertz", parts, 2 * parts, "solve") for parts in (512, 1024, 2048))
    fastest = min((row for row in rows if row["benchmark"] == "hertz"), key=lambda row: row["total"])["parts"]
    return [
        {"question": question, "paper": paper, "model": model}
        for question, paper, model in (
            (
                "`equidistributed` for Hertz past 512 processors",
                "useless",
                f"1024 at {gain('hertz', 512, 1024, 'total_equidistributed')} times the speed of 512; messages take "
                f"{found['hertz', 512]['waiting_dealt']:.0%} of the solver there, the paper's profile says 70 %",
            ),
            (
                "the curve for the indentation",
                "to 8192",
                f"8192 at {gain('indentation', 4096, 8192)} times the speed of 4096",
            ),
            ("the solver for Hertz from 1024 to 2048", "little gain", f"{at} there, {before} before, {after} after"),
            (
                "Hertz to 4096",
                "scales",
                f"{gain('hertz', 2048, 4096)} times the speed of 2048, 8192 at {gain('hertz', 4096, 8192)} times "
                f"that; fastest on {fastest}. The limit at 4096: the solver takes {share('solve', 4096)} of the step, "
                f"messages and reductions {found['hertz', 4096]['waiting']:.0%} of the solver; exchanges of the tree "
                f"take {share('exchanges', 4096)} of the step, its reductions {share('reductions', 4096)}",
            ),
            (
                "Hertz, whole pairs: time of `sfc` over that of `contact-sfc`",
                "",
                f"{against('sfc', 512)} on 512, {against('sfc', 2048)} on 2048, {against('sfc', 4096)} on 4096",
            ),
            (
                "Hertz, straight interfaces: time of the curve alone over that of `contact-sfc`",
                "",
                f"{against('curve_only', 512)} on 512, {against('curve_only', 2048)} on 2048, "
                f"{against('curve_only', 4096)} on 4096",
            ),
        )
    ]


def in_milliseconds(rows):
    """Rows of the MODEL with milliseconds, and the speed over that of half as many processors.

    Args:
        rows: dicts, as `tables.model` makes them.

    Yields:
        dict for each of them.
    """
    totals = {(row["benchmark"], row["parts"]): row["total"] for row in rows}
    for row in rows:
        milliseconds = {f"{k.removeprefix('total_')}_ms": 1e3 * v for k, v in row.items() if isinstance(v, float)}
        half = totals.get((row["benchmark"], row["parts"] // 2))
        yield {**row, **milliseconds, "gain": half and half / row["total"]}
