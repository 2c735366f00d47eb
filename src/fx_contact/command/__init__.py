"""The command `fx-contact`, also `python3 -m fx_contact`: programs, demos, records, versions.  It alone prints."""
