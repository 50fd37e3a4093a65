"""Exports: shapers as files, and as programs for machines without Python.

::

    js.export(shaper, "json", "shaper.json")
    js.export(shaper, "c99", "shaper.h", sample_time=0.001, arithmetic="q15")
    js.read_shaper("shaper.json")

``js.export`` is this package: called, it is ``formats.export``, whether or not a submodule was imported before.
"""

import sys
import types

from jshape.export.formats import FORMATS, Format, as_bytes, export
from jshape.export.shaper_file import read_shaper, read_tuned

__all__ = ["FORMATS", "Format", "as_bytes", "export", "read_shaper", "read_tuned"]


class _Callable(types.ModuleType):
    __call__ = staticmethod(export)


sys.modules[__name__].__class__ = _Callable
