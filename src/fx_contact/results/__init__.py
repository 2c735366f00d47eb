"""Results: records and fields on disk, contact surfaces, comparison with known and with finer solutions."""

from fx_contact.parallel.former import former_names
from fx_contact.results.accuracy import field_error, true_error
from fx_contact.results.contact_surface import contact_grid
from fx_contact.results.output import RecordWriter, write_fields

__all__ = ["RecordWriter", "contact_grid", "field_error", "true_error", "write_fields"]

__getattr__ = former_names(
    __name__,
    {name: f"fx_contact.adaptive.step_report.{name}" for name in ("table_head", "table_row")}
    | {name: f"fx_contact.results.report.{name}" for name in ("force_warnings", "model_warnings", "total_seconds")}
    | {
        name: f"fx_contact.results.analytic.{name}"
        for name in "Hertz HertzEllipse HertzLine Persson ShrinkFit".split()
    }
    | {name: f"fx_contact.results.reference_values.{name}" for name in ("REFERENCES", "ContactReference")}
    | {
        "contact_errors": "fx_contact.results.accuracy.contact_errors",
        "undirected": "fx_contact.adaptive.step_record.undirected",
        "contact_functions": "fx_contact.results.contact_surface.contact_grid",
        "doubt_lines": "fx_contact.results.report.model_warnings",
    },
)
