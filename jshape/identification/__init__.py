"""Identification: modes from measured data; a record in, a plant out, with its uncertainty."""

from jshape.identification.duffing import IdentifiedDuffing, identify_duffing
from jshape.identification.from_csv import identify_csv
from jshape.identification.modes import identify
from jshape.identification.planar import IdentifiedPlane, identify_planar
from jshape.identification.result import Identified

__all__ = [
    "Identified",
    "IdentifiedDuffing",
    "IdentifiedPlane",
    "identify",
    "identify_csv",
    "identify_duffing",
    "identify_planar",
]
