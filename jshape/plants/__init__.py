"""Plants and their parts. Start with ``TwoMass`` or ``Crane``; write your own from ``AbstractPlant``.

- ``base``: ``AbstractPlant``: what simulation, design and sweeps ask of a plant.
- ``linearised``: any plant linearised about rest, with its exact response.

A mass on a spring:

- ``oscillator``: ``AbstractOscillator``, the plant of the energy shapers.
- ``two_mass``: ``TwoMass``, driven by a displacement.
- ``forced``: ``ForcedMass``, driven by a force on the mass.
- ``forced_two_mass``: ``ForcedTwoMass``, two free masses, a force on the first.
- ``flexible_joint``: ``FlexibleJoint``, a robot joint that bends.
- ``sprung_pair``: what the last two share.
- ``springs``: ``Duffing`` and other springs.
- ``dampers``: dampers.
- ``controllers``: controllers of a motor.

Cranes:

- ``trolley``: ``AbstractCrane`` and ``Trolley``, which all but the slewing ones share.
- ``pendulum``: ``Crane`` and ``BobRodPendulum``, one angle.
- ``hoisting``: ``HoistingCrane``, whose cable is wound up.
- ``double_pendulum``: ``DoublePendulumCrane``, hook and payload.
- ``bridge``: ``BridgeCrane``, a trolley in a plane.
- ``slewing``: ``TowerCrane`` and ``BoomCrane``.
- ``sloshing``: ``SloshingTank``, whose modes are pendulums.

Modes and links:

- ``modes``: the base of plants made of independent modes.
- ``modal``: ``ModalPlant`` and ``PlanarModes``.
- ``rigid_flexible``: ``RigidFlexible``, a free body with modes.
- ``flexible_link``: ``FlexibleLink``, a link on a servo.
- ``links``: its modes as functions of the load at its tip.
- ``two_link``: ``TwoLinkArm``, a robot arm.

Machines from files:

- ``mujoco``: ``from_mjcf`` and ``from_urdf``.
- ``mujoco_model``: the file read, and what cannot be simulated refused.
- ``mujoco_contacts``: contacts refused.
- ``multibody``: ``Multibody``, the plant that comes of it.
- ``bodies``: its bodies and joints, with their numbers.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
