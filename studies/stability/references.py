"""Known answers for the scenes of the stress matrix: forces, energies, and twins that must give the same."""

from dataclasses import replace
from functools import partial

import numpy as np
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator

from fx_contact import Material, scenes
from fx_contact.results.analytic import Hertz
from fx_contact.scenes import punch, stack
from studies.stability.checks import Exact, Twin
from studies.stability.shapes import PLAIN

hertz = partial(scenes.hertz, comm=MPI.COMM_SELF)
#: Force of the project's first benchmark: an axisymmetric computation, which does not use this program.
HERTZ_A = Exact(force=5.37755e-4, approach=0.01, curved=True, unsure=1e-5)
#: By how much half-spheres pressed by their flat faces, free sideways, are stiffer than Hertz's half-spaces, over
#: Hertz's contact radius / R; the same axisymmetric computation, nu = 0.3, three digits.
STIFFER = PchipInterpolator([0.0, 0.02, 0.05, 0.1, 0.2], [0.0, 0.009, 0.026, 0.057, 0.126])


def material(young=1.0, poisson=0.3):
    """A Material."""
    return Material(young=young, poisson=poisson)


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
    exact = Exact(force=force, approach=displacement, curved=True, unsure=1e-3 if known else size + 1e-3)
    return {"scene": make, "reference": exact}


def punch_force(displacement, **more):
    """A punch pressed in little: Hertz on a half-space; both bodies finite, so off by about a/R."""
    modulus = PLAIN.plane_strain_modulus / 2
    force = 4 / 3 * modulus * displacement**1.5
    size = Hertz(1.0, modulus, force).contact_radius
    exact = Exact(force=force * (1 + size), approach=displacement, curved=True, unsure=size)
    return {"scene": partial(punch, displacement=displacement, **more), "reference": exact}


def stack_force(materials, displacement=0.01, height=1.0, gap=0.0, **more):
    """Blocks between plates: a uniform pressure."""
    approach = displacement - gap * (len(materials) - 1)
    pressure = max(approach, 0.0) / sum(height / m.young for m in materials)
    return {
        "scene": partial(stack, materials, displacement, height=height, gap=gap, **more),
        "reference": Exact(force=pressure, approach=approach, linear=True),
    }


def stack_pressed(materials, pressure, **more):
    """Blocks under a pressure, which store p^2 / E a volume."""
    energy = sum(pressure**2 / m.young for m in materials)
    return {
        "scene": partial(stack, materials, pressure=pressure, **more),
        "reference": Exact(energy=energy, linear=True),
    }


def changed(make, change):
    """A function that makes a scene and changes it."""
    return lambda: change(make())


def with_twin(make, transform, **known):
    """A scene and a transformed one."""
    return {"scene": make, "reference": Twin(changed(make, transform), **known)}


def units_of(length, stress):
    """What a twin in other units has, as keyword arguments of Twin."""
    return {"force": stress * length**2, "energy": stress * length**3, "pressure": stress}


#: Twins whose penalty errs otherwise, and twins on another mesh.
OTHER_CONTACT = {"same_contact": False, "curved": True}
#: The latter are so much finer that their own error hides none of the scene's: 0.09 of the square asked for.
OTHER_MESH = {"same_mesh": False, "same_contact": False, "tolerance": 0.3}


def refused(make):
    """A scene without solution."""
    return {"scene": make, "reference": None}
