"""What vibrates: plants and their parts. Start with ``TwoMass`` or ``Crane``; write your own from ``AbstractPlant``."""

from jshape.plants.base import AbstractPlant
from jshape.plants.bridge import BridgeCrane
from jshape.plants.controllers import AbstractController, PDController, PIController, ProportionalController
from jshape.plants.dampers import AbstractDamper, ForceDamper, LinearDamper, PowerDamper
from jshape.plants.double_pendulum import DoublePendulumCrane
from jshape.plants.flexible_joint import FlexibleJoint
from jshape.plants.flexible_link import FlexibleLink
from jshape.plants.forced import ForcedMass
from jshape.plants.forced_two_mass import ForcedTwoMass
from jshape.plants.hoisting import HoistingCrane
from jshape.plants.linearised import Linearised
from jshape.plants.links import AbstractLink, Beam, TabulatedLink
from jshape.plants.modal import ModalPlant
from jshape.plants.oscillator import AbstractOscillator
from jshape.plants.pendulum import BobRodPendulum, Crane
from jshape.plants.rigid_flexible import RigidFlexible
from jshape.plants.springs import (
    AbstractSpring,
    Duffing,
    ForceSpring,
    LinearSpring,
    PotentialSpring,
    PowerLawSpring,
    SaturatingSpring,
)
from jshape.plants.trolley import AbstractCrane, Trolley
from jshape.plants.two_mass import TwoMass

__all__ = [
    "AbstractController",
    "AbstractCrane",
    "AbstractDamper",
    "AbstractLink",
    "AbstractOscillator",
    "AbstractPlant",
    "AbstractSpring",
    "Beam",
    "BobRodPendulum",
    "BridgeCrane",
    "Crane",
    "DoublePendulumCrane",
    "Duffing",
    "FlexibleJoint",
    "FlexibleLink",
    "ForceDamper",
    "ForceSpring",
    "ForcedMass",
    "ForcedTwoMass",
    "HoistingCrane",
    "LinearDamper",
    "LinearSpring",
    "Linearised",
    "ModalPlant",
    "PDController",
    "PIController",
    "PotentialSpring",
    "PowerDamper",
    "PowerLawSpring",
    "ProportionalController",
    "RigidFlexible",
    "SaturatingSpring",
    "TabulatedLink",
    "Trolley",
    "TwoMass",
]


def __dir__() -> list[str]:
    return __all__
