"""The house keeps its order: imports point downward, the library is silent, and what is optional stays optional."""

import ast
from pathlib import Path

import pytest

import fx_contact

pytestmark = pytest.mark.ranks(1)

FOLDER = Path(fx_contact.__file__).parent

#: The rooms, from the ground up: each may import from those before it, and nothing else of ours.
ROOMS = "parallel linalg geometry items surfaces scene forest fem contact law estimate verdict adaptive path".split()
ROOMS += "results scenes plot command".split()
#: Modules that print, when they are asked to.
SPEAKING = {"adaptive.step_report", "__main__"}
OPTIONAL = {"gmsh", "matplotlib", "pyvista", "adios4dolfinx", "h5py"}
MODULES = sorted(FOLDER.rglob("*.py"))


def name_of(path):
    """Module name below the package; a room's own is `room.__init__`."""
    return ".".join(path.relative_to(FOLDER).with_suffix("").parts)


def room_of(name):
    """The room that a module, or a name of it, belongs to."""
    return name.split(".")[0]


def tree_of(path):
    """Syntax tree of a module."""
    return ast.parse(path.read_text(), str(path))


def own_imports(tree):
    """What a module imports of this package, anywhere in it, as room.module or room.module.name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            raise AssertionError(f"relative import in line {node.lineno}")
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "fx_contact":
            for alias in node.names:
                yield f"{node.module}.{alias.name}".removeprefix("fx_contact.")
        elif isinstance(node, ast.Import):
            yield from (a.name.removeprefix("fx_contact.") for a in node.names if room_of(a.name) == "fx_contact")


def modules_imported(path):
    """Names of the modules of this package that a module imports."""
    names = set(map(name_of, MODULES))
    for name in own_imports(tree_of(path)):
        found = [n for n in (name, name.rpartition(".")[0]) if n in names]
        yield found[0] if found else f"{name}.__init__"


def outer_statements(body):
    """Statements that run when a module is imported: not those inside functions."""
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        yield node
        yield from outer_statements(ast.iter_child_nodes(node))


def packages(node):
    """Top-level packages that an import statement names."""
    if isinstance(node, ast.Import):
        return {alias.name.split(".")[0] for alias in node.names}
    return {node.module.split(".")[0]} if isinstance(node, ast.ImportFrom) and node.module else set()


def test_every_module_is_in_a_room():
    """Beside the rooms there are only the public names, the runner of programs and the data."""
    assert {room_of(name_of(path)) for path in MODULES} == {*ROOMS, "__init__", "__main__"}
    assert len(MODULES) > 20


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_point_downward(path):
    """A module imports from rooms below its own, or from modules of its own room."""
    room = room_of(name_of(path))
    below = ROOMS if room.startswith("__") else ROOMS[: ROOMS.index(room) + 1]
    above = sorted(name for name in own_imports(tree_of(path)) if room_of(name) not in [*below, "fx_contact"])
    assert not above, f"{name_of(path)} imports {', '.join(above)}"


@pytest.mark.parametrize("room", ROOMS)
def test_no_circles_in_a_room(room):
    """Modules of one room import each other in one direction."""
    inside = {
        name_of(path): {n for n in modules_imported(path) if room_of(n) == room}
        for path in MODULES
        if room_of(name_of(path)) == room
    }
    while ready := [name for name, needs in inside.items() if not needs & inside.keys()]:
        for name in ready:
            del inside[name]
    assert not inside, f"a circle among {', '.join(inside)}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_and_what_it_defines_have_different_names(path):
    """What a room or the package hands on cannot hide a module of that name, and a name has one meaning."""
    defined = {node.name for node in tree_of(path).body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    assert not defined & {module.stem for module in MODULES}


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_no_collective_on_a_communicator_of_dolfinx(path):
    """`parallel.mpi` says why: no call like `mesh.comm.allreduce(...)` or on a communicator that PETSc hands out."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = ast.unparse(node.func.value)
            assert not owner.endswith(("mesh.comm", "tompi4py()")), f"{owner}.{node.func.attr} in line {node.lineno}"


@pytest.mark.parametrize("path", [path for path in MODULES if name_of(path) not in SPEAKING], ids=name_of)
def test_library_is_silent(path):
    """No module prints, or writes to the standard streams, but those that the user asks to."""
    for node in ast.walk(tree_of(path)):
        assert not (
            isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print"
        ), f"print in line {node.lineno}"
        assert not (
            isinstance(node, ast.Attribute) and node.attr in ("stdout", "stderr")
        ), f"stream in line {node.lineno}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_optional_packages_are_imported_where_needed(path):
    """What a run may do without is imported inside functions."""
    for node in outer_statements(tree_of(path).body):
        found = packages(node) & OPTIONAL
        assert not found, f"line {node.lineno} imports {', '.join(found)}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_files_are_short(path):
    """One concept a file: no more than 350 lines."""
    assert len(path.read_text().splitlines()) <= 350


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_functions_are_short(path):
    """One thought a function: no more than 60 lines beside its docstring."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.FunctionDef):
            told = len((ast.get_docstring(node, clean=False) or "").splitlines())
            length = node.end_lineno - node.lineno + 1 - told
            assert length <= 60, f"{node.name} has {length} lines"


def test_the_checks_can_fail():
    """An import upward, a print, and an outer optional import are seen."""
    bad = ast.parse(
        "import gmsh\nfrom fx_contact.adaptive.step import solve_step\nif TYPE_CHECKING:\n    import h5py\n"
        "def f():\n    import pyvista\n    print(1)\n"
    )
    assert list(own_imports(bad)) == ["adaptive.step.solve_step"]
    assert set().union(*map(packages, outer_statements(bad.body))) & OPTIONAL == {"gmsh", "h5py"}
