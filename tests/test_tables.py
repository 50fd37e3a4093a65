"""Tables at any width: no number is cut, no line is too long, nothing in a name is markup."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

import jshape as js
from jshape.reports import tables

NAMES = ["unshaped", "energy 4-impulse, first order", "[/red]", "a name of more than thirty-two characters, and more"]
HEADINGS = [
    "move\ntime\n(s)",
    "nominal\nenergy\n(J)",
    "worst\nenergy\n(J)",
    "worst\nvibration\n(% of move)",
    "more",
    "still more",
]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_number_is_cut(width, capsys):
    rows = [(name, [f"{-1.2345678e-9 * 7 ** (i + j):.5g}" for j in range(6)]) for i, name in enumerate(NAMES)]
    console = Console(width=width)
    tables.show_table(console, "shaper", HEADINGS, rows, "[bold]a title", bold=("unshaped",))
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= width
    assert [cell for _, cells in rows for cell in cells if cell not in printed] == []
    assert "…" not in printed
    assert "[bold]a title" in printed
    # A name that is folded is there in pieces.
    assert "[/red]" in printed
    blocks = printed.count("shaper")
    assert (blocks == 1) == (width == 120)
    assert printed.count("unshaped") == blocks


@pytest.mark.parametrize("width", [60, 120])
def test_impulses_stand_above_their_times(width, capsys):
    shaper = js.Shaper(np.full(20, 0.05), np.arange(20) / 7)
    tables.show_impulses(Console(width=width), [("long", shaper), ("a name that does not fit before", shaper)])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    numbers = [re.findall(r"\d\.\d{4}", line) for line in lines]
    rows = [found for found in numbers if found]
    for amplitudes, times in zip(rows[::2], rows[1::2], strict=True):
        assert len(amplitudes) == len(times)
        assert set(amplitudes) == {"0.0500"}
    expected = [f"{time:.4f}" for time in np.arange(20) / 7]
    assert [time for found in rows[1::2] for time in found] == 2 * expected


def test_times_of_a_fast_machine_keep_their_digits(capsys):
    tables.show_impulses(Console(width=80), [("ZV", js.Shaper([0.5, 0.5], [0.0, 2.5e-5]))])
    assert capsys.readouterr().out.split()[-5:] == ["ZV", "0.5000", "0.5000", "0", "2.5e-05"]


def test_columns_are_asked_for(monkeypatch):
    monkeypatch.setenv("COLUMNS", "66")
    assert tables.new_console().width == 66
    monkeypatch.delenv("COLUMNS")
    assert tables.new_console().width == 120


def test_a_table_for_latex():
    """Names with LaTeX's own characters, powers of ten and signs as formulas; a row ends with two backslashes."""
    row = SimpleNamespace(name="a_b & {c} 50%", nominal_energy=3.9e-5, worst_energy=-2.5, worst_vibration=0.1)
    plant = SimpleNamespace(energy_unit="J")
    problem = SimpleNamespace(title="crane #1 \\ $5", over={"m": [1.0]}, plant=plant)
    text = js.reports.latex_table(SimpleNamespace(problem=problem, rows=[row], move_time=lambda _: 1.5))
    assert r"\caption{crane \#1 \textbackslash{} \$5}" in text
    assert r"a\_b \& \{c\} 50\% & 1.5000 & $3.9 \times 10^{-5}$ & $-2.5$ & 10 \\" in text
    body = text[text.index("toprule") : text.index("bottomrule")]
    assert [line.count(" & ") for line in body.splitlines() if line.endswith(r"\\")] == [4, 4]
    assert r"\begin{tabular}{lrrrr}" in text


def test_what_is_no_number_is_said():
    assert [tables.number(value) for value in (np.inf, 1e30, np.nan, 0.1)] == ["diverged", "diverged", "not met", "0.1"]
