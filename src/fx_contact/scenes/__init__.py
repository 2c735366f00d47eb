"""Ready scenes."""

from fx_contact.scenes.hertz import hertz
from fx_contact.scenes.indentation import indentation

__all__ = ["hertz", "indentation"]
