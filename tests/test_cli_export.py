"""``jshape export`` as its user meets it."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import jshape as js
from jshape.cli.export import export as command
from jshape.export import FORMATS, read_shaper

app = typer.Typer()
app.command()(command)
run = CliRunner().invoke

SHAPER = js.design.linear.zv(300.0, 0.1)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.json"
    js.export(SHAPER, "json", path, name="mine")
    return str(path)


def test_formats_are_listed():
    result = run(app, ["--list"])
    assert result.exit_code == 0
    for name, form in FORMATS.items():
        assert f"{name} ({form.ending}): {form.what}" in result.output
        assert form.lacks in result.output
    assert "needs: --sample-time, --mode" in result.output


def test_a_files_name_is_no_command_to_the_terminal(file, tmp_path):
    """This one would set the window's title."""
    result = run(app, [file, "--format", "csv", "--out", str(tmp_path / "a\x1b]0;title\x07b.csv")])
    assert result.exit_code == 0
    assert "a\\x1b]0;title\\x07b.csv: written" in result.output
    assert "\x1b" not in result.output


def test_to_the_terminal_it_is_the_text_alone(file):
    result = run(app, [file, "--format", "klipper", "--axis", "y"])
    assert result.exit_code == 0
    assert result.stdout == js.export(SHAPER, "klipper", axis="y")
    result = run(app, [file, "--format", "c99", "--sample-time", "0.001", "--method", "zeros", "--mode", "300,0.1"])
    assert result.exit_code == 0
    assert result.stdout == js.export(SHAPER, "c99", sample_time=0.001, method="zeros", modes=[(300.0, 0.1)])
    by_unit = run(app, [file, "--format", "matlab", "--sample-time", "1 ms"])
    assert by_unit.stdout == js.export(SHAPER, "matlab", sample_time=0.001)
    result = run(app, [file, "--format", "reprapfirmware", "--firmware", "3.4"])
    assert result.stdout == js.export(SHAPER, "reprapfirmware", firmware="3.4")


def test_to_a_file_and_not_over_another(file, tmp_path):
    out = tmp_path / "shaper.npz"
    given = [file, "--format", "numpy", "--out", str(out)]
    assert run(app, given).exit_code == 0
    assert read_shaper(out).times.tolist() == SHAPER.times.tolist()
    out.write_text("mine", encoding="utf-8")
    result = run(app, given)
    assert result.exit_code == 2
    assert "exists already" in result.output
    assert out.read_text(encoding="utf-8") == "mine"
    assert run(app, [*given, "--force"]).exit_code == 0
    assert read_shaper(out).times.tolist() == SHAPER.times.tolist()
    # And back, from an npz.
    result = run(app, [str(out), "--format", "json"])
    np.testing.assert_array_equal(json.loads(result.stdout)["times"], SHAPER.times)


def test_mistakes(file, tmp_path):
    for given, words in [
        ([], "give a shaper file and --format"),
        ([file], "give a shaper file and --format"),
        ([str(tmp_path / "none.json"), "--format", "json"], "not a shaper file"),
        ([file, "--format", "cobol"], "format must be one of"),
        ([file, "--format", "c99"], "format 'c99' needs sample_time"),
        ([file, "--format", "c99", "--sample-time", "-1"], "sample_time must be greater than 0"),
        ([file, "--format", "c99", "--sample-time", "1 s"], "sample_time must not be longer than the shaper, 0.0105"),
        ([file, "--format", "c99", "--sample-time", "1 m"], "--sample-time must be in s or a multiple of it"),
        ([file, "--format", "marlin", "--firmware", "3.4"], "firmware is no option of format 'marlin'"),
        ([file, "--format", "scipy", "--sample-time", "0.1", "--mode", "9"], "--mode must be OMEGA,ZETA"),
        ([file, "--format", "numpy"], "is no text; name a file with --out"),
        ([file, "--format", "on_off", "--sample-time", "0.001", "--mode", "9,0"], "amplitudes must be 1, -1, ..., 1"),
        ([file, "--format", "json", "--out", str(tmp_path / "no" / "s.json")], "s.json: No such file or directory"),
    ]:
        result = run(app, given)
        assert result.exit_code == 2, (given, result.output)
        assert words in result.output
        assert "Traceback" not in result.output
