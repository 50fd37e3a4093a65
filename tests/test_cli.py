"""The command line as its user meets it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import jshape as js
from jshape._files import write_results
from jshape.cli import app
from jshape.cli._artist import artist
from jshape.cli._shared import explained, results_folder, results_name
from jshape.export import read_shaper
from jshape.problems.reading import shipped

run = CliRunner().invoke


def test_help_without_jax():
    """Help must not wait for JAX: it is not imported."""
    code = (
        "import sys\nfrom typer.testing import CliRunner\nfrom jshape.cli import app\n"
        "out = CliRunner().invoke(app, ['--help'])\nassert 'tune' in out.output\nassert 'jax' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_mistakes_end_with_a_line_and_status_2(tmp_path):
    wrong, text = tmp_path / "wrong.toml", shipped()["paper_000"].read_text(encoding="utf-8")
    wrong.write_text(text.replace("[design]", "[design]\ncommand_overshoot = { hoist = 0.1 }"), encoding="utf-8")
    for arguments, words in [
        (["tune", str(wrong), "--out", str(tmp_path / "o")], "toml:21: design.command_overshoot: must be numeric"),
        (["tune", str(tmp_path)], "is a directory"),
        (["tune", "no_such_problem"], "no such file"),
        (["compare", str(tmp_path / "x.toml")], "no such file"),
        (["new", str(tmp_path / "a" / "b.toml")], "no such folder"),
        (["tune", "paper_000", "--starts", "0", "--out", str(tmp_path / "out")], "starts must be a whole number"),
        (["new", str(tmp_path / "c.toml"), "--like", "nothing"], "no shipped problem"),
    ]:
        result = run(app, arguments)
        assert result.exit_code == 2
        assert words in result.output
        assert "Traceback" not in result.output


@pytest.mark.parametrize("words", ["RESOURCE_EXHAUSTED: Out of memory", "INTERNAL: Out of memory allocating 9 bytes"])
def test_a_full_memory_and_control_characters_are_a_line(words, capsys):
    with pytest.raises(typer.Exit) as ended, explained():
        raise RuntimeError(words)
    assert ended.value.exit_code == 2
    with pytest.raises(RuntimeError, match="another"), explained():
        raise RuntimeError("another")
    with pytest.raises(typer.Exit), explained():
        raise ValueError("\x1b[2J\udcff" + "x" * 5000)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "jshape: the memory is full"
    assert second.startswith("jshape: \\x1b[2J\\udcffxxx")
    assert len(second) < 3100


def test_foreign_files_are_not_written_over(tmp_path):
    (tmp_path / "precious.txt").write_text("mine", encoding="utf-8")
    result = run(app, ["compare", "paper_000", "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert "holds files that are not jshape's" in result.output
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]


def test_compare_says_why_no_closed_form_applies(tmp_path):
    (tmp_path / "cubic.toml").write_text(
        'distance = "5 N"\n[plant]\ntype = "ForcedMass"\nspring = { type = "PowerLawSpring", k = 10, power = 3 }\n'
    )
    result = run(app, ["compare", str(tmp_path / "cubic.toml"), "--out", str(tmp_path / "cubic")])
    assert result.exit_code == 2
    assert "no closed form applies to cubic: linear shapers: the plant has no natural frequency" in result.output


def test_an_earlier_result_is_named(tmp_path, capsys):
    write_results(tmp_path, {})
    assert results_folder(tmp_path, "unused") == tmp_path
    assert f"{tmp_path}: holds an earlier result, which a new one replaces" in capsys.readouterr().err
    assert results_folder(None, "other-results") == Path("other-results")
    assert capsys.readouterr().err == ""


def test_results_of_two_identified_axes_do_not_meet():
    assert results_name(Path("crane.toml")) == results_name(Path("machines/crane.toml")) == "crane-results"
    assert results_name(Path("problem.toml")) == "problem-results"
    assert results_name(Path("x-results/problem.toml")) == "x-problem-results"
    assert results_name(Path("data/y-results/problem.toml")) == "y-problem-results"


@pytest.mark.slow
def test_figures_are_drawn_in_processes_of_their_own(tmp_path):
    # They are on disk when the block ends, and what goes wrong there is raised here.
    history = np.array([3.0, 1.0, 0.5])
    with artist() as draw:
        draw(tmp_path / "a.png", "convergence", history, "worst")
        draw(tmp_path / "b.png", "convergence", history, "mean")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.pdf", "a.png", "b.pdf", "b.png"]
    with pytest.raises(FileNotFoundError), artist() as draw:
        draw(tmp_path / "nowhere" / "a.png", "convergence", history, "worst")


@pytest.mark.parametrize("loaded", [False, True])
def test_an_interrupt_ends_the_process_until_jax_is_loaded(loaded):
    """A KeyboardInterrupt inside JAX crashed one process in four that was interrupted while loading it."""
    code = (
        "import os, signal, sys, time; from jshape.cli import _interrupt\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n_interrupt.end_at_interrupts()\n"
        f"if {loaded}: _interrupt.raise_interrupts()\n"
        "try: os.kill(os.getpid(), signal.SIGINT); time.sleep(60)\nexcept KeyboardInterrupt: sys.exit(7)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=50)
    assert (ended.returncode, ended.stderr) == ((7, "") if loaded else (130, "jshape: interrupted\n"))


def test_processes_that_draw_end_with_a_command_that_ended_before_they_began():
    """Interrupted while it loads its libraries, a command left two of them for good, who held its output open."""
    code = "import os; from jshape.cli._artist import artist\nwith artist(): os._exit(3)"
    # Returns once nobody has the output open.
    ended = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, timeout=120)
    assert ended.returncode == 3


def test_new_writes_once(tmp_path):
    path = tmp_path / "mine.toml"
    assert run(app, ["new", str(path), "--like", "own_plant"]).exit_code == 0
    assert (tmp_path / "own_plant.py").exists()
    result = run(app, ["new", str(path)])
    assert result.exit_code == 2
    assert "exists already" in result.output


@pytest.mark.slow
def test_tune_the_uncertain_payload(tmp_path):
    """The main job, from the file to the folder: 6.9 times better than the paper's optimal three-impulse shaper."""
    out = tmp_path / "out"
    result = run(app, ["tune", "paper_001", "--out", str(out)])
    assert result.exit_code == 0, result.output
    # How much there is to do comes first: a step and three impulses make two segments.
    assert "work: 41 plants × 32 starts × 2 segments of a move" in result.output.splitlines()[0]
    numbers = json.loads((out / "results.json").read_text(encoding="utf-8"))
    rows = {row["name"]: row for row in numbers["shapers"]}
    paper, tuned = rows["energy 3-impulse"], rows["tuned"]
    # 0.0413257 J is the reference's value for the paper's shaper at m2 −20 %.
    np.testing.assert_allclose(paper["worst_residual_energy"], 0.04132570631074358, rtol=1e-8)
    assert paper["worst_residual_energy"] / tuned["worst_residual_energy"] > 6.9
    assert tuned["move_time"] <= paper["move_time"] * (1 + 1e-9)
    # Twice into the same folder is allowed: it holds jshape's own results.
    for figure in ("response", "energy", "sensitivity_m2", "convergence"):
        assert (out / "figures" / f"{figure}.png").stat().st_size > 10_000
    shaper = read_shaper(out / "shapers" / "tuned.json")
    assert shaper.amplitudes.tolist() == tuned["amplitudes"]
    assert read_shaper(out / "shapers" / "tuned.csv").times.tolist() == tuned["times"]


@pytest.mark.slow
def test_another_process_finds_the_programs_and_tells_the_same(tmp_path):
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "cache")}
    told, programs = [], []
    for name in ("first", "second"):
        arguments = ["-m", "jshape", "tune", "paper_000", "--out", str(tmp_path / name)]
        subprocess.run([sys.executable, *arguments], check=True, env=environment, capture_output=True)
        told.append((tmp_path / name / "results.json").read_bytes())
        programs.append({path.name: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("programs/*/*")})
    assert told[0] == told[1]
    # The second one has written none; the search, the kernel and the closed forms are among them.
    assert programs[0] == programs[1]
    kept = {name.partition("-")[0] for name in programs[0]}
    assert {
        "jshape.design.tuning.evaluate.linearise",
        "jshape.design.tuning.evaluate.evaluate",
        "jshape.sweeps.evaluate._many",
    } <= kept


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stage", "status"),
    [
        ("design.tuning.local_search.Descent.running", js.Status.INTERRUPTED),
        ("reports.report.build", js.Status.CONVERGED),
        ("reports.report_files.figures", js.Status.CONVERGED),
    ],
)
def test_an_interrupted_search_is_written(stage, status, tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"jshape.{stage}", interrupt)
    result = run(app, ["tune", "own_plant", "--starts", "1", "--out", str(tmp_path / "out")])
    assert result.exit_code == 130, result.output
    record = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert record["tuned"]["status"] == status.value
    assert record["shapers"][-1]["name"] == "tuned"
    # What had been computed when it came is there, too.
    assert (len(record["shapers"]) > 1) == (stage == "reports.report_files.figures")


@pytest.mark.slow
def test_a_plant_of_ones_own_and_its_warning(tmp_path):
    result = run(app, ["tune", "own_plant", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "runs code of its own, the plant own_plant:SinhMass" in result.output
    rows = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["shapers"]
    worst = {row["name"]: row["worst_residual_energy"] for row in rows}
    # The linear ZVD of the same duration, designed for the stiffness at rest.
    assert worst["tuned"] < worst["linear ZVD"] / 4


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
@pytest.mark.parametrize("arguments", [["tune", "nothing"], ["--nonsense"]])
def test_a_full_disk_for_messages_changes_no_status(arguments):
    """It was 1 where a line could not be printed."""
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run([sys.executable, "-m", "jshape", *arguments], stderr=full, check=False)
    assert done.returncode == 2
