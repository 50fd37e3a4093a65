"""Every example of the gallery runs as it stands, draws, and finds what its text says; the documentation builds."""

import importlib.util
import re
import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "experiments" / "gallery"


def each_is_best_by_its_own_measure(names) -> bool:
    return all(min(row, key=row.get) == measure for measure, row in names["measured"].items())


FINDS = {
    "first_shaper": lambda n: n["left"]["ZV"] < 1e-9 < 1 < n["left"]["unshaped"],
    "crane_to_plc": lambda n: (
        float(n["worst"].min()) == float(n["worst"].sel(shaper=n["best"])) < float(n["worst"].sel(shaper="zv")) / 2
        and "FUNCTION_BLOCK TrolleyShaper" in n["code"]
    ),
    "double_pendulum": lambda n: n["energies"]["both modes"] < n["energies"]["slow mode"] / 10,
    "printer": lambda n: (
        abs(n["found"].modes[0][0].frequency - 61) < 1.5
        and n["found"].offer.rated.smoothing < n["found"].choice.best.smoothing
    ),
    "own_plant": lambda n: n["left"]["tuned"] < 1e-6 < 0.1 < n["left"]["linear ZV"],
    "two_uncertain_leaves": lambda n: n["found"].residual_vibration.shape == (2, 21, 21),
    "pareto": lambda n: bool((np.diff(n["front"].objective.values, axis=1) <= 1e-9).all()),
    "objectives": each_is_best_by_its_own_measure,
    "measured_record": lambda n: abs(float(n["found"].omega[0]) - np.hypot(8.5, 0.15)) < 0.01 and n["left"] < 1e-3,
    "adaptive": lambda n: max(n["late"]["state-aware"][-3:]) < min(n["late"]["I"][-3:]) / 2,
    "gymnasium": lambda n: n["left"]["policy"].mean() < n["left"]["action 0"].mean() / 2,
    "many_plants": lambda n: n["found"].sizes["sample"] == 100_000 and float(n["vibration"].min()) >= 0,
    "paper_figure": lambda n: float(n["inside"].min()) == float(n["inside"].sel(shaper="tuned")),
    "gradients": lambda n: np.isclose(float(n["slopes"][0]), float(n["difference"]), rtol=1e-6),
    "hoisting": lambda n: min(n["energies"]) < n["before"] / 2 and 0 < int(np.argmin(n["energies"])) < 40,
}
"""Example → whether its numbers, by their names in the script, are what its text says."""

SCRIPTS = {path.stem[len("plot_00_") :]: path for path in sorted(GALLERY.glob("plot_*.py"))}


def test_no_example_is_left_out():
    assert list(SCRIPTS) == list(FINDS)
    assert len(SCRIPTS) >= 14


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_example(name, capsys, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.chdir(tmp_path)
    try:
        found = runpy.run_path(str(SCRIPTS[name]))
        assert plt.get_fignums()
        for number in plt.get_fignums():
            plt.figure(number).canvas.draw()
    finally:
        plt.close("all")
    assert capsys.readouterr().out.strip()
    assert FINDS[name](found)
    assert list(tmp_path.iterdir()) == []


def test_examples_have_no_numbers_of_their_own():
    """Results are printed, not written into the text: no decimal fraction stands in a comment or a docstring.

    Inputs, such as lengths and speeds that the script also states in code, may be repeated.
    """
    for path in SCRIPTS.values():
        text = path.read_text(encoding="utf-8")
        words = "\n".join([text.split('"""')[1], *re.findall(r"^# (?!%%)(.*)$", text, re.M)])
        code = re.sub(r'^""".*?"""|^#.*$', "", text, flags=re.M | re.S)
        assert [each for each in re.findall(r"\d+\.\d+", words) if each not in code] == [], path.name


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning(tmp_path):
    for needed in ("sphinx", "myst_parser", "pydata_sphinx_theme", "sphinx_gallery"):
        if importlib.util.find_spec(needed) is None:
            pytest.skip(f"{needed} is not installed: pip install 'jshape[docs]'")
    command = [sys.executable, "-m", "experiments.site", "--quick", "--out", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    pages = tmp_path / "site"
    for page in ("index.html", "experiments/site/guide.html", "api/jshape.html", "gallery/plot_01_first_shaper.html"):
        assert (pages / page).exists()
    # What is in the reference was found there: tune's arguments, a plant's fields.
    assert "starting points" in (pages / "api" / "jshape.html").read_text(encoding="utf-8")
    assert "cable_length" in (pages / "api" / "jshape.plants.html").read_text(encoding="utf-8")
