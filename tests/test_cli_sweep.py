"""``jshape sweep`` as its user meets it."""

import json

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from jshape.cli import app
from jshape.sweeps import sweep as robustness

run = CliRunner().invoke


@pytest.mark.slow
def test_sweep_a_problem(tmp_path):
    import jshape as js

    js.export(
        js.Shaper([0.25, 0.5, 0.25], [0.0, 0.8214899715396663, 1.6429799430793326]),
        "json",
        tmp_path / "mine.json",
        name="mine",
    )
    out = tmp_path / "out"
    arguments = ["sweep", "paper_001", "--metric", "residual_energy", "--shaper", str(tmp_path / "mine.json")]
    result = run(app, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "residual energy (J), 41 plants" in result.output
    numbers = json.loads((out / "results.json").read_text(encoding="utf-8"))["metrics"]["residual_energy"]
    # Moonmangmee and Chatlatanagulchai (2025), recomputed independently: at m2 − 20 %.
    for name, worst in (("energy 2-impulse", 0.660925), ("energy fast 3-impulse", 0.166804), ("mine", 0.0413257)):
        np.testing.assert_allclose(numbers[name]["worst"], worst, rtol=1e-5)
        assert f"{worst:.4g}" in result.output
    with xr.open_dataset(out / "sweep.nc") as ds:
        np.testing.assert_allclose(ds.residual_energy.sel(shaper="mine").max(), numbers["mine"]["worst"])
        assert ds.residual_energy.attrs["units"] == "J"
    assert len((out / "sweep.csv").read_text(encoding="utf-8").splitlines()) == 1 + ds.residual_energy.size
    assert (out / "sweep_residual_energy.png").stat().st_size > 10_000


@pytest.mark.slow
def test_interrupted_it_says_how_to_go_on(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(robustness, "sweep", interrupted)
    for given, words in (([], "with --store DIR"), (["--store", str(tmp_path / "s")], "same command resumes")):
        result = run(app, ["sweep", "paper_001", "--out", str(tmp_path / "out"), *given])
        assert result.exit_code == 130
        assert words in result.output


def test_mistakes(tmp_path):
    out = tmp_path / "out"
    certain = tmp_path / "certain.toml"
    certain.write_text(
        'distance = 1.0\n[plant]\ntype = "TwoMass"\nspring = { type = "Duffing", k1 = 10.0, k3 = 100.0 }\n',
        encoding="utf-8",
    )
    circle = tmp_path / "circle"
    circle.symlink_to(circle)
    for given, words in [
        ([str(certain)], "nothing is uncertain"),
        (["paper_001", "--store", str(circle)], "circle: "),
        (["paper_001", "--store", str(out / "store")], "must not lie in the folder of the results"),
        (["paper_001", "--metric", "beauty"], "metric must be one of"),
        (["paper_001", "--samples", "8", "--sampling", "dice"], "sampling must be one of"),
    ]:
        result = run(app, ["sweep", *given, "--out", str(out)])
        assert result.exit_code == 2
        assert words in result.output
        assert not out.exists()
