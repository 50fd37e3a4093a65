"""``jshape plants`` and ``jshape new`` as their user meets them, and what is answered before JAX is loaded."""

import subprocess
import sys

import pytest
from typer.testing import CliRunner

import jshape
from jshape.cli import app
from jshape.problems import catalogue
from jshape.problems.reading import read
from jshape.problems.starters import STARTERS

run = CliRunner().invoke


def test_what_is_answered_without_jax(tmp_path):
    """Mistakes too: each exit code, and what is said."""
    files = {"unknown": ("plant", "plnt"), "negative": ("m2 = 1.0", "m2 = -1.0"), "unit": ("k1 = 10.0", 'k1 = "10 m"')}
    source = read("paper_001").text
    for name, (old, new) in files.items():
        (tmp_path / f"{name}.toml").write_text(source.replace(old, new, 1), encoding="utf-8")
    code = f"""
import sys
from pathlib import Path
from typer.testing import CliRunner
from jshape.cli import app
folder = Path({str(tmp_path)!r})
for arguments, status, words in [
    (["--version"], 0, "jshape {jshape.__version__}"),
    (["plants"], 0, "DoublePendulumCrane"),
    (["plants", "Crane"], 0, "cable_length"),
    (["new", str(folder / "new.toml"), "--plant", "Crane"], 0, "Next: jshape tune"),
    (["tune", str(folder / "unknown.toml")], 2, "there are title, distance"),
    (["compare", str(folder / "negative.toml")], 2, "plant.m2: must be greater than 0, not -1.0"),
    (["sweep", str(folder / "unit.toml")], 2, "plant.spring.k1: must be in N/m"),
]:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == status, result.output
    assert words in result.output, result.output
assert "jax" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_alone_it_shows_the_help():
    result = subprocess.run([sys.executable, "-m", "jshape"], capture_output=True, text=True, check=True)
    assert "Usage" in result.stdout


def test_plants_are_listed_in_groups():
    output = run(app, ["plants"]).output
    assert all(group in output for group in catalogue.GROUPS)
    assert all(name in output for name in catalogue.plants())


@pytest.mark.parametrize("name", ["DoublePendulumCrane", "Duffing", "Trapezoid"])
def test_keys_with_unit_default_and_meaning(name):
    result = run(app, ["plants", name])
    assert result.exit_code == 0
    known = {**catalogue.plants(), **catalogue.known("AbstractSpring"), **catalogue.known("AbstractCommand")}
    words = " ".join(result.output.split())
    for key in known[name].keys.values():
        assert key.name in words
        assert (key.unit or "") in words
        assert key.meaning.split()[0] in words
    wrong = run(app, ["plants", name[:-1]])
    assert wrong.exit_code == 2
    assert f"did you mean {name}?" in wrong.output


def asked(monkeypatch, tmp_path, answers, *path):
    monkeypatch.setattr(sys.modules["jshape.cli.new"], "_on_terminal", lambda: True)
    monkeypatch.chdir(tmp_path)
    result = run(app, ["new", *path], input="\n".join(answers) + "\n")
    assert result.exit_code == 0, result.output
    return result.output, read("".join(path) or "problem.toml")


@pytest.mark.parametrize("path", [(), ("hall.toml",)])
def test_three_questions(path, monkeypatch, tmp_path):
    output, draft = asked(monkeypatch, tmp_path, ["2", "12 m", "500 kg to 9 t"], *path)
    assert output.count("?") == 0
    assert output.count("[") == 3
    assert draft.plant.kind == "DoublePendulumCrane"
    assert draft.command is not None
    assert draft.command.values["distance"] == 12
    assert draft.over["payload_mass"].values == [500, 9000]


def test_wrong_answers_are_asked_again(monkeypatch, tmp_path):
    output, draft = asked(monkeypatch, tmp_path, ["99", "1", "12 kg", "12 m", "5 m", "8 m to 5 m", "4 m to 9 m"])
    for words in ("must be a number from 1 to", "must be in m", "must be two quantities", "low must be below high"):
        assert words in output
    assert draft.over["cable_length"].values == [4, 9]


def test_a_plant_of_ones_own_is_an_answer(monkeypatch, tmp_path):
    output, draft = asked(monkeypatch, tmp_path, [str(len(STARTERS) + 1)])
    assert "a plant of your own" in output
    assert draft.foreign == "own_plant:SinhMass"
    assert (tmp_path / "own_plant.py").exists()


def test_mistakes(tmp_path):
    for given, words in [
        (["--plant", "Crain"], "there is no plant 'Crain', only"),
        (["--like", "paper_01"], "did you mean paper_001?"),
        (["--plant", "Crane", "--like", "paper_001"], "give only one of them"),
    ]:
        result = run(app, ["new", str(tmp_path / "new.toml"), *given])
        assert result.exit_code == 2
        assert words in result.output
        assert not (tmp_path / "new.toml").exists()


def test_without_a_standard_input_nothing_is_asked(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", None)
    assert not sys.modules["jshape.cli.new"]._on_terminal()
    result = run(app, ["new", "hall.toml"])
    assert result.exit_code == 0
    assert "a two-mass pair (paper_001); --plant Crane, say, for another machine" in result.output
