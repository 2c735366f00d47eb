"""Reference values that do not come from this program."""

import json
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from fx_contact.parallel.errors import SceneError


@dataclass(frozen=True, eq=False)
class ContactReference:
    """What is known of a contact of two equal half-spheres, pole to pole.

    Attributes:
        name: of the problem.
        source: where the values come from.
        radius: of the spheres [m].
        displacement: approach of the flat faces [m].
        young, poisson: of both [Pa], [-].
        force: F [N].
        contact_radius: a, undeformed [m].
        max_pressure: p0 [Pa].
        profile: (n, 2) float64 rows (radius [m], contact pressure [Pa]) from the centre outwards; empty: not known.
        axis: (n, 2) float64 rows (height above the contact [m], stress along the axis [Pa]); empty: not known.
    """

    name: str
    source: str
    radius: float
    displacement: float
    young: float
    poisson: float
    force: float
    contact_radius: float
    max_pressure: float
    profile: np.ndarray
    axis: np.ndarray

    def check_problem(self, radius, displacement, material):
        """See that these values are those of a problem.

        Args:
            radius: of the spheres.
            displacement: approach of the flat faces.
            material: Material of both.

        Raises:
            SceneError: another radius, displacement or material.
        """
        known = self.radius, self.displacement, self.young, self.poisson
        given = radius, displacement, material.young, material.poisson
        if not np.allclose(given, known, rtol=1e-9, atol=0):
            names = "radius", "displacement", "Young's modulus", "Poisson's ratio"
            wrong = ", ".join(f"{name} {a:g} instead of {b:g}" for name, a, b in zip(names, given, known) if a != b)
            raise SceneError(f"the reference {self.name} is of another problem: {wrong}")

    def pressure(self, r):
        """Contact pressure at radii [Pa], between the rows of `profile`: p^2 is nearly linear in r^2, as Hertz has it.

        Args:
            r: (n,) float64 [m].

        Returns:
            (n,) float64, zero outside the contact.
        """
        known = np.append(self.profile[:, 0], self.contact_radius), np.append(self.profile[:, 1], 0.0)
        return np.sqrt(np.interp(np.square(r), known[0] ** 2, known[1] ** 2, right=0.0))


def hertz_a():
    """HERTZ-A: R = 1, E = 1, nu = 0.3, approach 0.01.

    Axisymmetric P2 finite elements on one curved half-sphere, exact non-penetration, graded meshes, converged to the
    digits given.  Local.
    """
    data = json.loads(files("fx_contact").joinpath("data", "hertz_a.json").read_text())
    value, profile, axis = data["reference"], data["pressure_profile"], data["axis_stress"]
    return ContactReference(
        name="HERTZ-A",
        source="axisymmetric P2 computation, exact non-penetration",
        radius=value["R"],
        displacement=value["delta_total"],
        young=value["E"],
        poisson=value["nu"],
        force=value["F"],
        contact_radius=value["a"],
        max_pressure=value["p0"],
        profile=np.stack([profile["r"], profile["p"]], axis=1),
        axis=np.stack([axis["z"], axis["sigma_zz"]], axis=1),
    )


def ssnv104():
    """code_aster's SSNV104 in mm, N and MPa: R = 50, E = 20,000, nu = 0.3, approach 4 (a/R = 0.2).

    The values are those of linear elasticity at small strains with free faces, from an axisymmetric computation, three
    digits good; Hertz's half-spaces, as published with the case, give a = 10 and p0 = 2798.3.  Local.
    """
    none = np.zeros((0, 2))
    return ContactReference(
        name="SSNV104",
        source="axisymmetric computation, three digits",
        radius=50.0,
        displacement=4.0,
        young=20000.0,
        poisson=0.3,
        force=6.60e5,
        contact_radius=10.47,
        max_pressure=2912.0,
        profile=none,
        axis=none,
    )


#: References by the name of the demos' option.
REFERENCES = {"hertz-a": hertz_a, "ssnv104": ssnv104}
