"""One scene of the stress matrix, and a sample of many."""

import re
from dataclasses import dataclass

from fx_contact.adaptive.settings import DEGREE


@dataclass(frozen=True)
class Case:
    """One scene of the matrix.

    Attributes:
        axis: what is stressed.
        family: the row of the axis.
        value: the place in the row.
        scene: function of no argument.
        reference: Exact, or Twin; None where the scene must be refused.
        method, factor: how contact is enforced; None: as the program chooses.
        tolerance: prescribed relative error.
        degree: of the displacements.
        may_refuse: whether a typed error is an answer too.
    """

    axis: str
    family: str
    value: str
    scene: object
    reference: object
    method: str | None = None
    factor: float | None = None
    tolerance: float = 0.16
    degree: int = DEGREE
    may_refuse: bool = False

    @property
    def row(self):
        """Label of its row."""
        return f"{self.axis}: {self.family}"

    @property
    def name(self):
        """By which it is run again."""
        return "/".join(re.sub(r"[^\w.+-]+", "-", part) for part in (self.axis, self.family, self.value))


def exponent(value):
    """1e-6 and the like, as short as it goes."""
    return (
        re.sub(r"e([+-])0*", lambda sign: "e" + sign[1].strip("+"), f"{value:.0e}")
        if value not in (0, 1)
        else str(int(value))
    )


def sample(named, share=7):
    """A part of the scenes, spread over all rows: every row's turn comes at another of its values."""
    rows = {}
    for case in named.values():
        rows.setdefault(case.row, []).append(case)
    chosen = {}
    for number, row in enumerate(rows.values()):
        count = max(1, round(len(row) / share))
        for k in range(count):
            case = row[(7 * number + k * share) % len(row)]
            chosen[case.name] = case
    return chosen
