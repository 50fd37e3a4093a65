"""A link that carries what a page shows: its problem file, impulses and designs to compare, as bounded data.

The query string's ``state`` is JSON, deflated, in the characters that an address takes. What comes in is believed in
nothing: it is read as an uploaded problem file is, and every number is checked.
"""

import base64
import binascii
import itertools
import json
import math
import zlib
from typing import Any
from urllib.parse import parse_qs, urlsplit

from jshape.studio import state
from jshape.studio.state import MOST_PINS, State

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
    pins = [[pin.name, pin.amplitudes, pin.times] for pin in shown.pins]
    data = {"problem": shown.text, "impulses": [shown.amplitudes, shown.times], "pins": pins}
    made = base64.urlsafe_b64encode(zlib.compress(json.dumps(data).encode(), 9)).decode().rstrip("=")
    if len(made) > LONGEST:
        raise ValueError(f"a link carries at most {LONGEST} characters, not {len(made)}; save the problem file instead")
    return made


def unpacked(text: str) -> State:
    """The state that a query string carries.

    Args:
        text: the value of ``state``.

    Raises:
        ValueError: for whatever is wrong with it.
    """
    data = _json(text)
    if not isinstance(data, dict) or set(data) != {"problem", "impulses", "pins"}:
        raise ValueError("the link must carry problem, impulses and pins")
    problem, given = data["problem"], data["pins"]
    if not isinstance(problem, str):
        raise ValueError("the link's problem must be the text of a problem file")
    if not isinstance(given, list) or len(given) > MOST_PINS:
        raise ValueError(f"the link must carry at most {MOST_PINS} designs to compare")
    amplitudes, times = _impulses(data["impulses"])
    made = state.with_impulses(state.from_text(problem), amplitudes, times)
    for pin in given:
        # Their names are made anew.
        kept = state.with_pin(state.with_impulses(made, *_impulses(pin[1:] if isinstance(pin, list) else pin)))
        made = state.with_pins(made, kept.pins)
    return made


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


def _impulses(given: Any) -> tuple[list[float], list[float]]:
    """Amplitudes and times (s) of a shaper."""
    lists = isinstance(given, list) and len(given) == 2 and all(isinstance(each, list) for each in given)
    if not lists or len(given[0]) != len(given[1]) or not 1 <= len(given[0]) <= IMPULSES:
        raise ValueError(f"the link's impulses must be two lists of the same length, 1 to {IMPULSES}")
    if not all(type(value) in (int, float) and math.isfinite(value) for each in given for value in each):
        raise ValueError("the link's impulses must be finite numbers")
    amplitudes, times = ([float(value) for value in each] for each in given)
    if abs(sum(amplitudes) - 1) > 1e-6:
        raise ValueError(f"the link's amplitudes must sum to 1, not {sum(amplitudes):.6g}")
    if times[0] != 0 or any(later < earlier for earlier, later in itertools.pairwise(times)):
        raise ValueError("the link's times must increase from 0")
    return amplitudes, times
