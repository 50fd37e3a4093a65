"""``jshape train``: what it writes, and that it goes on after an interrupt; in a folder of its own."""

import csv
import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from jshape.cli.evaluate import COLUMNS, evaluate
from jshape.cli.train import train

app = typer.Typer()
app.command()(train)


def run(*arguments):
    return CliRunner().invoke(app, [str(each) for each in arguments])


@pytest.mark.slow
def test_train_writes_a_policy_its_curve_and_goes_on_from_its_checkpoint(tmp_path, monkeypatch):
    from jshape_envs import apg
    from jshape_envs.policy import load_policy

    out = tmp_path / "mine"
    small = ("DuffingPayload", "--out", out, "--moves", 80, "--environments", 4, "--window", 4, "--hidden", 8)
    whole, update = apg._update, []

    def interrupted(*arguments):
        update.append(None)
        if len(update) == 3:
            raise KeyboardInterrupt
        return whole(*arguments)

    monkeypatch.setattr(apg, "_update", interrupted)
    stopped = run(*small)
    assert stopped.exit_code == 130
    assert "the same command resumes it" in stopped.stderr
    assert not json.loads((out / "results.json").read_text(encoding="utf-8"))["ended"]
    ended = run(*small)
    assert ended.exit_code == 0, ended.output
    assert len(update) == 3 + 3
    assert "overwritten" not in ended.stderr
    with (out / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["moves"]) for row in rows] == [0, 16, 32, 48, 64]
    assert all(np.isfinite(float(row["reward"])) for row in rows)
    record = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert record["ended"]
    assert record["scores"]["regret"] > 0
    assert f"{record['scores']['reward']:.4f}" in ended.output
    assert load_policy(out / "policy.npz").cell.hidden_size == 8
    assert (out / "learning.png").read_bytes().startswith(b"\x89PNG")
    other = run(*small, "--seed", 1)
    assert other.exit_code == 2
    assert "is of another training" in other.stderr


def test_mistakes_are_told_in_a_line(tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("mine", encoding="utf-8")
    for arguments, words in (
        (("Duffing", "--out", tmp_path / "x"), "environment must be one of"),
        (
            ("DuffingPayload", "--out", tmp_path / "x", "--moves", 0),
            "moves must be a whole number of at least 1, not 0",
        ),
        (("DuffingPayload", "--out", tmp_path / "letters"), "holds files that are not jshape's results"),
    ):
        found = run(*arguments)
        assert found.exit_code == 2
        assert words in found.stderr.replace("\n", " ")
    assert not (tmp_path / "x").exists()


def test_a_wrong_policy_lists_what_there_is(tmp_path):
    other = typer.Typer()
    other.command()(evaluate)
    given = ["DuffingPayload", "--policy", "best-fxed", "--out", str(tmp_path / "x")]
    found = CliRunner().invoke(other, given)
    assert found.exit_code == 2
    words = "--policy must be a policy's file (.npz), guarded, trained or one of zv, zvd, ei, best-fixed"
    assert words in found.stderr
    assert "did you mean best-fixed?" in found.stderr


def test_policies_of_one_name_are_all_in_the_figure_and_one_seed_has_no_interval(tmp_path, monkeypatch):
    import jshape_envs.evaluate as judged

    from jshape.reports import plot

    drawn, values = {}, iter((0.2, 0.1, 0.3))
    monkeypatch.setattr(judged, "named_policy", lambda name, params: judged.baseline("zvd", params))
    monkeypatch.setattr(judged, "evaluate", lambda *_: None)
    row = judged.interval(np.array([1.0]))
    monkeypatch.setattr(
        judged, "summary", lambda _: dict.fromkeys(COLUMNS, row) | {"regret": row._replace(middle=next(values))}
    )
    monkeypatch.setattr(plot, "regret", drawn.update)
    monkeypatch.setattr(plot, "save", lambda *_: None)
    names = ("one/policy.npz", "two/policy.npz", "three/other.npz")
    other = typer.Typer()
    other.command()(evaluate)
    given = [word for name in names for word in ("--policy", name)]
    found = CliRunner().invoke(other, ["DuffingPayload", *given, "--seeds", "1", "--out", str(tmp_path / "x")])
    assert found.exit_code == 0, found.output
    assert list(drawn) == ["one/policy.npz", "two/policy.npz", "other"]
    assert "nan" not in found.output


def test_an_interrupted_evaluation_goes_on_where_it_was(tmp_path, monkeypatch):
    import jshape_envs.evaluate as judged

    from jshape.reports import plot

    row, asked = judged.interval(np.array([1.0])), []

    def score(name, *_):
        asked.append(name)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return dict.fromkeys(COLUMNS, row)

    monkeypatch.setattr(judged, "named_policy", lambda name, params: name)
    monkeypatch.setattr("jshape_envs.families.informed", lambda made, params: made)
    monkeypatch.setattr(judged, "evaluate", score)
    monkeypatch.setattr(judged, "summary", lambda scores: scores)
    monkeypatch.setattr(plot, "save", lambda *_: None)
    other = typer.Typer()
    other.command()(evaluate)
    given = ["DuffingPayload", "--policy", "zv", "--policy", "zvd", "--out", str(tmp_path / "x")]
    assert CliRunner().invoke(other, [*given, "--seeds", "1"]).exit_code == 130
    # Of another evaluation nothing is taken over.
    assert CliRunner().invoke(other, [*given, "--seeds", "2"]).exit_code == 0
    assert asked == ["zv", "zvd", "zv", "zvd"]

    asked.clear()
    assert CliRunner().invoke(other, [*given, "--seeds", "1"]).exit_code == 130
    found = CliRunner().invoke(other, [*given, "--seeds", "1"])
    assert found.exit_code == 0, found.output
    assert asked == ["zv", "zvd", "zvd"]
    assert "goes on after an interrupt; judged already: zv\n" in found.stderr
    record = json.loads((tmp_path / "x" / "results.json").read_text())
    assert record["finished"] is True
    assert list(record["policies"]) == ["zv", "zvd"]
    # A finished one begins anew.
    assert CliRunner().invoke(other, [*given, "--seeds", "1"]).exit_code == 0
    assert asked == ["zv", "zvd", "zvd", "zv", "zvd"]
