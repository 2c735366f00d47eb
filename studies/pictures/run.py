"""The pictures of contact in the README, on the home page, in the gallery, the examples and the verification.

python3 -m studies.pictures.run                              # all of them, into results/pictures: 3 minutes
python3 -m studies.pictures.run --output docs/figures        # those that are kept
python3 -m studies.pictures.run --only contact               # one; --help lists them
"""

import argparse
import re
import runpy
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread
from PIL import Image

from demos.hertz_reference import hertz_a
from fx_contact import Material, adapt, block, root_mesh_from_shapes, solve
from fx_contact.plot import draw_bodies, draw_contact, draw_mesh, draw_pressure, plotter_for
from fx_contact.plot.surfaces import contact_size
from fx_contact.results import true_error
from fx_contact.scenes import cylinders, hertz, indentation, patch, punch, shrink_fit, spheres, stack

DEMOS = Path(__file__).parents[2] / "demos"
EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"


def demo(name):
    """The last step of a demo's scene, at 10 %."""
    found = of_demo(name)
    return found["step"] if "step" in found else solve(found[name](), 0.1)


def of_demo(name):
    """What a demo defines."""
    sys.path.insert(0, str(DEMOS))
    sys.argv[:] = [str(DEMOS / f"{name}.py")]
    found = runpy.run_path(sys.argv[0])
    sys.path.remove(str(DEMOS))
    return found


def program(page):
    """The program of a page that has one."""
    (code,) = re.findall(r"^```\{code-cell\} python\n(.*?)^```", page.read_text(), flags=re.M | re.S)
    return code


def example(name):
    """The last step of a page of examples, whose program prints nothing here."""
    found = {}
    with redirect_stdout(None):
        exec(compile(program(EXAMPLES / f"{name}.md"), f"{name}.md", "exec"), found)
    return found["step"]


def stamp():
    """The stamp of the demo, deeper and in a smaller block."""
    mesh = root_mesh_from_shapes({"block": block((0, 0, -3), (3, 3, 0), (3, 3, 3))})
    return solve(replace(of_demo("rigid_stamp")["rigid_stamp"](0.15, 0.5), mesh=mesh), 0.05)


#: Scenes of the gallery: what gives the step, and by what displacements are drawn larger.
SCENES = {
    "hertz": (lambda: solve(hertz(coarse=2, order=6), 0.05), 5),
    "spheres": (lambda: solve(spheres((1.0, -2.0)), 0.05), 5),
    "punch": (lambda: solve(punch(), 0.1), 5),
    "cylinders": (lambda: solve(cylinders(length=0.5), 0.1), 5),
    "indentation": (lambda: solve(indentation(), 0.1), 5),
    "stack": (lambda: solve(stack((Material(1.0, 0.3), Material(5.0, 0.3), Material(1.0, 0.0))), 0.1), 10),
    "shrink_fit": (lambda: solve(shrink_fit(), 0.05), 5),
    "patch": (lambda: solve(patch(), 0.1), 10),
    "own_gmsh_model": (partial(demo, "own_gmsh_model"), 20),
    "step_part": (partial(demo, "step_part"), 20),
    "crossed_cylinders": (partial(demo, "crossed_cylinders"), 5),
    "shaft_in_bore": (partial(demo, "shaft_in_bore"), 20),
    "roller_on_block": (partial(demo, "roller_on_block"), 1),
    "rigid_stamp": (stamp, 1),
    "coated_half_space": (partial(example, "coated_half_space"), 20),
    "bimetal_strip": (partial(example, "bimetal_strip"), 50),
    "bolted_flange": (partial(example, "bolted_flange"), 20),
    "press_fit": (partial(example, "press_fit"), 1),
    "sandwich_beam": (partial(example, "sandwich_beam"), 20),
    "rubber_seal": (partial(example, "rubber_seal"), 5),
    "gasketed_joint": (partial(example, "gasketed_joint"), 20),
}
#: Magnification where the contact is small beside the bodies.
ZOOM = {"crossed_cylinders": 3, "shaft_in_bore": 2.5, "coated_half_space": 18}
#: Top of the colour scale where the contact is a small part of the surface, or the stress singular.
TOP = {"coated_half_space": 1200, "rubber_seal": 0.3}


def contact(folder, quick):
    """Contact pressure on two half-spheres that are pulled apart again."""
    scene = hertz(displacement=0.05, symmetry="quarter" if quick else "full", coarse=2, order=6)
    step = solve(scene, 0.3 if quick else 0.02)
    with plotter_for(folder / "contact.png", 1060, 600) as plotter:
        draw_bodies(step, cut=True, apart=0.13, zoom=4.3, plotter=plotter)


def gallery(name, folder, _quick):
    """Von Mises stress on the deformed bodies of a scene."""
    step, factor = SCENES[name][0](), SCENES[name][1]
    apart, zoom = 0.1 * (name in ("stack", "patch")), ZOOM.get(name, 1)
    with plotter_for(folder / f"scene_{name}.png", 640, 480) as plotter:
        draw_bodies(step, None, "stress", factor=factor, apart=apart, zoom=zoom, top=TOP.get(name), plotter=plotter)


def loop(folder, quick):
    """Four steps of the adaptive loop, all with the same scales: side by side, and as a moving picture."""
    frames = []
    for step in adapt(hertz(displacement=0.05, coarse=2, order=6), 0.3 if quick else 0.01):
        with plotter_for(folder / "loop.png", 340, 420) as plotter:
            draw_bodies(step, field="stress", top=0.07, plotter=plotter)  # about the largest [Pa]
            told = f"{step.record.dofs:,} unknowns, error {step.record.estimate:.1%}"
            plotter.add_text(told, position=(100, 8), color="black", font_size=8)
        frames.append(Image.open(folder / "loop.png").convert("RGB"))
    strip = Image.new("RGB", (340 * len(frames), 420))
    for place, one in enumerate(frames):
        strip.paste(one, (340 * place, 0))
    strip.save(folder / "loop.png", optimize=True)
    first, *others = (one.quantize(256, Image.Quantize.MAXCOVERAGE) for one in frames)
    first.save(folder / "loop.gif", save_all=True, append_images=others, duration=1500, loop=0)


def fretting(folder, _quick):
    """The bodies of the page of examples, and stick and slip on the ball, side by side."""
    step, strip = example("fretting"), Image.new("RGB", (1280, 480))
    for place, draw in (
        (0, partial(draw_bodies, step, None, "stress", factor=5, zoom=1.2, top=4000)),
        (640, partial(draw_contact, step, None, "status", zoom=1.3)),
    ):
        with plotter_for(folder / "scene_fretting.png", 640, 480) as plotter:
            draw(plotter=plotter)
        strip.paste(Image.open(folder / "scene_fretting.png"), (place, 0))
    strip.save(folder / "scene_fretting.png", optimize=True)


def pressure(folder, quick):
    """Contact pressure of half-spheres over the radius, against the axisymmetric computation."""
    step = solve(hertz(coarse=2, order=6), 0.3 if quick else 0.01)
    draw_pressure(step, folder / "pressure.png", hertz_a())


def geometry(folder, quick):
    """Half-spheres of straight and of curved root cells at the same estimated error, on the same scales."""
    figure, known = Figure(figsize=(9, 7), layout="constrained"), hertz_a()
    coarse = 2 if quick else 4
    panels = figure.subplots(2, 2, sharey="row", height_ratios=(1.2, 1))
    for order, name, (upper, lower) in zip((1, 3), ("straight cells", "order 3"), panels.T):
        step = solve(hertz(order=order, coarse=coarse), 0.6 if quick else 0.08, degree=1)
        with plotter_for(folder / "geometry.png", 600, 420) as plotter:
            draw_mesh(step, zoom=0.25 / contact_size(step), colour="level", plotter=plotter)
        true = true_error(step, 0.9 if quick else 0.04, hertz(order=6, coarse=coarse)).relative
        force = step.record.force / known.force - 1
        upper.imshow(imread(folder / "geometry.png"))
        told = f"{name}, {step.record.dofs:,} unknowns, estimated error {step.record.estimate:.0%}\n"
        upper.set_title(f"{told}true errors: energy {true:.0%}, force {force:+.1%}", fontsize=10)
        upper.axis("off")
        draw_pressure(step, ax=lower)
        r = np.linspace(0, 0.12, 300)
        lower.plot(r, known.pressure(r), color="#D55E00", label=known.name)
        lower.set(xlim=(0, 0.12), title="")
        lower.legend(frameon=False)
    figure.savefig(folder / "geometry.png", dpi=100)


def main():
    """Parse and draw."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    others = {draw.__name__: draw for draw in (contact, loop, fretting, pressure, geometry)}
    names = [*others, *SCENES]
    options.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME", help=", ".join(names))
    options.add_argument("--quick", action="store_true", help="coarse: do they still come out?")
    options.add_argument("--output", type=Path, default=Path("results/pictures"), help="folder (%(default)s)")
    arguments = options.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.only:
        draw = others.get(name) or partial(gallery, name)
        draw(arguments.output, arguments.quick)
        print(f"{name}: done", flush=True)


if __name__ == "__main__":
    main()
