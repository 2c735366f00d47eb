"""The stress matrix: stiff and extreme scenes, each scored, each a command of its own.

Each scene must balance its forces, have no tension, store the work done on it, and agree with a reference, or with a
twin: the same problem in other units, another direction or on another mesh. `checks.py` says how closely. Each runs on
one rank, with a time limit; a crash and a hang are scores too.

    python3 -m studies.stability.run --quick            # a fifth of the scenes, spread over all rows
    python3 -m studies.stability.run                    # all: ten minutes on two cores
    python3 -m studies.stability.run --only NAME        # one scene, with all its checks
    python3 -m studies.stability.run --axis parts loads # those of some axes
    python3 -m studies.stability.run --degree 1         # displacements of degree 1

A run goes on where it stopped; delete the folder of results to begin anew. It leaves there scores.jsonl, scores.csv
and matrix.png, of another degree than the default scores_degree1.jsonl and so on.  The picture has below each
scene what the other degree has made of it, as kept here.
"""

import difflib
import json
import os
import shlex
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

from mpi4py import MPI

from fx_contact import Enforcement, adapt
from fx_contact.adaptive.settings import DEGREE
from fx_contact.parallel.errors import FxContactError
from fx_contact.scene.fingerprint import scene_parts
from studies import tables
from studies.stability.cases import Twin, sample
from studies.stability.checks import LOST, State
from studies.stability.figures import draw_matrix, named, nearest, rows
from studies.stability.scenes import cases

#: Refinement ends above so many unknowns of each degree, whether the accuracy is reached or not.
MOST_DOFS = {1: 40_000, 2: 160_000}
#: Seconds that a scene may take.
TIME_LIMIT = 400
#: Entries of the record that are kept.
KEPT = ("step", "cells", "dofs", "max_level", "active_pairs", "estimate", "ratio", "assumed_effectivity")
KEPT += ("force", "max_penetration", "penalty_share")
#: Twins that this process has solved.
_TWINS = {}


def solve(scene, tolerance, degree, enforcement=None):
    """The state at the end of a run, accuracy reached or too many unknowns, and the iterations of all its steps."""
    enforcement, iterations = enforcement or Enforcement(), 0
    # That nothing is the answer to nothing is a scene too.
    how = {"degree": degree, "enforcement": enforcement, "allow": ("no load",)}
    for step in adapt(scene, tolerance, MPI.COMM_SELF, **how):
        iterations += step.record.contact_iterations + sum(step.record.krylov_iterations)
        if step.record.dofs > MOST_DOFS[degree]:
            break
    return State(step, enforcement.method == "penalty"), iterations


def score(case, changed=nullcontext()):
    """Run a scene, in a context, and what it is compared with, outside it.

    Returns:
        dict: name and place in the matrix, "score" (a key of `figures.SCORES`), the checks, the record.
    """
    start, result = time.process_time(), place(case)
    try:
        result |= _judged(case, changed)
    except FxContactError as error:
        refused = "refused" if case.reference is None or case.may_refuse else "error"
        result |= {"score": refused, "message": f"{type(error).__name__}: {error}"}
    return result | {"cpu_seconds": time.process_time() - start}


def place(case):
    """Name and place of a scene in the matrix, without a check: dict."""
    return {"name": case.name, "axis": case.axis, "row": case.row, "value": case.value, "checks": []}


def _judged(case, changed):
    start = time.process_time()
    with changed:
        state, iterations = solve(case.scene(), case.tolerance, case.degree, case.enforcement)
    record, reference = state.record, case.reference
    result = {"iterations": iterations, "noise": state.noise, "own_cpu_seconds": time.process_time() - start}
    result |= {name: getattr(record, name) for name in KEPT}
    result["doubts"] = ", ".join(doubt.kind for doubt in record.doubts)
    if reference is None:
        return result | {"score": "wrong", "message": "there is no solution, but one was delivered"}
    sound = state.checks()
    if isinstance(reference, Twin):
        compared = state.against_twin(_twin_of(case, record), reference)
    else:
        compared = state.against_exact(reference)
    result["checks"] = [[c.name, c.deviation, c.allowed, c.holds] for c in (*sound, *compared)]
    failed = [c.name for c in sound + compared * record.reached if not c.holds]
    if failed:
        return result | {"score": "wrong", "message": "; ".join(failed)}
    if not record.reached:
        about = f"estimated error {record.estimate:.0%}, {record.dofs} dofs"
        return result | {"score": "unreached", "message": about}
    return result | {"score": "noisy" if state.noise > LOST else "right"}


def _twin_of(case, record):
    """The State of a scene's twin, without its step; many scenes have the twin of another one: the first one pays.

    One on another mesh is solved to a closer tolerance as long as it has so many cells as the record: its mesh may be
    the same.
    """
    twin = case.reference
    scene, tolerance = twin.scene(), case.tolerance * twin.tolerance
    while True:
        key = repr((scene_parts(scene), tolerance, case.degree))
        if key not in _TWINS:
            _TWINS[key] = solve(scene, tolerance, case.degree)[0].without_step()
        if twin.same_mesh or _TWINS[key].record.cells != record.cells:
            return _TWINS[key]
        tolerance /= 2


def command(name, degree=DEGREE):
    """What runs one scene again."""
    return f"python3 -m studies.stability.run{_option(degree)} --only {shlex.quote(name)}"


def _option(degree):
    return "" if degree == DEGREE else f" --degree {degree}"


def read(path):
    """Scores of a file, the last one of each name; a line that was cut off is passed over."""
    result = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            one = json.loads(line)
        except ValueError:
            continue
        result[one["name"]] = one
    return result


def keep(path, one):
    """Append a score to a file, in one write."""
    with path.open("ab", buffering=0) as file:
        file.write((json.dumps(one) + "\n").encode())


def study(chosen, path, limit=TIME_LIMIT):
    """Score what has no score in a file yet, in as many processes as there are cores.

    Where a process dies, the scene that it was at gets a score for that, and another process goes on behind it.

    Args:
        chosen: name -> Case, of one degree.
        path: of the file.
        limit: seconds that a scene may take.
    """
    context, cores = get_context("spawn"), len(os.sched_getaffinity(0))

    def attempt(share):
        while todo := [case for case in share if case.name not in read(path)]:
            names = [case.name for case in todo]
            process = context.Process(target=_serve, args=(names, todo[0].degree, path, limit), daemon=True)
            process.start()
            process.join()
            lost = next((case for case in todo if case.name not in read(path)), None)
            if lost:
                code = process.exitcode
                hung = code == -signal.SIGALRM
                result = {"score": "hang" if hung else "crash", "cpu_seconds": limit if hung else 0.0}
                keep(path, place(lost) | result | {"message": f"exit code {code}"})

    todo = [case for case in chosen.values() if case.name not in read(path)]
    with ThreadPoolExecutor(cores) as threads:
        list(threads.map(attempt, [todo[k::cores] for k in range(cores)]))


def _serve(names, degree, path, limit):
    """Score scenes one after the other; a signal ends the process where one takes too long."""
    named = cases()
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    for name in names:
        signal.setitimer(signal.ITIMER_REAL, limit)
        one = score(replace(named[name], degree=degree))
        signal.setitimer(signal.ITIMER_REAL, 0)
        keep(path, one)
        print(line(one), flush=True)


def line(one):
    """A score in one line."""
    worst = max(one["checks"], key=nearest, default=None)
    about = f"{worst[0]}: {worst[1]:.1e} of {worst[2]:.1e}" if worst else ""
    return f"{one['score']:9}  {one['name']:55} {one['cpu_seconds']:5.1f} s  {one.get('message') or about}"


def show(one):
    """A score with all its checks."""
    print(line(one))
    for name, deviation, allowed, holds in one["checks"]:
        print(f"    {'holds' if holds else 'FAILS'}  {name:32} {deviation:9.2e}, allowed {allowed:9.2e}")
    skip = ("name", "axis", "row", "value", "checks", "score", "message", "doubts")
    print("    doubts:", one.get("doubts") or "none")
    print("   ", ", ".join(f"{k} {v:.4g}" for k, v in one.items() if k not in skip and v is not None))


def main():
    """Run what is asked for."""
    parser = tables.options(__doc__, "stability")
    parser.add_argument("--quick", action="store_true", help="a seventh of each row, at least one: a fifth of all")
    parser.add_argument("--axis", nargs="+", help="the scenes of some axes (all)")
    parser.add_argument("--only", metavar="NAME", help="run one scene, whether it has a score or not")
    parser.add_argument("--degree", type=int, choices=(1, 2), default=DEGREE, help="of displacements (%(default)s)")
    parser.add_argument("--list", action="store_true", help="print the names of the scenes chosen")
    arguments = parser.parse_args()
    scenes = {name: replace(case, degree=arguments.degree) for name, case in cases().items()}
    chosen = sample(scenes) if arguments.quick else scenes
    if arguments.axis:
        chosen = {name: case for name, case in chosen.items() if case.axis in arguments.axis}
        if not chosen:
            parser.error(f"no axis {arguments.axis}: give some of {sorted({case.axis for case in scenes.values()})}")
    if arguments.list:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # not PETSc's, for `| head`
        print("\n".join(chosen))
        return
    arguments.output.mkdir(parents=True, exist_ok=True)
    suffix = "" if arguments.degree == DEGREE else f"_degree{arguments.degree}"
    path = arguments.output / f"scores{suffix}.jsonl"
    if arguments.only is not None:
        if arguments.only not in scenes:
            near = difflib.get_close_matches(arguments.only, scenes, cutoff=0.3)
            parser.error(f"no scene {arguments.only!r}; the nearest are {', '.join(near)}; --list shows all")
        one = score(scenes[arguments.only])
        keep(path, one)
        show(one)
        return
    study(chosen, path)
    known = read(path)
    scores = [known[name] for name in chosen if name in known]
    made_by = "python3 -m studies.stability.run" + " --quick" * arguments.quick + _option(arguments.degree)
    made_by += f" --axis {shlex.join(arguments.axis)}" if arguments.axis else ""
    kept = arguments.output / f"scores{suffix}.csv"
    tables.write(kept, list(rows(scores, partial(command, degree=arguments.degree))), made_by)
    _, other = tables.read(tables.TOP / f"studies/stability/scores{'_degree1' * (not suffix)}.csv")
    draw_matrix(scores, arguments.output / f"matrix{suffix}.png", {row["name"]: row for row in other})
    print(f"\n{named(scores)}\n\ncommands and messages: {kept}")


if __name__ == "__main__":
    main()
