"""Computations that wait, ``yield``, while a program runs, so that others can go on meanwhile in one thread."""

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

Computing = Generator[None, None, T]


def end_of(computing: Computing[T]) -> T:
    """The result of a computation, run to its end without another one beside it.

    Args:
        computing: the computation, which yields while a program runs.
    """
    while True:
        try:
            next(computing)
        except StopIteration as end:
            return end.value
