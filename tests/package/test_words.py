"""What users read and hand in: no units but theirs, figures with digits, folders that are no files, frozen meshes."""

from dataclasses import replace

import pytest
from conftest import WORLD

from demos.hertz_reference import REFERENCES
from fx_contact import (
    GeometryError,
    Material,
    OutputError,
    RootMesh,
    SceneError,
    adapt,
    block,
    root_mesh_from_gmsh,
    root_mesh_from_shapes,
)
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.parallel.errors import CheckpointError
from fx_contact.parallel.validation import percent
from fx_contact.plot import draw_mesh, draw_pressure
from fx_contact.plot.canvas import axes_for, draw_on_first, plotter_for
from fx_contact.results import RecordWriter, write_fields
from fx_contact.scenes import patch, stack

CUBE = root_mesh_from_shapes({"cube": block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)})


@pytest.fixture(scope="module")
def step():
    return next(adapt(patch(cells=(1, 1, 1)), 0.5, max_steps=1, degree=1))


def test_no_units(step):
    """Lengths, forces and stresses are in the units of the user's mesh, which nobody knows."""
    words = f"{step} {step.contact} {step.scene} {CUBE}".replace(",", " ").split()
    assert not {"m", "N", "Pa", "mm"} & set(words) and "E" in words
    with pytest.raises(SceneError) as caught:
        adapt(stack(displacement=30.0), 0.1)
    assert "differ by 30, and all bodies together are 3 large" in str(caught.value)


@pytest.mark.parametrize(
    "value, text", [(1.2345e-9, "1.2e-07%"), (0.004, "0.4%"), (0.016, "1.6%"), (0.5, "50%"), (0.0, "0%")]
)
def test_percent(value, text):
    """A small part has digits: nobody is told that 0.0% is more than 0.0%."""
    assert percent(value) == text


@pytest.mark.parametrize("name", ["fields.bp", "contact.VTU", "steps.jsonl", "a/table.csv"])
def test_folders_are_no_files(step, tmp_path, name):
    """What writes several files says that it wants a folder, and makes none that is called like a file."""
    path = WORLD.bcast(tmp_path) / name
    for use, error in (
        (lambda: write_fields(step, path), OutputError),
        (lambda: RecordWriter(path, WORLD), OutputError),
        (lambda: next(adapt(step.scene, 0.5, checkpoint=path)), OutputError),
        (lambda: Checkpoint(path, step.scene, WORLD), CheckpointError),
    ):
        with pytest.raises(error, match=f"folder.* must be a folder, got .*{path.name}"):
            use()
    assert not path.exists()


@pytest.mark.parametrize("draw", [draw_mesh, draw_pressure])
def test_pictures_are_png(step, tmp_path, draw):
    """A name that no picture can have is named, with the ending that it can have, before anything is drawn."""
    with pytest.raises(OutputError, match="must end in .png, got .*picture.xyz'"):
        draw(step, WORLD.bcast(tmp_path) / "new" / "picture.xyz")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("ending, canvas", [(".png", plotter_for), (".svg", axes_for)])
def test_errors_while_drawing_stay(tmp_path, ending, canvas):
    """An error of what draws is not one of the name of the file."""

    def draw(_):
        raise ValueError("not drawn")

    with pytest.raises(ValueError, match="not drawn"):
        draw_on_first(WORLD, WORLD.bcast(tmp_path) / f"a{ending}", draw, canvas)


def test_meshes_are_frozen():
    """A mesh cannot be changed in place, whoever made its arrays, and whoever made these can go on with them."""
    points, rows = CUBE.points.copy(), [[0, 5]]
    view = points[:]
    mesh = RootMesh(view, CUBE.cells.copy(), ("cube",), [0], {"top": rows})
    view.setflags(write=False)
    points += 1.0
    assert (mesh.points == CUBE.points).all()
    again = RootMesh(view, mesh.cells, ("cube",), mesh.body)
    points -= 1.0
    assert (again.points == CUBE.points + 1.0).all() and again.cells is mesh.cells
    for array in (mesh.points, mesh.cells, mesh.body, mesh.surfaces["top"]):
        with pytest.raises(ValueError, match="read-only"):
            array += 1
    with pytest.raises(TypeError):
        mesh.surfaces["side"] = rows
    assert set(replace(mesh, surfaces={**mesh.surfaces, "side": [[0, 1]]}).surfaces) == {"top", "side"}


def test_errors_of_gmsh_have_a_type():
    """What Gmsh refuses in the user's function is a GeometryError with Gmsh's words; other errors stay theirs."""

    def refused():
        import gmsh

        gmsh.clear()
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.cut([(3, 1)], [(3, 7)])

    def mistaken():
        raise Exception("my own")

    with pytest.raises(GeometryError, match="Gmsh cannot build the model: .*7"):
        root_mesh_from_gmsh(WORLD, refused)
    with pytest.raises(Exception, match="my own") as caught:
        root_mesh_from_gmsh(WORLD, mistaken)
    assert not isinstance(caught.value, GeometryError)


@pytest.mark.parametrize("name", REFERENCES)
def test_references_are_of_one_problem(name):
    """Published values are compared with their own problem alone."""
    known = REFERENCES[name]()
    material = Material(known.young, known.poisson)
    known.check_problem(known.radius, known.displacement, material)
    for other in (
        (2 * known.radius, known.displacement, material),
        (known.radius, 0.5 * known.displacement, material),
        (known.radius, known.displacement, Material(known.young, 0.2)),
        (known.radius, known.displacement, Material(3.0, known.poisson)),
    ):
        with pytest.raises(SceneError, match="of another problem: .* instead of"):
            known.check_problem(*other)
