"""What machines take away: shapers as files, and as programs for those who have no Python.

::

    s.export("json", "shaper.json")
    s.export("c99", "shaper.h", sample_time=0.001, arithmetic="q15")
    read_shaper("shaper.json")
"""

from jshape.export.formats import FORMATS, Format, as_bytes, export
from jshape.export.shaper_file import read_shaper, write_csv, write_json

__all__ = ["FORMATS", "Format", "as_bytes", "export", "read_shaper", "write_csv", "write_json"]
