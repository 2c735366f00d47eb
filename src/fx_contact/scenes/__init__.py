"""Ready scenes."""

from fx_contact.scenes.hertz import hertz
from fx_contact.scenes.indentation import indentation
from fx_contact.scenes.patch import patch, patch_pressure

__all__ = ["hertz", "indentation", "patch", "patch_pressure"]
