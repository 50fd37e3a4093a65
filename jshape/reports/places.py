"""Positions of a machine's parts while it moves, for films and for the studio's drawing."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jshape.plants import AbstractPlant, SloshingTank
    from jshape.simulation.response import Response


@dataclasses.dataclass(frozen=True)
class Motion:
    """Positions of a machine's parts in every frame.

    Attributes:
        kind: ``"crane"``, ``"tank"``, ``"link"`` or ``"masses"``, and ``"above"`` for a view from above.
        places: of each part from the driven one, or from the axis of slewing, to the payload: positions (x, y), m; of a
            tank's walls, from the top of the one behind to the top of the one in front, then of its liquid's surface
            and back; the angles, rad, of a link's motor and tip; shape (frames, parts, 2) or (frames, 2).
        deflection: of the flexible part along each axis, m or rad; shape (frames, axes).
    """

    kind: str
    places: np.ndarray
    deflection: np.ndarray


def motion_of(plant: "AbstractPlant", run: "Response", times: np.ndarray) -> Motion:
    """Positions of a machine's parts at some instants of a response.

    Args:
        plant: of the response.
        run: the response.
        times: s, shape (frames,); between its samples the response is taken as linear.

    Raises:
        ValueError: for a machine of several axes from an MJCF or URDF file.
    """
    # Here, since figures of numbers are drawn without JAX.
    from jshape import plants
    from jshape.plants.multibody import Multibody

    if plant.axes and isinstance(plant, Multibody):
        raise ValueError(f"model must be given for a machine of the axes {', '.join(plant.axes)} from a file")
    payload, bent = sampled(run, run.payload, times), sampled(run, run.deflection, times)
    states = sampled(run, run.states, times)
    if plant.axes:
        return _of_axes(plant, payload, bent)
    ahead = payload[:, 0]
    base = ahead - bent[:, 0]
    if plant.unit == "rad":
        joint = isinstance(plant, plants.FlexibleJoint | plants.FlexibleLink)
        motor = states[:, 0] if joint else base
        return Motion("link", np.stack([motor, ahead], axis=-1), (ahead - motor)[:, None])
    if not isinstance(plant, plants.AbstractCrane):
        return Motion("masses", _parts((base, 0 * base), (ahead, 0 * base)), bent)
    first = 1 if plant.drive == "force" else 0
    angles = states[:, first : first + plant.angles]
    if isinstance(plant, plants.SloshingTank):
        return Motion("tank", _tank_places(plant, ahead, angles), bent)
    if isinstance(plant, plants.DoublePendulumCrane):
        upper, lower = float(plant.hook_length), float(plant.payload_length)
        hook = base + upper * np.sin(angles[:, 0]), -upper * np.cos(angles[:, 0])
        low = hook[1] - lower * np.cos(angles[:, 1])
        return Motion("crane", _parts((base, 0 * base), hook, (ahead, low)), bent)
    rod = plant.bob_position if isinstance(plant, plants.BobRodPendulum) else getattr(plant, "cable_length", 1.0)
    low = -float(rod) * np.prod(np.cos(angles), axis=1)
    return Motion("crane", _parts((base, 0 * base), (ahead, low)), bent)


def bent_along(plant: "AbstractPlant", run: Any, axis: int = 0) -> tuple[np.ndarray, str, str]:
    """Deflection of a machine's flexible part along one axis, as it is drawn.

    Args:
        plant: of the response.
        run: the response.
        axis: index of the axis.

    Returns:
        The values, shape (samples,), their unit, ``"°"`` or ``"mm"``, and the word for them. Of a crane that slews the
        angles of its cable: sideways along its first axis, outwards along the second.
    """
    from jshape.plants.slewing import AbstractSlewingCrane

    if isinstance(plant, AbstractSlewingCrane) and axis < 2:
        return np.degrees(np.asarray(run.states)[:, 1 - axis]), "°", ("sway sideways", "sway outwards")[axis]
    values = np.asarray(run.deflection, float)
    values = values.reshape(len(values), -1)[:, axis]
    if plant.axis_unit(axis) == "rad":
        return np.degrees(values), "°", bent_word(plant, axis)
    return 1e3 * values, "mm", bent_word(plant, axis)


def bent_word(plant: "AbstractPlant", axis: int = 0) -> str:
    """The word for how much the flexible part of a machine is bent along an axis: what hangs sways, except upwards."""
    from jshape import plants
    from jshape.plants.slewing import AbstractSlewingCrane

    if isinstance(plant, plants.SloshingTank):
        return "wave at the wall"
    crane = isinstance(plant, plants.AbstractCrane | AbstractSlewingCrane)
    return "sway" if crane and plant.axes[axis : axis + 1] != ("hoist",) else "deflection"


def sampled(run: "Response", values: Any, times: np.ndarray) -> np.ndarray:
    """Values (samples, …) of a response at some instants, shape (frames, values)."""
    at = np.asarray(run.times, float)
    rows = np.asarray(values, float).reshape(len(at), -1).T
    return np.stack([np.interp(times, at, row) for row in rows], axis=-1)


def _parts(*parts: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Parts in the order in which they hang on each other, shape (frames, parts, 2)."""
    return np.stack([np.stack(part, axis=-1) for part in parts], axis=1)


def _of_axes(plant: "AbstractPlant", payload: np.ndarray, bent: np.ndarray) -> Motion:
    """Of a machine of several axes: from above, or from the side where one of two axes is a hoist."""
    from jshape import plants

    (first, second, *_), (x, y, *_) = payload.T, (payload - bent).T
    zero = 0 * x
    if isinstance(plant, plants.HoistingCrane):
        low = -(float(plant.cable_length) + second)
        return Motion("crane", _parts((x, zero), (first, low)), bent)
    if isinstance(plant, plants.TwoLinkArm):
        upper, fore = float(plant.upper_length), float(plant.fore_length)
        elbow = upper * np.cos(first), upper * np.sin(first)
        along = first + second + float(plant.elbow_angle)
        tip = elbow[0] + fore * np.cos(along), elbow[1] + fore * np.sin(along)
        return Motion("above", _parts((zero, zero), elbow, tip), bent)
    if "slew" in plant.axes:
        held, load = (y * np.cos(x), y * np.sin(x)), (second * np.cos(first), second * np.sin(first))
        return Motion("above", _parts((zero, zero), held, load), bent)
    return Motion("above", _parts((x, y), (first, second)), bent)


def _tank_places(plant: "SloshingTank", centre: np.ndarray, angles: Any) -> np.ndarray:
    import jax

    half, depth = float(plant.length) / 2, float(plant.depth)
    along = np.linspace(half, -half, 25)
    height = np.asarray(jax.vmap(lambda one: plant.surface(one, along))(angles))
    base = centre - np.asarray(jax.vmap(plant.centre)(angles))
    top = max(0.4 * depth, 1.1 * float(np.max(np.abs(height))))
    walls = np.array([[-half, top], [-half, -depth], [half, -depth], [half, top]])
    surface = np.stack([np.broadcast_to(along, height.shape), height], axis=-1)
    places = np.concatenate([np.broadcast_to(walls, (len(base), 4, 2)), surface], axis=1)
    return places + np.stack([base, 0 * base], axis=-1)[:, None]
