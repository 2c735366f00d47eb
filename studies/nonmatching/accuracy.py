"""Accuracy and cost on surfaces meshed apart, beside the same bodies meshed alike.

    python3 -m studies.nonmatching.accuracy    # ten minutes

It leaves accuracy.csv in results/nonmatching.  Exact pressures: Lame's hollow spheres; HERTZ-A (`results.hertz_a`).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from demos.hertz_reference import hertz_a
from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    Scene,
    Shape,
    Step,
    SymmetryPlane,
    adapt,
    ball,
    block,
    join,
    root_mesh_from_shapes,
)
from fx_contact.parallel.arrays import FloatArray
from fx_contact.results import true_error
from studies.tables import options, tabulate

PLANES = "x = 0", "y = 0", "z = 0"
#: Angle between the meshes of the half-spheres [degrees].
TURN = 20.0
_SAME = 1e-9

Errors = dict[str, float]


class Case(NamedTuple):
    """A scene by the cells of its two bodies, a tolerance, and relative errors of its last step.

    Attributes:
        finer: tolerance of the solution that gives the true energy error; None: not computed.
    """

    name: str
    scene: Callable[[int, int], Scene]
    cells: tuple[tuple[int, int], tuple[int, int]]
    tolerance: float
    errors: Callable[[Step], Errors]
    finer: float | None = None


def shell(inner: float, outer: float, around: int) -> Shape:
    """An octant of a hollow sphere: three blocks of around^2 cells."""
    piece = block((0, 0, 0), (1, 1, 1), (around, around, 1), 6)

    def place(x: FloatArray) -> FloatArray:
        ray = np.stack([np.tan(np.pi / 4 * x[0]), np.tan(np.pi / 4 * x[1]), np.ones_like(x[0])])
        return (inner + (outer - inner) * x[2]) * ray / np.linalg.norm(ray, axis=0)

    def part(turn: int) -> Shape:
        names = {"bottom": "inside", "top": "outside", "left": PLANES[turn], "front": PLANES[(turn + 1) % 3]}
        sides = {name: piece.sides[side] for side, name in names.items()}
        return replace(piece, sides=sides).placed(place).turned((1, 1, 1), 120 * turn)

    return join(*map(part, range(3)))


def spheres(inner: int, outer: int, clearance: float = 0.0) -> Scene:
    """Nested hollow spheres 20/30 and 30/40, E = 2000, with a pressure of 25 inside or with interference."""
    bodies = {"inner": shell(20, 30, inner), "outer": shell(30, 40, outer)}
    surfaces = {plane: [f"{body} {plane}" for body in bodies] for plane in PLANES}
    surfaces |= {f"{body} {side}": [f"{body} {side}"] for body in bodies for side in ("inside", "outside")}
    return Scene(
        name="spheres",
        mesh=root_mesh_from_shapes(bodies, surfaces),
        materials=dict.fromkeys(bodies, Material(2000.0, 0.3)),
        dirichlet=tuple(map(SymmetryPlane, PLANES)),
        contact=(ContactPair("inner outside", "outer inside", clearance=clearance),),
        tractions=() if clearance else (Pressure("inner inside", 25.0),),
    )


def half_spheres(upper: int, lower: int) -> Scene:
    """HERTZ-A, both bodies whole, the lower one turned about the axis if its mesh is another one."""
    known, turn = hertz_a(), TURN if upper != lower else 0.0
    cap = "cap", "outside"
    bodies = {
        "upper": ball(1.0, upper, 6, octants=4).named(*cap, where=_above).mirrored("z").shifted(z=1.0),
        "lower": ball(1.0, lower, 6, octants=4).named(*cap, where=_above).turned("z", turn).shifted(z=-1.0),
    }
    corner = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    axes = {f"{body} axis": (body, lambda x: np.hypot(x[0], x[1]) < _SAME) for body in bodies}
    arms = {
        "upper arm": ("upper", lambda x: np.hypot(x[0] - 1, x[1]) + abs(x[2] - 1) < _SAME),
        "lower arm": ("lower", lambda x: np.hypot(x[0] - corner[0], x[1] - corner[1]) + abs(x[2] + 1) < _SAME),
    }
    half = known.displacement / 2
    return Scene(
        name="half-spheres",
        mesh=root_mesh_from_shapes(bodies, curves=axes, vertices=arms),
        materials=dict.fromkeys(bodies, Material(known.young, known.poisson)),
        dirichlet=(
            *(Dirichlet(f"{body} z = 0", z=z) for body, z in (("upper", -half), ("lower", half))),
            *(Dirichlet(axis, x=0.0, y=0.0) for axis in axes),
            *(Dirichlet(arm, y=0.0) for arm in arms),
        ),
        contact=(ContactPair("upper cap", "lower cap", direction=(0.0, 0.0, -1.0)),),
        contact_centre=(0.0, 0.0, 0.0),
    )


def _above(x: FloatArray) -> FloatArray:
    """The cap of a ball around the z axis."""
    return np.asarray(np.maximum(abs(x[0]), abs(x[1])) <= x[2] + _SAME)


def of_pressure(exact: float) -> Callable[[Step], Errors]:
    """Errors of a uniform pressure: of its mean, and the largest at a node."""

    def errors(step: Step) -> Errors:
        comm, pressure, area = step.forest.comm, step.contact.pressure, step.rows.area
        total, whole = comm.allreduce(np.array([pressure @ area, area.sum()]))
        off = comm.allreduce(float(np.abs(pressure / exact - 1).max(initial=0.0)), op=MPI.MAX)
        return {"mean": total / whole / exact - 1, "largest": off}

    return errors


def of_hertz(step: Step) -> Errors:
    """Errors of the force and of the largest pressure."""
    known, record = hertz_a(), step.record
    return {"mean": record.force / known.force - 1, "largest": record.max_pressure / known.max_pressure - 1}


CASES = (
    Case("nested spheres, pressure inside", spheres, ((2, 2), (2, 3)), 0.02, of_pressure(4.894180), 0.01),
    Case(
        "the same, interference 0.01",
        partial(spheres, clearance=-0.01),
        ((2, 2), (2, 3)),
        0.02,
        of_pressure(0.2952),
        0.01,
    ),
    Case("half-spheres", half_spheres, ((4, 4), (4, 3)), 0.02, of_hertz, 0.01),
    Case("half-spheres", half_spheres, ((4, 4), (4, 3)), 0.01, of_hertz),
)


def rows(cases: Iterable[Case], comm: MPI.Intracomm) -> Iterator[dict[str, object]]:
    """A row for each case and pair of meshes.  Collective on comm."""
    for case in cases:
        for cells in case.cells:
            scene = case.scene(*cells)
            steps = list(adapt(scene, case.tolerance, comm))
            record = steps[-1].record
            yield {
                "scene": case.name,
                "cells": ":".join(map(str, cells)),
                "tolerance": case.tolerance,
                "steps": len(steps),
                "dofs": record.dofs,
                "iterations": record.krylov_iterations[-1],
                "estimate": record.estimate,
                "true_error": "" if case.finer is None else true_error(steps[-1], case.finer).relative,
                "cpu_s": sum(step.record.cpu_seconds["total"] - step.record.cpu_seconds["compile"] for step in steps),
                **case.errors(steps[-1]),
            }


def main() -> None:
    """All cases; print the table and keep it."""
    tabulate(rows(CASES, MPI.COMM_WORLD), options(__doc__, "nonmatching").parse_args().output / "accuracy.csv")


if __name__ == "__main__":
    main()
