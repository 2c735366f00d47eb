"""Text about a run: warnings, seconds by stage.  Local."""

from collections.abc import Mapping, Sequence

from fx_contact.adaptive.step_record import StepRecord
from fx_contact.parallel.timing import STAGES


def force_warnings(record: StepRecord) -> list[str]:
    """Warnings about contact pairs whose force has a larger error than the tolerance, from the last step."""
    names = [repr(one.name) for one in record.resultants or () if one.kind == "contact"]
    lines = []
    for index, (force, error) in enumerate(zip(record.pair_forces, record.pair_errors)):
        if force and error and error > record.tolerance:
            leaves, name = record.pair_leaves[index], names[index] if names else index
            reason = (
                f"{leaves:,} leaves are marked for it: allow more steps"
                if leaves
                else "no leaf is refined for errors of forces below the square of the tolerance times the largest force"
            )
            lines.append(f"contact pair {name}: the estimated error of its force is {min(error, 1):.0%}; {reason}")
    return lines


def model_warnings(record: StepRecord) -> list[str]:
    """Warnings about violated assumptions of the model, a line each, from the last step."""
    return [*map(str, record.doubts)]


def total_seconds(steps: Sequence[Mapping[str, float]]) -> str:
    """Wall time of a run, its six longest stages, and the time of compilation, from the `seconds` of the records."""
    total = {name: sum(seconds[name] for seconds in steps) for name in (*STAGES, "total")}
    compiled = total.pop("compile")
    largest = sorted((name for name in total if name != "total"), key=lambda name: total[name], reverse=True)[:6]
    parts = ", ".join(f"{name} {total[name]:.1f}" for name in largest)
    return f"{total['total'] - compiled:.1f} s ({parts}) and {compiled:.1f} s of compilation"
