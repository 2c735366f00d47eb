"""What comes out: records and fields on disk, contact surfaces, comparison with known and finer solutions."""
