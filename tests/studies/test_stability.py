"""Some scenes of the stress matrix: no scene is delivered wrong, none dies, and the judge sees what is wrong."""

import os
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere, outside

from fx_contact import Enforcement, Material, adapt
from fx_contact.contact.constraint_rows import Role
from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from fx_contact.scenes import stack
from studies.stability import run as stability
from studies.stability import without
from studies.stability.cases import Case, Exact, sample
from studies.stability.checks import Check
from studies.stability.figures import SCORES, draw_matrix, named, rows
from studies.stability.references import stack_force
from studies.stability.scenes import cases
from studies.stability.shapes import sheared_nodes
from studies.tables import TOP, read

NAMED = cases()
CHOSEN = sample(NAMED)
SOFT = Material(1.0, 0.3)

alone = pytest.mark.skipif(WORLD.size > 1, reason="scores on one rank")


@pytest.mark.skipif(WORLD.size != 2, reason="a minute, on one number of ranks")
def test_scores():
    """Every fourth of what `--quick` runs, on one rank each: right, rightly refused, or not for the reason kept."""
    _, kept = read(TOP / "studies/stability/scores.csv")
    known = {row["name"]: row["score"] for row in kept if row["score"] in ("noisy", "unreached", "error")}
    cases = list(CHOSEN.values())[::4]
    mine = [stability.score(case) for case in cases[WORLD.rank :: WORLD.size]]
    bad = [one for one in mine if one["score"] not in ("right", "refused", known.get(one["name"]))]
    everywhere(not bad, "\n".join(stability.line(one) for one in bad))
    good = WORLD.allreduce(sum(one["score"] in ("right", "refused") for one in mine))
    assert good > 0.95 * len(cases) > 20


@alone
def test_the_tables():
    """The kept scores are of these scenes, as many as the pages say; the sample has every row."""
    for name in ("scores", "scores_degree1"):
        assert [row["name"] for row in read(TOP / f"studies/stability/{name}.csv")[1]] == list(NAMED)
    pages = "".join((TOP / page).read_text() for page in ("docs/verification.md", "studies/stability/README.md"))
    assert set(re.findall(r"\b(\d{3}) scenes", pages)) == {str(len(NAMED))}
    assert {case.row for case in CHOSEN.values()} == {case.row for case in NAMED.values()}
    assert len(NAMED) / 6 < len(CHOSEN) <= len(NAMED) / 5
    assert all(set(name) <= set("/-+._()" + name) and " " not in name for name in NAMED)


def last(name, tolerance=0.2):
    """The last step of a scene of the matrix."""
    *_, step = adapt(NAMED[name].scene(), tolerance, comm=stability.MPI.COMM_SELF)
    return step


def failed(step, **changes):
    """Names of the checks that a step fails whose solution is changed; as it is, it fails none."""
    assert all(c.holds for c in stability.State(step).checks())
    state = stability.State(replace(step, solution=replace(step.solution, **changes)))
    return {c.name for c in state.checks() if not c.holds}


def judged(reference, **changes):
    """The score of a stack against a reference."""
    known = {"scene": lambda: stack([SOFT, SOFT]), "reference": reference}
    return stability.score(Case("axis", "family", "value", **(known | changes)))


@alone
def test_the_judge_sees_a_wrong_force():
    """Off by 1e-4 where nothing excuses it is a silent failure; so is a solution where there is none."""
    right = stack_force([SOFT, SOFT])[1]
    assert judged(right)["score"] == "right"
    assert judged(replace(right, force=right.force * 1.0001))["score"] == "wrong"
    assert judged(None)["score"] == "wrong"
    assert judged(right, scene=lambda: stack([SOFT]))["score"] == "error"
    assert judged(None, scene=lambda: stack([SOFT]))["score"] == "refused"
    assert not Check("not a number", np.nan, 1.0).holds


@alone
def test_either_degree():
    """A scene is scored with the degree that was asked for, and its command asks for it."""
    one, two = (judged(stack_force([SOFT, SOFT])[1], degree=degree) for degree in (1, 2))
    assert one["score"] == two["score"] == "right" and two["dofs"] / two["cells"] > 3 * one["dofs"] / one["cells"]
    assert {"--degree" in stability.command("name", degree) for degree in (1, 2)} == {False, True}


@alone
def test_the_judge_wants_what_was_asked_for_and_what_is_stated():
    """Off by more than the record's error allows, or by more than the square of the tolerance, is wrong."""
    *_, step = adapt(stack([SOFT, SOFT]), 0.2, comm=stability.MPI.COMM_SELF)
    state = stability.State(step)
    trusted = 0.1 / 0.8, 0.1 / (0.8 * 0.5)
    for seen, tolerance, error in ((1.0, 0.2, trusted[0]), (0.5, 0.3, trusted[1]), (0.5, 0.2, 0.2)):
        state.record = replace(step.record, estimate=0.1, assumed_effectivity=seen, tolerance=tolerance)
        for off, holds in ((0.99 * error**2, True), (1.01 * error**2, False)):
            known = Exact(force=state.interfaces()[0] / (1 + off), approach=0.01)
            (check,) = state.against_exact(known)
            assert check.holds == holds, (seen, tolerance, off)
            (check,) = state.against_exact(replace(known, linear=True))
            assert not check.holds, "uniform stresses are exact"


@alone
@pytest.mark.parametrize("method", ["exact", "penalty"])
def test_the_potential_energy_is_also_that_of_contact(method):
    """f . u = a(u, u) + F . (g + penetration): so it is -a(u, u) less penalty and 2 F . g, of a gap that closes."""
    scene = NAMED["drawn/plate-over-a-stop/2"].scene()
    *_, step = adapt(scene, 0.3, comm=stability.MPI.COMM_SELF, enforcement=Enforcement(method))
    state, closed = stability.State(step, method == "penalty"), step.solution.force @ step.rows.gap
    assert closed > state.energy and (method == "exact" or state.yielded > 1e-5 * state.energy)
    assert abs(state.potential + state.energy + state.yielded + 2 * closed) < 1e-7 * state.energy


@alone
@pytest.mark.parametrize(
    "spoil, check",
    [
        (lambda c: replace(c, row_force=1.001 * c.row_force), "balance of each body"),
        (lambda c: replace(c, row_force=c.force - 2 * c.force * (c.force == c.force.max())), "no tension"),
        (
            lambda c: replace(c, active=np.zeros_like(c.active), row_force=0 * c.force),
            "no penetration but the penalty's",
        ),
        (lambda c: replace(c, displacement=1.01 * c.displacement), "work is stored"),
    ],
    ids=["force", "tension", "penetration", "work"],
)
def test_the_judge_sees_a_spoilt_solution(spoil, check):
    """Each check fails where what it is for is wrong, and holds where nothing is."""
    penalty = Enforcement("penalty")  # whose overlap is a spoilt solution's if no pair is closed
    *_, step = adapt(stack([SOFT, Material(3.0, 0.1)]), 0.2, comm=stability.MPI.COMM_SELF, enforcement=penalty)
    assert all(c.holds for c in stability.State(step, True).checks())
    state = stability.State(replace(step, solution=spoil(step.solution)), True)
    assert check in [c.name for c in state.checks() if not c.holds]


def _spoilt_ties(solution, factor):
    """Forces of all rows, those of ties times a factor."""
    return np.where(solution.rows.role == Role.EQUATION, factor, 1.0) * solution.row_force


@alone
def test_the_judge_sees_a_spoilt_tie():
    """Forces of ties are among those on a body, beside contact and without it."""
    for name in ("E-5e1", "layers"):
        step = last(f"ties/tied/{name}")
        assert failed(step, row_force=_spoilt_ties(step.solution, 1.001)) == {"balance of each body"}


@alone
@pytest.mark.parametrize(
    "name", ["parts/bonded/soft", "loads/strains/gap", "loads/springs/1e9", "loads/rigid-faces/far"]
)
def test_the_judge_sees_a_wrong_modulus(name):
    """Parts, stress-free strains, springs and rigid loads: moduli off by 1e-3 are noticed."""
    case = NAMED[name]
    assert stability.score(case)["score"] == "right"

    def stiffer():
        """The scene with other moduli."""
        scene = case.scene()
        known = {name: replace(one, young=1.001 * one.young) for name, one in scene.materials.items()}
        return replace(scene, materials=known)

    assert stability.score(replace(case, scene=stiffer))["score"] == "wrong"


@alone
@pytest.mark.parametrize(
    "name, expected",
    [
        ("loads/rigid-faces/pressed", {"given forces", "balance of each body", "work is stored"}),
        ("loads/preload/pulled", {"balance of each body", "work is stored"}),
        ("drawn-loads/loads/bolt-1", {"given forces", "balance of each body", "work is stored"}),
    ],
)
def test_the_judge_sees_spoilt_forces_of_loads(name, expected):
    """Forces of rigid faces and sections that are not those given, or not in balance, are noticed."""
    step = last(name)
    assert failed(step, row_force=_spoilt_ties(step.solution, 1.01)) == expected


@alone
def test_the_judge_sees_spoilt_springs_and_strains():
    """Displacements that are off are noticed in the balance of bodies on springs, and in the stored work."""
    for name in ("loads/springs/1e9", "loads/strains/gap"):
        step = last(name)
        assert "work is stored" in failed(step, displacement=1.01 * step.solution.displacement)


@alone
def test_the_potential_of_rigid_loads():
    """F . t = a(u, u): the potential, with the loads, is its negative; with the motion prescribed it is the energy."""
    state = stability.State(last("drawn-loads/loads/rigid-2", 0.3))
    assert abs(state.given - 2 * state.energy) < 1e-7 * state.energy and state.energy > 0
    assert abs(state.potential + state.energy) < 1e-7 * state.energy


@alone
def test_errors_beside_free_expansion():
    """They are relative to the tolerance times the norm of full restraint; the force of a pair to itself."""
    step = last("drawn-loads/loads/heat-2", 0.16)
    state = stability.State(step)
    assert step.estimate.energy_norm**2 == pytest.approx(state.restraint * state.energy, rel=1e-6)
    assert state.restraint > 100 and state.asked() == 0.16
    off = (step.record.estimate * step.estimate.energy_norm) ** 2 / state.energy / (0.8 * 0.4) ** 2
    assert state.stated() == pytest.approx(off, rel=1e-6)


@alone
def test_errors_of_motions_found_and_prescribed_add_up():
    """Energies err downwards below loads and upwards where they are prescribed; a modulus off by a tenth is noticed."""
    case = replace(NAMED["drawn-loads/loads/rigid-2"], degree=1)
    one = stability.score(case)
    off = [check[1] for check in one["checks"] if check[0] == "energy against the twin"]
    assert one["score"] == "right" and 0.25**2 < off[0] < 0.25**2 * (1 + 0.5**2)

    def stiffer():
        """The scene with another modulus."""
        return replace(scene := case.scene(), materials={"bar": replace(scene.materials["bar"], young=1.1)})

    assert stability.score(replace(case, scene=stiffer))["score"] == "wrong"


@alone
def test_moved_nodes_keep_the_shape():
    """Cells with inner nodes moved have other maps but the same corners and surfaces."""
    scene = stack([SOFT, SOFT], order=2)
    moved = sheared_nodes(scene, 0.9, [0, 1, 2])
    assert np.array_equal(scene.mesh.points[scene.mesh.corners], moved.mesh.points[moved.mesh.corners])
    assert np.abs(scene.mesh.points - moved.mesh.points).max() > 0.1
    assert np.array_equal(scene.mesh.points.max(axis=0), moved.mesh.points.max(axis=0))


@alone
def test_a_scene_with_an_unsure_reference():
    """An uncertain reference allows its own uncertainty, no more."""
    right = stack_force([SOFT, SOFT])[1]
    off = Exact(force=1.01 * right.force, approach=right.approach, linear=True, unsure=0.011)
    assert judged(off)["score"] == "right"
    assert judged(replace(off, unsure=0.009))["score"] == "wrong"


@alone
def test_twins_are_kept_apart(monkeypatch):
    """Scenes have the twins that they have by themselves, whatever was solved before; one in common is solved once."""
    first, alike = NAMED["tilt/blocks/10-about-x"], NAMED["tilt/blocks/45-about-x"]
    others = [
        NAMED["other-loads/pressure-beside-a-plate/0.02"],
        replace(first, tolerance=0.5),
        replace(first, degree=1),
    ]
    kept = {}
    monkeypatch.setattr(stability, "_TWINS", kept)
    together = [stability.score(case) for case in (first, alike, *others)]
    assert len(kept) == 1 + len(others)
    for case, one in zip(others, together[2:]):
        kept.clear()
        assert stability.score(case)["checks"] == one["checks"] and one["score"] == "right"


@alone
def test_a_twin_on_another_mesh_has_one():
    """A scene that is compared with itself on the same mesh would agree whatever it gives."""
    checks = stability.score(NAMED["order/indentation/1"])["checks"]
    assert all(deviation > 1e-6 for what, deviation, _, _ in checks if "against the twin" in what)


@alone
def test_rules_are_switched_off_for_a_scene_alone():
    """Not for its twin, whose errors would be the same; and they are back afterwards."""
    case, before = NAMED["drawn/two-crests-1-pair/4"], GapBetweenNodes.penetrated
    known = stability.score(case)
    assert known["score"] == "right"
    found = without.scored(case.name, ["penetration between nodes"])
    assert found["score"] == "wrong" and found["dofs"] < known["dofs"]
    assert GapBetweenNodes.penetrated is before
    row = without.compared([known], [found])
    assert row["worse"] == 1 and row["which"] == case.name and row["unknowns"] < 1


@alone
def test_processes(tmp_path, monkeypatch):
    """Scenes run in other processes, are not run again, and a hang or a crash is a score; all is drawn."""
    for name in set(os.environ) - set(outside()):  # they are no ranks of an mpirun above
        monkeypatch.delenv(name)
    names = ["bodies/stack/2", "held-by-contact/nothing-holds/pulled-stack", "gap/stack/1e-2"]
    chosen, path = {name: NAMED[name] for name in names}, tmp_path / "scores.jsonl"
    lost = {"lost": Case("no", "such", "scene", None, None)}
    for more, limit in (({}, 60.0), (lost, 60.0), ({"late": NAMED["gap/stack/-1e-4"]}, 1e-3)):
        stability.study(chosen | more, path, limit)
        scores = stability.read(path)
        assert len(path.read_text().splitlines()) == len(scores), "scored again"
    expected = dict(zip(names, ("right", "refused", "right"))) | {"no/such/scene": "crash", "gap/stack/-1e-4": "hang"}
    assert {name: one["score"] for name, one in scores.items()} == expected
    scores = list(scores.values())
    draw_matrix(scores, tmp_path / "matrix.png", {one["name"]: one for one in scores[:2]})
    assert [row["score"] for row in rows(scores, str)] == [one["score"] for one in scores]
    assert (tmp_path / "matrix.png").stat().st_size > 5_000  # with a palette; next to nothing on white has 2,000
    assert "- crash: `no/such/scene`" in named(scores) and {one["score"] for one in scores} <= set(SCORES)
