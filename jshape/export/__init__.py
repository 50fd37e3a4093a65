"""Exports: shapers as files, and as programs for machines without Python.

::

    js.export(shaper, "json", "shaper.json")
    js.export(shaper, "c99", "shaper.h", sample_time=0.001, arithmetic="q15")
    js.read_shaper("shaper.json")

``js.export`` is this package: called, it is ``formats.export``, whether or not a submodule was imported before.

- ``formats``: ``js.export``: the table of all formats.
- ``shaper_file``: JSON, CSV and npz, and ``js.read_shaper``, which reads them back.
- ``c99``: a C header.
- ``structured_text``: a function block of IEC 61131-3.
- ``on_off``: a switching table of an on-off shaper.
- ``firmware``: lines for printers: Klipper, Kalico, Marlin, RepRapFirmware.
- ``matlab``: a script for MATLAB and Octave.
- ``ros2``: parameters of a filter of ros2_control.
- ``fmu``: functional mock-up units.
- ``plant``: ``js.export_plant``: a plant as such a unit.
- ``equations``: a function of JAX, written out in C, for ``plant``.
- ``compiler``: this machine's C compiler, for the libraries of ``fmu``.
- ``text``: what all generated texts share: templates, checked names, numbers.
"""

import sys
import types

from jshape.export.formats import FORMATS, Format, as_bytes, export
from jshape.export.shaper_file import read_shaper, read_tuned

__all__ = ["FORMATS", "Format", "as_bytes", "export", "read_shaper", "read_tuned"]


class _Callable(types.ModuleType):
    __call__ = staticmethod(export)


sys.modules[__name__].__class__ = _Callable
