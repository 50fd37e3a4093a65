"""Limits of a problem file's content: one that is damaged or hostile is refused at once, in a line.

``parse`` gives the text and the tables; ``exceeded`` finds the keys whose values are beyond a limit.
"""

import re
import tomllib
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

from jshape._files import printable, read_text
from jshape.problems.units import number_of

SIZE = 2**20
"""Bytes of a file."""

DEPTH = 16
"""Tables and lists inside of each other."""

LENGTH = 1000
"""Characters of a word, and of a key."""

LEAST, GREATEST = 1e-30, 10**18
"""Sizes of a number, but for 0: no machine has others, and those whose squares overflow take minutes."""

DOTS = 200
"""Dots in a line that are none of a number."""

_DOT = re.compile(r"(?<!\d)\.|\.(?!\d)|\.(?=[\w\s-]*\.)")

PLANTS = 10**7
"""Plants that the counts of an uncertainty multiply to."""


def parse(path: Path, text: str | None = None) -> tuple[str, dict[str, Any]]:
    """A file's text and its tables.

    Args:
        path: of the file.
        text: the file's, where it is known already; its path is then only what it is called.

    Raises:
        ValueError: that says what is wrong, for one that is too long, no text or no TOML.
    """
    if text is None:
        text = read_text(path, SIZE)
    elif len(text.encode()) > SIZE:
        raise ValueError(f"{path}: must have at most {SIZE} bytes, not {len(text.encode())}")
    # Tables inside of each other by name: their reader takes memory as the square of how many there are.
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > DOTS and not line.startswith("#") and len(_DOT.findall(line)) > DOTS:
            raise ValueError(f"{path}:{number}: more than {DEPTH} tables and lists are inside of each other")
    try:
        return text, tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"{path}: more than {DEPTH} tables and lists are inside of each other") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: malformed TOML: {error}") from None
    except ValueError:
        # Python's own limit to the digits of a number, which says neither file nor key.
        raise ValueError(f"{path}: a whole number has more digits than {GREATEST:.0e}") from None


def beyond(number: float) -> str:
    """What is said of a number that is too great or too small; nothing of others."""
    if not number or LEAST <= abs(number) <= GREATEST:
        return ""
    return f"must be 0, or lie between {LEAST:g} and {GREATEST:.0e} in size, not {number:g}"


def exceeded(value: Any, keys: tuple[str, ...] = ()) -> Iterator[tuple[list[str], str]]:
    """The keys whose values are beyond a limit, and what is said of each.

    Args:
        value: a file's tables, or a part of them.
        keys: of that part.
    """
    if isinstance(value, dict | list) and len(keys) > DEPTH:
        yield list(keys), f"more than {DEPTH} tables and lists are inside of each other"
    elif isinstance(value, dict):
        for key, inner in value.items():
            if len(key) > LENGTH:
                yield [*keys, printable(key[:20])], f"a key has {len(key)} characters, more than {LENGTH}"
            elif printable(key) != key:
                yield [*keys, printable(key)], f"a key must be of printable characters, not {key[:20]!r}"
            else:
                yield from exceeded(inner, (*keys, key))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from exceeded(inner, (*keys, str(i)))
    elif isinstance(value, str) and not (printable(value) == value and len(value) <= LENGTH):
        yield list(keys), f"must be at most {LENGTH} printable characters, not {value[:20]!r}"
    elif isinstance(value, str) and (words := beyond(number_of(value))):
        yield list(keys), words
    elif isinstance(value, int) and abs(value) > GREATEST:
        yield list(keys), f"must be at most {GREATEST:.0e} in size, not a number of {len(str(abs(value)))} digits"
    elif isinstance(value, float) and isfinite(value) and (words := beyond(value)):
        yield list(keys), words
