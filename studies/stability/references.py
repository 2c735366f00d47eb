"""Known answers for scenes of the stress matrix: functions give what makes the scene, and the Exact reference."""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.interpolate import PchipInterpolator

from fx_contact.results.analytic import Hertz
from fx_contact.scenes import hertz, punch, stack
from studies.stability.cases import Exact
from studies.stability.shapes import PLAIN

#: Force of the project's first benchmark: an axisymmetric computation, which does not use this program.
HERTZ_A = Exact(force=5.37755e-4, approach=0.01, curved=True, unsure=1e-5)
#: By how much half-spheres pressed by their flat faces, free sideways, are stiffer than Hertz's half-spaces, over
#: Hertz's contact radius / R; the same axisymmetric computation, nu = 0.3, three digits.
STIFFER = PchipInterpolator([0.0, 0.02, 0.05, 0.1, 0.2], [0.0, 0.009, 0.026, 0.057, 0.126])


def hertz_force(displacement, upper=PLAIN, lower=PLAIN, order=6, **more):
    """Two half-spheres of radius 1, and Hertz's force for the approach, corrected for their size.

    The correction is known for one Poisson's ratio and equal bodies; else it is as uncertain as it is large.
    """

    def make():
        scene = hertz(1.0, displacement, PLAIN, order, **more)
        return replace(scene, materials={"lower": lower, "upper": upper})

    modulus = 1 / (1 / upper.plane_strain_modulus + 1 / lower.plane_strain_modulus)
    known = upper.poisson == lower.poisson == 0.3 and upper == lower
    size = float(STIFFER(np.sqrt(displacement / 2)))
    force = 4 / 3 * modulus * np.sqrt(0.5) * displacement**1.5 * (1 + size)
    return make, Exact(force, displacement, curved=True, unsure=1e-3 if known else size + 1e-3)


def punch_force(displacement, **more):
    """A punch pressed in little: Hertz on a half-space; both bodies finite, so off by about a/R."""
    modulus = PLAIN.plane_strain_modulus / 2
    force = 4 / 3 * modulus * displacement**1.5
    size = Hertz(1.0, modulus, force).contact_radius
    known = Exact(force * (1 + size), displacement, curved=True, unsure=size)
    return partial(punch, displacement=displacement, **more), known


def stack_force(materials, displacement=0.01, height=1.0, gap=0.0, **more):
    """Blocks between plates: a uniform pressure."""
    approach = displacement - gap * (len(materials) - 1)
    pressure = max(approach, 0.0) / sum(height / m.young for m in materials)
    scene = partial(stack, materials, displacement, height=height, gap=gap, **more)
    return scene, Exact(pressure, approach, linear=True)


def stack_pressed(materials, pressure):
    """Blocks under a pressure, which store p^2 / E a volume."""
    energy = sum(pressure**2 / m.young for m in materials)
    return partial(stack, materials, pressure=pressure), Exact(energy=energy, linear=True)
