"""Computations that wait, ``yield``, while a program runs, so that others can go on meanwhile in one thread."""

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

Computing = Generator[None, None, T]


def end_of(computing: Computing[T]) -> T:
    """What a computation comes to, if nothing else goes on."""
    while True:
        try:
            next(computing)
        except StopIteration as end:
            return end.value
