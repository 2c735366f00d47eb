"""Nothing of a step waits for Python's garbage collector, whose time differs between ranks."""

import gc
import weakref

import pytest
from conftest import everywhere

from fx_contact import (
    ContactPair,
    Dirichlet,
    Displacement,
    Elastic,
    Material,
    Pressure,
    RigidSphere,
    Scene,
    SymmetryPlane,
    ThermalStrain,
    adapt,
    block,
    root_mesh_from_shapes,
)
from fx_contact.scenes import hertz


def blocks(upper=(3, 3, 2), poisson=0.3, **options):
    """A block on another one, whose meshes match or not."""
    shapes = {"lower": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1), "upper": block((0, 0, 1), (1, 1, 2), upper, 1)}
    mesh = root_mesh_from_shapes(shapes)
    held = [SymmetryPlane(f"{body} {side}") for body in shapes for side in ("left", "front")]
    return Scene(
        "blocks",
        mesh,
        dict.fromkeys(shapes, Material(1.0, poisson)),
        (*held, Dirichlet("lower bottom", z=0.0)),
        ContactPair("lower top", "upper bottom"),
        Pressure("upper top", 0.01),
        **options,
    )


def below_a_ball():
    """A block below a sphere with a force."""
    mesh = root_mesh_from_shapes({"block": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block bottom", z=0.0)
    pair = ContactPair("block top", RigidSphere((0.0, 0.0, 2.0), 1.0), force=(0, 0, -1e-3))
    return Scene("ball", mesh, {"block": Material(1.0, 0.3)}, held, pair)


SCENES = {
    "hertz": lambda: hertz(order=2, coarse=2),
    "rubber": lambda: blocks((2, 2, 2), 0.499),
    "apart": lambda: blocks(springs=Elastic("lower right", normal=1.0)),
    "heated": lambda: blocks((2, 2, 2), strains=ThermalStrain("upper", 1e-5, 10.0)),
    "settling": below_a_ball,
}


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("name", SCENES)
def test_a_step_is_freed_with_its_last_name(name):
    """Mesh, spaces and prolongation are freed at once, and their communicators with them, in the same order."""
    goals = [Displacement((0.0, 0.0, 2.0), (0, 0, 1), 0.5)] if name == "heated" else []
    step = list(adapt(SCENES[name](), 0.3, goals=goals, max_steps=2))[-1]
    assert step.stress and step.mesh  # UFL leaves cycles where a form is compiled for the first time
    del step
    gc.collect()
    gc.disable()
    try:
        run = adapt(SCENES[name](), 0.3, goals=goals, max_steps=2)
        step = list(run)[-1]
        assert step.stress and step.mesh
        held = step.mesh, step.elasticity, step.elasticity.prolongation, step.elasticity.function_space
        references = [weakref.ref(one) for one in (*held, step.field.function)]
        del step, held, run
        everywhere(not any(reference() is not None for reference in references), "a cycle of references")
    finally:
        gc.enable()
