"""Memory that a process gives back."""

import sys

import jax
import pytest

from jshape import memory


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no such limit")
def test_programs_make_room_before_linux_maps_no_more_memory(monkeypatch):
    traced = []

    @jax.jit
    def twice(x):
        traced.append(x)
        return 2 * x

    twice(1.0)
    # Other tests of this process may have mapped more than half.
    monkeypatch.setattr(memory, "MAPPED", 1.0)
    memory.make_room()
    twice(1.0)
    assert len(traced) == 1
    monkeypatch.setattr(memory, "MAPPED", 0.0)
    memory.make_room()
    assert float(twice(1.0)) == 2.0
    assert len(traced) == 2
    # Of memory; then not again before there is half as much again.
    monkeypatch.setattr(memory, "_remaining", 0.0)
    for most, traces in ((1e9, 2), (0.0, 3), (0.0, 3)):
        monkeypatch.setattr(memory, "HELD", most)
        memory.bound_memory()
        twice(1.0)
        assert len(traced) == traces
