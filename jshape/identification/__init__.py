"""Identification: modes from measured data; a record in, a plant out, with its uncertainty."""

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
