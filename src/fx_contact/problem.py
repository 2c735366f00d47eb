"""Former package of scenes and meshes, whose public names are those of `fx_contact`; removed in the next version."""

import fx_contact
from fx_contact.parallel.former import former_names

__getattr__ = former_names(__name__, {name: f"fx_contact.{name}" for name in fx_contact.__all__})
