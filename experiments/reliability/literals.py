"""Values that nobody means: what hands, programs and attackers write in the place of a number or a name."""

import inspect
import re
from typing import Any

import numpy as np
from hypothesis import strategies as st

LITERALS = (
    *("nan", "inf", "-inf", "-0.0", "0", "1e308", "-1e308", "1e-320", "5e-324", "1e400", "0x7fffffffffffffff"),
    *("1_0", "true", "false", "1979-05-27", "07:32:00", "[]", "[[]]", "{}", "[1, 2, 3]", "[nan]", "{ low = 1 }"),
    *("null", "None", '""', '"x"', '"[/]"', '"[bold]"', '"$\\\\frac$"', '"\\u001b[2J"', '"\U0001f600"', '"../../x"'),
    *('"nan"', "'a'", '"TwoMass"', '"Duffing"', '"Trapezoid"', '"unity"', '"worst"', "1 m"),
    *("\udcff", "\0", "\r", "\t", '"', "'", "#", "="),
)
"""As they stand in a file."""

WORDS = ("type", "plant", "spring", "k1", "over", "design", "uncertainty", "count", "values", "low", "a.b.c", '"[/]"')
"""Keys, right ones in wrong places among them."""


def literal(random: np.random.Generator) -> str:
    """Something in the place of a value."""
    kind = random.random()
    if kind < 0.4:
        return LITERALS[random.integers(len(LITERALS))]
    if kind < 0.6:
        return str(random.integers(-3, 100))
    if kind < 0.8:
        largest = 3 if random.random() < 0.5 else 700
        return repr(float(np.exp(random.uniform(-largest, largest)) * random.choice([-1, 1, 1])))
    if kind < 0.85:
        return "1" + "0" * int(random.integers(1, 6000))
    if kind < 0.9:
        depth = int(random.integers(1, 3000))
        return "[" * depth + "]" * depth
    return '"' + "".join(chr(random.integers(32, 0x2FFF)) for _ in range(random.integers(1, 40))) + '"'


def altered(text: str, random: np.random.Generator) -> str:
    """A TOML file in which one to three values, keys or lines are others."""
    lines = text.split("\n")
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        places = [i for i, line in enumerate(lines) if "=" in line and not line.startswith("#")]
        place, kind = places[random.integers(len(places))], random.random()
        key, _, value = lines[place].partition("=")
        if kind < 0.5:
            lines[place] = f"{key}= {literal(random)}"
        elif kind < 0.7:
            # One value within a table or a list.
            parts = re.split(r"(-?\d[\d.e+-]*|\"[^\"]*\")", value)
            if len(parts) > 1:
                parts[1 + 2 * int(random.integers(len(parts) // 2))] = literal(random)
            lines[place] = f"{key}={''.join(parts)}"
        elif kind < 0.8:
            lines[place] = f"{WORDS[random.integers(len(WORDS))]} ={value}"
        elif kind < 0.9:
            del lines[place]
            lines.append("x = 1")
        else:
            lines.insert(place, f"{WORDS[random.integers(len(WORDS))]} = {literal(random)}")
    return "\n".join(lines)


NAMES = ("(", "[", "a|", "(a+)+$", "self", "delay", "commands", "type", "synchronised", "trolley", "x.y", "\\u202e", "")
"""Of tables: words of regular expressions and of Python's calls among them."""


def exchanged(text: str, other: str, random: np.random.Generator) -> str:
    """A TOML file in which one to three tables are another file's, have another name, or are missing."""
    tables, others = (re.split(r"^(?=\[)", each, flags=re.MULTILINE) for each in (text, other))
    for _ in range(random.choice([1, 1, 2, 3])):
        place, kind = int(random.integers(len(tables))), random.random()
        if kind < 0.6:
            tables[place] = others[random.integers(len(others))]
        elif kind < 0.9:
            name = f'."{NAMES[random.integers(len(NAMES))]}"]'
            tables[place] = re.sub(r"(\.\w+)?\]", lambda _, name=name: name, tables[place], count=1)
        elif len(tables) > 1:
            del tables[place]
    return "".join(tables)


NUMBERS = st.one_of(
    st.floats(0.01, 100.0), st.floats(), st.integers(), st.integers(-(10**400), 10**400), st.booleans(), st.none()
)
VALUES = st.one_of(
    NUMBERS,
    st.lists(NUMBERS, max_size=5),
    st.lists(st.floats(0.0, 10.0), max_size=5),
    st.lists(st.lists(NUMBERS, max_size=3), max_size=3),
    st.text(max_size=8),
    st.binary(max_size=4),
    st.complex_numbers(),
    st.dictionaries(st.text(max_size=3), NUMBERS, max_size=2),
    st.sampled_from([np.array("x"), np.array([None]), np.zeros((2, 2, 2)), np.ma.masked, float, ...]),
)


def arguments(kind: Any) -> st.SearchStrategy[dict[str, Any]]:
    """Arguments for a class: most of them a plausible number, one or two anything."""
    names = [name for name, one in inspect.signature(kind).parameters.items() if one.default is one.empty]
    each = st.one_of(st.floats(0.1, 10.0), st.lists(st.floats(0.1, 10.0), min_size=1, max_size=4), VALUES)
    return st.fixed_dictionaries(dict.fromkeys(names, each))
