"""What each part of a small scene costs.

The bare scene: two columns of straight cells that do not touch, solved once at degree 1. Each row adds one part. CPU
seconds of one core without compilation, the least of five runs.

    python3 -m studies.cost.parts

It leaves parts.csv in results/cost.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact import BodyForce, Dirichlet, Material, Traction, adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import CheckpointWriter
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.plot import draw_stress
from fx_contact.results.output import write_fields
from fx_contact.scene.fingerprint import scene_parts
from fx_contact.scenes import patch
from studies.tables import TABLES, write

REPEATS, CELLS = 5, (8, 8, 16)
IMPORT = "import dolfinx, time; t = time.process_time(); import fx_contact; print(time.process_time() - t)"


def scenes():
    """Name -> Scene: the bare one, then that with one part more each."""
    contact = patch(cells=CELLS)
    held = Dirichlet("on block 0", z=0.001), Dirichlet("under block 1", z=0.001)
    bare = replace(contact, contact=(), dirichlet=contact.dirichlet + held)
    curved = patch(cells=CELLS, order=3).mesh
    points = curved.points + 0.05 * np.sin(np.pi * curved.points[:, [2, 2, 0]]) * [0, 0, 1]
    bent = RootMesh(points, curved.cells, curved.bodies, curved.body, curved.surfaces)
    soft = dict.fromkeys(bare.materials, Material(1.0, 0.45))
    weight = BodyForce("block 0", (0, 0, -1e-3))
    shear = Traction("top", lambda x: 1e-3 * x * [[1], [1], [0]])
    pressed = tuple(replace(c, z=lambda x: -0.01 - 0.01 * x[0]) if c.where == "top" else c for c in bare.dirichlet)
    return {
        "bare scene": bare,
        "contact": contact,
        "curved cells, order 3": replace(bare, mesh=bent, dirichlet=contact.dirichlet),
        "nu >= 0.4: one volume strain a cell": replace(bare, materials=soft),
        "a displacement that is a function": replace(bare, dirichlet=pressed),
        "a traction that is a function": replace(bare, tractions=(shear,)),
        "a body force": replace(bare, body_forces=(weight,)),
    }


def first_step(scene, **options):
    """The first step of a run, and its CPU seconds without compilation."""
    start = time.process_time()
    step = next(iter(adapt(scene, 0.04, degree=1, max_steps=1, **options)))
    return step, time.process_time() - start - step.record.cpu_seconds["compile"]


def least(function):
    """The least CPU seconds of some calls."""
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        function()
        seconds.append(time.process_time() - start)
    return min(seconds)


def measured():
    """Rows of the table."""
    bare = None
    for name, scene in scenes().items():
        first_step(scene)  # compiles
        step, seconds = min((first_step(scene) for _ in range(REPEATS)), key=lambda run: run[1])
        bare = bare or seconds
        iterations = sum(step.record.krylov_iterations)
        more = {"dofs": step.record.dofs, "iterations": iterations, "more_s": seconds - bare}
        yield {"part": name, "cpu_s": seconds, **more}
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        writer = CheckpointWriter(folder, MPI.COMM_SELF, scene_parts(scene), {})
        single = {
            "making the scene: root mesh, pairing, checks": lambda: patch(cells=CELLS),
            "refinement of all leaves": lambda: Beginning.uniform(scene, 1, MPI.COMM_SELF),
            "a checkpoint": lambda: writer.save(step, [step.record]),
            "fields for ParaView": lambda: write_fields(step, folder),
            "a picture of the stress": lambda: draw_stress(step, folder / "stress.png"),
        }
        for name, function in single.items():
            function()  # imports and compiles
            yield {"part": name, "cpu_s": least(function)}
    seconds = min(float(subprocess.check_output([sys.executable, "-c", IMPORT])) for _ in range(REPEATS))
    yield {"part": "`import fx_contact` after `import dolfinx`", "cpu_s": seconds}


def main():
    """Measure; print the table and keep it."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rows = list(measured())
    write(Path("results/cost/parts.csv"), rows)
    print(TABLES["studies/cost/parts.csv"](rows))


if __name__ == "__main__":
    main()
