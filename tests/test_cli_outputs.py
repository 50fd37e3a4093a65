"""What commands write and print: names are data, files are whole or not there, and what a user has edited stays."""

import dataclasses
import errno
import json
import os
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
import typer
from test_identification_files import text
from typer.testing import CliRunner

from jshape import _files
from jshape.cli import _shared
from jshape.cli import app as whole_app
from jshape.cli.identify import identify
from jshape.identification.files import write
from jshape.identification.from_csv import identify_csv
from jshape.problems.problem import load
from jshape.reports import plot, tables
from jshape.reports.report import Report, Row
from jshape.reports.report_files import write as write_report
from jshape.reports.report_files import write_numbers
from jshape.shaper import Shaper

app = typer.Typer()
app.command()(identify)
run = CliRunner().invoke

MARKUP = ("[/]", "[bold]x", "[link=http://x]", ":smile:")


@pytest.fixture
def data(tmp_path):
    path = tmp_path / "arm.csv"
    path.write_text(text(), encoding="utf-8")
    return path


# --- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", MARKUP)
def test_names_are_never_markup(words, capsys):
    console = tables.new_console()
    tables.show_table(console, words, [words, words], [(words, [words, words])], words, left=[words])
    tables.say(console, words)
    assert capsys.readouterr().out.count(words) == 8
    with _shared.progress_line() as (step, progress):
        step(words)
        progress(words, 1, 2, 3.0)


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("name", ["$", "$\\frac$", "$$", "_hidden", "\U0001f600$x$"])
def test_names_are_never_formulas(name, tmp_path):
    x = np.linspace(0.0, 1.0, 5)
    figure = plot.curves([(name, x, x), ("other", x, 2 * x)], ("x", "y")).get_figure(root=True)
    assert len(figure.legends[0].get_texts()) == 2
    figure.canvas.draw()
    plt.close(figure)
    columns = np.stack([x, x], axis=1)
    figure = plot.prediction(x, columns, columns, [name, name])[0].figure
    figure.canvas.draw()
    plt.close(figure)


@pytest.mark.parametrize("name", ["\U0001f600 arm.csv", b"\xff\xfe arm.csv", "a\x7f\x1b[2J\nb.csv", '"\\.csv'])
def test_a_record_of_any_name_makes_a_problem_that_can_be_read(name, data, tmp_path):
    path = data.parent / os.fsdecode(name)
    data.rename(path)
    out = tmp_path / "out"
    result = run(app, [str(path), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert load(out / "problem.toml").title.startswith("Identified from ")
    assert load(out / "problem.toml").title.isprintable()
    json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert "\x1b[2J" not in result.output


def test_an_error_about_such_a_name_can_be_printed(tmp_path):
    result = run(app, [os.fsdecode(os.fsencode(tmp_path) + b"/\xff.csv")])
    assert result.exit_code == 2
    assert "\\udcff.csv: cannot be read: No such file" in result.output


# --- folders ----------------------------------------------------------------------------------------------------------


def test_a_folder_that_cannot_be_written_to_is_named_before_anything_is_computed(data, tmp_path, monkeypatch):
    def computed(*_, **__):
        raise AssertionError("computed")

    monkeypatch.setattr("jshape.identification.from_csv.identify", computed)
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for out, words in {
        tmp_path / "file": "file: is a file, not a folder",
        tmp_path / "file" / "below": "below: cannot be written to: Not a directory",
        tmp_path / ("x" * 300): "cannot be written to: File name too long",
    }.items():
        result = run(app, [str(data), "--out", str(out)])
        assert result.exit_code == 2
        assert words in " ".join(result.output.split())
        assert "Traceback" not in result.output

    def full(**_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(_files.tempfile, "TemporaryFile", full)
    result = run(app, [str(data), "--out", str(tmp_path / "a" / "b")])
    assert result.exit_code == 2
    assert "b: cannot be written to: No space left on device" in result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.csv", "file"]


def test_what_a_killed_process_left_is_no_foreign_file(tmp_path):
    (tmp_path / ".7-7.partial").write_bytes(b"half")
    _files.check_writable(tmp_path)


def test_a_problem_file_that_was_edited_stays(data, tmp_path):
    out = tmp_path / "out"
    for _ in range(2):
        assert run(app, [str(data), "--out", str(out)]).exit_code == 0
    path = out / "problem.toml"
    edited = path.read_text(encoding="utf-8").replace("distance = 1.0", "distance = 0.3")
    path.write_text(edited, encoding="utf-8")
    result = run(app, [str(data), "--out", str(out)])
    assert result.exit_code == 2
    assert "problem.toml: has been edited, and is left as it is" in " ".join(result.output.split())
    assert path.read_text(encoding="utf-8") == edited
    # The same text is no edit: a problem in its own folder.
    _files.check_unedited(out, edited)


# --- faults while writing ---------------------------------------------------------------------------------------------


class Faulty:
    """``os.replace`` and the files' ``write`` that fail from the n-th file on."""

    def __init__(self, monkeypatch, last):
        self.left, real = last, os.replace

        def replace(source, target):
            self.left -= 1
            if self.left < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(source))
            real(source, target)

        monkeypatch.setattr(_files.os, "replace", replace)


def assert_whole(folder):
    """Every file in a folder is one that can be read from its beginning to its end."""
    for path in folder.rglob("*"):
        content = path.read_bytes() if path.is_file() else b""
        assert path.suffix != ".partial"
        if path.suffix == ".json":
            json.loads(content)
        elif path.suffix == ".toml":
            load(path)
        elif path.suffix == ".png":
            assert content.endswith(b"IEND\xaeB`\x82")
        elif path.suffix == ".pdf":
            assert content.rstrip().endswith(b"%%EOF")
        elif path.suffix == ".csv":
            assert content.endswith(b"\n")


def test_a_disk_that_fills_up_leaves_whole_files_numbers_first(data, tmp_path, monkeypatch):
    found = identify_csv(data)
    expected = ["results.json", "problem.toml", "prediction.csv", "prediction.png", "prediction.pdf"]
    for last in range(len(expected)):
        folder = tmp_path / f"out{last}"
        with monkeypatch.context() as patch:
            Faulty(patch, last)
            with pytest.raises(OSError, match="No space left") as caught:
                write(found, folder, "arm.csv")
        assert caught.value.filename == str(folder / expected[last])
        assert {path.name for path in folder.iterdir()} == set(expected[:last])
        assert_whole(folder)
        if last:
            # The folder is still jshape's: the same command can be given again.
            _files.check_writable(folder)


def test_a_report_writes_its_numbers_before_its_pictures(tmp_path, monkeypatch):
    problem = load("paper_001")
    report = Report(problem, [], {}, {}, None)
    monkeypatch.setattr(
        "jshape.reports.report_files.figures", lambda *_: iter([("one", "convergence", ([1.0, 0.5], "worst"))])
    )

    def fail(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "one.png")

    with pytest.raises(OSError, match="No space left"):
        write_report(report, tmp_path / "out", draw=fail)
    record = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert record["title"] == problem.title
    _files.check_unedited(tmp_path / "out")
    assert_whole(tmp_path / "out")


def test_shapers_and_figures_of_another_problem_are_removed(tmp_path):
    """A tuned shaper, and its convergence, lay beside the closed forms of a problem that it was not made for."""
    folder, problem = tmp_path / "out", load("paper_001")
    rows = [Row(name, Shaper([0.5, 0.5], [0.0, 1.0]), 0.0, 0.0, 0.0) for name in ("linear ZV", "tuned")]

    write_numbers(Report(problem, rows, {}, {}, None), folder)
    own = [folder / "shapers" / "mine.json", folder / "figures" / "mine.png", folder / "notes.txt"]
    figures = [folder / "figures" / f"{name}.png" for name in ("convergence", "response_x", "sensitivity_m2")]
    for path in (*own, *figures, folder / "sensitivity_m2.csv"):
        path.write_text("", encoding="utf-8")
    # The same problem, compared: what was tuned is still its own.
    write_numbers(Report(problem, rows[:1], {}, {}, None), folder)
    assert all(path.exists() for path in (*own, *figures))
    write_numbers(Report(problem, rows, {}, {}, None), folder)
    other = dataclasses.replace(problem, text=problem.text + "\n# Another load.\n")
    write_numbers(Report(other, rows[:1], {}, {}, None), folder)
    assert all(path.exists() for path in own)
    assert not any(path.exists() for path in (*figures, folder / "sensitivity_m2.csv"))
    assert {path.name for path in (folder / "shapers").iterdir()} == {
        *("linear_ZV.json", "linear_ZV.csv", "mine.json", "tuned_before.json", "tuned_before.csv")
    }


def test_an_error_of_the_disk_is_one_line(tmp_path):
    @_shared.explained()
    def command():
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(tmp_path / "x.png"))

    patched = typer.Typer()
    patched.command()(command)
    result = run(patched, [])
    assert result.exit_code == 2
    assert re.fullmatch(r"jshape: .*x\.png: File too large\n", result.output)


def test_foreign_code_is_announced_before_it_is_imported(tmp_path):
    # A module that ends the process was run without a word.
    (tmp_path / "module_that_ends.py").write_text("print('it runs')\nraise SystemExit(7)\n", encoding="utf-8")
    path = tmp_path / "foreign.toml"
    path.write_text('distance = 1.0\n[plant]\ntype = "module_that_ends:Plant"\n', encoding="utf-8")
    result = run(whole_app, ["pareto", str(path), "--out", str(tmp_path / "out")])
    announced, ran = (result.output.index(words) for words in ("runs code of its own", "it runs"))
    assert announced < ran
