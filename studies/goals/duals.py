"""When the error of a contact force is known without its dual solution z, and how large xi(z) / omega(z) is then.

    python3 -m studies.goals.duals    # a minute

Each step of each scene that meets the tolerance: the part of the energy that is not the work of contact, the least over
the largest movement of the surfaces by strains, xi(u) / omega(u), xi(z) / omega(z), and the error of the force relative
to it by the dual solution.  It leaves duals.csv in results/goals.
"""

import argparse
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np

from fx_contact import adapt, scenes
from fx_contact.estimate import contact_goals
from fx_contact.estimate.dual_weighted import Goals
from studies.stability.shapes import beam, bump, films, on_a_base, sinking, waves
from studies.tables import plain, write

#: Scenes of contact alone, and those where other loads do work.
SCENES = {
    "hertz": partial(scenes.hertz, order=6, coarse=2),
    "punch": scenes.punch,
    "punch by force": partial(scenes.punch, force=1e-3),
    "bump, little pressed": partial(bump, 4, 0.2, 1e-3),
    "spheres": scenes.spheres,
    "cylinders": scenes.cylinders,
    "indentation": scenes.indentation,
    "waves": partial(waves, 0.25),
    "stack": scenes.stack,
    "shrink fit": scenes.shrink_fit,
    "beam": partial(beam, 0.5),
    "block that sinks": partial(sinking, 5e-3),
    "films under pressure": partial(films, pressure=1e-2),
    "plate beside a pressure": partial(on_a_base, pressure=1e-2),
}
TOLERANCES = (0.3, 0.1, 0.05)


def measured(name, tolerance):
    """Rows of a scene."""
    found, force = [], Goals.force

    def watched(goals, index):
        """The goal, looked at."""
        goal, state = force(goals, index), goals._state
        elsewhere, alike = contact_goals.likeness(state)
        found.append(
            {
                "scene": name,
                "tolerance": tolerance,
                "cells": state.estimate.cells,
                "closed": goals._comm.allreduce(int(state.solution.active.sum())),
                "elsewhere": elsewhere,
                "alike": alike,
                "of_u": state.estimate.relative,
                "of_z": goal.dual.relative,
                "error": goal.total / goal.value,
            }
        )
        return goal

    with mock.patch.object(contact_goals, "_bound", lambda *_: np.inf), mock.patch.object(Goals, "force", watched):
        for step in adapt(SCENES[name](), tolerance):
            if step.record.dofs > 40_000:
                break
    return found


def main():
    """All scenes; print the table and keep it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=SCENES, nargs="+", default=list(SCENES), help="scenes (all)")
    names = parser.parse_args().only
    rows = [row for name in names for tolerance in TOLERANCES for row in measured(name, tolerance)]
    write(Path("results/goals/duals.csv"), rows)
    print(plain(rows))


if __name__ == "__main__":
    main()
