"""Scores the four kinds of partition for 2 to 8192 parts, and predicts the strong scaling of an adaptive step.

The forests are those of adaptive runs of both benchmarks, every leaf refined once more, at degree 2 twice: over a
million leaves at degree 1. Each rank scores one benchmark by itself, so two ranks halve the time:

    mpirun -n 2 python3 -m studies.partition.run --quick
    mpirun -n 2 python3 -m studies.partition.run
    mpirun -n 2 python3 -m studies.partition.run --degree 2

The prediction is of degree 1, whose kernels are measured. It leaves table.csv
(table_degree2.csv), quality.csv, targets.md, cost.md, prediction.md, prediction.csv and pictures in results/partition.
"""

import argparse
import time
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from demos.common import RankZeroParser, plain_errors
from fx_contact import adapt
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.interface_smoothing import FEW, WORTHWHILE
from fx_contact.forest.leaf_graph import create_leaf_graph
from fx_contact.forest.partition import KINDS
from fx_contact.forest.super_elements import Units, curve_keys
from fx_contact.parallel.errors import OutputError, PartitionError
from fx_contact.parallel.exchange import FEW_RANKS
from fx_contact.parallel.mpi import together
from fx_contact.plot import draw_parts
from fx_contact.scenes import hertz, indentation
from studies import tables
from studies.partition.figures import draw_cuts, draw_prediction, side_by_side
from studies.partition.measures import Judge, Quality
from studies.partition.partitions import CURVE, REPEATED, history, of_middle_cut, parents, partitions
from studies.partition.partners import Exchanges, Partners
from studies.partition.scaling_kernels import TIMES, measure, migration
from studies.partition.scaling_model import Network, predict
from studies.partition.tables import prediction, quality, seconds_by_stage, table, targets

#: Benchmarks: how to make the scene on one rank, the tolerances of the run and of the quick one at degree 1 and 2,
#: unknowns in the paper, half width of the picture [m].
BENCHMARKS = {
    "hertz": (partial(hertz, comm=MPI.COMM_SELF), {1: (0.035, 0.07), 2: (0.004, 0.01)}, 18.3e6, 0.25),
    "indentation": (indentation, {1: (0.051, 0.1), 2: (0.03, 0.06)}, 295.9e6, 1.0),
}
#: Tolerance of the runs in which the kernels are measured, and of those of --quick.
TOLERANCES = (0.05, 0.12)
COMM = MPI.COMM_WORLD


@dataclass(frozen=True)
class Score:
    """One row of the study.

    Attributes:
        scene: name of the benchmark.
        leaves, dofs: of its forest.
        kind: of the partition.
        quality: Quality.
        partners: Partners.
        seconds: to make the partition, once keys and graph are there.
    """

    scene: str
    leaves: int
    dofs: int
    kind: str
    quality: Quality
    partners: Partners
    seconds: float


def show(*words):
    """Print on rank 0."""
    if COMM.rank == 0:
        print(*words, flush=True)


def draw_in_32(name, forests, lineage, folder):
    """Pictures of each kind in 32 parts, as the paper's figure 3, of the first forest of 20,000 leaves or more."""
    make, *_, reach = BENCHMARKS[name]
    chosen = next((i for i, forest in enumerate(forests) if len(forest) >= 20_000), len(forests) - 1)
    forest, pictures = forests[chosen], {}
    pieces = {pairs: Units(forest, pairs) for pairs in (True, False)}
    judge = Judge(forest, Prolongation(Space(forest, 1)))
    for made in partitions(forests[: chosen + 1], lineage, 32, pieces):
        if made.kind in KINDS:
            found, path = judge.score(made.part, 32), folder / f"{name}_{made.kind}_32.png"
            pictures[f"{made.kind}: {found.cut_facets:,} cut facets, {found.split_pairs:,} split pairs"] = path
            draw_parts(forest, made.part, make().contact_centre or (0.0, 0.0, 0.0), reach, path)
    side_by_side(pictures, f"{name}, {len(forest):,} leaves in 32 parts", folder / f"{name}_32.png")


def scored(name, degree, quick, most, folder):
    """All scores of one benchmark, and its cost in seconds.  Local."""
    make, tolerances, _, _ = BENCHMARKS[name]
    forests = history(make, tolerances[degree][quick], degree)
    lineage = [None, *(parents(a, b) for a, b in zip(forests, forests[1:]))]
    draw_in_32(name, forests, lineage, folder)

    forest, cost = forests[-1], {}
    if most > len(forest) // 2:
        raise PartitionError(
            f"--parts {most} is too much for the {len(forest):,} leaves of {name}: at most half of them"
        )
    pieces = {pairs: Units(forest, pairs) for pairs in (True, False)}
    # Nothing is known yet of leaves in random order, and nothing sorted.
    strewn = [forest.ordered(np.random.default_rng(0).permutation(len(forest))) for _ in range(2)]
    for title, step in {
        "keys": lambda: curve_keys(strewn[0]),
        "keys and sort": lambda: Units(strewn[1], True),
        "graph": lambda: pieces[True].graph,
    }.items():
        start = time.perf_counter()
        step()
        cost[title] = time.perf_counter() - start
    prolongation = Prolongation(Space(forest, degree))
    judge, dofs = Judge(forest, prolongation), 3 * prolongation.index_map.size_global
    exchanges = Exchanges(forest, prolongation, create_leaf_graph(forest))
    rows = []
    for parts in 2 ** np.arange(1, int(np.log2(most)) + 1):
        for made in partitions(forests, lineage, int(parts), pieces):
            part = made.part
            if made.kind == "graph" and parts <= REPEATED:
                part = of_middle_cut(pieces[KINDS[made.kind].pairs], int(parts), part)
            cuts = None if parts <= FEW_RANKS else made.cuts  # as in a run
            partners = exchanges.count(int(parts), part, cuts, made.rows, made.reductions)
            quality = judge.score(part, int(parts))
            rows.append(Score(name, len(forest), dofs, made.kind, quality, partners, made.seconds))
        cuts = ", ".join(f"{row.kind} {row.quality.cut_facets:,}" for row in rows[-1 - len(KINDS) :])
        print(f"{name}, {len(forest):,} leaves in {parts} parts, cut facets: {cuts}", flush=True)
    return rows, cost


def predicted(rows, kernels):
    """Seconds by stage: benchmark -> kind -> parts -> dict, at the size that the paper's meshes have."""
    result = {}
    for row in rows:
        if row.quality.parts < 32:
            continue
        dofs = BENCHMARKS[row.scene][2]
        scale = dofs / row.dofs
        if row.kind == "contact-sfc" and scale * row.leaves >= WORTHWHILE * row.quality.parts:
            # There interfaces flow, as they do where the scored mesh has such parts: at most so many reductions.
            many = (other for other in rows if other.scene == row.scene and other.quality.parts > FEW)
            most = max(other.partners.reductions for other in many)
            row = replace(row, partners=replace(row.partners, reductions=most))
        seconds = predict(row, scale * row.leaves, dofs, kernels, Network(), scale)
        result.setdefault(row.scene, {}).setdefault(row.kind, {})[row.quality.parts] = seconds
    return result


def cost_table(costs, rows, moved):
    """What making a partition costs, in Markdown."""
    lines = ["| step | " + " | ".join(costs) + " |", "|---|" + "--:|" * len(costs)]
    leaves = {row.scene: row.leaves for row in rows}
    for title in next(iter(costs.values())):
        values = (f"{1e6 * cost[title] / leaves[name]:.2f}" for name, cost in costs.items())
        lines.append(f"| {title}, one rank, microseconds a leaf | " + " | ".join(values) + " |")
    for kind in (CURVE, *KINDS):
        for parts in sorted({row.quality.parts for row in rows} & {2, 32, 1024}):
            found = {row.scene: row.seconds for row in rows if (row.kind, row.quality.parts) == (kind, parts)}
            values = (f"{1e6 * found[name] / leaves[name]:.2f}" for name in costs)
            lines.append(f"| {kind}, {parts} parts, microseconds a leaf | " + " | ".join(values) + " |")
    seconds, size, count = moved
    lines.append(
        f"\nMigration of all {count:,} leaves to the next of {COMM.size} ranks: "
        f"{1e6 * seconds * COMM.size / count:.2f} microseconds a leaf of a rank, {size} bytes a leaf."
    )
    return "\n".join(lines)


def kernel_table(kernels):
    """The measured kernels, in Markdown."""
    names = [field.name for field in fields(kernels[0]) if field.name not in ("ranks", "levels")]
    lines = [
        "| kernel | " + " | ".join(f"{k.ranks} rank(s)" for k in kernels) + " |",
        "|---|" + "--:|" * len(kernels),
    ]
    for name in names:
        values = (getattr(k, name) for k in kernels)
        lines.append(
            f"| {name} | "
            + " | ".join(f"{1e6 * v:.3g} us" if name in TIMES else f"{v}" for v in values)
            + " |"
        )
    return "\n".join(lines)


def main():
    """Parse and run."""
    options = RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="forests of some 100,000 leaves: two minutes")
    options.add_argument("--degree", type=int, choices=(1, 2), default=1, help="of the displacements (%(default)s)")
    options.add_argument("--parts", type=int, default=8192, help="most parts, 32 or more (%(default)s)")
    options.add_argument("--output", type=Path, default=Path("results/partition"), help="folder (%(default)s)")
    arguments = options.parse_args()
    if arguments.parts < 32 or arguments.parts & (arguments.parts - 1):
        options.error("--parts must be a power of two, and 32 or more for the prediction")
    with plain_errors(COMM):
        study(arguments)


def folder_for(path):
    """Make the folder of results; OutputError if that cannot be done.  Collective."""
    with together(COMM):
        if COMM.rank == 0:
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(
                    f"cannot make the folder {str(path)!r}: {error}; name another with --output"
                ) from error
    return path


def study(arguments):
    """Score, measure, predict; all is written as soon as it is known.  Collective."""
    folder = folder_for(arguments.output)
    with together(COMM):
        mine = {
            name: scored(name, arguments.degree, arguments.quick, arguments.parts, folder)
            for name in list(BENCHMARKS)[COMM.rank :: COMM.size]
        }
    found = {name: result for part in COMM.allgather(mine) for name, result in part.items()}
    rows = [row for name in BENCHMARKS for row in found[name][0]]
    made_by = f"mpirun -n {COMM.size} python3 -m studies.partition.run --parts {arguments.parts}"
    made_by += f" --degree {arguments.degree}" * (arguments.degree > 1) + " --quick" * arguments.quick
    if COMM.rank == 0:
        short, name = table(rows), "table.csv" if arguments.degree == 1 else "table_degree2.csv"
        tables.write(folder / "quality.csv", list(quality(rows)), made_by)
        tables.write(folder / name, short, made_by)
        draw_cuts(rows, folder / "cut.png")
        show(tables.TABLES[f"studies/partition/{name}"](short))
    write(targets(rows), folder / "targets.md")
    if arguments.degree == 1:
        forecast(arguments.quick, rows, {name: found[name][1] for name in BENCHMARKS}, made_by, folder)
    show(f"results in {folder}")


def forecast(quick, rows, costs, made_by, folder):
    """Measure kernels, and predict the time of a step at degree 1; made_by is the command.  Collective."""
    tolerance = TOLERANCES[quick]
    *_, last = adapt(hertz(), tolerance, degree=1)
    moved = (*migration(COMM, last.forest), last.forest.size_global)
    del last
    write(cost_table(costs, rows, moved), folder / "cost.md")

    kernels = [measure(COMM, tolerance)]
    if COMM.rank == 0 and COMM.size > 1:
        alone = measure(MPI.COMM_SELF, tolerance)
        kernels = [alone, replace(kernels[0], levels=alone.levels)]
    kernels = COMM.bcast(kernels)
    seconds = predicted(rows, kernels[-1])
    text = [f"MODEL, not a measurement: {Network()}, kernels as measured here:\n", kernel_table(kernels)]
    if COMM.size == 1:
        text.append("\nOn one rank no rows travel: exchanges are missing. Run on two ranks.")
    for name, kinds in seconds.items():
        dofs = f"{name}, {BENCHMARKS[name][2] / 1e6:.1f} million dofs"
        text += ["", prediction(dofs, kinds)]
        if COMM.rank == 0:
            draw_prediction(kinds, dofs, folder / f"prediction_{name}.png")
    if COMM.rank == 0:
        tables.write(folder / "prediction.csv", list(seconds_by_stage(seconds)), made_by)
    write("\n".join(text), folder / "prediction.md")


def write(text, path):
    """Show a text and keep it."""
    if COMM.rank == 0:
        path.write_text(text + "\n")
    show(text)


if __name__ == "__main__":
    main()
