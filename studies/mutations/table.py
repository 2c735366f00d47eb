"""Rates by room and kind of mistake, and what survives."""

from collections import Counter
from pathlib import Path
from typing import Any

EQUIVALENT = Path(__file__).with_name("equivalent.tsv")


def equivalent() -> dict[tuple[str, str, str], str]:
    """Mistakes that change neither a result nor a message: file, old and new line; the reason."""
    rows = [line.split("\t") for line in EQUIVALENT.read_text().splitlines()[1:]]
    return {(file, old, new): reason for file, old, new, reason in rows}


def table(entries: list[dict[str, Any]]) -> str:
    """Text of what came of mistakes.

    Args:
        entries: lines of the results.
    """
    reasons = equivalent()
    lines, same = [], []
    for entry in entries:
        old, new = (" ".join(line[1:].strip() for line in entry["difference"] if line[0] == sign) for sign in "-+")
        entry["reason"] = reasons.get((entry["file"], old, new))
        if entry["reason"] and not entry["noticed"]:
            same.append(entry)
    counted = [entry for entry in entries if entry not in same]
    for title, key in (("room", "file"), ("kind", "operator")):
        names = [(entry[key].split("/")[0], entry["noticed"]) for entry in counted]
        all_of, noticed = Counter(name for name, _ in names), Counter(name for name, seen in names if seen)
        lines += [f"| {title} | noticed | of |", "|---|---|---|"]
        lines += [f"| {name} | {noticed[name]} | {count} |" for name, count in sorted(all_of.items())] + [""]
    total = sum(entry["noticed"] for entry in counted)
    lines += [f"{total} of {len(counted)} noticed, {total / max(1, len(counted)):.0%}"]
    lines += [f"{len(same)} more change neither a result nor a message", ""]
    for entry in counted:
        if not entry["noticed"]:
            lines += [f"{entry['file']} ({entry['operator']}; {entry['by']})"] + entry["difference"] + [""]
    return "\n".join(lines)
