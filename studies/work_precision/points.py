"""The points of the work-precision study: which commands are run, and on which line of which plot each is."""

import re
from dataclasses import dataclass, replace

from fx_contact.contact.enforcement import METHODS
from studies.runs import Case

TOLERANCES = (0.16, 0.11, 0.08, 0.056, 0.04)
FEW = (0.16, 0.08, 0.04)
QUICK = (0.16, 0.08)
#: Enforcements of contact besides the default, by the names of `--enforcement`.
ENFORCEMENTS = METHODS[1:]


@dataclass(frozen=True)
class Point:
    """One point of the study.

    Attributes:
        group: of lines that are drawn together.
        line: the method, as the legend has it.
        case: what is run.
        same: the case with the same discrete solution whose true error holds here too, or None.
        quick: whether it is in the quick study.
    """

    group: str
    line: str
    case: Case
    same: Case | None = None
    quick: bool = True

    @property
    def timing(self):
        """The case without what comes after the clock has stopped: what repetitions run."""
        return replace(self.case, options=re.sub(r" --true-error \S+", "", self.case.options))


DEFAULT = "adaptive, order 3, 2 ranks"


def points(quick):
    """All points, those of the quick study alone if that is asked for."""
    return [point for point in _all() if point.quick or not quick]


def reference(tolerance, more="", true=0.5, ranks=2):
    """HERTZ-A at a tolerance; with the true error by a solution of a share of it, unless the share is 0."""
    words = ["--records-only", "--reference hertz-a", f"--tolerance {tolerance:g}", more]
    words += [f"--true-error {true * tolerance:g}"] if true else []
    return Case("hertz", " ".join(filter(None, words)), ranks)


def _uniform(coarse, levels, true):
    words = f"--records-only --reference hertz-a --coarse {coarse} --uniform {levels} --tolerance 0.04"
    return Case("hertz", words + (f" --true-error {true:g}" if true else ""))


def _all():
    for tolerance in TOLERANCES:
        yield Point("adaptivity", DEFAULT, reference(tolerance), quick=tolerance in QUICK)
    yield Point("adaptivity", DEFAULT, reference(0.028, true=0), quick=False)
    # The estimate stands for the true error of the largest mesh, which costs too much to refine.
    for coarse, levels, true in ((4, 1, 0.25), (4, 2, 0.12), (4, 3, 0.07), (6, 3, None)):
        yield Point("adaptivity", "uniform, order 3", _uniform(coarse, levels, true), quick=levels < 3)

    for order, line in ((1, "straight cells"), (2, "order 2"), (6, "order 6")):
        for tolerance in FEW:
            # Straight cells are so far off that a finer solution need not be fine.
            case = reference(tolerance, f"--order {order}", true=1 if order == 1 else 0.5)
            yield Point("geometry", line, case, quick=tolerance in QUICK and order == 1)
    for factor in ("100", "1e4", "1e8"):
        for tolerance in FEW:
            case = reference(tolerance, f"--penalty {factor}")
            quick = tolerance == 0.16 and factor in ("100", "1e8")
            yield Point("enforcement", f"penalty c = {factor}", case, quick=quick)
    for name in ENFORCEMENTS:
        for tolerance in FEW:
            case = reference(tolerance, f"--enforcement {name}")
            yield Point("enforcement", name, case, quick=tolerance == 0.16)

    for tolerance in FEW:
        same, quick = reference(tolerance), tolerance in QUICK
        for line, more in (
            ("ILU", "--preconditioner ilu"),
            ("Jacobi", "-fx_pc_type jacobi"),
            ("GAMG", "-fx_pc_type gamg"),
        ):
            case = reference(tolerance, more, true=0)
            yield Point("solver", line, case, same, quick=quick and line == "ILU")
        yield Point("solver", "BoomerAMG, 1 rank", reference(tolerance, true=0, ranks=1), same, quick)

    for tolerance in FEW:
        words = (
            f"--records-only --reference ssnv104 --radius 50 --displacement 4 --young 20000 --tolerance {tolerance:g}"
        )
        yield Point("references", "SSNV104", Case("hertz", words), quick=tolerance in QUICK)
    for factor in ("100", "1e4", "1e8"):
        yield Point("references", "patch test", Case("patch", f"--records-only --penalty {factor}"))
    for name in ENFORCEMENTS:
        yield Point("references", "patch test", Case("patch", f"--records-only --enforcement {name}"))
    yield Point("references", "manufactured, adaptive", Case("manufactured", "--tolerance 0.08"))
    yield Point("references", "manufactured, adaptive", Case("manufactured", "--tolerance 0.04"), quick=False)
    yield Point("references", "manufactured, adaptive", Case("manufactured", "--tolerance 0.02"), quick=False)
    yield Point("references", "manufactured, uniform", Case("manufactured", "--uniform --tolerance 0.1"))
    yield Point(
        "references", "manufactured, uniform", Case("manufactured", "--uniform --tolerance 0.05"), quick=False
    )
    for order, line in ((1, "straight cells"), (3, "order 3")):
        case = Case("hertz", f"--order {order} --tolerance 0.04")
        yield Point("picture", line, case, quick=False)
