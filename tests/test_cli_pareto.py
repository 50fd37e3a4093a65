"""``jshape pareto`` as its user meets it: the table, the files, a mistake."""

import json

import pytest
import xarray as xr
from typer.testing import CliRunner

from jshape.cli import app

PROBLEM = """
title = "A front"
distance = 1.0
[plant]
type = "TwoMass"
m1 = 1.0
m2 = 1.0
[plant.spring]
type = "Duffing"
k1 = 10.0
k3 = 100.0
[uncertainty]
m2 = { low = 0.8, high = 1.2, count = 5 }
[pareto]
impulses = [2]
durations = [0.4, 0.591241]
starts = 2
"""


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.slow
def test_front(tmp_path):
    problem, out = tmp_path / "front.toml", tmp_path / "out"
    problem.write_text(PROBLEM + "[design]\npeak_deflection = 2\n", encoding="utf-8")
    result = run("pareto", problem, "--out", out)
    assert result.exit_code == 0, result.output
    assert "a front keeps to no limits: peak_deflection of [design] left out" in result.output
    assert "A front\n" in result.output
    assert "residual energy, worst case (J) for each duration" in result.output
    assert "energy 2-impulse: 0.6609 J in 0.5912 s" in result.output
    with xr.open_dataset(out / "pareto.nc") as saved:
        assert float(saved.objective[0, 1]) < 0.660925
        assert saved.objective.attrs["units"] == "J"
    record = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert record["pareto"]["coords"]["duration"]["data"] == [0.4, 0.591241]
    assert {path.name for path in out.iterdir()} == {"pareto.nc", "pareto.png", "pareto.pdf", "results.json"}


def test_mistakes_are_told_with_their_line(tmp_path):
    problem = tmp_path / "front.toml"
    problem.write_text(PROBLEM.replace("starts = 2", "starts = 0"), encoding="utf-8")
    result = run("pareto", problem, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert f"{problem}:17: pareto.starts: input should be greater than or equal to 1, not 0" in result.output
    problem.write_text(PROBLEM.replace("[0.4, 0.591241]", "[0.6, 0.4]"), encoding="utf-8")
    output = run("pareto", problem, "--out", tmp_path / "out").output
    assert f"{problem}:16: pareto.durations: must be a list in ascending order" in output


def test_a_store_in_the_folder_of_the_results_is_refused(tmp_path):
    """An interrupted command could not go on: the folder would hold files that are no results."""
    problem, out = tmp_path / "front.toml", tmp_path / "out"
    problem.write_text(PROBLEM, encoding="utf-8")
    for store in (out, out / "store"):
        result = run("pareto", problem, "--out", out, "--store", store)
        assert result.exit_code == 2, result.output
        assert "must not lie in the folder of the results" in result.output
        assert not out.exists()
