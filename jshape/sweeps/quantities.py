"""What a sweep is asked for, by name: metrics, shapers and leaves of a plant, with their long names and units.

Nothing here loads xarray, half a second that those who only tune a shaper do without.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from jshape import _check
from jshape._described import described, in_words, printed
from jshape.plants import AbstractPlant
from jshape.shaper import Shaper, Shaping
from jshape.sweeps.evaluate import Metric

METRICS = {
    "residual_energy": ("residual energy", "J"),
    "residual_vibration": ("residual vibration over distance", "1"),
    "overshoot": ("overshoot over distance", "1"),
    "peak_deflection": ("peak deflection", "m"),
    "settling_time": ("settling time", "s"),
    "rise_time": ("rise time", "s"),
}
"""What can be swept by name, with its long name and unit."""


def named_shapers(shapers: Shaper | Mapping[str, Shaping], axes: tuple[str, ...] = ()) -> dict[str, Shaping]:
    """One shaper or several, by name.

    Args:
        shapers: one, or name → shaper.
        axes: of the plant, if it has several.

    Raises:
        ValueError: if there is none, one is no shaper, or the names are those of axes.
    """
    if isinstance(shapers, Mapping) and shapers and set(shapers) <= set(axes):
        raise ValueError(
            f"shapers: {', '.join(shapers)} are axes of the plant; a shaper for each axis needs a name, as in "
            "{'own': {axis: shaper}}"
        )
    names: dict[str, Shaping] = dict(shapers) if isinstance(shapers, Mapping) else {"shaper": shapers}
    if not names or any(not (s is None or isinstance(s, Shaper | Mapping)) for s in names.values()):
        raise ValueError(f"shapers must be one shaper or a mapping of names to shapers, not {shapers!r}")
    return names


def about_metric(name: str, plant: AbstractPlant) -> tuple[str, str]:
    """The long name and the unit of a metric, of one axis (``"overshoot.trolley"``) or of the whole plant."""
    kind, _, axis = name.partition(".")
    words, unit = METRICS.get(kind, (kind, "SI"))
    if kind == "residual_energy":
        unit = plant.energy_unit
    if kind == "peak_deflection" and (axis or not plant.axes):
        unit = plant.axis_unit(plant.axes.index(axis) if axis else 0)
    return (f"{words}, {axis}" if axis else words), unit


def as_metrics(
    metric: str | Metric | Sequence[str | Metric], axes: tuple[str, ...] = (), known: tuple[str, ...] = ()
) -> dict[str, str | Metric]:
    """The metrics by the names of their variables.

    Args:
        metric: one, or several.
        axes: of those that have a value for each axis.
        known: axes that may be named.

    Raises:
        ValueError: for no metric, an unknown name, or one given twice.
    """
    several = list(metric) if isinstance(metric, Sequence) and not isinstance(metric, str) else [metric]
    found: dict[str, str | Metric] = {}
    for one in several:
        if isinstance(one, str) and axes and one in METRICS and one != "residual_energy":
            found |= {f"{one}.{axis}": f"{one}.{axis}" for axis in axes}
            continue
        if not callable(one):
            kind, _, axis = str(one).partition(".")
            _check.one_of(kind if axis in (known or axes) else one, "metric", tuple(METRICS))
        name = getattr(one, "__name__", "metric") if callable(one) else one
        if name in found:
            raise ValueError(f"metric must name each one once, not {name!r} twice")
        found[name] = one
    if not found:
        raise ValueError(f"metric must be at least one of {', '.join(METRICS)}, or a function, not {metric!r}")
    return found


def leaf_label(plant: AbstractPlant, name: str) -> tuple[str, str]:
    """A plant's leaf in words, and its unit, ``"SI"`` where it is not known: what its class's docstring says of it."""
    *parts, field = [part for part in name.split(".") if not part.isdigit()]
    owner: Any = plant
    for part in parts:
        owner = getattr(owner, part, None)
    meanings = [described(kind.__doc__).get(field) for kind in type(owner).__mro__]
    meaning = next((each for each in meanings if each), None)
    if meaning is None:
        return name, "SI"
    unit = printed(meaning) or ("1" if field in ("zeta", "gains") else "SI")
    # What bends between angles has the units of a torsion spring.
    turns = plant.unit == "rad" and bool(parts)
    return in_words(field, meaning, name.rpartition(".")[2]), "SI" if turns else unit
