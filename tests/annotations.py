"""The type checker of jaxtyping's import hook: beartype, which also takes an integer for a float."""

import contextlib

import jaxtyping
import pytest
from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))

_raises = pytest.raises


@contextlib.contextmanager
def unchecked():
    """Without checks: they take a twentieth of a millisecond a call, and some tests make a hundred thousand calls."""
    disabled = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", disabled)


@contextlib.contextmanager
def raises(*args, **kwargs):
    """``pytest.raises``, inside which wrong types pass: what is wrong there is for jshape itself to say."""
    with unchecked(), _raises(*args, **kwargs) as caught:
        yield caught
