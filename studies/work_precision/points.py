"""The points of the work-precision study: which commands are run, and on which line of which plot each is."""

from dataclasses import dataclass

import numpy as np

from studies.runs import Case

TOLERANCES = {1: (0.16, 0.08, 0.04, 0.028), 2: (0.08, 0.04, 0.02, 0.01, 0.005, 0.003, 0.0014)}
INDENTATION = {1: (0.16, 0.08, 0.056, 0.04, 0.03), 2: (0.16, 0.08, 0.056, 0.04, 0.028, 0.02)}
#: Force of the whole INDENT-A: F_h over xi^2 is a line, through those of degree 2 at tolerances of 8 and 4 %; 4 digits.
INDENT_A = 0.019119


@dataclass(frozen=True)
class Point:
    """One point of the study.

    Attributes:
        group: of lines that are drawn together.
        line: the method, as the legend has it.
        case: what is run.
        quick: whether it is in the quick study.
    """

    group: str
    line: str
    case: Case
    quick: bool = False


def points(quick):
    """All points, those of the quick study alone if that is asked for."""
    return [point for point in _all() if point.quick or not quick]


def reference(tolerance, more="", ranks=2):
    """HERTZ-A at a tolerance."""
    words = "--records-only --reference hertz-a"
    return Case("hertz", f"{words} --tolerance {tolerance:g} {more}".strip(), ranks)


def true_error_of_indentation(force):
    """Relative energy error of a solution of INDENT-A by its force.

    All pairs are closed and all facets flat, so that a(u_h, u_h) = F_h D with the approach D, and by Galerkin
    orthogonality ||u - u_h||^2 / ||u||^2 = F_h / F - 1.
    """
    return float(np.sqrt(force / INDENT_A - 1))


def _uniform(levels, degree):
    return reference(0.04, f"--degree {degree} --order 6 --coarse 4 --uniform {levels}")


def _all():
    yield from _hertz()
    yield from _indentation()
    for degree in (2, 1):
        for tolerance in ((0.08, 0.04), (0.04, 0.01))[degree - 1]:
            case = Case("manufactured", f"--degree {degree} --tolerance {tolerance:g}")
            yield Point("manufactured", f"adaptive, degree {degree}", case, tolerance * degree == 0.08)
        case = Case("manufactured", f"--degree {degree} --uniform --tolerance {0.05 / degree**3:g}")
        yield Point("manufactured", f"uniform, degree {degree}", case)
    for tolerance in (0.02, 0.01):
        yield Point("defaults", "defaults", reference(tolerance))
    for order in (2, 3, 6):
        case = reference(0.01, f"--degree 2 --coarse 4 --order {order}", ranks=1)
        yield Point("orders", f"order {order}, 1 rank", case)


def _hertz():
    for degree in (2, 1):
        for tolerance in TOLERANCES[degree]:
            case = reference(tolerance, f"--degree {degree} --order 6")
            yield Point("HERTZ-A", f"degree {degree}", case, tolerance >= 0.08 / degree)
    for degree, levels in ((2, 0), (2, 1), (2, 2), (1, 1), (1, 2), (1, 3)):
        yield Point("HERTZ-A", f"uniform, degree {degree}", _uniform(levels, degree), levels < 2)
    for tolerance in (0.16, 0.04):
        case = reference(tolerance, "--degree 2 --coarse 4 --order 1")
        yield Point("HERTZ-A", "straight cells, degree 2", case, tolerance == 0.16)


def _indentation():
    words = "--records-only --tolerance"
    for degree in (2, 1):
        for tolerance in INDENTATION[degree]:
            case = Case("indentation", f"{words} {tolerance:g} --degree {degree}")
            yield Point("INDENT-A", f"degree {degree}", case, tolerance > 0.1 / degree)
    for degree in (2, 1):
        for levels in range(2 - degree, 5 - degree):
            case = Case("indentation", f"{words} 0.04 --degree {degree} --uniform {levels}")
            yield Point("INDENT-A", f"uniform, degree {degree}", case, levels < 2)
    case = Case("indentation", f"{words} 0.028 --degree 2 --symmetry full")
    yield Point("INDENT-A full", "degree 2", case)
