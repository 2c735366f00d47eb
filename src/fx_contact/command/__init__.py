"""The command `fx-contact`, also `python3 -m fx_contact`: programs, versions.  It alone prints."""
