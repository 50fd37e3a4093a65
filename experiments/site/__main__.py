"""The documentation as web pages: python -m experiments.site [--out FOLDER] [--quick]

The repository's documents are copied in their folders, so that their links hold here as they do there; beside them
stand the gallery, whose examples are run, the studio's pictures, which are taken (neither with ``--quick``), and the
reference, made of docstrings. A warning, such as that of a link that leads nowhere, ends the build. Nothing is loaded
from a network. Needs the extra ``[docs]``, and ``[studio]``, playwright and a Chromium for the pictures.
"""

import argparse
import inspect
import re
import shutil
import sys
from pathlib import Path
from types import ModuleType

import jshape_envs
from sphinx.application import Sphinx

import jshape as js
from experiments.site.pictures import illustrate, without_pictures

ROOT = Path(__file__).resolve().parents[2]

ROOMS: dict[str, ModuleType] = {
    "jshape": js,
    "jshape.plants": js.plants,
    "jshape.design.energy": js.design.energy,
    "jshape.design.linear": js.design.linear,
    "jshape.design.insensitive": js.design.insensitive,
    "jshape.design.switching": js.design.switching,
    "jshape.reports.plot": js.plot,
    "jshape.calibration": js.calibration,
    "jshape.adaptive": js.adaptive,
    "jshape.moves": js.moves,
    "jshape_envs": jshape_envs,
}
"""What the reference lists: modules by the name under which a user finds their members."""

STUDIO = Path("experiments/site/tour/studio.md")
"""The page with pictures that are taken while it is built."""

COPIED = ("*.md", "*.svg", "*.py", "*.json", "*.csv", "*.rst")
"""Documents, and what they link to."""

REDIRECT = (
    '<!doctype html><meta http-equiv="refresh" content="0; url=experiments/site/index.html"><title>jshape</title>\n'
)


def main() -> None:
    parser = argparse.ArgumentParser(description="builds the documentation")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "site", help="folder of the pages")
    parser.add_argument("--quick", action="store_true", help="show the examples of the gallery, do not run them")
    given = parser.parse_args()
    build(given.out.resolve(), run=not given.quick)
    print(f"{given.out}/index.html: written")


def build(out: Path, run: bool) -> None:
    """Build the pages.

    Args:
        out: folder of the pages; the sources from which Sphinx makes them are put into ``out/.sources``.
        run: whether the examples of the gallery are run.

    Raises:
        SystemExit: if Sphinx reports a warning or fails.
    """
    sources = out / ".sources"
    shutil.rmtree(sources, ignore_errors=True)
    assemble(sources)
    if run:
        illustrate(sources / STUDIO)
    else:
        without_pictures(sources / STUDIO)
    app = Sphinx(
        sources, None, out, out / ".doctrees", "html", confoverrides=configuration(sources, run), warningiserror=True,
        freshenv=True, status=None,
    )  # fmt: skip
    app.connect("autodoc-process-docstring", as_written)
    app.build()
    if app.statuscode:
        sys.exit(app.statuscode)
    (out / "index.html").write_text(REDIRECT, encoding="utf-8")


def assemble(sources: Path) -> None:
    """Put every document where it stands in the repository, and a page of the reference for each room beside them."""
    for name in ("README.md", "LICENSE", ".github/CHANGELOG.md", ".github/CONTRIBUTING.md"):
        (sources / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, sources / name)
    for pattern in COPIED:
        for path in (ROOT / "experiments").rglob(pattern):
            copy = sources / path.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, copy)
            if pattern == "*.md" and not (text := path.read_text(encoding="utf-8")).startswith("# "):
                copy.write_text(f"# {path.parent.name.capitalize()}: {path.stem}\n\n{text}", encoding="utf-8")
    folder = sources / "api"
    folder.mkdir()
    described: set[int] = set()
    for name, room in ROOMS.items():
        (folder / f"{name}.rst").write_text(reference(name, room, described), encoding="utf-8")
    entries = "\n".join(f"   {name}" for name in ROOMS)
    head = "Reference\n=========\n\nMade of the docstrings.\n\n.. toctree::\n   :maxdepth: 1\n\n"
    (folder / "index.rst").write_text(head + entries + "\n", encoding="utf-8")


def reference(name: str, room: ModuleType, described: set[int]) -> str:
    """The page of one room: its docstring, then every public class and function.

    Args:
        name: by which a user finds the room.
        room: the module.
        described: what other pages have in the index already; what this one has is added.
    """
    lines = [name, "=" * len(name), "", f".. automodule:: {room.__name__}", "   :no-members:", ""]
    for member in sorted(public(room), key=str.lower):
        found = getattr(room, member)
        if not callable(found):
            continue
        kind, options = ("class", ["members", "show-inheritance"]) if inspect.isclass(found) else ("function", [])
        options += ["no-index"] if id(found) in described else []
        described.add(id(found))
        lines += [f".. auto{kind}:: {name}.{member}", *(f"   :{option}:" for option in options), ""]
    return "\n".join(lines)


def as_written(app: Sphinx, what: str, name: str, found: object, options: object, lines: list[str]) -> None:
    """Bars, as in |x|, and the star of (times, *axes) are kept, which reStructuredText takes for marks.

    Code that touches a letter or a sign, as in ±``limit``, is code as well.
    """
    marks = re.compile(r"(``.*?``)|(\||(?<![*\\])\*(?=\w+[^\w*]))")
    lines[:] = [marks.sub(lambda mark: mark[1] or "\\" + mark[2], line) for line in lines]
    code = re.compile(r"([^\s`(\[{<\"'/:-])?(``[^`]+``)(\w)?")
    lines[:] = [code.sub(lambda part: "\\ ".join(filter(None, part.groups())), line) for line in lines]


def public(room: ModuleType) -> list[str]:
    """The names that a module offers: its ``__all__``, or the functions and classes of the package that it names."""
    listed = getattr(room, "__all__", None) or [
        name for name, found in vars(room).items() if getattr(found, "__module__", "").startswith("jshape")
    ]
    return [name for name in listed if not name.startswith("_")]


def configuration(sources: Path, run: bool) -> dict[str, object]:
    """The settings that Sphinx reads from a ``conf.py`` elsewhere."""
    return {
        "project": "jshape",
        "copyright": "the jshape authors",
        "release": js.__version__,
        "root_doc": "experiments/site/index",
        "extensions": [
            "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery",
        ],
        "source_suffix": {".rst": "restructuredtext", ".md": "markdown"},
        "exclude_patterns": ["experiments/gallery"],
        "myst_heading_anchors": 4,
        "html_theme": "pydata_sphinx_theme",
        "html_title": "jshape",
        "html_show_sourcelink": False,
        "html_theme_options": {
            "navigation_with_keys": False, "secondary_sidebar_items": ["page-toc"], "header_links_before_dropdown": 9,
            "logo": {"text": "jshape"},
        },
        "html_static_path": [str(ROOT / "experiments" / "site" / "static")],
        "html_css_files": ["pages.css"],
        # Pages without others below them have no navigation at their side.
        "html_sidebars": {f"experiments/site/{page}": [] for page in ("install", "concepts", "guide", "questions")},
        "autodoc_typehints": "none",
        "toc_object_entries_show_parents": "hide",
        # What a base class of another library says is found there.
        "autodoc_inherit_docstrings": False,
        "autodoc_default_options": {"exclude-members": "__init__"},
        "napoleon_use_ivar": True,
        "napoleon_attr_annotations": False,
        "sphinx_gallery_conf": {
            "examples_dirs": str(sources / "experiments" / "gallery"),
            "gallery_dirs": "gallery",
            "plot_gallery": run,
            "abort_on_example_error": True,
            "within_subsection_order": "FileNameSortKey",
            "download_all_examples": False,
            "show_memory": False,
            # Figures are sharp on a screen of any resolution.
            "image_srcset": ["2x"],
            "min_reported_time": 1e9,
        },
    }  # fmt: skip


if __name__ == "__main__":
    main()
