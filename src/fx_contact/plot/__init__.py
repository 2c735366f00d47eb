"""Pictures of a step or a run, as PNG files.  Plotting libraries are imported when a picture is drawn.

Functions that draw are collective.  Rank 0 draws into the PNG of a path, or on its axes `ax` or plotter `plotter`;
all ranks return the path, or the given object.  OutputError: the picture cannot be written.
"""

from fx_contact.plot.bodies import draw_bodies, draw_mesh
from fx_contact.plot.canvas import plotter_for
from fx_contact.plot.contact_map import draw_contact
from fx_contact.plot.curves import draw_convergence, draw_pressure, draw_sweep
from fx_contact.plot.cut import draw_stress

__all__ = [
    "draw_bodies",
    "draw_contact",
    "draw_convergence",
    "draw_mesh",
    "draw_pressure",
    "draw_stress",
    "draw_sweep",
    "plotter_for",
]
