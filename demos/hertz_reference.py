"""Reference values of other programs for two equal half-spheres, and errors of a step against them."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact import Material, SceneError, Step
from fx_contact.items.materials import VOIGT
from fx_contact.parallel.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class ContactReference:
    """Reference values for the contact of two equal half-spheres, pole to pole.

    Attributes:
        source: of the values.
        radius: of the spheres [m].
        displacement: approach of the flat faces [m].
        young, poisson: of both [Pa], [-].
        force: F [N].
        contact_radius: a, undeformed [m].
        max_pressure: p0 [Pa].
        profile: (n, 2), radius [m] and contact pressure [Pa] from the centre outwards; empty if unknown.
        axis: (n, 2), height above the contact [m] and stress along the axis [Pa]; empty if unknown.
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
    profile: FloatArray
    axis: FloatArray

    def check_problem(self, radius: float, displacement: float, material: Material) -> None:
        """Raises SceneError if these values are for another radius, approach of the flat faces or material."""
        known = self.radius, self.displacement, self.young, self.poisson
        given = radius, displacement, material.young, material.poisson
        if not np.allclose(given, known, rtol=1e-9, atol=0):
            names = "radius", "displacement", "Young's modulus", "Poisson's ratio"
            wrong = ", ".join(f"{name} {a:g} instead of {b:g}" for name, a, b in zip(names, given, known) if a != b)
            raise SceneError(f"the reference {self.name} is of another problem: {wrong}")

    def pressure(self, r: float | FloatArray) -> FloatArray:
        """Contact pressure [Pa] at radii r [m], zero outside; p^2 is interpolated over r^2, as linear for Hertz."""
        known = np.append(self.profile[:, 0], self.contact_radius), np.append(self.profile[:, 1], 0.0)
        return np.sqrt(np.interp(np.square(r), known[0] ** 2, known[1] ** 2, right=0.0))


def hertz_a() -> ContactReference:
    """HERTZ-A: R = 1, E = 1, nu = 0.3, approach 0.01.

    Local.  Source: axisymmetric P2 finite elements on one curved half-sphere, exact non-penetration, graded meshes,
    converged to the digits given.
    """
    data = json.loads(Path(__file__).with_name("hertz_a.json").read_text())
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


def ssnv104() -> ContactReference:
    """code_aster's SSNV104 in mm, N and MPa: R = 50, E = 20,000, nu = 0.3, approach 4 (a/R = 0.2).

    Local.  Source: axisymmetric computation with linear elasticity at small strains and free faces, accurate to three
    digits.  Hertz's half-spaces, as published with the case, give a = 10 and p0 = 2798.3.
    """
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
        profile=np.zeros((0, 2)),
        axis=np.zeros((0, 2)),
    )


#: References by the name of the demos' option.
REFERENCES = {"hertz-a": hertz_a, "ssnv104": ssnv104}


def contact_errors(step: Step, reference: ContactReference) -> dict[str, float]:
    """Relative errors with sign [-] of the contact of two half-spheres along z against a reference.

    Collective on the step's communicator.

    Returns:
        `force`, `contact_radius` (of round contact), `max_pressure`, and if the reference has them `pressure`, in the
        L2 norm over the contact surface, and `axis_stress`, in the Euclidean norm over the reference's heights.
    """
    found = {name: getattr(step.record, name) for name in ("force", "contact_radius", "max_pressure")}
    result = {name: value / getattr(reference, name) - 1 for name, value in found.items() if value is not None}
    if len(reference.profile):
        result["pressure"] = _pressure_error(step, reference)
    if len(reference.axis):
        result["axis_stress"] = _axis_error(step, reference)
    return {name: float(value) for name, value in result.items()}


def _pressure_error(step: Step, reference: ContactReference) -> float:
    pairs = step.rows
    assert pairs is not None
    arm = pairs.position - np.asarray(step.record.contact_centre)
    known = reference.pressure(np.linalg.norm(arm[:, :2], axis=1))
    off = step.contact.pressure - known
    sums = step.forest.comm.allreduce(np.array([pairs.area @ off**2, pairs.area @ known**2]), op=MPI.SUM)
    return float(np.sqrt(sums[0] / sums[1]))


def _axis_error(step: Step, reference: ContactReference) -> float:
    """Error of the stress along the axis of the upper body.  Collective; only nodes on the axis are gathered."""
    forest, comm, space = step.forest, step.forest.comm, step.elasticity.prolongation.space
    leaf, node = space.example.T
    position = space.positions() - np.asarray(step.record.contact_centre)
    upper = forest.mesh.body[forest.cell[leaf]] == forest.mesh.bodies.index("upper")
    on = upper & (np.abs(position[:, :2]).max(axis=1) < 1e-9 * reference.radius)
    stress = step.nodal_stress[leaf, node, VOIGT.index((2, 2))]
    rows = np.concatenate(comm.allgather(np.stack([position[on, 2], stress[on]], axis=1)))
    rows = rows[np.argsort(rows[:, 0])]
    height, known = reference.axis.T
    off = np.interp(height, rows[:, 0], rows[:, 1]) - known
    return float(np.sqrt((off @ off) / (known @ known)))
