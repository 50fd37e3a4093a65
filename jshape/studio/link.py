"""A link that carries what a page shows: its problem file, impulses and designs to compare, as bounded data.

The query string's ``state`` is JSON, deflated, in the characters that an address takes. What comes in is believed in
nothing: it is read as an uploaded problem file is, and every number is checked.
"""

import base64
import binascii
import itertools
import json
import zlib
from typing import Any
from urllib.parse import parse_qs, urlsplit

from jshape.problems.limits import GREATEST
from jshape.studio import changes, state
from jshape.studio.state import MOST_PINS, Pin, State

LONGEST = 2**14
"""Characters of the query string's state; browsers and servers take an address of as many."""

LARGEST = 2**17
"""Bytes of it once it is inflated."""

IMPULSES = 64
"""Of a shaper."""


def packed(shown: State) -> str:
    """The state as a query string carries it.

    Args:
        shown: by the page.

    Raises:
        ValueError: for a state that is too large for an address.
    """
    if shown.files:
        raise ValueError("a link carries no file of a machine; save the problem file, which takes it along")
    pins = [_design(pin) for pin in shown.pins]
    data = {"problem": shown.text, "shown": _design(shown), "pins": pins}
    made = base64.urlsafe_b64encode(zlib.compress(json.dumps(data).encode(), 9)).decode().rstrip("=")
    if len(made) > LONGEST:
        raise ValueError(f"a link carries at most {LONGEST} characters, not {len(made)}; save the problem file instead")
    return made


def _design(shown: State | Pin) -> dict[str, Any]:
    own = {each.name: [each.amplitudes, each.times] for each in shown.own}
    return {"axis": shown.axis, "impulses": [shown.amplitudes, shown.times], "own": own}


def unpacked(text: str) -> State:
    """The state that a query string carries.

    Args:
        text: the value of ``state``.

    Raises:
        ValueError: for whatever is wrong with it.
    """
    data = _json(text)
    if not isinstance(data, dict) or set(data) != {"problem", "shown", "pins"}:
        raise ValueError("the link must carry problem, shown and pins")
    problem, given = data["problem"], data["pins"]
    if not isinstance(problem, str):
        raise ValueError("the link's problem must be the text of a problem file")
    if not isinstance(given, list) or len(given) > MOST_PINS:
        raise ValueError(f"the link must carry at most {MOST_PINS} designs to compare")
    made = _with(state.from_text(problem), data["shown"])
    for pin in given:
        # Their names are made anew.
        made = changes.with_pins(made, changes.with_pin(_with(made, pin)).pins)
    return made


def _with(before: State, given: Any) -> State:
    """The state with a design of the link."""
    if not isinstance(given, dict) or set(given) != {"axis", "impulses", "own"} or not isinstance(given["own"], dict):
        raise ValueError("a design of the link must have axis, impulses and own")
    axis, names = given["axis"], state.axes(before)
    if axis not in (names or [""]) or sorted([axis, *given["own"]]) not in ([axis], sorted(names)):
        raise ValueError(f"the link's axes must be those of the machine, {', '.join(names) or 'none'}, not {axis!r}")
    own = tuple(Pin(name, *_impulses(each)) for name, each in given["own"].items())
    return changes.with_design_of(before, Pin("", *_impulses(given["impulses"]), axis, own))


def from_address(address: str) -> State:
    """The state of a link, from the whole address.

    Raises:
        ValueError: for one without a state, and as ``unpacked``.
    """
    found = parse_qs(urlsplit(address).query).get("state", [""])[0]
    if not found:
        raise ValueError(f"{address[:80]}: carries no state")
    return unpacked(found)


def _json(text: str) -> Any:
    if len(text) > LONGEST:
        raise ValueError(f"a link carries at most {LONGEST} characters, not {len(text)}")
    try:
        raw = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
        inflate = zlib.decompressobj()
        plain = inflate.decompress(raw, LARGEST)
        if not inflate.eof or inflate.unused_data:
            raise ValueError(f"the link's state must have at most {LARGEST} bytes, and be whole")
        return json.loads(plain)
    except (binascii.Error, zlib.error, UnicodeDecodeError, json.JSONDecodeError, RecursionError):
        raise ValueError("the link is damaged: its state cannot be read") from None


def _impulses(given: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Amplitudes and times (s) of a shaper."""
    lists = isinstance(given, list) and len(given) == 2 and all(isinstance(each, list) for each in given)
    if not lists or len(given[0]) != len(given[1]) or not 1 <= len(given[0]) <= IMPULSES:
        raise ValueError(f"the link's impulses must be two lists of the same length, 1 to {IMPULSES}")
    if not all(type(value) in (int, float) and abs(value) <= GREATEST for each in given for value in each):
        raise ValueError(f"the link's impulses must be finite numbers of at most {GREATEST:.0e} in size")
    amplitudes, times = (tuple(float(value) for value in each) for each in given)
    if abs(sum(amplitudes) - 1) > 1e-6:
        raise ValueError(f"the link's amplitudes must sum to 1, not {sum(amplitudes):.6g}")
    if times[0] != 0 or any(later < earlier for earlier, later in itertools.pairwise(times)):
        raise ValueError("the link's times must increase from 0")
    return amplitudes, times
