"""The recovered stress, and the energies that come with it."""

import numpy as np
from conftest import WORLD, everywhere
from model_problems import conforming_positions, discrete, grown, pressed, roots, two_boxes

from fx_contact.estimate.recovery import VOIGT, Recovery
from fx_contact.parallel.timing import Stages


def test_energies_add_up():
    """The energy of sigma_h is that of its displacement; omega (4) has xi too, omega^2 = |sigma_h|^2 + xi^2."""
    scene = pressed(two_boxes(bend=0.2))
    forest = grown(roots(scene), 2, share=0.2)
    elasticity = discrete(scene, forest)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    u = 0.1 * np.sin(3 * position)
    elasticity.set_displacement(u)
    nowhere = np.zeros(u.shape, dtype=bool)
    estimate = Recovery(elasticity, nowhere, Stages()).estimate()
    energy, error2 = WORLD.allreduce(np.array([estimate.energy.sum(), (estimate.error**2).sum()]))
    assert estimate.relative > 0.3, "hardly an error"
    assert abs(energy / elasticity.energy_norm(u) ** 2 - 1) < 1e-12
    assert abs(error2 / estimate.error_global**2 - 1) < 1e-12
    assert abs((energy + error2) / estimate.energy_norm**2 - 1) < 1e-12
    assert estimate.cells == forest.size_global


def test_no_shear_stress_where_symmetry_forbids_it():
    """On planes across x that are named, s_xy and s_xz are 0, the other components as without."""
    scene = pressed(two_boxes())
    forest = grown(roots(scene), 1, share=0.2)
    elasticity = discrete(scene, forest)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    elasticity.set_displacement(position @ np.array([[1.0, 0.5, 0.2], [0.3, 2.0, 0.4], [0.6, 0.1, 3.0]]))
    plane = np.zeros(position.shape, dtype=bool)
    plane[:, 0] = np.abs(position[:, 0]) < 1e-9
    free, held = (Recovery(elasticity, which, Stages()).estimate() for which in (np.zeros_like(plane), plane))
    on = elasticity.at_blocks(elasticity.prolongation.prolong(np.repeat(plane[:, :1], 6, axis=1).astype(float)))
    on, free, held = (values.reshape(-1, 6) for values in (on == 1, free.stress.x.array, held.stress.x.array))
    on = on.all(axis=1)
    shear = [VOIGT.index(pair) for pair in ((0, 1), (0, 2))]
    others = [i for i in range(6) if i not in shear]
    assert WORLD.allreduce(int(on.sum())) > 4
    everywhere(
        np.abs(held[on][:, shear]).max(initial=0) == 0 < np.abs(free[:, shear]).min(initial=1), "a shear stress"
    )
    everywhere(np.abs(held - free)[:, others].max(initial=0) < 1e-12, "another normal stress")
