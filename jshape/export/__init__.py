"""What machines take away: shapers as files."""

from jshape.export.shaper_file import read_shaper, write_csv, write_json

__all__ = ["read_shaper", "write_csv", "write_json"]
