"""What docstrings say of parameters: their meaning, their unit, and the words for them on an axis of a figure."""

import inspect
import re

# As docstrings print a unit: SI symbols alone, also with an exponent that is a parameter.
_SI = r"(?:kg|m|s|N|J|Hz|rad)(?:[²³⁴]|\^p)?"
PRINTED = re.compile(rf"(?:^|[,;] )((?:1|{_SI})(?:[ /](?:{_SI}|\({_SI}(?:[ /]{_SI})*\)(?:\^p)?))*)(?=[,;.]|\s\(|$)")

SYMBOLS = ("omega", "zeta", "gains")
"""Parameters that are named by what they mean, as all of fewer than four letters are."""


def described(doc: str | None, title: str = "Attributes") -> dict[str, str]:
    """The entries under ``Attributes:`` (or ``Args:``) in a docstring, by name."""
    _, _, text = inspect.cleandoc(doc or "").partition(f"\n{title}:\n")
    block = re.split(r"\n(?=\S)", text)[0]
    found = re.findall(r"^    (\w+): (.*(?:\n     +.*)*)", block, re.M)
    return {name: " ".join(words.replace("``", "").split()) for name, words in found}


def printed(text: str) -> str | None:
    """The unit that the description of a parameter names, if it names one: ``"its length, m."`` names m."""
    found = PRINTED.search(text)
    return found[1] if found else None


def in_words(name: str, meaning: str | None, entry: str = "") -> str:
    """A parameter in words for an axis of a figure: ``payload mass``, ``linear stiffness``, ``natural frequency 1``.

    Args:
        name: of the parameter.
        meaning: of it, where that is known.
        entry: the index, where it is one of a list.
    """
    words = name.replace("_", " ")
    if meaning is not None and (len(name) < 4 or name in SYMBOLS):
        words = re.split(r"[,;:.(]", meaning)[0].strip() or words
    return words + (f" {int(entry) + 1}" if entry.isdecimal() else "")
