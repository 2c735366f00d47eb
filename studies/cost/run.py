"""Where the time goes, and how it grows: the README's performance table, and the paper's figure 5 and beyond.

Runs the demos as anyone would, one command after the other, and reads their records.  What has run before is not run
again, so that an interrupted study goes on where it stopped: after a change of the program, name another folder.  CPU
seconds are those of all ranks and all steps, without compilation, start of Python and root mesh; memory is the largest
resident size of all ranks together.

    python3 -m studies.cost.run                  # the README's table, without the large runs
    python3 -m studies.cost.run --large          # with them: 20 minutes, 16 GB
    python3 -m studies.cost.run --study orders growth ranks contact python

Tables and pictures go to results/cost.
"""

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np

from studies.runs import STAGES, TOP, Case, at_once, cpu, records, wall

#: The README's table: targets in CPU seconds and kB a dof, where there are some.
STANDARD = {
    Case("indentation", "--symmetry full --tolerance 0.06"): (87, 3.0),
    Case("hertz", "--symmetry full --tolerance 0.08"): (25, 3.2),
    Case("hertz", "--symmetry full --tolerance 0.04"): (230, 3.2),
    Case("hertz", "--tolerance 0.08"): (25 / 4, None),
    Case("hertz", "--tolerance 0.04"): (230 / 4, None),
}
LARGE = {
    Case("indentation", "--symmetry full --tolerance 0.04"): (None, None),
    Case("hertz", "--tolerance 0.02"): (None, None),
    Case("hertz", "--tolerance 0.014"): (None, None),
}
#: Targets in CPU seconds for a million dofs: affine cells, and curved ones.
RATE = {"indentation": 70, "hertz": 120}
ORDERS = [
    Case("hertz", f"--order 6 --geometry-order {order} {name} --tolerance 0.08", ranks)
    for order in (1, 2, 3, 6)
    for name in ("--preconditioner boomeramg", "--preconditioner ilu", "-fx_pc_type gamg")
    for ranks in (1, 2)
]
CHOSEN = Case("hertz", "--order 6 --tolerance 0.08")
AFFINE = ORDERS[1]
RANKS = [
    Case(demo, options, ranks)
    for demo, options in (("indentation", "--symmetry full --tolerance 0.06"), ("hertz", "--tolerance 0.04"))
    for ranks in (1, 2)
]
GROWTH = [Case("indentation", "--symmetry full --tolerance 0.06"), Case("hertz", "--tolerance 0.04")]


def output(command):
    """What a command prints; None if it failed."""
    run = subprocess.run(shlex.split(command), cwd=TOP, capture_output=True, text=True)
    if run.returncode:
        print(f"failed: {command}\n{run.stderr[-2000:]}", file=sys.stderr)
        return None
    return run.stdout


def kilobytes(steps):
    """Peak memory of all ranks for each unknown of the last mesh."""
    return steps[-1]["peak_memory_bytes"] / steps[-1]["dofs"] / 1e3


def against(value, target, unit):
    """A figure, and its target where there is one."""
    return f"{value:.3g} {unit}" if target is None else f"{value:.3g} {unit} (target {target:.3g})"


def standard(folder, large):
    """The README's table."""
    yield "| command | dofs | steps | CPU | wall | CPU for a million dofs | peak memory for a dof |"
    yield "|---|---|---|---|---|---|---|"
    for case, (seconds, memory) in (STANDARD | (LARGE if large else {})).items():
        steps = records(case, folder)
        if steps is None:
            yield f"| `{case.command}` | failed | | | | | |"
            continue
        dofs = steps[-1]["dofs"]
        rate = f"{cpu(steps) / dofs * 1e6:.0f} s (target {RATE[case.demo]})"
        yield (
            f"| `{case.command}` | {dofs:,} | {len(steps)} | {against(cpu(steps), seconds, 's')} | {wall(steps):.1f} s "
            f"| {rate} | {against(kilobytes(steps), memory, 'kB')} |"
        )


def orders(folder):
    """Geometry order, preconditioner and ranks: time by stage and memory, for one root mesh of order 6."""
    heads = ["geometry order", "preconditioner", "ranks", "dofs", "CPU", *STAGES, "Krylov, last step", "memory"]
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for case in [*ORDERS, CHOSEN]:
        steps = records(case, folder)
        if steps is None:
            yield f"| `{case.command}` failed {'| ' * len(heads)}"
            continue
        last, words = steps[-1], case.options.split()
        given = dict(zip(words[::2], words[1::2]))
        order = given.get("--geometry-order", f"chosen: {last['geometry_order']}")
        name = given.get("-fx_pc_type") or given.get("--preconditioner", "boomeramg")
        columns = [order, name, case.ranks, f"{last['dofs']:,}"]
        columns += [f"{cpu(steps):.1f} s"]
        columns += [f"{cpu(steps, [name]):.1f} s" for name in STAGES]
        columns += [sum(last["krylov_iterations"]), f"{last['peak_memory_bytes'] / 1e9:.2f} GB"]
        yield f"| {' | '.join(map(str, columns))} |"
    pair = [records(case, folder) for case in (CHOSEN, AFFINE)]
    if None not in pair:
        time = cpu(pair[0]) / cpu(pair[1])
        memory = pair[0][-1]["peak_memory_bytes"] / pair[1][-1]["peak_memory_bytes"]
        yield f"\nChosen order against order 1: {time:.2f} times the CPU, {memory:.2f} times the memory (target 1.2)."


def ranks(folder):
    """Two ranks against one, in every stage that takes over a tenth of the time; and what the machine allows.

    Two cores share memory and its bandwidth: two independent runs at the same time, which exchange nothing, are each
    slower than one alone.  Twice the one over the other is the most that two ranks could gain.
    """
    yield "| command | stage | share | wall on 1 | wall on 2 | speed-up (target 1.7) | of two runs at once |"
    yield "|---|---|---|---|---|---|---|"
    for one, two in zip(RANKS[::2], RANKS[1::2]):
        both, copies = [records(case, folder) for case in (one, two)], at_once(one, folder)
        if None in (*both, copies):
            yield f"| `{one.command}` or 2 ranks failed | | | | | | |"
            continue
        names = [n for n in STAGES if _seconds(both[0], [n]) > 0.1 * wall(both[0])]
        for name, stages in [(n, [n]) for n in names] + [("all", STAGES)]:
            first, second, *others = (_seconds(steps, stages) for steps in (*both, *copies))
            share = first / _seconds(both[0], STAGES)
            gains = f"{first / second:.2f} | {2 * first / np.mean(others):.2f}"
            row = f"{share:.0%} | {first:.1f} s | {second:.1f} s | {gains}"
            yield f"| `demos/{one.demo}.py {one.options}` | {name} | {row} |"


def _seconds(steps, stages):
    """Wall seconds of all steps in some stages."""
    return sum(step["seconds"][name] for step in steps for name in stages)


def growth(folder, large):
    """CPU seconds and memory against the number of unknowns, step by step; the slope in the logarithms."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    head = "slope of time | of memory | largest over 1e5 (target 1.2)"
    yield f"| command | dofs | CPU for a step and a million dofs | {head} |"
    yield "|---|---|---|---|---|---|"
    for case, marker in zip([*GROWTH, *(LARGE if large else {})], "os^Dv"):
        steps = records(case, folder)
        if steps is None:
            yield f"| `{case.command}` failed | | | | | |"
            continue
        dofs = np.array([step["dofs"] for step in steps])
        seconds = np.array([cpu([step]) for step in steps])
        memory = np.array([step["peak_memory_bytes"] for step in steps])
        big = dofs >= 1e4
        slopes = ["-", "-"]
        if big.sum() > 1:
            slopes = [f"{np.polyfit(np.log(dofs[big]), np.log(y[big]), 1)[0]:.2f}" for y in (seconds, memory)]
        rate = np.interp(np.log([1e5, dofs[-1]]), np.log(dofs), seconds / dofs)
        growth = f"{rate[1] / rate[0]:.2f}" if dofs[0] <= 1e5 <= dofs[-1] else "-"
        each = ", ".join(f"{s / d * 1e6:.0f} s" for s, d in zip(seconds[big], dofs[big]))
        yield f"| `{case.command}` | {dofs[-1]:,} | {each} | {' | '.join(slopes)} | {growth} |"
        label = f"{case.demo} {case.options}"
        axes[0].loglog(dofs, seconds, marker=marker, label=label)
        axes[1].loglog(dofs, memory / 1e9, marker=marker, label=label)
    axes[0].set(xlabel="conforming dofs", ylabel="CPU seconds of a step, all ranks")
    axes[1].set(xlabel="conforming dofs", ylabel="peak memory of all ranks [GB]")
    for one in axes:
        one.grid(which="both", alpha=0.3)
    axes[0].legend(frameon=False, fontsize=8)
    figure.savefig(folder / "growth.png", dpi=150)


def python(folder):
    """Python's own share, from above: no step has more of it than the smallest mesh's takes in all.

    Nothing in the package loops over cells or nodes in Python, so that its share of a step does not grow with the mesh.
    """
    yield "| command | CPU of the first step | steps | CPU | Python's share at most (target 5 %) | of the last step |"
    yield "|---|---|---|---|---|---|"
    for case in GROWTH:
        steps = records(case, folder)
        if steps is None:
            yield f"| `{case.command}` failed | | | | | |"
            continue
        each = [cpu([step]) for step in steps]
        least, shares = min(each), (min(each) * len(each) / sum(each), min(each) / each[-1])
        row = " | ".join(f"{share:.1%}" for share in shares)
        yield f"| `{case.command}` | {least:.2f} s | {len(each)} | {sum(each):.1f} s | {row} |"


def contact(folder):
    """What contact costs, as `studies.cost.glued` prints it (target 1.15)."""
    for scene in ("hertz", "indentation"):
        command, kept = (
            f"mpirun -n 2 python3 -m studies.cost.glued --scene {scene} --tolerance 0.04",
            folder / f"glued-{scene}.txt",
        )
        if not kept.exists():
            printed = output(command)
            if printed is None:
                yield f"`{command}` failed"
                continue
            kept.write_text(printed)
        yield f"`{command}` (target 1.15)\n\n```\n{kept.read_text()}```\n"


def main():
    """Run what is asked for; print it and keep it in the folder; exit code 1 if a run failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    studies = {
        "standard": lambda: standard(arguments.output, arguments.large),
        "orders": lambda: orders(arguments.output),
        "growth": lambda: growth(arguments.output, arguments.large),
        "ranks": lambda: ranks(arguments.output),
        "contact": lambda: contact(arguments.output),
        "python": lambda: python(arguments.output),
    }
    parser.add_argument("--study", choices=studies, nargs="+", default=["standard"], help="(%(default)s)")
    parser.add_argument("--large", action="store_true", help="include the runs that take minutes and up to 16 GB")
    parser.add_argument("--output", type=Path, default=Path("results/cost"), help="folder (%(default)s)")
    arguments = parser.parse_args()
    try:
        arguments.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        parser.error(f"cannot make {str(arguments.output)!r}: {error.strerror}")
    failed = False
    for name in arguments.study:
        with (arguments.output / f"{name}.md").open("w") as file:
            for line in studies[name]():
                print(line, flush=True)
                print(line, file=file)
                failed |= "failed" in line
    sys.exit(failed)


if __name__ == "__main__":
    main()
