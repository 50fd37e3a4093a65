"""Faults as people make them in a module's source, one at a time.

    found = faults(source)            # every one that can be seeded, each with its kind and place
    seeded(source, found[3])          # the whole module with that fault and no other

Nothing is changed where a fault cannot matter, or where it makes a wrong word rather than a wrong number: annotations,
docstrings, formatted text, the messages of errors, decorators, assertions; tolerances (below 1e-4) and numbers of steps
(integers above 16), which choose how much is computed.
"""

import ast
import copy
import itertools
from collections import Counter
from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

OPPOSITE = {
    ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Eq: ast.NotEq, ast.Is: ast.IsNot, ast.In: ast.NotIn,
    ast.Add: ast.Sub, ast.Mult: ast.Div,
}  # fmt: skip
OPPOSITE |= {after: before for before, after in OPPOSITE.items()}

EXCHANGED = {"min": "max", "minimum": "maximum", "argmin": "argmax", "floor": "ceil", "sin": "cos"}
EXCHANGED |= {after: before for before, after in EXCHANGED.items()}

KINDS = (
    *("a sign", "a coefficient", "an index", "a comparison", "a skipped check", "plus and minus"),
    *("times and divided", "an exchanged function", "an axis", "a dropped term", "a dropped statement", "a flag"),
)

AXES = {"axis", "axes", "in_axes", "out_axes", "dimension"}

NO_MATTER = {"indent", "stacklevel", "strict"}
"""Keyword arguments that change no result."""

SMALLEST, LARGEST, MOST_STEPS = 1e-4, 1e4, 16
"""Numbers outside of these are tolerances, or as good as infinite; greater integers are numbers of steps."""

LONGEST = 64
"""Characters of a description."""


class Fault(NamedTuple):
    """A fault that can be seeded.

    Attributes:
        kind: one of ``KINDS``.
        line: of the source.
        name: what is changed, in which function; no other fault of the module has the same name.
        number: its place among the faults of the module.
    """

    kind: str
    line: int
    name: str
    number: int


class _Site(NamedTuple):
    """A node of the tree, where it hangs, and in which function; the node's ``place`` in the parent's list, if any."""

    node: ast.AST
    parent: ast.AST
    field: str
    place: int | None
    where: str

    def put(self, node: ast.AST) -> None:
        if self.place is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.place] = node


def faults(source: str) -> list[Fault]:
    """Every fault that can be seeded in a module."""
    seen: Counter[str] = Counter()
    found = []
    for number, (site, kind, changed) in enumerate(_seeds(ast.parse(source))):
        name = f"{site.where}: {_describe(site, changed)}"
        seen[name] += 1
        name += f" ({seen[name]})" if seen[name] > 1 else ""
        found.append(Fault(kind, getattr(site.node, "lineno", 0), name, number))
    return found


def seeded(source: str, fault: Fault) -> str:
    """The module with that fault, as Python writes it: without comments, one line a statement."""
    tree = ast.parse(source)
    site, _, changed = next(itertools.islice(_seeds(tree), fault.number, None))
    site.put(changed)
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _seeds(tree: ast.AST) -> Iterator[tuple[_Site, str, ast.AST]]:
    for site in _sites(tree, ""):
        for kind, changed in _changes(site):
            yield site, kind, changed


def _describe(site: _Site, changed: ast.AST) -> str:
    """What was there and what is there now, with what stands around it where that is short."""
    if isinstance(changed, ast.Pass):
        return f"{_short(site.node)} → nothing"
    before, after = _short(site.node), _short(changed)
    if isinstance(site.parent, ast.expr | ast.keyword | ast.Return) and not isinstance(site.node, ast.Compare):
        around = _short(site.parent)
        if not around.endswith("…"):
            site.put(changed)
            before, after = around, _short(site.parent)
            site.put(site.node)
    return f"{before} → {after}"


def _short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def _sites(parent: ast.AST, where: str) -> Iterator[_Site]:
    """Every node whose change can matter, from the top down."""
    if isinstance(parent, ast.Raise | ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
        return
    if isinstance(parent, ast.If) and "TYPE_CHECKING" in ast.unparse(parent.test):
        return
    if isinstance(parent, ast.FunctionDef | ast.ClassDef):
        where = f"{where}.{parent.name}".lstrip(".")
    for field, value in ast.iter_fields(parent):
        if field in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        if isinstance(parent, ast.keyword) and parent.arg in NO_MATTER:
            continue
        for place, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.AST):
                yield _Site(child, parent, field, place, where or "module")
                yield from _sites(child, where)


def _changes(site: _Site) -> Iterator[tuple[str, ast.AST]]:
    """The faults of one node: their kinds and what takes its place."""
    node = site.node
    if isinstance(node, ast.Constant):
        yield from _of_a_number(site, node)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and site.field != "slice":
        yield "a sign", node.operand
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert):
        yield "a comparison", node.operand
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OPPOSITE:
        yield "a comparison", _with(node, ops=[OPPOSITE[type(node.ops[0])]()])
    elif isinstance(node, ast.Raise) or _checks(node):
        yield "a skipped check", ast.copy_location(ast.Pass(), node)
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "a dropped statement", ast.copy_location(ast.Pass(), node)
    elif isinstance(node, ast.BinOp | ast.AugAssign):
        yield from _of_an_operation(node)
    elif isinstance(node, ast.BoolOp):
        kept = node.values[:-1]
        yield "a dropped term", kept[0] if len(kept) == 1 else _with(node, values=kept)
    elif isinstance(node, ast.Call):
        yield from _of_a_call(node)


def _with(node: Any, **fields: Any) -> Any:
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _checks(node: ast.AST) -> bool:
    """Whether a statement only calls something that checks an argument."""
    if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)):
        return False
    called = ast.unparse(node.value.func)
    return called.startswith("_check.") or "check" in called.rpartition(".")[2] or "_require" in called


def _of_a_number(site: _Site, node: ast.Constant) -> Iterator[tuple[str, ast.AST]]:
    value, parent = node.value, site.parent
    if not isinstance(value, int | float):
        return
    constant = partial(ast.copy_location, old_node=node)
    if isinstance(value, bool):
        yield "a flag", constant(ast.Constant(not value))
    elif isinstance(parent, ast.keyword) and parent.arg in AXES:
        yield "an axis", constant(ast.Constant(1 if value == 0 else value - 1))
    elif isinstance(value, int) and not _is_factor(parent):
        if value <= MOST_STEPS:
            yield "an index", constant(ast.Constant(value + 1))
    elif SMALLEST <= abs(value) <= LARGEST:
        yield "a coefficient", constant(ast.Constant(round(1.1 * value, 12)))


def _is_factor(parent: ast.AST) -> bool:
    return isinstance(parent, ast.BinOp) and not isinstance(parent.op, ast.Add | ast.Sub)


def _of_an_operation(node: ast.BinOp | ast.AugAssign) -> Iterator[tuple[str, ast.AST]]:
    if _is_text(node):
        return
    if type(node.op) in OPPOSITE:
        kind = "plus and minus" if isinstance(node.op, ast.Add | ast.Sub) else "times and divided"
        yield kind, _with(node, op=OPPOSITE[type(node.op)]())
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub | ast.BitAnd | ast.BitOr):
        yield "a dropped term", node.left


def _is_text(node: ast.AST) -> bool:
    """Whether an operation joins texts, lists or paths rather than numbers, as far as that can be seen."""
    if isinstance(node, ast.AugAssign):
        return _is_text(node.value)
    if isinstance(node, ast.BinOp):
        return _is_text(node.left) or _is_text(node.right)
    text = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return text or isinstance(node, ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp | ast.Dict)


def _of_a_call(node: ast.Call) -> Iterator[tuple[str, ast.AST]]:
    called = node.func
    name = called.attr if isinstance(called, ast.Attribute) else called.id if isinstance(called, ast.Name) else ""
    if name in EXCHANGED:
        other = _with(called, **{"attr" if isinstance(called, ast.Attribute) else "id": EXCHANGED[name]})
        yield "an exchanged function", _with(node, func=other)
    if name == "Argument" and node.args:
        yield "a skipped check", _with(node, args=node.args[1:])
