"""A scene of the stress matrix and what its answer is compared with."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from fx_contact import Enforcement, Scene
from fx_contact.adaptive.settings import DEGREE


@dataclass(frozen=True)
class Exact:
    """A known answer.

    Attributes:
        force: of the whole bodies, in each contact pair [N]; None where a load prescribes it.
        approach: of the bodies since they touch [m].
        energy: stored in the bodies, without springs, twice, of the whole [J]; where the force is prescribed, or beside
            it.  0: a free expansion, without stress.
        linear: whether the contact area stays the same and the stress is uniform, which any mesh has exactly.
        curved: whether the contact is round.
        unsure: relative error of the reference itself.
    """

    force: float | None = None
    approach: float | None = None
    energy: float | None = None
    linear: bool = False
    curved: bool = False
    unsure: float = 0.0


@dataclass(frozen=True)
class Twin:
    """Another run that must give the same answer, its contact enforced as the program chooses.

    Attributes:
        scene: makes it.
        force, energy, pressure: what one of the scene is in the twin.
        same_mesh: whether equal numbers of cells and active pairs mean the same discrete problem.
        same_contact: whether contact is as soft in both.
        curved: whether the contact is round.
        tolerance: of the twin's run, relative to that of the run.
        each: whether the force of each contact pair is compared, to the tolerance: it may be light beside other loads.
        held: whether it prescribes the motions that tensions and rigid loads find.
    """

    scene: Callable[[], Scene]
    force: float = 1.0
    energy: float = 1.0
    pressure: float = 1.0
    same_mesh: bool = True
    same_contact: bool = True
    curved: bool = False
    tolerance: float = 1.0
    each: bool = False
    held: bool = False


#: Twins on another mesh, whose own error is at most a quarter of the square asked for, where edges are singular, and
#: 0.09 of it elsewhere.
SHARP = {"same_mesh": False, "same_contact": False, "tolerance": 0.5}
SMOOTH = SHARP | {"tolerance": 0.3}


@dataclass(frozen=True)
class Case:
    """One scene of the matrix.

    Attributes:
        axis: what is stressed.
        family: the row of the axis.
        value: the place in the row.
        scene: makes it.
        reference: None where the scene must be refused.
        tolerance: prescribed relative error.
        enforcement: of contact; None: as the program chooses.
        may_refuse: whether a typed error is an answer too.
        degree: of the displacements.
    """

    axis: str
    family: str
    value: str
    scene: Callable[[], Scene]
    reference: Exact | Twin | None
    tolerance: float = 0.16
    enforcement: Enforcement | None = None
    may_refuse: bool = False
    degree: int = DEGREE

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
    return str(int(value)) if value in (0, 1) else re.sub(r"e\+?(-?)0*", r"e\1", f"{value:.0e}")


def sample(named, share=7):
    """A part of the scenes, spread over all rows: every row's turn comes at another of its values."""
    rows = {}
    for case in named.values():
        rows.setdefault(case.row, []).append(case)
    chosen = {}
    for number, row in enumerate(rows.values()):
        for k in range(max(1, round(len(row) / share))):
            case = row[(7 * number + k * share) % len(row)]
            chosen[case.name] = case
    return chosen
