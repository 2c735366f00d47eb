"""Ready scenes, and their twins in other units or directions."""

from fx_contact.scenes.hertz import hertz
from fx_contact.scenes.indentation import indentation
from fx_contact.scenes.punch import punch
from fx_contact.scenes.stack import stack
from fx_contact.scenes.twins import scaled, swapped, turned

__all__ = ["hertz", "indentation", "punch", "scaled", "stack", "swapped", "turned"]
