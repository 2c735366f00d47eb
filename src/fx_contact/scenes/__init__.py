"""Ready scenes; each file can be read as an example."""

from fx_contact.scenes.columns import patch, stack
from fx_contact.scenes.cube_indentation import indentation
from fx_contact.scenes.half_spheres import hertz
from fx_contact.scenes.shrunk_rings import shrink_fit
from fx_contact.scenes.spherical_punch import punch
from fx_contact.scenes.two_cylinders import cylinders
from fx_contact.scenes.two_spheres import spheres

__all__ = ["cylinders", "hertz", "indentation", "patch", "punch", "shrink_fit", "spheres", "stack"]
