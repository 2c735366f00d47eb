"""A kind of contact that a user adds from the public parts: a `Contact`, a `RowKind`, and an entry in `KINDS`."""

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import everywhere
from model_problems import grown, roots

from fx_contact import Dirichlet, Material, Scene, SceneError, SymmetryPlane, adapt, block, root_mesh_from_shapes
from fx_contact.adaptive.beginning import Beginning
from fx_contact.contact.constraint_rows import RowColumns, RowKind
from fx_contact.contact.contact_facets import facet_shares, moduli, nodal_sums, spring_stiffness
from fx_contact.contact.row_entries import KeyedEntries
from fx_contact.contact.row_kinds import KINDS
from fx_contact.items.contact import Contact

pytestmark = pytest.mark.ranks(1, 2, 3)


@dataclass(frozen=True)
class Floor(Contact):
    """A rigid plane z = height below a surface."""

    surface: str
    height: float = 0.0

    @property
    def surfaces(self):
        return (self.surface,)

    @property
    def unit_direction(self):
        return np.array([0.0, 0.0, -1.0])


class FloorRows(RowKind):
    """A row for each node: n . u <= g, n downwards."""

    SLIDES = True

    def apart(self, forest, leaf, face, points):
        x = forest.evaluate(forest.cell[leaf], points)
        return np.stack([0 * x[..., 0], 0 * x[..., 1], self.contact.height - x[..., 2]], axis=-1)

    def columns(self, prolongation, enforcement):
        space, forest = prolongation.space, prolongation.space.forest
        leaf, face = self.facets(forest)
        points = space.points[leaf[:, None], space.face_nodes[face]]
        here = forest.evaluate(forest.cell[leaf], points)
        area, _ = facet_shares(space, here, face)
        bodies = np.stack([forest.mesh.body[forest.cell[leaf]], np.full(len(leaf), -1)], axis=1)
        stiffness = spring_stiffness(enforcement, moduli(self.scene, bodies), area)
        first, example, sums = nodal_sums(prolongation, leaf, face, np.stack([area, stiffness], axis=2))
        count, key = len(first), space.keys[space.on_faces(leaf, face)].ravel()[example]
        return RowColumns(
            first=first,
            entries=KeyedEntries(np.arange(count), key, np.zeros(count, dtype=np.int64), np.ones(count)),
            across=sums[:, :1] * self.contact.unit_direction,
            apart=self.apart(forest, leaf, face, points).reshape(-1, 3)[example],
            area=sums[:, 0],
            stiffness=sums[:, 1],
            position=here.reshape(-1, 3)[example],
            modulus=moduli(self.scene, bodies[example // points.shape[1]]),
            bodies=bodies[example // points.shape[1]],
        )


def on_floor(contact):
    """A cube above a contact of its base, pressed down."""
    mesh = root_mesh_from_shapes({"cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    held = SymmetryPlane("cube left"), SymmetryPlane("cube front"), Dirichlet("cube top", z=-0.01)
    return Scene("cube", mesh, {"cube": Material(1.0, 0.3)}, held, contact)


def test_a_kind_of_the_user(monkeypatch):
    """It goes through a run with hanging nodes: the uniform pressure of a cube under a strain of 1 % is exact."""
    monkeypatch.setitem(KINDS, Floor, FloorRows)
    scene = on_floor(Floor("cube bottom"))
    forest = grown(roots(scene), 2, share=0.3)
    step = next(adapt(scene, 0.1, beginning=Beginning.at_rest(forest)))
    assert step.record.hanging_nodes > 0 and abs(step.record.force / 0.01 - 1) < 1e-7
    everywhere(np.abs(step.contact.pressure / 0.01 - 1).max(initial=0.0) < 1e-5, "not uniform")


def test_an_unknown_kind():
    """A contact without rows is named."""
    with pytest.raises(SceneError, match="no rows for a Floor"):
        next(adapt(on_floor(Floor("cube bottom", -0.001)), 0.1))
