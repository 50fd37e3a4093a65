"""``jshape identify`` as its user meets it."""

import json

import numpy as np
import pytest
import typer
from test_identification_files import DAMPING, FREQUENCY, edited, text
from typer.testing import CliRunner

from jshape.cli.identify import identify
from jshape.problems.problem import load

app = typer.Typer()
app.command()(identify)
run = CliRunner().invoke


def test_from_a_file_to_a_problem(tmp_path):
    data, out = tmp_path / "arm.csv", tmp_path / "out"
    data.write_text(text("Zeit;Weg;Winkel", ";", comma=True), encoding="utf-8")
    result = run(app, [str(data), "--columns", "Zeit,Weg", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "1 mode (by Bayes's criterion" in result.output
    assert f"jshape tune {out / 'problem.toml'}" in result.output
    numbers = json.loads((out / "results.json").read_text(encoding="utf-8"))
    np.testing.assert_allclose(np.array(numbers["omega"]) / 2 / np.pi, [FREQUENCY], rtol=2e-3)
    np.testing.assert_allclose(numbers["zeta"], [DAMPING], rtol=0.1)
    assert numbers["channels"] == ["Weg"]
    assert f"{numbers['omega'][0] / 2 / np.pi:.6g}" in result.output
    # The problem file is one that the other commands read, with the plant that was measured.
    problem = load(out / "problem.toml")
    np.testing.assert_array_equal(problem.plant.natural_frequency(), numbers["omega"])
    low, high = problem.over["omega.0"][[0, -1]]
    ends = np.array(numbers["omega_95"][0]) / numbers["omega"][0]
    np.testing.assert_allclose([low, high], ends + np.array([-0.05, 0.05]), atol=1e-4)
    # It may last as long as ZVD does, with the impulses that then leave least: three, or four on a grid of times.
    damped = numbers["omega"][0] * np.sqrt(1 - numbers["zeta"][0] ** 2)
    assert problem.design.duration == pytest.approx(2 * np.pi / damped, rel=1e-5)
    assert problem.design.impulses in (3, 4)
    lines = (out / "prediction.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "time_s,Weg measured,Weg fit"
    table = np.array([line.split(",") for line in lines[1:]], float)
    assert len(table) == 200
    assert np.std(table[:, 1] - table[:, 2]) < 2e-3
    assert (out / "prediction.png").stat().st_size > 10_000


def test_mistakes_are_a_line(tmp_path):
    good, bad, full = tmp_path / "good.csv", tmp_path / "bad.csv", tmp_path / "full"
    good.write_text(text(), encoding="utf-8")
    bad.write_text(edited(_50="0.96,oops,1.0"), encoding="utf-8")
    full.mkdir()
    (full / "precious.txt").write_text("mine", encoding="utf-8")
    for given, words in [
        ([str(tmp_path / "gone.csv")], "gone.csv: cannot be read"),
        ([str(bad)], "bad.csv:50: x: 'oops' is no number"),
        ([str(good), "--columns", "time,x"], "there are 1 't', 2 'x', 3 'y'"),
        ([str(good), "--kind", "song"], "kind must be one of"),
        ([str(good), str(bad)], "bad.csv: a second file is named by --along-y"),
        ([str(good), "--modes", "0"], "modes must be a whole number"),
        ([str(good), "--sample-rate", "0"], "sample_rate must be greater than 0"),
        ([str(good), "--kind", "sweep"], "--input must name the column of the command"),
        ([str(good), "--out", str(full)], "holds files that are not jshape's"),
    ]:
        out = [] if "--out" in given else ["--out", str(tmp_path / "out")]
        result = run(app, [*given, *out])
        assert result.exit_code == 2, result.output
        assert words in " ".join(result.output.split()), result.output
        assert "Traceback" not in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("line", ["0.96,,1.0", None])
def test_notes_are_told(tmp_path, line):
    data = tmp_path / "data.csv"
    data.write_text(edited(_50=line), encoding="utf-8")
    result = run(app, [str(data), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert f"note: {data}:50: " in result.output
