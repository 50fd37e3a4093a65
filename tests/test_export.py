"""Shaper files: read back identically; wrong ones are told."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jshape as js
from jshape.export import read_shaper, write_csv, write_json


@given(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=6), st.floats(1e-6, 100.0))
def test_round_trip_is_exact(tmp_path_factory, weights, spread):
    folder = tmp_path_factory.mktemp("shapers")
    amplitudes = np.array(weights) / np.sum(weights)
    shaper = js.Shaper(amplitudes, spread * np.arange(len(weights)))
    write_json(shaper, folder / "s.json", "name")
    write_csv(shaper, folder / "s.csv")
    for name in ("s.json", "s.csv"):
        back = read_shaper(folder / name)
        assert back.amplitudes.tolist() == shaper.amplitudes.tolist()
        assert back.times.tolist() == shaper.times.tolist()


def test_wrong_files(tmp_path):
    good = {"format": "jshape-shaper", "version": 1, "amplitudes": [0.5, 0.5], "times": [0.0, 1.0]}
    cases = {
        "version": (good | {"version": 7}, "version 7 is not known"),
        "format": (good | {"format": "x"}, "format 'x'"),
        "sum": (good | {"amplitudes": [0.5, 0.6]}, "sum to 1"),
        "order": (good | {"amplitudes": [0.5, 0.2, 0.3], "times": [0.0, 2.0, 1.0]}, "times must not decrease"),
        "missing": ({"format": "jshape-shaper", "version": 1, "times": [0.0]}, "'amplitudes' is missing"),
        "list": ([1, 2], "not a shaper file"),
    }
    for name, (content, words) in cases.items():
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps(content), encoding="utf-8")
        with pytest.raises(ValueError, match=words) as caught:
            read_shaper(path)
        assert path.name in str(caught.value)
    with pytest.raises(ValueError, match="not a shaper file"):
        read_shaper(tmp_path / "none.json")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(ValueError, match="'time_s' is missing"):
        read_shaper(tmp_path / "bad.csv")
