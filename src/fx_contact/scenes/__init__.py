"""Ready scenes, each a file that may be read as an example, and their twins in other units or directions."""

from fx_contact.scenes.cylinders import cylinders
from fx_contact.scenes.hertz import hertz
from fx_contact.scenes.indentation import indentation
from fx_contact.scenes.punch import punch
from fx_contact.scenes.shrink_fit import shrink_fit
from fx_contact.scenes.spheres import spheres
from fx_contact.scenes.stack import patch, stack
from fx_contact.scenes.twins import scaled, swapped, turned

__all__ = [
    "cylinders",
    "hertz",
    "indentation",
    "patch",
    "punch",
    "scaled",
    "shrink_fit",
    "spheres",
    "stack",
    "swapped",
    "turned",
]
