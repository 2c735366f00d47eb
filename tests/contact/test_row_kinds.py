"""Kinds of rows beside node pairs go through whole adaptive runs: no second body, and many nodes a row on both sides.

Both are made here, from the public parts: a `Contact`, a `RowKind`, and an entry in `KINDS`.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, discrete, grown, prolongation_of, roots
from scipy.sparse import coo_matrix, csr_matrix, diags

from fx_contact import ContactPair, Dirichlet, Enforcement, Material, SceneError, SolveError, adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.contact.constraint_rows import KeyedEntries, RowColumns, RowKind
from fx_contact.contact.contact_facets import facet_shares, moduli, nodal_sums, positions_across, spring_stiffness
from fx_contact.contact.projection import Projection
from fx_contact.contact.row_kinds import KINDS, create_rows
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import Contact
from fx_contact.parallel.exchange import Exchange
from fx_contact.scenes import hertz, patch, stack

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


class Averaged(ContactPair):
    """A pair whose rows are means over nodes."""


class AveragedRows(RowKind):
    """Rows D^-1 (M + D) / 2 B of node pairs B, with M the mass matrix of the first surface and D its row sums.

    A row has the nodes of all facets around its node, on both sides, of whichever rank.  Uniform pressure passes: the
    columns of M + D add up to 2 D.
    """

    def _local(self, prolongation):
        """Nodes of this rank's facets, (M + D) / 2 of these, and areas."""
        space, forest = prolongation.space, prolongation.space.forest
        leaf, face = self.facets(forest)
        weights, value, along_u, along_v = space.facet_rule
        here = forest.evaluate(forest.cell[leaf], space.points[leaf[:, None], space.face_nodes[face]])
        jacobian = np.linalg.norm(np.cross(along_u @ here, along_v @ here), axis=2)
        mass = np.einsum("ng,gi,gj->nij", weights * jacobian, value, value)
        area = mass.sum(axis=2)
        return leaf, face, (mass + area[:, :, None] * np.eye(value.shape[1])) / 2, area

    def _entries(self, prolongation):
        """Entries on the owners of the rows: owned node, side, key of the column and value.  Collective."""
        space, comm = prolongation.space, prolongation.comm
        imap, size = prolongation.index_map, len(prolongation.zeros(1))
        leaf, face, local, _ = self._local(prolongation)
        node, facing = space.on_faces(leaf, face), space.facing(leaf, face)
        k = node.shape[1]
        on_facets = np.arange(node.size).reshape(node.shape)
        row, column = np.repeat(on_facets, k, axis=1).ravel(), np.tile(on_facets, k).ravel()
        mass = csr_matrix((local.ravel(), (row, column)), shape=(node.size, node.size))
        here, there = prolongation.rows(space.keys[node.ravel()]), prolongation.rows(facing.ravel())
        parts = [(here.T @ mass @ side).tocoo() for side in (here, there)]
        number = imap.local_to_global(np.arange(size, dtype=np.int32))
        keys = self._keys(prolongation)
        row, column = (np.concatenate([getattr(part, name) for part in parts]) for name in ("row", "col"))
        side = np.repeat([0, 1], [part.nnz for part in parts])
        value = np.concatenate([part.data for part in parts])
        owner = np.concatenate([np.full(imap.size_local, comm.rank), imap.owners])[row]
        exchange = Exchange(comm, owner)
        sent = [exchange.forward(rows) for rows in (number[row], side, keys[column], value)]
        return sent[0] - imap.local_range[0], *sent[1:]

    @staticmethod
    def _keys(prolongation):
        """Keys of all positions in the index map, ghosts included.  Collective."""
        space = prolongation.space
        owned = prolongation.injected(space.keys)
        halves = np.stack([owned >> 31, owned & (1 << 31) - 1], axis=1).astype(float)
        high, low = prolongation.ghosted(halves).astype(np.int64).T
        return high << 31 | low

    def apart(self, forest, leaf, face, points):
        here, there = positions_across(forest, leaf, face, points)
        return there - here

    def columns(self, prolongation, enforcement):
        space, forest = prolongation.space, prolongation.space.forest
        prolongation = prolongation.reaching(space.facing(*self.facets(forest)).ravel())
        leaf, face, local, area = self._local(prolongation)
        points = space.points[leaf[:, None], space.face_nodes[face]]
        here, there = positions_across(forest, leaf, face, points)
        partner = forest.pairing.partner[forest.cell[leaf], face, 0]
        bodies = np.stack([forest.mesh.body[cell] for cell in (forest.cell[leaf], partner)], axis=1)
        stiffness = spring_stiffness(enforcement, moduli(self.scene, bodies), area)
        _, outward = facet_shares(space, here, face)
        values = np.concatenate([area[..., None], stiffness[..., None], outward, local @ (there - here)], axis=2)
        first, example, sums = nodal_sums(prolongation, leaf, face, values)
        assert (first < prolongation.owned).all(), "a row that its node's owner does not make"
        node, side, key, value = self._entries(prolongation)
        row = np.full(prolongation.owned, -1)
        row[first] = np.arange(len(first))
        # Sums of what the ranks sent for each row, node and side.
        keys, column = np.unique(key, return_inverse=True)
        sent = coo_matrix((value, (row[node], 2 * column + side)), shape=(len(first), 2 * len(keys))).tocsr()
        sent = (diags(1 / sums[:, 0]) @ sent).tocoo()
        order = np.lexsort((sent.col, sent.row))
        column, side = np.divmod(sent.col[order].astype(np.int64), 2)
        weight = np.where(side, -1, 1) * sent.data[order]
        return RowColumns(
            first=first,
            entries=KeyedEntries(sent.row[order].astype(np.int64), keys[column], side, weight),
            across=sums[:, 2:5],
            apart=sums[:, 5:] / sums[:, :1],
            area=sums[:, 0],
            stiffness=sums[:, 1],
            position=here.reshape(-1, 3)[example],
            modulus=moduli(self.scene, bodies[example // points.shape[1]]),
            bodies=bodies[example // points.shape[1]],
        )


@pytest.fixture(autouse=True)
def kinds(monkeypatch):
    """Both kinds are known."""
    monkeypatch.setitem(KINDS, Floor, FloorRows)
    monkeypatch.setitem(KINDS, Averaged, AveragedRows)


def on_floor(scene, name, height=0.0, keep=None):
    """The upper part of a scene of two bodies, on a plane instead of the lower one; `top` is held as in the scene."""
    mesh, materials = scene.mesh, {keep: scene.materials[keep]}
    cells = np.flatnonzero(mesh.body == mesh.bodies.index(keep))
    nodes, numbered = np.unique(mesh.cells[cells], return_inverse=True)
    found = {key: rows[np.isin(rows[:, 0], cells)] for key, rows in mesh.surfaces.items()}
    surfaces = {
        key: np.column_stack([np.searchsorted(cells, rows[:, 0]), rows[:, 1]]).astype(np.int32)
        for key, rows in found.items()
        if len(rows)
    }
    body, shape = np.zeros(len(cells), dtype=np.int32), (len(cells), -1)
    part = RootMesh(mesh.points[nodes], numbered.reshape(shape), (keep,), body, surfaces)
    held = tuple(c for c in scene.dirichlet if getattr(c, "where", getattr(c, "surface", None)) in surfaces)
    return replace(scene, mesh=part, materials=materials, dirichlet=held, contact=(Floor(name, height),))


def averaged(scene):
    """The same scene, its contact pairs averaged."""
    return replace(scene, contact=tuple(Averaged(**vars(pair)) for pair in scene.contact))


def around_the_axis(scene):
    """A Beginning with hanging nodes on the contact: leaves around the axis are halved twice."""
    forest = Beginning.uniform(scene, 0).forest
    for reach in (0.4, 0.2):
        forest, _ = forest.refined(np.linalg.norm(forest.centres[:, :2], axis=1) < reach)
    return Beginning.at_rest(forest)


@pytest.mark.parametrize("degree, tolerance", [(1, 0.2), (2, 0.06)])
def test_a_sphere_on_a_floor(degree, tolerance):
    """Half of Hertz's problem of equal spheres: at first the same numbers, in the end the same force.

    The whole has more leaves, around the rim of its facing surfaces.  The force on the floor is that of the flat face.
    """
    whole = hertz(displacement=0.02, coarse=2, order=3)
    half = on_floor(whole, "upper pole", keep="upper")
    assert not half.pairing.paired.any() and (half.contact_surfaces.contact >= 0).any()
    both, steps = (list(adapt(scene, tolerance, degree=degree)) for scene in (whole, half))
    two, one = both[0].record, steps[0].record
    assert two.cells == 2 * one.cells and two.active_pairs == one.active_pairs
    for name in ("force", "max_pressure", "estimate"):
        assert abs(getattr(one, name) / getattr(two, name) - 1) < 1e-4, name
    two, one = both[-1], steps[-1]
    assert len(steps) > 2 and one.record.reached and one.record.hanging_nodes > 0
    assert abs(one.record.force / two.record.force - 1) < tolerance**2
    assert abs(one.record.pair_errors[0] / two.record.pair_errors[0] - 1) < 0.5
    totals = {(r.name, r.kind): np.array(r.force) for r in one.resultants}
    pressed = totals["upper pole", "contact"]
    assert abs(np.linalg.norm(pressed) / one.record.force - 1) < 1e-9
    assert pressed[2] < 0 and np.abs(pressed - totals["top", "reaction"]).max() < 1e-6 * one.record.force
    exact = 4 / 3 * 0.5 / (1 - 0.3**2) * 0.5**0.5 * 0.02**1.5
    assert abs(one.record.force / exact - 1) < 0.1


@pytest.mark.parametrize("degree, tolerance", [(1, 0.2), (2, 0.06)])
def test_averaged_rows_of_spheres(degree, tolerance):
    """Hertz's force within the square of the tolerance of that of node pairs, error of the force and all."""
    scene = hertz(displacement=0.02, coarse=2, order=3)
    *_, pairs = (step.record for step in adapt(scene, tolerance, degree=degree))
    steps = list(adapt(averaged(scene), tolerance, degree=degree))
    last = steps[-1]
    assert len(steps) > 2 and last.record.reached and last.record.hanging_nodes > 0
    assert last.record.pair_errors[0] is not None
    per_row = np.bincount(last.rows.entries.row, minlength=len(last.rows))
    assert WORLD.allreduce(int(per_row.max(initial=0)), op=max) > 8
    assert abs(last.record.force / pairs.force - 1) < 2 * tolerance**2
    assert abs(last.record.max_pressure / pairs.max_pressure - 1) < tolerance


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("method", ["exact", "penalty"])
def test_three_kinds_in_a_stack(degree, method):
    """Node pairs, averaged rows and a floor in one scene with hanging nodes: the uniform pressure is exact.

    Springs of a penalty are stiffer on smaller facets, by which the pressure varies there.
    """
    material = Material(1.0, 0.3)
    scene = stack((material, Material(3.0, 0.2), material), pressure=0.01)
    one, two = scene.contact
    held = tuple(c for c in scene.dirichlet if not isinstance(c, Dirichlet))
    scene = replace(scene, dirichlet=held, contact=(one, Averaged(**vars(two)), Floor("bottom")))
    options = {"degree": degree, "beginning": around_the_axis(scene), "enforcement": Enforcement(method)}
    step = next(adapt(scene, 0.1, **options))
    assert step.record.hanging_nodes > 0
    assert np.abs(np.array(step.record.pair_forces) / 0.01 - 1).max() < 1e-6
    off = np.abs(step.contact.pressure / 0.01 - 1).max(initial=0.0)
    everywhere(off < (1e-5 if method == "exact" else 0.05), "not uniform")


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_averaged_rows_are_the_same_anywhere(distribution, monkeypatch):
    """Weights of a row add up to 1 and -1, and B u of a linear field is that of the node pairs, on any distribution."""
    scene = averaged(patch(cells=(2, 2, 1)))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2, share=0.2))
    prolongation = prolongation_of(scene, forest, 2)
    rows = create_rows(scene, prolongation, Enforcement())
    entries = rows.entries
    for side, total in ((0, 1.0), (1, -1.0)):
        sums = np.bincount(entries.row[entries.side == side], entries.weight[entries.side == side], len(rows))
        everywhere(np.abs(sums - total).max(initial=0.0) < 1e-12, "weights")
    x = prolongation.injected(prolongation.space.positions())
    body = prolongation.injected(scene.mesh.body[forest.cell[prolongation.space.example[:, 0]]])
    u = np.where(body[:, None] == 0, [0.1, 0.2, 0.7], [0.3, 0.0, -0.2]) + 0.0 * x
    everywhere(np.abs(rows.jump(u) - 0.9).max(initial=0.0) < 1e-12, "B u")
    everywhere(np.abs(rows.closing(u) - [-0.2, 0.2, 0.9]).max(initial=0.0) < 1e-12, "jump")
    everywhere(np.abs(rows.sliding(u) - np.hypot(0.2, 0.2)).max(initial=0.0) < 1e-12, "sliding")
    monkeypatch.setattr(AveragedRows, "SLIDES", True)
    everywhere((rows.sliding(u) == 0).all(), "rows over a plane")
    total = WORLD.allreduce(float(rows.area.sum()))
    assert abs(total - 0.25) < 1e-12 and discrete(scene, forest).prolongation.owned > 0


def test_rows_whose_projection_does_not_converge(monkeypatch):
    """It is an error on all ranks, not a wrong force; it converges in the iterations that there are."""
    scene = averaged(patch(cells=(2, 2, 1)))
    assert next(adapt(scene, 0.1, degree=1)).record.force > 0
    monkeypatch.setattr(Projection, "_ITERATIONS", 2)
    with pytest.raises(SolveError, match="projection .* has not converged in 2 iterations"):
        next(adapt(scene, 0.1, degree=1))


def test_an_unknown_kind(monkeypatch):
    """A contact without rows is named."""
    monkeypatch.delitem(KINDS, Floor)
    scene = on_floor(patch(cells=(1, 1, 1)), "under block 1", 1.0, keep="block 1")
    with pytest.raises(SceneError, match="no rows for a Floor"):
        next(adapt(scene, 0.1))
