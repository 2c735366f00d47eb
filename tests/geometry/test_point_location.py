"""Points in the root mesh."""

import numpy as np

from fx_contact.geometry.point_location import root_cells_at
from fx_contact.scenes import hertz, shrink_fit


def test_points_of_curved_cells():
    """The place that a cell's map gives is found again in that cell, on its faces and corners too; others are not."""
    random = np.random.default_rng(1)
    for scene in (hertz(order=6, coarse=2), shrink_fit(interference=1e-3, coarse=2)):
        mesh = scene.mesh
        for cell in random.integers(len(mesh.cells), size=12):
            at = random.random(3)
            at = np.where(random.random(3) < 0.4, np.round(at), at)
            (point,) = mesh.evaluate(np.array([cell]), at[None, :, None])[0]
            cells, found = root_cells_at(mesh, point)
            assert (np.diff(cells) > 0).all() and np.abs(found[cells == cell] - at).max() < 1e-5
            for one, here in zip(cells, found):
                assert np.linalg.norm(mesh.evaluate(np.array([one]), here[None, :, None])[0, 0] - point) < 1e-5
        assert not len(root_cells_at(mesh, 1.01 * mesh.points.max(axis=0))[0])


def test_points_beside_a_sphere():
    """A point just outside of the curved surface is in no cell."""
    mesh = hertz(order=6, coarse=2).mesh
    inside, outside = (np.array([np.sin(0.5), 0.0, np.cos(0.5)]) * r - [0, 0, 1] for r in (0.999, 1.001))
    assert len(root_cells_at(mesh, inside)[0]) and not len(root_cells_at(mesh, outside)[0])
