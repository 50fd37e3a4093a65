"""What vibrates: plants, their springs and dampers. Start with ``TwoMass``; write your own from ``AbstractPlant``."""

from jshape.plants.base import AbstractPlant
from jshape.plants.dampers import AbstractDamper, ForceDamper, LinearDamper, PowerDamper
from jshape.plants.forced import ForcedMass
from jshape.plants.modal import ModalPlant
from jshape.plants.oscillator import AbstractOscillator
from jshape.plants.springs import (
    AbstractSpring,
    Duffing,
    ForceSpring,
    LinearSpring,
    PotentialSpring,
    PowerLawSpring,
    SaturatingSpring,
)
from jshape.plants.two_mass import TwoMass

__all__ = [
    "AbstractDamper",
    "AbstractOscillator",
    "AbstractPlant",
    "AbstractSpring",
    "Duffing",
    "ForceDamper",
    "ForceSpring",
    "ForcedMass",
    "LinearDamper",
    "LinearSpring",
    "ModalPlant",
    "PotentialSpring",
    "PowerDamper",
    "PowerLawSpring",
    "SaturatingSpring",
    "TwoMass",
]
