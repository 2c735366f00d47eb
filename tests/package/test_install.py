"""The package can be installed, and declares what it imports."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from conftest import WORLD, outside

import fx_contact

TOP = Path(__file__).parents[2]
PROJECT = tomllib.loads((TOP / "pyproject.toml").read_text())["project"]
#: Modules that come with something, or have another name than it: in pyproject.toml, in environment.yml.
FROM = {
    **dict.fromkeys(("dolfinx", "basix", "ufl", "ffcx"), ("fenics-dolfinx", "fenics-dolfinx")),
    **dict.fromkeys(("IPython", "traitlets"), ("ipykernel", "ipykernel")),
    "nbformat": ("nbclient", "nbclient"),
    "PIL": ("pillow", "pillow"),
    "vtkmodules": ("pyvista", "pyvista"),
    "gmsh": ("gmsh", "python-gmsh"),
    "yaml": ("pyyaml", "pyyaml"),
}

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="reads files, and starts programs of its own")


def imported():
    """Names of the modules of others that the project imports, those that tests may lack among them."""
    files = [path for folder in ("src", "demos", "studies", "tests") for path in (TOP / folder).rglob("*.py")]
    files += (TOP / "notebooks").glob("*.py")
    found, own = set(), {"fx_contact", *(path.stem for path in files), *(path.parent.name for path in files)}
    for path in files:
        tree = ast.parse("\n".join(x for x in path.read_text().splitlines() if not x.startswith("%")))
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add(node.module.split(".")[0])
            elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "importorskip":
                found.add(node.args[0].value)
    return found - own - set(sys.stdlib_module_names) - {"pip"}


def declared():
    """Names of the distributions in pyproject.toml, without versions, and packages of environment.yml."""
    lists = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    lines = [line.strip() for line in (TOP / "environment.yml").read_text().splitlines()]
    packages = [line[2:] for line in lines if line.startswith("- ")]
    return ({name.partition(">")[0].partition("=")[0] for name in some} for some in (sum(lists, []), packages))


def test_all_imports_are_declared():
    """Of pip and of conda; nothing is found that the project does not have."""
    modules = imported()
    assert {"dolfinx", "gmsh", "matplotlib", "pyvista", "yaml"} <= modules
    for number, names in enumerate(declared()):
        missing = {name for name in modules if FROM.get(name, (name, name))[number] not in names}
        assert not missing, missing


def test_conda_recipe():
    """It has the version, the command, and what the main job needs by environment.yml."""
    recipe = (TOP / "packaging/conda/meta.yaml").read_text()
    assert f'set version = "{fx_contact.__version__}"' in recipe
    assert all(f"- {name} = {place}" in recipe for name, place in PROJECT["scripts"].items())
    main = (TOP / "environment.yml").read_text().partition("# Pictures")[0]
    needed = {re.match(r"[\w-]+", line.strip()[2:])[0] for line in main.splitlines() if line.startswith("  - ")}
    runs = recipe.partition("  run:\n")[2].partition("  run_constrained:")[0]
    assert needed - {"openmpi"} == set(re.findall(r"- ([\w-]+)", runs)), "mpi4py brings the MPI"


def test_pip_install(tmp_path):
    """Into the Python that runs this test: what is installed has the data and the mark of types, and is imported."""
    pytest.importorskip("pip")
    pytest.importorskip("setuptools", minversion="77")
    shutil.copytree(TOP / "src", tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(TOP / name, tmp_path)
    offline = "--no-deps --no-build-isolation --no-index --break-system-packages".split()
    command = [sys.executable, "-m", "pip", "install", *offline, "--root", tmp_path / "root", "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert f"installed fx_contact-{fx_contact.__version__}" in done.stdout.replace("fx-contact", "fx_contact")
    assert [*(tmp_path / "root").rglob("bin/fx-contact")], "the command"
    (package,) = (tmp_path / "root").rglob("fx_contact/py.typed")
    site = package.parents[1]
    assert package.with_name("fem").joinpath("sum_factorisation.c").exists(), "what is compiled"
    code = "import fx_contact.results as r; print(r.__file__)"
    env = outside() | {"PYTHONPATH": str(site)}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith(str(tmp_path)), done.stderr
