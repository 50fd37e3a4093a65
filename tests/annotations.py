"""The type checker of jaxtyping's import hook: beartype, which also takes an integer for a float."""

import contextlib

import jaxtyping
import pytest
from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))

_raises = pytest.raises


@contextlib.contextmanager
def raises(*args, **kwargs):
    """``pytest.raises``, inside which wrong types pass: what is wrong there is for jshape itself to say."""
    disabled = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        with _raises(*args, **kwargs) as caught:
            yield caught
    finally:
        jaxtyping.config.update("jaxtyping_disable", disabled)
