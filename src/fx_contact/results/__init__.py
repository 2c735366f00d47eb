"""Results: records and fields on disk, contact surfaces, comparison with known and with finer solutions."""

import warnings
from typing import Any

from fx_contact.adaptive.step_record import undirected
from fx_contact.adaptive.step_report import table_head, table_row
from fx_contact.results.accuracy import contact_errors, field_error, true_error
from fx_contact.results.analytic import Hertz, HertzEllipse, HertzLine, Persson, ShrinkFit
from fx_contact.results.contact_surface import contact_functions
from fx_contact.results.output import RecordWriter, write_fields
from fx_contact.results.reference_values import REFERENCES, ContactReference
from fx_contact.results.report import force_warnings, model_warnings, total_seconds

__all__ = [
    "REFERENCES",
    "ContactReference",
    "Hertz",
    "HertzEllipse",
    "HertzLine",
    "Persson",
    "RecordWriter",
    "ShrinkFit",
    "contact_errors",
    "contact_functions",
    "field_error",
    "force_warnings",
    "model_warnings",
    "table_head",
    "table_row",
    "total_seconds",
    "true_error",
    "undirected",
    "write_fields",
]


def __getattr__(name: str) -> Any:
    """The former name `doubt_lines`, with a warning."""
    if name != "doubt_lines":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn("doubt_lines is now model_warnings", DeprecationWarning, stacklevel=2)
    return model_warnings
