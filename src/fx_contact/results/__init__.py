"""Results: records and fields on disk, contact surfaces, comparison with known and with finer solutions."""

from fx_contact.results.accuracy import field_error, true_error
from fx_contact.results.contact_surface import contact_grid
from fx_contact.results.output import RecordWriter, write_fields

__all__ = ["RecordWriter", "contact_grid", "field_error", "true_error", "write_fields"]
