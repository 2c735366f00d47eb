"""Docstrings are complete: everything public says what it is, what it raises, and who must call it together."""

import ast
from pathlib import Path

import pytest

import fx_contact

pytestmark = pytest.mark.ranks(1)

FOLDER = Path(fx_contact.__file__).parent
MODULES = sorted(FOLDER.rglob("*.py"))
ERRORS = {
    node.name
    for node in ast.parse((FOLDER / "parallel" / "errors.py").read_text()).body
    if isinstance(node, ast.ClassDef)
}
#: Arguments that live on several ranks: who takes one says "Collective" or "Local".
SPREAD = {"comm", "forest", "mesh", "step", "prolongation", "elasticity", "matrix"}
#: Methods that stand for their class.
_MAKING = ("__init__", "__post_init__")


def public(tree):
    """Public classes, functions and methods of a module: (name, docstring, the functions that it answers for)."""
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
            inner = [n for n in node.body if isinstance(n, ast.FunctionDef)] if isinstance(node, ast.ClassDef) else []
            own = [n for n in inner if n.name in _MAKING] if isinstance(node, ast.ClassDef) else [node]
            yield node.name, ast.get_docstring(node) or "", own
            for method in inner:
                if not method.name.startswith("_"):
                    yield f"{node.name}.{method.name}", ast.get_docstring(method) or "", [method]


def raised(function):
    """Names of the package's errors that a function raises itself, or through a check of an argument."""
    names = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and node.exc is not None:
            what = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            names |= {getattr(what, "id", "")} & ERRORS
        if isinstance(node, ast.Call) and getattr(node.func, "id", "").startswith("check_"):
            names.add("Error")
    return names


def missing(tree):
    """What the docstrings of a module do not say, as sentences."""
    whole = (ast.get_docstring(tree) or "").lower()
    if not whole:
        yield "the module has no docstring"
    for name, doc, functions in public(tree):
        if not doc:
            yield f"{name} has no docstring"
        found = set().union(*map(raised, functions))
        said = doc.partition("Raise")[2]
        for error in sorted(error for error in found if error not in said):
            yield f"{name} raises {error} and does not say so"
        arguments = {a.arg for f in functions for a in (*f.args.args, *f.args.kwonlyargs)} & SPREAD
        if arguments and not any(word in text for word in ("collective", "local") for text in (doc.lower(), whole)):
            yield f"{name} takes {', '.join(sorted(arguments))} and is neither Collective nor Local"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: ".".join(path.relative_to(FOLDER).with_suffix("").parts))
def test_complete(path):
    """No docstring of a module leaves any of it out."""
    assert not list(missing(ast.parse(path.read_text())))


def test_the_test_can_fail():
    """All kinds of gap are seen, in modules, functions, methods and classes."""
    bad = """
def f(comm):
    '''Says nothing of ranks.'''
def g(x):
    '''Local.'''
    if x: raise SceneError("no")
class A:
    '''Raises: nothing that it says.'''
    def __init__(self, x): check_number("x", x); raise OutputError
    def h(self): pass
"""
    assert [line.split()[0] for line in missing(ast.parse(bad))] == ["the", "f", "g", "A", "A", "A.h"]
    assert len(MODULES) > 40 and "SceneError" in ERRORS
