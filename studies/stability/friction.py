"""Two hundred load paths with friction, drawn with a seed: the law, forces and work of each load step.

At each node friction is at most its bound, nodes below it stick, others slip along their force; forces are in balance,
and no work is gained.  A fifth of the paths have a twin, turned, in other units or with surfaces exchanged, with the
same forces.

    python3 -m studies.stability.friction              # all: a quarter of an hour on one core
    python3 -m studies.stability.friction --quick      # one path of each family
    python3 -m studies.stability.friction --only NAME  # one path, with all its checks

A run goes on where it stopped; delete the folder of results to begin anew.
"""

import time
import traceback
from collections import Counter

import numpy as np
from mpi4py import MPI

from fx_contact import Solver, SymmetryPlane, Tresca, increments
from fx_contact.adaptive.step_solver import HISTORY
from fx_contact.contact.constraint_rows import Role
from fx_contact.geometry.shapes import rotation
from fx_contact.parallel.errors import FxContactError
from studies import tables
from studies.stability import twins
from studies.stability.checks import CONTRACT, LOST, Check, State
from studies.stability.figures import nearest
from studies.stability.friction_scenes import EACH, paths
from studies.stability.run import keep, read

#: Of the stress; and meshes of a load step.
TOLERANCE, MESHES = 0.3, 2
#: Relative difference of a twin's forces on the same mesh.
ALIKE = 1e-5
#: Linear solves of a load step that are many, for coefficients up to 0.6 and above.
MANY = {0.6: 12, np.inf: 20}
#: Every so many paths have a twin.
TWINS = 5
#: Of twins: lengths and stresses in other units.
LENGTH, STRESS = 1e3, 2e-6


def solve(path, changed=lambda scene: scene):
    """Yields the scene and the last step of each load step of a path, its scenes changed by a function."""
    scenes = [changed(path.scene(motion)) for motion in path.motions]
    options = {"degree": path.degree, "max_steps": MESHES}
    values = range(len(scenes))
    for point in increments(lambda k: scenes[round(k)], values, TOLERANCE, MPI.COMM_SELF, **options):
        yield scenes[point.record.point], point.step


class Friction:
    """Checks of the law of friction in a load step.

    Args:
        step: the last one of a load step.
        scene, before: of this load step, and of the one before or None.
    """

    def __init__(self, step, scene, before):
        self.step, self.scene, self.record = step, scene, step.record
        self.state = State(step)
        solution, rows = step.solution, step.solution.rows
        self._of = [np.flatnonzero((rows.role == Role.TANGENT) & (rows.axis == axis)) for axis in (1, 2)]
        normal = np.flatnonzero(rows.role == Role.NORMAL)
        rough = [index for index, pair in enumerate(scene.contact) if pair.tangential is not None]
        normal = normal[np.isin(rows.contact[normal], rough)]
        self.closed, self.slips = solution.active[normal], solution.slipping[normal]
        self.force = np.stack([solution.row_force[of] for of in self._of], axis=1)
        self.normal = solution.row_force[normal]
        self.stiffness = rows.capped_stiffness[normal]
        self.bound = np.where(self.closed, self._bounds(rows, normal), 0.0)
        moved = rows.jump(solution.displacement) - self._history(rows) - self._of_obstacles(rows, before)
        self.slip = np.stack([moved[of] for of in self._of], axis=1) * self.closed[:, None]
        self.scale = max(float(self.bound.max(initial=0.0)), CONTRACT * self.state.scale)

    def _bounds(self, rows, normal):
        """Largest tangential force of each node [N]."""
        laws = [pair.tangential for pair in self.scene.contact]
        known = [(law.bound, 0.0) if isinstance(law, Tresca) else (0.0, law and law.coefficient) for law in laws]
        traction, coefficient = np.array(known, dtype=np.float64)[rows.contact[normal]].T
        pressed = np.maximum(self.normal, 0.0)
        return np.where(traction > 0, np.minimum(traction * rows.area[normal], pressed), coefficient * pressed)

    def _history(self, rows):
        """B u of the load step before (n,) [m]."""
        if HISTORY not in self.step.fields:
            return np.zeros(len(rows))
        space = rows.prolongation.space
        return rows.jump(rows.prolongation.injected(self.step.fields.at_nodes(space, HISTORY)))

    def _of_obstacles(self, rows, before):
        """How far obstacles have moved in the load step along the rows (n,) [m]."""
        last = [pair.moved for pair in before.contact] if before else np.zeros((len(self.scene.contact), 3))
        moved = np.array([pair.moved for pair in self.scene.contact]) - last
        return np.einsum("ni,ni->n", rows.normal, moved[rows.contact])

    @property
    def allowed(self):
        """Change of a nodal force by the solver's error, relative to the largest bound."""
        contact = self.step.solution
        spread = max(1.0, 2 * sum(contact.krylov_iterations) / np.log(2 / Solver().tolerance))
        stiffest = np.sqrt(self.stiffness.max(initial=0.0))
        return CONTRACT + min(2 * spread * contact.energy_error * stiffest / self.scale, LOST)

    def checks(self):
        """List of Check."""
        size, allowed = np.linalg.norm(self.force, axis=1), self.allowed
        trial = self.force + self.stiffness[:, None] * self.slip
        length = np.linalg.norm(trial, axis=1)
        limited = trial * np.minimum(1.0, self.bound / np.maximum(length, np.finfo(float).tiny))[:, None]
        worst = {
            "no more than the bound": (size - self.bound).max(initial=0.0),
            "the bound where it slips": np.abs(size - self.bound)[self.slips].max(initial=0.0),
            "no slip where it sticks": (length - size)[self.closed & ~self.slips].max(initial=0.0),
            "stick, or slip along the force": np.abs(self.force - limited)[self.closed].max(initial=0.0),
            "open nodes carry nothing": np.abs(np.column_stack([self.force, self.normal]))[~self.closed].max(
                initial=0.0
            ),
        }
        checks = [Check(name, float(value) / self.scale, allowed) for name, value in worst.items()]
        return [*checks, *self._of_the_record(), *self._sound()]

    def _sound(self):
        """Checks of any solution, but that of stored work, which is without friction."""
        return [check for check in self.state.checks() if check.name != "work is stored"]

    def _of_the_record(self):
        """Work and resultants."""
        record, noise, scale = self.record, self.state.noise, self.state.scale
        work = float((self.force * self.slip).sum()) * self.scene.symmetry
        lost = noise * scale * self.state.size * self.scene.symmetry
        of = {}
        for one in record.resultants:
            of.setdefault(one.kind, []).append(np.array(one.force))
        unbalanced = max(np.linalg.norm(force) for force in of["balance"])
        loads = ("traction", "pressure", "reaction")
        total = sum((force for kind in loads for force in of.get(kind, ())), np.zeros(3))
        for pair, force in zip(self.scene.contact, of["contact"]):
            total -= force * (pair.obstacle is not None)
        counts = int(np.count_nonzero(self.closed & self.slips)), int(np.count_nonzero(self.closed & ~self.slips))
        unlike = counts != (record.slipping_pairs, record.sticking_pairs)
        return [
            Check("no work is gained", max(-work, 0.0), lost),
            Check("work of the record", abs(work - record.dissipated_energy), lost),
            Check("nodes of the record", float(unlike), 0.0),
            Check("balance of the record", unbalanced / scale, noise),
            Check("reactions and loads", np.linalg.norm(total) / (scale * self.scene.symmetry), noise),
        ]


def turned(scene):
    """The scene seen from another direction, by any angles if all conditions hold all components; and the matrix."""
    free = any(isinstance(c, SymmetryPlane) or not c.held.all() for c in scene.dirichlet)
    turn = np.eye(3)[[2, 0, 1]] if free else rotation((1.0, 2.0, 3.0), 50.0)
    return twins.turned(scene, turn), turn


def in_other_units(scene):
    """The scene in other units of length and stress, and the matrix of its forces."""
    return twins.scaled(scene, LENGTH, STRESS), STRESS * LENGTH**2 * np.eye(3)


def exchanged(scene):
    """The scene with the surfaces of each contact exchanged, and the matrix of its forces."""
    return twins.swapped(scene), -np.eye(3)


def twin_of(path, number):
    """Function of a scene that gives its twin and the matrix of its forces; None: the path has none."""
    if number % TWINS:
        return None
    # Tresca's bounds are of the areas of nodes on the first surface.
    one_sided = path.kind == "obstacle" or "Tresca" in path.how
    ways = (turned, in_other_units) if one_sided else (turned, in_other_units, exchanged)
    return ways[number // TWINS % len(ways)]


def _contact_forces(step):
    return np.array([one.force for one in step.record.resultants if one.kind == "contact"])


def against_twin(path, how, found):
    """Comparison of the contact forces of each load step, as found, with those of a twin: list of Check."""
    scale = max(np.abs(forces).max() for forces, _ in found) or 1.0
    matrix, result = how(path.scene(path.motions[0]))[1], []
    size = np.linalg.norm(matrix, 2)
    for (_, step), (forces, (cells, noise)) in zip(solve(path, lambda scene: how(scene)[0]), found, strict=True):
        same = step.record.cells == cells
        off = np.abs(_contact_forces(step) - forces @ matrix.T).max() / (scale * size)
        allowed = max(ALIKE, 2 * noise) if same else TOLERANCE**2
        result.append(Check(f"{how.__name__}, on {'the same' if same else 'another'} mesh", float(off), allowed))
    return result


def judged(path, how=None):
    """Checks of all load steps of a path, and figures of them: list of Check, dict."""
    checks, found, before, solves, iterations, many, doubts = [], [], None, [], [], 0, set()
    for scene, step in solve(path):
        friction, record = Friction(step, scene, before), step.record
        checks += friction.checks()
        noise = friction.state.noise
        found.append((_contact_forces(step), (record.cells, noise)))
        solves.append(len(record.krylov_iterations))
        iterations.append(sum(record.krylov_iterations))
        doubts |= {doubt.kind for doubt in record.doubts}
        before = scene
    many = sum(one > limit for one in solves for limit in [next(m for mu, m in MANY.items() if path.mu <= mu)])
    figures = {"solves": max(solves), "iterations": max(iterations), "many": many, "all solves": solves}
    figures |= {"unknowns": record.dofs, "sticking": record.sticking_pairs, "slipping": record.slipping_pairs}
    if how is not None:
        checks += against_twin(path, how, found)
    return checks, figures | {"doubts": ", ".join(sorted(doubts))}


def score(path, number):
    """Verdict of a path: dict."""
    start, how = time.process_time(), twin_of(path, number)
    result = {"name": path.name, "mu": path.mu, "nu": path.nu, "ratio": path.ratio, "degree": path.degree}
    result |= {"kind": path.kind, "steps": len(path.motions), "how": path.how, "twin": how.__name__ if how else ""}
    try:
        checks, figures = judged(path, how)
        failed = dict.fromkeys(check.name for check in checks if not check.holds)
        result |= figures | {"verdict": "wrong" if failed else "right", "message": "; ".join(failed)}
        result["checks"] = [[c.name, c.deviation, c.allowed, c.holds] for c in checks]
    except FxContactError as error:
        result |= {"verdict": "error", "message": f"{type(error).__name__}: {error}"}
    except Exception:
        result |= {"verdict": "crash", "message": traceback.format_exc()}
    return result | {"cpu": time.process_time() - start}


def rows(scores):
    """A row a path, for a CSV file."""
    columns = ("mu", "nu", "ratio", "degree", "kind", "steps", "how", "twin", "verdict", "doubts", "solves")
    columns += ("iterations", "many", "unknowns", "sticking", "slipping", "cpu", "message")
    for one in scores:
        worst = max(one.get("checks", ()), key=nearest, default=("", "", ""))
        row = {"scene": one["name"]} | {name: one.get(name, "") for name in columns}
        yield row | dict(zip(("worst", "deviation", "allowed"), worst))


def line(one):
    """A verdict in one line."""
    about = f"mu {one['mu']:.2f} ratio {one['ratio']:.0e} degree {one['degree']} {one['kind']}"
    found = one.get("all solves", "")
    return f"{one['verdict']:6} {one['name']:22} {about:42} {one['cpu']:5.1f} s  {found} {one['message'][:200]}"


def main():
    """Run what is asked for."""
    parser = tables.options(__doc__, "stability")
    parser.add_argument("--quick", action="store_true", help="one path of each family")
    parser.add_argument("--only", metavar="NAME", help="run one path, whether it has a verdict or not")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    kept, chosen = arguments.output / "friction.jsonl", {n: (p, k) for k, (n, p) in enumerate(paths().items())}
    if arguments.only is not None:
        one = score(*chosen[arguments.only])
        for name, deviation, allowed, holds in one.get("checks", ()):
            print(f"    {'holds' if holds else 'FAILS'}  {name:32} {deviation:9.2e}, allowed {allowed:9.2e}")
        print(one["message"], *(f"{k}: {v}" for k, v in one.items() if k not in ("checks", "message")), sep="\n")
        return
    if arguments.quick:
        chosen = dict(list(chosen.items())[::EACH])
    for name, (path, number) in chosen.items():
        if name not in read(kept):
            # A path at which the process ends is passed over by the next run.
            keep(kept, {"name": name, "mu": path.mu, "verdict": "crash", "message": "the process ended", "cpu": 0.0})
            one = score(path, number)
            keep(kept, one)
            print(line(one), flush=True)
    known = read(kept)
    scores = [known[name] for name in chosen if name in known]
    made_by = "python3 -m studies.stability.friction" + " --quick" * arguments.quick
    tables.write(arguments.output / "friction.csv", list(rows(scores)), made_by)
    solves = [one for score in scores for one in score.get("all solves", ())]
    print(dict(Counter(one["verdict"] for one in scores)), f"{len(solves)} load steps")
    print("linear solves:", dict(sorted(Counter(solves).items())), "many:", sum(one.get("many", 0) for one in scores))


if __name__ == "__main__":
    main()
