"""What the README and the documents behind it show works as it stands there."""

import re
from pathlib import Path

import matplotlib as mpl
import pytest

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
        assert names["tuned"].objective_on_finer_set < 0.00594 * 1.001


def test_no_document_with_python_is_left_out():
    found = {path.relative_to(ROOT).as_posix() for path in [ROOT / "README.md", *ROOT.glob("experiments/**/*.md")]}
    assert {name: len(blocks(name)) for name in sorted(found) if blocks(name)} == dict(sorted(DOCUMENTS.items()))


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
        assert other.exists(), f"{document} links to {target}"
        if heading:
            titles = re.findall(r"^#+ (.*)$", other.read_text(encoding="utf-8"), re.M)
            anchors = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
            assert heading in anchors, f"{document} links to {target}#{heading}"
