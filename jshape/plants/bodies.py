"""Rigid bodies and joints: the numbers of a ``Multibody``, which sweeps and gradients reach by the file's names."""

from typing import Any

import equinox as eqx

from jshape._check import Argument, Checked, finite, not_negative, scalar
from jshape._types import Scalar
from jshape.plants._rigid_body import Inertia
from jshape.plants._vectors import ZERO, Entry, Vector, minus, plus, times

Entries = dict[str, Scalar]
"""Those entries of a vector, by ``x``, ``y`` and ``z``, that are leaves; the others are 0."""


def entries(*checks: Any) -> Argument:
    def convert(values: dict[str, Any], name: str) -> Entries:
        found = {axis: scalar(value, f"{name}.{axis}") for axis, value in values.items()}
        for axis, value in found.items():
            for check in checks:
                check(value, f"{name}.{axis}")
        return found

    return Argument(convert=convert)


class Body(Checked):
    """A rigid body. What is 0 in a vector is no leaf unless asked for, nor is what has no influence on the motion.

    Attributes:
        mass: kg; its moments of inertia do not change with it.
        position: of its frame in its parent's, m.
        center_of_mass: in its own frame, m.
        inertia: principal moments of inertia about its centre of mass, kg m².

    Raises:
        ValueError: for a mass or a moment of inertia that is negative, and what is not finite.
    """

    mass: Scalar | None = eqx.field(default=None, converter=Argument(not_negative, optional=True))
    position: Entries = eqx.field(default_factory=dict, converter=entries(finite))
    center_of_mass: Entries = eqx.field(default_factory=dict, converter=entries(finite))
    inertia: Entries = eqx.field(default_factory=dict, converter=entries(not_negative))

    def inertias(self) -> Inertia:
        """All of it, for the equation of motion."""
        mass = 0.0 if self.mass is None else self.mass
        return Inertia(mass, vector(self.center_of_mass), vector(self.inertia))


class Joint(Checked):
    """A joint; with y = q − springref its force is −stiffness y − cubic_stiffness y³ − damping q'.

    A joint that follows the command has an anchor alone. Units are those of a hinge; those of a slide have m for rad
    and N for N m.

    Attributes:
        stiffness: N m/rad.
        springref: coordinate at which the spring is relaxed, rad.
        damping: N m s/rad.
        armature: inertia that turns with the joint alone, a motor's, kg m².
        cubic_stiffness: N m/rad³.
        anchor: of a hinge, in its body's frame, m.

    Raises:
        ValueError: for damping or armature that is negative, and what is not finite.
    """

    stiffness: Scalar | None = eqx.field(default=None, converter=Argument(finite, optional=True))
    springref: Scalar | None = eqx.field(default=None, converter=Argument(finite, optional=True))
    damping: Scalar | None = eqx.field(default=None, converter=Argument(not_negative, optional=True))
    armature: Scalar | None = eqx.field(default=None, converter=Argument(not_negative, optional=True))
    cubic_stiffness: Scalar | None = eqx.field(default=None, converter=Argument(finite, optional=True))
    anchor: Entries = eqx.field(default_factory=dict, converter=entries(finite))

    def pull(self, coordinate: Entry) -> Entry:
        """The resisting force of the spring, N m or N."""
        stretch = minus(coordinate, given(self.springref))
        cubic = times(given(self.cubic_stiffness), times(stretch, times(stretch, stretch)))
        return plus(times(given(self.stiffness), stretch), cubic)

    def stored(self, rest: Entry, step: Entry) -> Entry:
        """The spring's energy at ``rest + step`` above that at ``rest``, J; without cancellation in a small step."""
        low = minus(rest, given(self.springref))
        high = plus(low, step)
        square = times(step, plus(low, high)) / 2
        cubic = times(given(self.cubic_stiffness), times(square, low * low + high * high)) / 2
        return plus(times(given(self.stiffness), square), cubic)


def given(value: Entry | None) -> Entry:
    return 0.0 if value is None else value


def vector(entries: dict[str, Entry]) -> Vector:
    if not entries:
        return ZERO
    return entries.get("x", 0.0), entries.get("y", 0.0), entries.get("z", 0.0)
