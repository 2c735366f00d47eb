"""The page of slips: each of its calls is answered as the page says, on all ranks alike."""

import ast
import re
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
import ufl
from conftest import WORLD
from dolfinx import fem
from dolfinx.mesh import create_unit_cube
from test_bad_input import COMM, STEEL, press
from test_slips import PAIR, beside, held, joined, planes

import fx_contact
from fx_contact import (
    ContactPair,
    Dirichlet,
    FxContactError,
    RigidMotion,
    Scene,
    Shape,
    adapt,
    block,
    cylinder,
    root_mesh_from_shapes,
    scenes,
)
from fx_contact.verdict.scene_warnings import warnings_of

pytestmark = pytest.mark.ranks(1, 2)

PAGE = Path(__file__).parents[2] / "docs" / "slips.md"
ROW = r"^\| `(.+)` \| (\w+): (.*) \|$"
ROWS = re.findall(ROW, PAGE.read_text(), flags=re.M)
#: Public classes that the program makes, and those that `press`, `cube` and other tests stand for.
RESULTS = {"Step", "StepRecord", "Beginning", "Checkpoint", "Scene", "RootMesh", "Shape"}
CELL = create_unit_cube(COMM, 1, 1, 1)
CUBE = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)


def run(scene=None, tolerance=0.5, comm=COMM, **options):
    """A run of the two cubes."""
    return adapt(press() if scene is None else scene, tolerance, comm, **options)


def below(obstacle, **options):
    """A cube below an obstacle."""
    mesh, contact = root_mesh_from_shapes({"cube": CUBE}), ContactPair("cube top", obstacle, **options)
    return Scene("below", mesh, {"cube": STEEL}, (Dirichlet("cube bottom", 0, 0, 0),), contact=contact)


def down(x):
    """The direction against z at positions (3, n)."""
    return np.stack([0 * x[0], 0 * x[0], 0 * x[0] - 1])


def sliding():
    """The lower cube clamped, the upper one held along y and z on top."""
    return Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", y=0.0, z=-0.01), Dirichlet("upper left", x=0.0)


def one_plane():
    """Planes of symmetry by a Dirichlet on the lower cube alone."""
    return *held(), Dirichlet("lower left", x=0.0)


def standing():
    """The lower cube clamped, the upper one moved down on two sides."""
    return held()[0], Dirichlet("top", 0.0, 0.0, -0.05), Dirichlet("over", 0.0, 0.0, -0.05)


def small_seat(obstacle=None):
    """A cube pressed against another one, or an obstacle, where a part of its top alone may touch it."""
    seat = {"where": lambda x: x[0] < 0.6}
    lower = block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)
    shapes = {"lower": lower.named("seat", "top", **seat)}
    held = [Dirichlet("lower bottom", 0.0, 0.0, 0.05)]
    if obstacle is None:
        shapes["upper"] = lower.shifted(z=1.01).named("seat", "bottom", **seat)
        held.append(Dirichlet("upper top", 0.0, 0.0, 0.0))
    contact = ContactPair("lower seat", "upper seat" if obstacle is None else obstacle)
    return Scene("seat", root_mesh_from_shapes(shapes), dict.fromkeys(shapes, STEEL), held, contact=contact)


def turned(degrees):
    """The upper cube pressed down and turned on top."""
    angle = np.radians(degrees)
    return held()[0], RigidMotion("top", (0, 0, -0.01), (0, 0, angle), (0.5, 0.5, 2.0))


def pins():
    """Two round bodies with the surfaces of the cubes."""
    pin = cylinder(1, 1, (1, 1), order=2)
    names = {"base": "lower bottom", "under": "lower top", "over": "upper bottom", "top": "upper top"}
    return root_mesh_from_shapes({"lower": pin, "upper": pin.shifted(z=1)}, names | {"round": "upper outside"})


NAMES = {name: getattr(fx_contact, name) for name in fx_contact.__all__} | {
    "CELL": CELL,
    "COMM": COMM,
    "fem": fem,
    "ufl": ufl,
    "np": np,
    "STEEL": STEEL,
    "PAIR": PAIR,
    "PAIR_OF": ContactPair("under", "over"),
    "cube": CUBE,
    "press": press,
    "beside": beside,
    "scenes": scenes,
    "held": held,
    "joined": joined,
    "planes": planes,
    "run": run,
    "below": below,
    "down": down,
    "up": lambda x: -down(x),
    "sliding": sliding,
    "one_plane": one_plane,
    "standing": standing,
    "small_seat": small_seat,
    "turned": turned,
    "pins": pins,
}


def answer(call):
    """Kind of the answer to a call, and its words: an error, doubts of a scene or a step, or none."""
    try:
        value = eval(call, dict(NAMES))
    except (FxContactError, TypeError) as error:
        return type(error).__name__, str(error)
    doubts = warnings_of(value) if isinstance(value, Scene) else value.record.doubts or ()
    return ("doubt", ", ".join(one.kind for one in doubts)) if doubts else ("works", "")


@pytest.mark.parametrize("call, kind, words", [pytest.param(*row, id=row[0]) for row in ROWS])
def test_answer(call, kind, words):
    """As the page says, on all ranks."""
    told = WORLD.allgather(answer(call))
    assert len(set(told)) == 1, told
    assert told[0][0] == kind and (kind == "works" or words in told[0][1]), told[0]


def test_all_rows_are_read():
    """Each row of the tables is a case, and there are many."""
    rows = [line for line in PAGE.read_text().splitlines() if re.match(r"\| (?!call|---)", line)]
    assert len(rows) == len(ROWS) > 80
    assert {kind for _, kind, _ in ROWS} >= {"SceneError", "GeometryError", "PairingError", "doubt", "works"}


def arguments(name):
    """Arguments of a public class or function; of another one None."""
    made = getattr(fx_contact, name, None) or getattr(Shape, name, None)
    return list(signature(made).parameters) if callable(made) else None


def given(call):
    """Names of classes and functions, each with an argument that a call gives it."""
    for node in ast.walk(ast.parse(call, mode="eval")):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", None))
            name = {"press": "Scene", "run": "adapt", "below": "ContactPair"}.get(name, name)
            names = arguments(name) or ()
            names = names[1:] if names[:1] == ["self"] else names
            yield from ((name, one) for one in [*names[: len(node.args)], *(word.arg for word in node.keywords)])


def test_public_arguments_have_rows():
    """Each argument of public classes and functions is in a row; `solve` and `increments` have those of others."""
    public = {name for name in fx_contact.__all__ if not name.endswith("Error") and arguments(name)} - RESULTS
    wanted = {(name, argument) for name in public - {"solve", "increments"} for argument in arguments(name)}
    wanted -= {("sweep", "options"), *(("Scene", name) for name in ("name", "mesh"))}
    missing = sorted(wanted - {pair for call, *_ in ROWS for pair in given(call)})
    assert not missing and RESULTS <= set(fx_contact.__all__), missing
