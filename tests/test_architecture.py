"""The house keeps its order: imports point downward, the library is silent, and what is optional stays optional."""

import ast
import re
from pathlib import Path

import pytest

import fx_contact

FOLDER = Path(fx_contact.__file__).parent

#: The modules, or folders of modules, from the ground up: each may import those before it, and nothing else of ours.
ORDER = """
    errors _mpi checks agreement stages memory rowfile
    reference rootmesh gmsh_model lattice pairing curve prescriptions plausibility analytic references
    scene problem scenes
    forest leafgraph units _compat smoothing partition hanging quality mesh
    petsc_objects matrix petsc_options solver krylov
    compilation elasticity conditions loads enforcement projection contact
    activeset guess contact_system solve estimate balance gap spots places
    stored openings unseen force_error verdict contact_error
    report step checkpoint
    accuracy
    adapt manufactured
    overrefined
    plot surface output
    __init__
""".split()

OPTIONAL = {"gmsh", "matplotlib", "pyvista", "tqdm", "adios4dolfinx", "h5py"}
MODULES = sorted(FOLDER.rglob("*.py"))


def name_of(path):
    """Module name below the package."""
    return ".".join(path.relative_to(FOLDER).with_suffix("").parts)


def place_of(name):
    """The entry of the order that a module belongs to."""
    return name.split(".")[0]


def tree_of(path):
    """Syntax tree of a module."""
    return ast.parse(path.read_text(), str(path))


def own_imports(tree):
    """Modules of this package that a module imports, anywhere in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            raise AssertionError(f"relative import in line {node.lineno}")
        if isinstance(node, ast.ImportFrom) and node.module == "fx_contact":
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module.startswith("fx_contact."):
            yield node.module.removeprefix("fx_contact.")
        elif isinstance(node, ast.Import):
            yield from (
                a.name.removeprefix("fx_contact.") for a in node.names if a.name.split(".")[0] == "fx_contact"
            )


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


def test_every_module_has_its_place():
    """The order names every module, and none that is not there."""
    assert sorted(ORDER) == sorted({place_of(name_of(path)) for path in MODULES})
    assert len(MODULES) > 20


def test_the_map_is_complete():
    """ARCHITECTURE.md names every module or folder of modules, and none that is not there."""
    text = (Path(__file__).parent.parent / "ARCHITECTURE.md").read_text()
    named = set(
        re.findall(r"\b(\w+)(?:\.py|/)(?=[\s,])", text[text.index("    src/fx_contact") : text.index("    demos ")])
    )
    assert named == set(ORDER) - {"__init__"}


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_point_downward(path):
    """A module imports only modules below it, or beside it in its folder."""
    place = place_of(name_of(path))
    below = ORDER[: ORDER.index(place)] + [place] * (path.parent != FOLDER)
    above = sorted(name for name in own_imports(tree_of(path)) if place_of(name) not in below)
    assert not above, f"{name_of(path)} imports {', '.join(above)}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_no_collective_on_a_communicator_of_dolfinx(path):
    """`_mpi` says why: no call like `mesh.comm.allreduce(...)` or on a communicator that PETSc hands out."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = ast.unparse(node.func.value)
            assert not owner.endswith(("mesh.comm", "tompi4py()")), f"{owner}.{node.func.attr} in line {node.lineno}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_library_is_silent(path):
    """No module prints, or writes to the standard streams."""
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
def test_releases_are_told_apart_in_one_place(path):
    """No module asks for a release by its number, and none but `_compat` tries what a release has."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Attribute) and name_of(path) != "report":
            assert node.attr not in ("__version__", "version_info"), f"line {node.lineno}"
        if isinstance(node, ast.ExceptHandler) and node.type is not None and name_of(path) != "_compat":
            tried = {getattr(kind, "id", "") for kind in ast.walk(node.type)}
            assert not tried & {"ImportError", "ModuleNotFoundError", "AttributeError"}, f"line {node.lineno}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_files_are_short(path):
    """One concept a file: no more than 400 lines, none longer than 120 characters."""
    lines = path.read_text().splitlines()
    assert len(lines) <= 400
    assert max(map(len, lines), default=0) <= 120


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_docstrings(path):
    """Modules, and all classes, functions and methods without underscore, say what they are."""
    tree = tree_of(path)
    assert ast.get_docstring(tree), "no module docstring"
    scopes = [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_"))]
    for scope in scopes:
        for node in scope.body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{node.name} in line {node.lineno} has no docstring"


def test_the_checks_can_fail():
    """An import upward, a print, and an outer optional import are seen."""
    bad = ast.parse("import gmsh\nfrom fx_contact.adapt import adapt\ndef f():\n    import pyvista\n    print(1)\n")
    assert list(own_imports(bad)) == ["adapt"]
    assert set().union(*map(packages, outer_statements(bad.body))) & OPTIONAL == {"gmsh"}
