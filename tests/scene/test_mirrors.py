"""The whole of which a part is modelled: sums over mirror images, found from the planes of symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from model_problems import ALONG, PLANES, wedge

from fx_contact import Dirichlet, SymmetryPlane
from fx_contact.geometry.shapes import rotation
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.mirrors import Mirrors, mirror_group
from fx_contact.scenes import cylinders, indentation, shrink_fit, stack
from studies.stability.twins import scaled

#: What a stack has, but for the declaration of symmetry.
HELD = Dirichlet("bottom", z=0.0), Dirichlet("top", z=-0.1), Dirichlet("x = 0", x=0.0), Dirichlet("y = 0", y=0.0)


@pytest.mark.parametrize("degrees, parts", [(90, 4), (60, 6), (45, 8), (30, 12), (20, 18)])
@pytest.mark.parametrize("planes", range(4))
def test_sums_over_images(degrees, parts, planes):
    """Between planes at 180 degrees / m there are 2 m parts: as of a particle that is mirrored until it comes again."""
    random, tilt = np.random.default_rng(2), rotation((1.0, 2.0, 3.0), 40.0)
    angle = np.radians(degrees)
    normals = np.array([[0.0, 1.0, 0.0], [np.sin(angle), -np.cos(angle), 0.0], [0.0, 0.0, 1.0]])[:planes] @ tilt.T
    mirrors = Mirrors(normals, normals @ random.normal(size=3), mirror_group(normals, 100))
    point, force = random.normal(size=3), random.normal(size=3)
    centre = mirrors.centre(point)
    assert np.allclose(normals @ centre, mirrors.at)
    off = np.linalg.lstsq(normals.T, centre - point)[0] @ normals if planes else 0.0
    assert np.allclose(off, centre - point), "moved along a plane"
    arms, forces = [point - centre], [force]
    for arm, push in zip(arms, forces):  # they grow
        for normal in normals:
            image = arm - 2 * (arm @ normal) * normal
            if np.linalg.norm(np.array(arms) - image, axis=1).min() > 1e-9:
                arms.append(image)
                forces.append(push - 2 * (push @ normal) * normal)
    assert mirrors.parts == len(arms) == (1, 2, parts, 2 * parts)[planes]
    x, f = np.array(arms), np.array(forces)
    assert np.allclose(mirrors.force(force), f.sum(axis=0))
    assert np.allclose(mirrors.moment(np.cross(arms[0], force)), np.cross(x, f).sum(axis=0))
    assert np.allclose(mirrors.second_moment(np.outer(arms[0], arms[0])), x.T @ x)


def test_centre_between_planes_that_almost_agree():
    """Two surfaces of one plane, whose normals differ by rounding, move a point across it alone."""
    normals = np.array([[1.0, 0.0, 0.0], [1.0, 1e-9, 0.0]])
    centre = Mirrors(normals, np.array([0.0, 1e-9]), mirror_group(normals, 4)).centre(np.array([3.0, 5.0, 7.0]))
    assert np.allclose(centre, [0.0, 5.0, 7.0], atol=1e-6)


def test_mirrors_of_a_wedge():
    """Three planes at 30 and 90 degrees make 24 copies, two 12, also of a slice, of which 24 are not known."""
    mirrors = wedge(symmetry=24).mirrors
    assert mirrors.parts == 24 and np.abs(mirrors.centre(np.ones(3))).max() < 1e-12
    sliced = wedge(held=(*PLANES, SymmetryPlane("top")), symmetry=12).mirrors
    assert sliced.parts == 12
    assert np.allclose(sliced.centre(np.ones(3)), ALONG[:, 2] * (ALONG[:, 2] @ np.ones(3)))
    for scene in (wedge(), wedge(held=(*PLANES, SymmetryPlane("right")), symmetry=24)):
        assert scene.mirrors.parts == 1
        assert np.array_equal(scene.mirrors.force(np.ones(3)), np.ones(3))


@pytest.mark.parametrize(
    "symmetry, made", [(12, "more than 12"), (36, "24"), (48, "24")], ids=["too few", "no multiple", "a multiple"]
)
def test_copies_that_planes_cannot_make(symmetry, made):
    """Forces of the whole would be wrong."""
    with pytest.raises(SceneError, match=f"symmetry={symmetry}, but .* make {made} copies"):
        wedge(symmetry=symmetry)


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
