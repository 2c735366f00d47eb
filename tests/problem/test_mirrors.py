"""The whole of which a part is modelled: sums over mirror images, found from the planes of symmetry."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from fx_contact import Dirichlet
from fx_contact.problem.mirrors import Mirrors, mirror_group
from fx_contact.scenes import cylinders, indentation, shrink_fit, stack
from studies.stability.twins import scaled

#: What a stack has, but for the declaration of symmetry.
HELD = Dirichlet("bottom", z=0.0), Dirichlet("top", z=-0.1), Dirichlet("x = 0", x=0.0), Dirichlet("y = 0", y=0.0)


@pytest.mark.parametrize("across", product([False, True], repeat=3))
def test_sums_over_images(across):
    """Forces at points, their moments and second moments about the centre: as of the forces and all their images."""
    random = np.random.default_rng(1)
    points, forces, at = random.normal(size=(5, 3)), random.normal(size=(5, 3)), random.normal(size=3)
    normals = np.eye(3)[np.flatnonzero(across)]
    mirrors = Mirrors(normals, normals @ at, mirror_group(normals, 8))
    centre = mirrors.centre(random.normal(size=3))
    arms, images = points - centre, [(points - centre, forces)]
    for axis in np.flatnonzero(across):
        flip = np.where(np.arange(3) == axis, -1.0, 1.0)
        images += [(flip * x, flip * f) for x, f in images]
    x, f = (np.concatenate(part) for part in zip(*images))
    assert mirrors.parts == len(images)
    assert np.allclose(mirrors.force(forces.sum(axis=0)), f.sum(axis=0))
    assert np.allclose(mirrors.moment(np.cross(arms, forces).sum(axis=0)), np.cross(x, f).sum(axis=0))
    assert np.allclose(mirrors.second_moment(arms.T @ arms), x.T @ x)


@pytest.mark.parametrize(
    "make, across",
    [
        (stack, "xy"),
        (indentation, "xy"),
        (lambda: indentation(symmetry="full"), ""),
        (shrink_fit, "xyz"),
        (cylinders, "x"),
        (lambda: scaled(cylinders(), 1e-7, 1.0), "x"),
        (lambda: replace(stack(), symmetry=1), ""),
        (lambda: replace(stack(), symmetry=8), ""),
        (lambda: replace(stack(), dirichlet=HELD), ""),
    ],
    ids=["stack", "quarter", "full", "rings", "slice", "thin slice", "one part", "an eighth", "undeclared"],
)
def test_mirrors_of_scenes(make, across):
    """Planes of symmetry that make the copies which the scene says, at their place; a slice is between two."""
    mirrors = make().mirrors
    assert sorted("xyz"[abs(normal).argmax()] for normal in mirrors.normals) == list(across)
    assert np.abs(mirrors.at).max(initial=0.0) < 1e-12


def test_place_of_a_mirror():
    """A plane need not be at 0."""
    scene = stack()
    moved = replace(scene, mesh=replace(scene.mesh, points=scene.mesh.points + [3.0, -2.0, 1.0]))
    assert np.allclose(moved.mirrors.centre(np.array([5.0, 5.0, 5.0])), [3.0, -2.0, 5.0])
