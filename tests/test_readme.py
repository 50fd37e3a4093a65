"""What the README and the documents behind it show works as it stands there."""

import json
import re
import tomllib
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import jshape as js

ROOT = Path(__file__).parent.parent
LEARNING = "experiments/learning/README.md"
DOCUMENTS = {"README.md": 2, "experiments/site/guide.md": 7, LEARNING: 1}
"""Every document with Python in it, and how many blocks it has."""


def blocks(document: str) -> list[str]:
    """The Python blocks of a document, in order."""
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(encoding="utf-8"), re.S)


@pytest.mark.parametrize("document", [pytest.param(name, marks=pytest.mark.slow) for name in DOCUMENTS])
def test_python_blocks_run(document):
    mpl.use("Agg")
    names: dict[str, object] = {}
    for block in blocks(document):
        exec(compile(block, document, "exec"), names)
    if document == "README.md":
        tuned, closed = names["tuned"], names["closed"]
        assert tuned.objective_on_finer_set < 0.00594 * 1.001
        payloads = {"m2": np.linspace(0.8, 1.2, 41)}
        worst = float(js.sweep(names["plant"], closed, 1.0, payloads, "residual_energy").residual_energy.max())
        assert f"{worst / tuned.objective:.3g} times less energy" in (ROOT / document).read_text(encoding="utf-8")


def test_no_document_with_python_is_left_out():
    found = {path.relative_to(ROOT).as_posix() for path in [ROOT / "README.md", *ROOT.glob("experiments/**/*.md")]}
    assert {name: len(blocks(name)) for name in sorted(found) if blocks(name)} == dict(sorted(DOCUMENTS.items()))


def test_every_extra_is_named():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    page = (ROOT / "experiments" / "site" / "install.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `(\w+)` \|", page, re.M)) == sorted(extras)


def test_the_front_page_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


PAGES = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("experiments/site/**/*.md"))
OTHERS = [".github/CONTRIBUTING.md", "experiments/benchmarks/README.md"]


@pytest.mark.parametrize("document", sorted({*DOCUMENTS, *PAGES, *OTHERS}))
def test_links_lead_somewhere(document):
    """Files that a document links to exist, and so do the headings in them."""
    path = ROOT / document
    for target, _, heading in re.findall(r"\]\((?!https?:)([^)#\s]*)(#([^)\s]*))?\)", path.read_text(encoding="utf-8")):
        other = (path.parent / target).resolve() if target else path
        # The studio's pictures are taken while the pages are built.
        if other.suffix == ".png":
            continue
        assert other.exists(), f"{document} links to {target}"
        if heading:
            titles = re.findall(r"^#+ (.*)$", other.read_text(encoding="utf-8"), re.M)
            anchors = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
            assert heading in anchors, f"{document} links to {target}#{heading}"


BENCHMARKS = ["benchmarks/kernel.json", "benchmarks/growth.json"]
SOURCES = {
    "README.md": BENCHMARKS,
    "experiments/benchmarks/README.md": [*BENCHMARKS, "benchmarks/card.json", "benchmarks/lorenz.json"],
    "experiments/adaptive/README.md": [
        *("benchmarks/adaptive.json", "adaptive/recovery.md", "adaptive/nonlinear.md", "adaptive/within_move.md"),
    ],
    LEARNING: [f"learning/{name}" for name in ("leaderboard.json", "learning.md", "never_worse.json")],
}
"""Documents written by hand, and the files under experiments that scripts wrote, in which their numbers stand."""

NUMBER = r"(?<![\w.])\d[\d,]*(?:\.\d+(?:e[+-]?\d+)?|e[+-]?\d+)(?!\w)"
SETTINGS = ("1e-9", "1e-8", "0.27", "3.11", "0.2.0", "6.96")
"""Tolerances, versions and inputs; and what ``test_python_blocks_run`` computes."""


def numbers(path: Path) -> set[float]:
    """Every number of a JSON file or of a table."""
    found: set[float] = set()

    def collect(value: object) -> None:
        if isinstance(value, dict | list):
            for inner in value.values() if isinstance(value, dict) else value:
                collect(inner)
        elif isinstance(value, int | float):
            found.add(float(value))

    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        collect(json.loads(text))
    else:
        found |= {float(each.replace(",", "")) for each in re.findall(r"\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?", text)}
    return found


@pytest.mark.parametrize("document", SOURCES)
def test_numbers_stand_in_files_that_scripts_wrote(document):
    """Each fraction and power of ten, as it is rounded there; or a hundred or a thousand times that, for units."""
    known = set().union(*(numbers(ROOT / "experiments" / source) for source in SOURCES[document]))
    text = (ROOT / document).read_text(encoding="utf-8")
    text = text.partition("## How fast")[2] if document == "README.md" else text
    for shown in set(re.findall(NUMBER, re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)", "", text, flags=re.S))) - set(
        SETTINGS
    ):
        if "e" in shown:
            digits = len(shown.partition("e")[0].replace(".", "")) - 1
            found = any(f"{value:.{digits}e}" == f"{float(shown):.{digits}e}" for value in known)
        else:
            digits = len(shown.partition(".")[2])
            found = any(
                f"{size * value:.{digits}f}" == shown.replace(",", "") for value in known for size in (1, 100, 1000)
            )
        assert found, f"{document}: {shown} stands in none of {', '.join(SOURCES[document])}"
