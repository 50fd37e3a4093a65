"""Identification: a record in, a plant out, with its uncertainty.

What users call:

- ``modes``: ``js.identify``: natural frequencies and damping ratios from a record.
- ``from_csv``: ``js.identify_csv``: the same from a CSV file.
- ``planar``: ``js.identify_planar``: modes of a machine that moves in a plane.
- ``duffing``: ``js.identify_duffing`` and ``js.identify_payloads``: a spring that hardens or softens.
- ``drive``: ``js.identify_drive``: mass and friction of an axis.

Records, as they come and checked:

- ``csv_file``: CSV files of any origin.
- ``csv_lines``: their lines, cells and headers.
- ``channel_units``: units of the channels, to SI.
- ``records``: the clock, gaps, channels without a signal; ``RecordError``.
- ``free_vibration``: the part of a record in which the machine vibrates freely.

Modes, by a fit that is linear but for frequencies and damping ratios:

- ``_search``: how many modes there are, and where.
- ``_projection``: the fit by variable projection.
- ``ring_down``: the model of a free vibration.
- ``sweep``: the model of a response to a recorded input.
- ``step``: the step in a recorded input, and the gains of modes after it.
- ``spectrum``: the models of frequency responses and of power spectra.

The law of a motion, fitted by simulation:

- ``_start``: where the fit begins.
- ``_motion``: the simulation and its fit.
- ``motion``: the result that these identifications share.

Results:

- ``_uncertainty``: uncertainty of fitted parameters, from the residuals.
- ``result``: ``js.Identified``: modes, their uncertainty, the plant.
- ``files``: the files that ``jshape identify`` writes.
"""

from jshape.identification.drive import IdentifiedDrive, identify_drive
from jshape.identification.duffing import IdentifiedDuffing, IdentifiedPayloads, identify_duffing, identify_payloads
from jshape.identification.from_csv import identify_csv
from jshape.identification.modes import identify
from jshape.identification.planar import IdentifiedPlane, identify_planar
from jshape.identification.result import Identified

__all__ = [
    "Identified",
    "IdentifiedDrive",
    "IdentifiedDuffing",
    "IdentifiedPayloads",
    "IdentifiedPlane",
    "identify",
    "identify_csv",
    "identify_drive",
    "identify_duffing",
    "identify_payloads",
    "identify_planar",
]
