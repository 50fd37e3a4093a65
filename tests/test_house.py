"""The house itself, read and not run: no circle of imports, no private names of other rooms, short functions."""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import jshape as js

ROOT = Path(__file__).parents[1]
PACKAGES = {
    name: ROOT / folder
    for name, folder in (("jshape", "jshape"), ("jshape_envs", "envs/jshape_envs"), ("experiments", "experiments"))
}

LONGEST = 60
"""Lines of a function's body, from its first statement after the docstring to its end."""

NOT_OUR_WORDS = (
    "calmest",
    "skirt",
    "louder",
    "will not come back",
    "prices of",
    "told",
    "doubted",
    "gets lost",
    "is lost",
)
"""What the vocabulary of CONTRIBUTING.md replaces: infeasible, leakage, diverged, multipliers, rejected."""


def files() -> dict[str, Path]:
    """Every module of the packages by its dotted name; a package stands for its ``__init__``."""
    found = {}
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = (package, *path.relative_to(folder).with_suffix("").parts)
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


FILES = files()


@functools.cache
def tree(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text())


def when_imported(node: ast.AST) -> Iterator[ast.AST]:
    """The statements that run when the module is imported: those of functions and of type checkers do not."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        yield child
        yield from when_imported(child)


def imported(module: str, nodes: Iterator[ast.AST]) -> Iterator[tuple[str, str | None]]:
    """Modules and, with ``from``, the names that statements import, of these packages alone."""
    package = module if FILES[module].name == "__init__.py" else module.rpartition(".")[0]
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names if alias.name.partition(".")[0] in PACKAGES)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parents, *filter(None, [base])])
            if base.partition(".")[0] in PACKAGES:
                yield from ((base, alias.name) for alias in node.names)


def targets(module: str) -> set[str]:
    """The modules that a module needs at import."""
    found = set()
    for base, name in imported(module, when_imported(tree(module))):
        inner = f"{base}.{name}"
        found.add(inner if inner in FILES else base)
    return {target for target in found if target in FILES and target != module}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules of which each imports the next and the last one the first; empty where there is no such circle."""
    done: set[str] = set()

    def visit(module: str, path: list[str]) -> list[str]:
        if module in path:
            return [*path[path.index(module) :], module]
        if module in done:
            return []
        for target in sorted(graph.get(module, ())):
            if found := visit(target, [*path, module]):
                return found
        done.add(module)
        return []

    return next((found for module in sorted(graph) if (found := visit(module, []))), [])


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]


def test_imports_have_no_circle():
    graph = {module: targets(module) for module in FILES}
    assert sum(map(len, graph.values())) > len(graph)
    assert circle(graph) == []


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def foreign(module: str, base: str, name: str | None) -> bool:
    """Whether a module reaches into another room: what is private in a package is for those inside it alone.

    Private modules at the top (``jshape._check``) are every room's; private names in the modules there are theirs.
    """
    parts = base.split(".") if name is None else [*base.split("."), name]
    if ".".join(parts[:2]) in FILES and any(map(private, parts[:2])):
        return any(map(private, parts[2:]))
    first = next((i for i, part in enumerate(parts) if private(part)), None)
    if first is None:
        return False
    room = ".".join(parts[:first])
    package = room if FILES.get(room, Path("__init__.py")).name == "__init__.py" else room.rpartition(".")[0]
    inside = (module if FILES.get(module, Path()).name == "__init__.py" else module.rpartition(".")[0]) == package
    return not (inside if package in PACKAGES else f"{module}.".startswith(f"{package}."))


def test_what_is_foreign():
    assert foreign("jshape.sweeps.sweep", "jshape.design.tuning._search", "best")
    assert foreign("jshape.sweeps.sweep", "jshape.metrics", "_profile")
    assert foreign("jshape.sweeps.sweep", "jshape._check", "_scalar")
    assert not foreign("jshape.sweeps.sweep", "jshape", "_check")
    assert not foreign("jshape.sweeps.sweep", "jshape._check", "scalar")
    assert not foreign("jshape.sweeps.sweep", "jshape.sweeps._grid", "steps")
    assert not foreign("jshape.design.tuning.slsqp", "jshape.design._search", "best")


def reached(module: str) -> Iterator[tuple[str, str]]:
    """Attributes ``name._private`` of imported modules."""
    nodes = [node for node in ast.walk(tree(module)) if isinstance(node, ast.Import | ast.ImportFrom)]
    bound = {}
    for node in nodes:
        for (base, name), alias in zip(imported(module, iter([node])), node.names, strict=False):
            target = base if name is None else f"{base}.{name}"
            if target in FILES:
                bound[alias.asname or alias.name] = target
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Attribute) and private(node.attr) and ast.unparse(node.value) in bound:
            yield bound[ast.unparse(node.value)], node.attr


def test_no_private_name_of_another_room():
    """Neither imported nor reached through its module."""
    wrong = [
        f"{module}: {base}{'' if name is None else f'.{name}'}"
        for module in FILES
        for base, name in [*imported(module, ast.walk(tree(module))), *reached(module)]
        if foreign(module, base, name)
    ]
    assert wrong == []


def bodies(module: str) -> Iterator[tuple[str, int]]:
    """Every function of a module and the lines of its body, the docstring not counted."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            yield node.name, (node.end_lineno - body[0].lineno + 1 if body else 0)


def test_functions_are_short():
    long = {f"{module}.{name}": lines for module in FILES for name, lines in bodies(module) if lines > LONGEST}
    assert long == {}


def test_file_names_have_no_spaces():
    kept = ("jshape", "envs", "experiments", "tests")
    names = [path.relative_to(ROOT) for folder in kept for path in (ROOT / folder).rglob("*")]
    assert names
    assert [str(name) for name in names if any(character.isspace() for character in str(name))] == []


@pytest.mark.parametrize("module", [js, js.plants], ids=["jshape", "jshape.plants"])
def test_listing_shows_public_names_only(module):
    listed = [name for name in dir(module) if not name.startswith("__")]
    assert [name for name in listed if name.startswith("_")] == []
    assert set(listed) == set(module.__all__) - {name for name in module.__all__ if name.startswith("__")}
    assert all(hasattr(module, name) for name in listed)


LISTED = [name for name, path in FILES.items() if path.name == "__init__.py" and not name.startswith("experiments")]
"""Packages whose docstrings list their modules; what the experiments are, their README files say."""


@pytest.mark.parametrize("package", LISTED)
def test_package_names_its_modules(package):
    """One line a module in the docstring of every package with more than six, and none for a module that is gone.

    Private modules may be left out: they are listed where a package has hardly any others.
    """
    inside = {name.rpartition(".")[2] for name in FILES if name.rpartition(".")[0] == package} - {"__main__"}
    named = re.findall(r"^- ``(\w+)``: ", ast.get_docstring(tree(package)) or "", re.MULTILINE)
    assert len(named) == len(set(named))
    assert set(named) <= inside
    if len(inside) > 6:
        assert {name for name in inside if not private(name)} <= set(named)


@pytest.mark.parametrize("words", NOT_OUR_WORDS)
def test_vocabulary(words):
    pattern = re.compile(rf"\b{words}\b", re.IGNORECASE)
    lines = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in FILES.values()
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if pattern.search(line)
    ]
    assert lines == []
