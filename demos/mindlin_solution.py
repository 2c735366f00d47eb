"""Cattaneo and Mindlin's solution of two like balls that are pressed together, then moved tangentially.

Source: K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985, sections 7.2 and 7.4.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from matplotlib.figure import Figure

from fx_contact import Material, Step, StepRecord
from fx_contact.path.load_path import LoadPath
from fx_contact.plot import draw_pressure
from fx_contact.results.analytic import Hertz

#: Found values and those of the solution, by name.
Pairs = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Mindlin:
    """First loading by a tangential force; exact for half-spaces and Poisson's ratio 0.

    Attributes:
        hertz: contact by the normal force P.
        shear: tangential force Q, at most mu P [N].
        friction: coefficient mu [-].
        material: of both balls.
    """

    hertz: Hertz
    shear: float
    friction: float
    material: Material

    @classmethod
    def of(cls, record: StepRecord, friction: float, material: Material) -> Self:
        """The solution for balls of radius 1 at the forces of a record."""
        (contact,) = (one for one in record.resultants or () if one.kind == "contact")
        return cls(Hertz.of_equal_spheres(1.0, material, record.force), abs(contact.force[1]), friction, material)

    @property
    def bound(self) -> float:
        """Largest tangential force, mu P [N]."""
        return self.friction * self.hertz.force

    @property
    def stick_radius(self) -> float:
        """Radius c of the circle that sticks, over the contact radius a: (1 - Q / (mu P))^(1/3) [-]."""
        return max(0.0, 1 - self.shear / self.bound) ** (1 / 3)

    @property
    def displacement(self) -> float:
        """Relative tangential displacement of distant points [m]."""
        return 3 / 16 * self.bound / self.hertz.contact_radius * self._compliance * (1 - self.stick_radius**2)

    @property
    def dissipated_energy(self) -> float:
        """Work of friction, a quarter of that of a cycle between Q and -Q [J]."""
        part = 1 - self.stick_radius**5 - 5 / 6 * self.shear / self.bound * (1 + self.stick_radius**2)
        return 9 / 40 * self.bound**2 / self.hertz.contact_radius * self._compliance * part

    @property
    def _compliance(self) -> float:
        """Sum of (2 - nu) / G of both [1/Pa]."""
        return 4 * (2 - self.material.poisson) * (1 + self.material.poisson) / self.material.young

    def traction(self, radius: np.ndarray) -> np.ndarray:
        """Tangential traction [Pa] at radii, relative to the contact radius [-]."""
        whole, stuck = (np.sqrt(np.maximum(0.0, end**2 - radius**2)) for end in (1.0, self.stick_radius))
        return self.friction * self.hertz.max_pressure * (whole - stuck)


def stick_radius(step: Step) -> float:
    """Radius of the circle that sticks, relative to the contact radius [-].

    Collective.  Hertz's pressure has the force P (1 - (1 - (c / a)^2)^(3/2)) inside a circle of radius c, and the nodes
    that stick carry it.
    """
    table, parts = step.contact, step.scene.symmetry
    stuck = table.comm.allreduce(float(parts * table.force @ (table.active & ~table.slipping)))
    return float(np.sqrt(1 - max(0.0, 1 - stuck / step.record.force) ** (2 / 3)))


def compared(path: LoadPath, step: Step, displacement: float, friction: float, material: Material) -> Pairs:
    """Values of the last point of a path, loaded up to 1 and moved up to 2, and those of the solution.

    Collective.  Half-balls yield more than half-spaces, by a displacement in proportion to Q: that of the first load
    step with a tangential force is added to the solution.
    """
    first, last = next(one for one in path.records if one.value > 1), path.records[-1]
    known, before = (Mindlin.of(one.record, friction, material) for one in (last, first))
    shift, distant = (last.value - 1) * displacement, (first.value - 1) * displacement - before.displacement
    return {
        "tangential_force": (known.shear, known.bound),
        "stick_radius": (stick_radius(step), known.stick_radius),
        "displacement": (shift, known.displacement + distant * known.shear / before.shear),
        "work_of_friction": (last.dissipated_energy or 0.0, known.dissipated_energy),
    }


def table_of(rows: Iterable[Pairs]) -> Iterable[str]:
    """Lines of a table of load steps."""
    yield f"{'Q / (mu P)':>11}{'stick radius c / a':>26}{'displacement':>24}{'work of friction':>24}"
    yield f"{'':11}" + f"{'found':>14}{'Mindlin':>10}" * 3
    for row in rows:
        (shear, bound), *others = row.values()
        values = "".join(f"{found:14.4g}{known:10.4g}" for found, known in others)
        yield f"{shear / bound:11.4f}{values if row['stick_radius'][0] else '  slides as a whole'}"


def deviations(row: Pairs) -> dict[str, float] | None:
    """Relative deviations from the solution; None: the ball slides, and there is no solution."""
    names = ("stick_radius", "displacement", "work_of_friction") if row["stick_radius"][0] else ()
    return {name: row[name][0] / row[name][1] - 1 for name in names} or None


def draw_traction(step: Step, known: Mindlin, path: Path) -> None:
    """Pressure and tangential traction over the radius, with Hertz's and Mindlin's curves.  Collective."""
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    axes, radius = figure.subplots(), np.linspace(0, 1, 400)
    draw_pressure(step, exact=known.hertz, ax=axes)
    if step.forest.comm.rank == 0:
        axes.plot(radius, known.traction(radius), color="black", lw=1.2, label="traction, Mindlin")
        axes.set_ylabel("contact pressure and traction")
        axes.legend(frameon=False)
        figure.savefig(path, dpi=120)
