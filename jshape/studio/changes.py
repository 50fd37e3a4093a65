"""What changes a page's state: each function makes another one, and none changes the state that it is given."""

import dataclasses
from typing import Any

from jshape._types import ArrayLike
from jshape.studio.own_code import entry
from jshape.studio.state import MOST_PINS, PLANTS, Pin, State, axes, parameters


def with_value(state: State, path: str, value: float) -> State:
    """The state with another value of a parameter, in its unit.

    Raises:
        ValueError: for an unknown path.
    """
    known = {parameter.path: parameter for parameter in parameters(state)}
    if path not in known:
        raise ValueError(f"path must be one of {', '.join(known)}, not {path!r}")
    unit, starter = known[path].unit, state.starter
    # A number with its unit reads best, where a problem file takes that one.
    written = value if not unit or "^p" in unit else f"{value!r} {unit}"
    table, _, rest = path.partition(".")
    if table == "plant":
        keys = entry(starter).keys.values()
        lists = {key.name: list(key.default) for key in keys if isinstance(key.default, list | tuple)}
        return _with(state, values=_placed(lists | starter.values, rest.split("."), written))
    return _with(state, move=_placed(starter.move, rest.split(".") if rest else [table], written if rest else value))


def _placed(values: Any, keys: list[str], value: Any) -> Any:
    """Nested tables and lists with one value changed."""
    first, *rest = keys
    if isinstance(values, list | tuple):
        changed = list(values)
        changed[int(first)] = _placed(changed[int(first)], rest, value) if rest else value
        return changed
    return {**values, first: _placed(values[first], rest, value) if rest else value}


def with_uncertainty(state: State, leaf: str, share: float | None) -> State:
    """The state with a leaf that is uncertain by ± a share of its nominal value, before all others, or certain.

    Args:
        state: before.
        leaf: of the plant.
        share: a fraction in (0, 1); ``None`` for a leaf that is known.

    Raises:
        ValueError: for a share outside (0, 1).
    """
    if share is not None and not 0 < share < 1:
        raise ValueError(f"share must lie between 0 and 1, not {share!r}")
    rest = {name: spread for name, spread in state.starter.uncertain.items() if name != leaf}
    if share is not None:
        # The first one is that over which the sensitivity is drawn.
        rest = {leaf: {"low": round(1 - share, 6), "high": round(1 + share, 6), "count": PLANTS}} | rest
    return _with(state, uncertain=rest, design=_for(state.starter.design, rest))


def _for(design: dict[str, Any], uncertain: dict[str, Any]) -> dict[str, Any]:
    """A design without an objective that needs an uncertain set, where there is none (and the other way round)."""
    fits = (design.get("objective", "worst") == "nominal") == (not uncertain)
    return design if fits else {key: value for key, value in design.items() if key != "objective"}


def with_design(state: State, **changes: Any) -> State:
    """The state with other numbers in its design; ``None`` takes one out."""
    design = {key: value for key, value in (state.starter.design | changes).items() if value is not None}
    return _with(state, design=design)


def _with(state: State, **changes: Any) -> State:
    return dataclasses.replace(state, starter=state.starter._replace(**changes))


def with_impulses(state: State, amplitudes: Any, times: Any) -> State:
    """The state with another shaper.

    Args:
        state: before.
        amplitudes: of the impulses.
        times: of the impulses, s.
    """
    return dataclasses.replace(state, amplitudes=tuple(map(float, amplitudes)), times=tuple(map(float, times)))


def with_axis(state: State, axis: str) -> State:
    """The state that shows another axis.

    Raises:
        ValueError: for an axis that the machine does not have.
    """
    if axis not in axes(state):
        raise ValueError(f"axis must be one of {', '.join(axes(state)) or 'none'}, not {axis!r}")
    if axis == state.axis or not state.own:
        return dataclasses.replace(state, axis=axis)
    (chosen,) = [each for each in state.own if each.name == axis]
    rest = [each for each in state.own if each.name != axis]
    own = (*rest, Pin(state.axis, state.amplitudes, state.times))
    return with_impulses(dataclasses.replace(state, axis=axis, own=own), chosen.amplitudes, chosen.times)


def with_own(state: State, own: bool) -> State:
    """The state in which each axis has a shaper of its own, at first the one that all shared; or all share one."""
    if not axes(state):
        return state
    others = [axis for axis in axes(state) if axis != state.axis] if own else []
    shapers = tuple(Pin(axis, state.amplitudes, state.times) for axis in others)
    design = state.starter.design | {"shapers": "per axis" if own else "shared"}
    return _with(dataclasses.replace(state, own=shapers), design=design)


def with_one_for_all(state: State, amplitudes: ArrayLike, times: ArrayLike) -> State:
    """The state with another shaper, the same for all axes at first where each has its own."""
    made = with_impulses(state, amplitudes, times)
    return with_own(made, True) if state.own else made


def with_shapers(state: State, shapers: dict[str, tuple[list[float], list[float]]]) -> State:
    """The state with a shaper for each axis.

    Args:
        state: before.
        shapers: axis → amplitudes and times (s).
    """
    own = tuple(Pin(axis, tuple(a), tuple(t)) for axis, (a, t) in shapers.items() if axis != state.axis)
    return with_impulses(dataclasses.replace(state, own=own), *shapers[state.axis])


def with_amplitude(state: State, index: int, value: float) -> State:
    """The state with another amplitude of one impulse; the others keep their ratios and the sum stays 1."""
    rest = 1.0 - state.amplitudes[index]
    others = len(state.amplitudes) - 1
    if not others:
        return state
    shares = [amplitude / rest if abs(rest) > 1e-9 else 1 / others for amplitude in state.amplitudes]
    changed = [value if i == index else (1 - value) * share for i, share in enumerate(shares)]
    return with_impulses(state, changed, state.times)


def with_time(state: State, index: int, value: float) -> State:
    """The state with another time of one impulse, s, between those of its neighbours; the first stays at 0."""
    times = list(state.times)
    if index > 0:
        times[index] = min([max(value, times[index - 1]), *times[index + 1 : index + 2]])
    return with_impulses(state, state.amplitudes, times)


def with_pin(state: State) -> State:
    """The state with its shaper among the designs to compare.

    Raises:
        ValueError: for more than five, and for one that is there already.
    """
    if len(state.pins) == MOST_PINS:
        raise ValueError(f"at most {MOST_PINS} designs can be compared; remove one first")
    made = Pin("", state.amplitudes, state.times, state.axis, state.own)
    if any(dataclasses.replace(pin, name="") == made for pin in state.pins):
        raise ValueError("this design is pinned already")
    taken = {pin.name for pin in state.pins}
    letter = next(letter for letter in "ABCDE" if not any(name.startswith(letter) for name in taken))
    name = f"{letter}: {len(state.times)} impulses, {state.times[-1]:.3g} s"
    return dataclasses.replace(state, pins=(*state.pins, dataclasses.replace(made, name=name)))


def with_design_of(state: State, pin: Pin) -> State:
    """The state with the shapers of a design."""
    fitting = state if bool(pin.own) == bool(state.own) else with_own(state, bool(pin.own))
    return with_impulses(dataclasses.replace(fitting, axis=pin.axis, own=pin.own), pin.amplitudes, pin.times)


def with_pins(state: State, pins: tuple[Pin, ...]) -> State:
    """The state with other designs to compare."""
    return dataclasses.replace(state, pins=pins)


def without_pin(state: State, name: str) -> State:
    """The state with one design less to compare."""
    return dataclasses.replace(state, pins=tuple(pin for pin in state.pins if pin.name != name))


def with_one_more(state: State) -> State:
    """The state with another impulse after the last one, of amplitude 0."""
    after = state.times[-1] + (state.times[-1] - state.times[-2] if len(state.times) > 1 else 0.5)
    return with_impulses(state, (*state.amplitudes, 0.0), (*state.times, after))


def with_one_less(state: State) -> State:
    """The state without its last impulse, whose amplitude the others take over in their ratios; one always stays."""
    if len(state.times) == 1:
        return state
    certain = with_amplitude(state, len(state.times) - 1, 0.0)
    return with_impulses(state, certain.amplitudes[:-1], certain.times[:-1])
