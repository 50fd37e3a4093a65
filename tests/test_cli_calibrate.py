"""``jshape calibrate`` as its user meets it: the table, the reasons, the files, the lines to paste, mistakes."""

import configparser
import json
from pathlib import Path

import numpy as np
import pytest
import typer
from calibration_data import RECORD, sets_text, spectrum_text
from typer.testing import CliRunner

from jshape.calibration.files import axis_of
from jshape.cli.calibrate import _axes, calibrate
from jshape.export import read_shaper
from jshape.klipper import impulses

app = typer.Typer()
app.command()(calibrate)


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("calibrate")


@pytest.fixture(scope="module")
def result(folder):
    data = folder / "resonances_y_made_up.csv"
    data.write_text(spectrum_text(), encoding="utf-8")
    return run(data, "--out", folder / "out", "--starts", 4, "--reprapfirmware", "--kalico")


def test_table_reasons_and_lines(result):
    assert result.exit_code == 0, result.output
    expected = ["Why this one: ", "vibration left: how much", "modes left: ", "modes at 55."]
    expected += ["* recommended by Klipper (current): ", " instead: ", "tuned: ", "less smoothing"]
    for words in expected:
        assert words in result.output
    assert "shaper_freq_y: " in result.output
    assert 'M593 P"custom" H' in result.output
    assert "(axis y, from the file's name" in result.output


def test_files(result, folder):
    out = folder / "out"
    record = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert record["format"] == "jshape-results"
    shapers = {row["name"]: row for row in record["shapers"]}
    assert list(shapers) == ["zv", "mzv", "ei", "2hump_ei", "3hump_ei", "klipper_tuned", "kalico_smooth", "tuned"]
    best = shapers[record["recommended"]]
    assert shapers["tuned"]["vibration"] <= best["vibration"]
    assert set(record["costs"]) == {"zv", "mzv", "ei", "2hump_ei", "3hump_ei"} - {record["recommended"]}
    for name, row in shapers.items():
        for ending in ("json", "csv"):
            shaper = read_shaper(out / "shapers" / f"{name}.{ending}")
            np.testing.assert_array_equal(shaper.times, row["times"])
            np.testing.assert_array_equal(shaper.amplitudes, row["amplitudes"])
    for name in ("calibration", "step"):
        assert (out / f"{name}.png").stat().st_size > 10_000
        assert (out / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    pasted = (out / "paste.txt").read_text(encoding="utf-8")
    assert f"# shaper_type_y: {record['recommended']}" in pasted
    # The block as Klipper reads it: one section, whose shaper is the tuned one.
    parser = configparser.ConfigParser()
    parser.read_string(pasted[: pasted.index("# For an older")])
    settings = dict(parser["input_shaper"])
    assert settings.pop("shaper_type_y") == record["klipper_tuned"]["name"]
    kind = record["klipper_tuned"]["name"]
    amplitudes, times = impulses(kind, *(float(settings[f"{key}_y"]) for key in ("shaper_freq", "damping_ratio")))
    np.testing.assert_allclose(amplitudes, shapers["klipper_tuned"]["amplitudes"], atol=1e-12)
    np.testing.assert_allclose(times, shapers["klipper_tuned"]["times"], rtol=1e-12)
    assert shapers["klipper_tuned"]["vibration"] <= best["vibration"]
    assert shapers["klipper_tuned"]["smoothing"] <= best["smoothing"]
    # And as Kalico does.
    kalico = configparser.ConfigParser()
    kalico.read_string(pasted[pasted.index("# For Kalico") : pasted.rindex("# For Kalico")])
    lists = [[float(v) for v in kalico["input_shaper"][f"shaper_{letter}_y"].split(",")] for letter in "at"]
    np.testing.assert_allclose(lists, [shapers["tuned"]["amplitudes"], shapers["tuned"]["times"]], atol=1e-8)
    assert "smoother_freq_y: " in pasted


def test_mistakes_end_with_a_line(folder):
    data = folder / "bad.csv"
    data.write_text(spectrum_text().replace("\n4.8,", "\n4.8;"), encoding="utf-8")
    good = folder / "good.csv"
    good.write_text(sets_text(), encoding="utf-8")
    (folder / "full").mkdir()
    (folder / "full" / "mine.txt").write_text("mine", encoding="utf-8")
    for arguments, words in [
        ((data,), f"{data}:5: has 4 cells where the header has 5"),
        ((folder / "none.csv",), "cannot be read"),
        ((good, "--axis", "q"), "--axis must be x or y, not 'q'"),
        ((good, "--klipper", "2019"), "version must be one of"),
        ((good, "--component", "x"), "has no column psd_x"),
        ((good, "--zeta", "0.9"), "zeta must be over 0"),
        ((good, "--out", folder / "full"), "holds files that are not jshape's results"),
        ((good, "--vibration", "0.1", "--smoothing", "0.1", "--out", folder / "n"), "only one may be limited"),
    ]:
        outcome = run(*arguments)
        assert outcome.exit_code == 2, outcome.output
        assert words in outcome.output
        assert "Traceback" not in outcome.output
    assert not (folder / "n").exists()


def test_two_files_are_two_axes_or_two_loads():
    """Told apart by their names; loads are asked for."""
    x, y, other = Path("resonances_x_1.csv"), Path("resonances_y_1.csv"), Path("loaded.csv")
    assert _axes([x, y], None, False) == {"x": [x], "y": [y]}
    assert _axes([x, other], None, True) == {"x": [x, other]}
    assert _axes([x, y], "y", True) == {"y": [x, y]}
    belts = [Path(f"raw_data_axis=1.000,{sign}1.000_{name}.csv") for sign, name in (("", "a"), ("-", "b"))]
    assert _axes(belts, None, False) == {"x": belts, "y": belts}
    assert _axes([Path("raw_data_axis=1.000,0.000_a.csv")], None, False) == {
        "x": [Path("raw_data_axis=1.000,0.000_a.csv")]
    }
    with pytest.raises(ValueError, match=r"resonances_x_1.csv and loaded.csv: are all of axis x; --loads"):
        _axes([x, other], None, False)


@pytest.mark.slow
def test_two_axes(folder):
    files = [folder / f"two_{axis}.csv" for axis in "xy"]
    for file in files:
        file.write_text(spectrum_text(), encoding="utf-8")
    outcome = run(*files, "--out", folder / "axes", "--starts", 2)
    assert outcome.exit_code == 0, outcome.output
    for axis in "xy":
        assert f"shaper_freq_{axis}: " in outcome.output
        assert f"shaper_type_{axis}" in (folder / "axes" / axis / "paste.txt").read_text(encoding="utf-8")
    assert "Kalico and RepRapFirmware do" in outcome.output
    assert "M593" not in outcome.output
    parser = configparser.ConfigParser()
    parser.read(folder / "axes" / "paste.txt", encoding="utf-8")
    assert {key[-1] for key in parser["input_shaper"]} == {"x", "y"}


def test_lines_of_someone_elses_are_not_written_over(tmp_path):
    for axis in "xy":
        (tmp_path / f"made_up_{axis}.csv").write_text(spectrum_text(), encoding="utf-8")
    (tmp_path / "paste.txt").write_text("mine", encoding="utf-8")
    found = run(tmp_path / "made_up_x.csv", tmp_path / "made_up_y.csv", "--out", tmp_path)
    assert found.exit_code == 2, found.output
    assert "paste.txt: is not jshape's, and is left as it is" in found.output
    assert (tmp_path / "paste.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.slow
def test_belts_share_a_shaper_that_both_axes_have(folder, monkeypatch):
    files = [folder / f"raw_data_axis=1.000,{sign}1.000_{name}.csv" for sign, name in (("", "a"), ("-", "b"))]
    lines = RECORD.read_text(encoding="utf-8").splitlines()
    for file, factor in zip(files, (1.0, 0.9), strict=True):
        rows = [line.split(",") for line in lines[1:]]
        file.write_text(
            "\n".join([lines[0], *(",".join([f"{float(r[0]) / factor:.6f}", *r[1:]]) for r in rows)]), "utf-8"
        )
    outcome = run(*files, "--out", folder / "belts", "--starts", 2)
    assert outcome.exit_code == 0, outcome.output
    assert "the belts' strongest modes are 11." in outcome.output
    assert "(both axes, from the belts' names; --axis says otherwise)" in outcome.output
    parser = configparser.ConfigParser()
    parser.read(folder / "belts" / "paste.txt", encoding="utf-8")
    settings = dict(parser["input_shaper"])
    assert settings["shaper_type_x"] == settings["shaper_type_y"]
    assert outcome.output.count("* recommended by Klipper") == 1
    # Each axis has a folder of its own where none is named, too.
    monkeypatch.chdir(folder)
    assert run(*files, "--starts", 2).exit_code == 0
    for axis in "xy":
        text = (folder / f"{files[0].stem}-{axis}-calibration" / "paste.txt").read_text(encoding="utf-8")
        assert f"shaper_type_{axis}: " in text


def test_axis_from_the_name(tmp_path):
    for name, axis in [
        ("raw_data_y_20250101.csv", "y"),
        ("resonances_x.csv", "x"),
        ("proxy.csv", "x"),
        ("y-2.csv", "y"),
    ]:
        assert axis_of(tmp_path / name) == axis


@pytest.mark.slow
def test_two_files_that_share_a_shaper(folder):
    """A raw record of the empty bed and, ten per cent lower, a loaded one."""
    lines = RECORD.read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines[1:]]
    loaded = folder / "loaded_x.csv"
    loaded.write_text("\n".join([lines[0], *(",".join([f"{float(r[0]) / 0.9:.6f}", *r[1:]]) for r in rows)]), "utf-8")
    outcome = run(RECORD, loaded, "--loads", "--out", folder / "both", "--shift", 0.02)
    assert outcome.exit_code == 0, outcome.output
    record = json.loads((folder / "both" / "results.json").read_text(encoding="utf-8"))
    assert record["spectra"] == [RECORD.name, "loaded_x.csv"]
    assert record["tuned"]["status"] == "converged"
