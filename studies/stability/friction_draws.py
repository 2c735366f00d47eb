"""A load path with friction, and what all families of them draw."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fx_contact import Material, Scene, Tresca
from studies.stability.draws import count, decades

#: Modulus of the first body [Pa], and powers of ten of the coefficients.
YOUNG, COEFFICIENTS = 1.0, (np.log10(0.05), 0.0)


@dataclass(frozen=True)
class Path:
    """A load path that was drawn.

    Attributes:
        name: family and number.
        kind: of the rows: "pairs", "mortar" or "obstacle".
        scene: of a motion: down, x and y [m].
        motions: one for each load step.
        degree: of the displacements.
        mu: largest coefficient; of Tresca's law that of its bound over the pressure [-].
        nu: largest Poisson's ratio [-].
        ratio: of the moduli [-].
        how: other choices, in words.
    """

    name: str
    kind: str
    scene: Callable[[tuple[float, float, float]], Scene]
    motions: tuple[tuple[float, float, float], ...]
    degree: int
    mu: float
    nu: float
    ratio: float
    how: str


class Draws:
    """What all families draw: coefficient, materials, degree, depth and motions.

    Args:
        rng: generator of random numbers.
        depth: powers of ten of what bodies are pressed by [m].
    """

    def __init__(self, rng, depth=(-3.0, -2.0)):
        self.rng, self.mu, self.how = rng, decades(rng, *COEFFICIENTS), []
        self.ratio, self.degree, self.depth = decades(rng, -4, 4), count(rng, 1, 2), decades(rng, *depth)
        self.poisson = rng.uniform(0.0, 0.45, size=2)
        self.tresca = rng.random() < 0.15
        self.turn, self.largest = rng.uniform(0.0, 2 * np.pi), self.mu

    @property
    def soft(self):
        """The smaller modulus [Pa]."""
        return min(1.0, self.ratio) * YOUNG

    def materials(self, *bodies):
        """Materials by name, the moduli 1 and `ratio` in turn."""
        known = [Material(YOUNG * young, nu) for young, nu in zip((1.0, self.ratio), self.poisson)]
        return {body: known[k % 2] for k, body in enumerate(bodies)}

    def law(self, pressure):
        """Coulomb's law, or Tresca's, whose bound is mu times a pressure [Pa]."""
        if self.tresca:
            self.how.append("Tresca")
            return Tresca(self.mu * pressure)
        return self.mu

    def other_law(self):
        """Another coefficient, for a second contact; sometimes 0."""
        other = 0.0 if self.rng.random() < 0.15 else decades(self.rng, *COEFFICIENTS)
        self.largest = max(self.largest, other)
        return other

    def motions(self, along=None):
        """Down, x and y [m]: pressed, moved at an angle, partly back, and in another direction.

        Args:
            along: 0, 1: moved along x or y alone; None: in both.
        """
        rng, steps = self.rng, count(self.rng, 2, 4)
        size, angle = self.mu * self.depth * rng.uniform(0.3, 3.0), self.turn
        start = size * np.array([np.cos(angle), np.sin(angle)])
        turned = angle + rng.uniform(0.3, 2.8)
        places = [0.0 * start, start, rng.uniform(-0.5, 0.8) * start]
        places.append(places[-1] + size * np.array([np.cos(turned), np.sin(turned)]))
        downs = self.depth * np.array([1.0, *rng.uniform(0.7, 1.3, size=3)])
        if along is not None:
            keep = np.arange(2) == along
            places = [np.where(keep, np.sign(place[along] or 1.0) * np.linalg.norm(place), 0.0) for place in places]
        return tuple((float(down), float(x), float(y)) for down, (x, y) in list(zip(downs, places))[:steps])

    def path(self, family, kind, scene, along=None):
        """The Path of a family, with the name that `paths` gives it."""
        motions = self.motions(along)
        return Path(
            family,
            kind,
            scene,
            motions,
            self.degree,
            self.largest,
            float(self.poisson.max()),
            1.0 if kind == "obstacle" else self.ratio,
            ", ".join(self.how),
        )
