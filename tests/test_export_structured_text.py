"""The function blocks, cycle by cycle, by a small interpreter; by a compiler and a parser of others where there are."""

import itertools
import math
import os
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from function_blocks import Block, shaped

import jshape as js
from jshape.export import export
from jshape.export.structured_text import in_dialect, real


def filtered(taps, commands):
    """The same by a convolution, from rest at the first command."""
    held = np.concatenate([np.full(len(taps) - 1, commands[0]), commands])
    return np.convolve(held, taps, "valid")


SHAPER = js.design.linear.zvd(9.0, 0.05)
CYCLE = 0.03


@pytest.fixture(scope="module")
def source():
    return export(SHAPER, "structured_text", sample_time=CYCLE, name="Crane")


@pytest.fixture(scope="module")
def commands():
    rng = np.random.default_rng(3)
    return np.concatenate([np.repeat(rng.uniform(-2, 5, 6), 37), rng.uniform(-2, 5, 100)])


@pytest.mark.parametrize("to_dint", [round, math.trunc], ids=["rounds", "truncates"])
@pytest.mark.parametrize("cycle", [CYCLE, 0.0177, 0.11])
def test_any_cycle_time_cycle_by_cycle(source, commands, cycle, to_dint):
    taps = SHAPER.digitise(cycle, "split")
    found = shaped(Block(source, to_dint), commands, CycleTime=cycle)
    np.testing.assert_allclose(found, filtered(taps, commands), rtol=0, atol=1e-13)


@pytest.mark.parametrize("method", ["nearest", "zeros"])
def test_placed_on_cycles(commands, method):
    modes = [(9.0, 0.05)]
    text = export(SHAPER, "structured_text", sample_time=CYCLE, method=method, modes=modes, capacity=60)
    found = shaped(Block(text), commands)
    np.testing.assert_allclose(found, filtered(SHAPER.digitise(CYCLE, method, modes), commands), rtol=0, atol=1e-13)


def test_first_cycle_and_enable(source):
    block = Block(source)
    assert set(shaped(block, [7.3] * 200)) == {7.3}
    shaped(block, [9.0] * 5)
    assert block.Shaped != 9.0
    # Disabled, the command comes out at once; enabled again, it begins at rest there.
    assert shaped(block, [3.1, 4.0], Enable=False).tolist() == [3.1, 4.0]
    assert set(shaped(block, [4.0] * 200, Enable=True)) == {4.0}


def test_bypass_and_parameters_change_without_a_jump(source, commands):
    """Every change of the command goes through the shaper in force when it came: by the sum over all of them."""
    block = Block(source)
    capacity = block.Capacity
    slow = [1.6 * time for time in block.Times]
    settings = [{}, {"Bypass": True}, {"Bypass": False, "Times": slow}, {"Amplitudes": [0.3, 0.3, 0.4]}]
    settings.append({"CycleTime": 2 * CYCLE})
    shapers = [
        SHAPER,
        js.Shaper([1.0], [0.0]),
        js.Shaper(SHAPER.amplitudes, slow),
        js.Shaper([0.3, 0.3, 0.4], slow),
        js.Shaper([0.3, 0.3, 0.4], slow),
    ]
    cycles = [CYCLE] * 4 + [2 * CYCLE]
    longer = np.tile(commands, 3)
    found, moves, wanted, last, age, force = [], [], [], longer[0], capacity, 0
    asked = 0
    for k, command in enumerate(longer):
        if k and k % 130 == 0 and asked + 1 < len(settings):
            asked += 1
            for name, value in settings[asked].items():
                setattr(block, name, value)
        if asked != force and age >= capacity:
            force, age = asked, 0
        block(Command=float(command))
        found.append(block.Shaped)
        age = min(age + 1, capacity)
        assert block.Busy == (age < capacity)
        taps = shapers[force].digitise(cycles[force], "split")
        moves.append((command - last, np.cumsum(taps)))
        last = command
        wanted.append(longer[0] + sum(m * r[min(k - j, len(r) - 1)] for j, (m, r) in enumerate(moves)))
    assert force == 4
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


def test_a_change_at_rest_is_not_seen(source):
    block = Block(source)
    shaped(block, [0.7] * 10)
    for change in ({"Bypass": True}, {"Bypass": False}, {"Times": [0.0, 0.4, 0.5]}, {"CycleTime": 0.021}):
        assert set(shaped(block, [0.7] * (block.Capacity + 3), **change)) == {0.7}
        assert not block.Error


@pytest.mark.parametrize(
    "wrong",
    [
        {"CycleTime": 0.0},
        {"CycleTime": -0.01},
        {"CycleTime": math.nan},
        {"CycleTime": 1e-9},
        {"Amplitudes": [0.5, 0.5, 0.5]},
        {"Amplitudes": [0.5, 0.5, math.nan]},
        {"Times": [0.0, -0.1, 0.2]},
        {"Times": [0.0, 0.1, 1e9]},
    ],
    ids=str,
)
def test_wrong_parameters_are_refused(source, commands, wrong):
    block, good = Block(source), Block(source)
    before = shaped(block, commands[:50])
    after = shaped(block, commands[50:], **wrong)
    assert block.Error
    # The last good ones stay: nothing is seen of the change.
    np.testing.assert_array_equal([*before, *after], shaped(good, commands))
    name = next(iter(wrong))
    shaped(block, [1.0], **{name: list(getattr(good, name)) if name != "CycleTime" else CYCLE})
    assert not block.Error
    # From the first cycle on wrong: the command goes through.
    fresh = Block(source)
    assert shaped(fresh, commands[:9], **wrong).tolist() == commands[:9].tolist()
    assert fresh.Error


def test_room_and_names():
    with pytest.raises(ValueError, match="capacity must be a whole number of at least 26"):
        export(SHAPER, "structured_text", sample_time=CYCLE, capacity=25)
    for name in ("Function", "at", "1st", "a__b", "ü", "TON", "command"):
        with pytest.raises(ValueError, match="name must"):
            export(SHAPER, "structured_text", sample_time=CYCLE, name=name)
    with pytest.raises(ValueError, match="method must be one of"):
        export(SHAPER, "structured_text", sample_time=CYCLE, method="best")


def test_the_example_has_the_cycle_time_that_was_asked_for():
    text = export(js.Shaper([0.5, 0.5], [0.0, 0.5]), "structured_text", sample_time=0.05)
    assert "Axis(Command := Wanted, CycleTime := 0.05);" in text


def test_numbers_as_the_language_writes_them():
    for value, text in ((0.25, "0.25"), (1e-5, "1.0E-5"), (2.5e22, "2.5E22"), (-1.0, "-1.0"), (1 / 3, repr(1 / 3))):
        assert real(value) == text
        assert float(text) == value


# On-off


ON_OFF = js.Shaper([1.0, -1.0, 1.0, -1.0, 1.0], [0, 0.16425413, 0.62590402, 1.08755391, 1.25180804])
MODES = [(2 * math.pi * f, 0.0) for f in (0.5430, 0.6004, 0.6578)]


@pytest.fixture(scope="module")
def table():
    return export(ON_OFF, "on_off", sample_time=0.04, modes=MODES, name="Hoist")


def test_on_off_switches_by_its_table(table):
    block = Block(table)
    cycles = list(block.Switches)
    length, seen = cycles[-1] + 1, []
    for run in (True, False, True):
        for k in range(length + 4):
            block(Run=run)
            seen.append(block.Drive)
            assert block.Busy == (k < length - 1)
    steps = np.zeros(length + 4)
    np.add.at(steps, cycles, [1, -1, 1, -1, 1])
    on = np.cumsum(steps) == 1
    np.testing.assert_array_equal(seen, np.concatenate([on, ~on, on]))
    # A button let go at once: the sequence is finished, then the other follows.
    block, pressed = Block(table), []
    for k in range(2 * length):
        block(Run=k < 3)
        pressed.append(block.Drive)
    np.testing.assert_array_equal(pressed, np.concatenate([on[:length], ~on[:length]]))
    block(Run=True)
    block(Run=True, Abort=True)
    assert not block.Drive
    block(Run=True, Abort=False)
    assert block.Drive


def test_on_off_says_what_rounding_costs(table):
    cycles = np.array(Block(table).Switches)
    rounded = js.Shaper(ON_OFF.amplitudes, 0.04 * cycles)
    lines = re.findall(r"omega = (\S+) rad/s, zeta = (\S+): (\S+) % exact, (\S+) % rounded", table)
    assert len(lines) == len(MODES)
    for (omega, zeta), (w, z, exact, shown) in zip(MODES, lines, strict=True):
        assert (float(w), float(z)) == (omega, zeta)
        assert float(exact) == pytest.approx(100 * float(js.percentage_vibration(ON_OFF, omega, zeta)), rel=1e-3)
        assert float(shown) == pytest.approx(100 * float(js.percentage_vibration(rounded, omega, zeta)), rel=1e-3)
    # Of all choices of the cycle before or after each instant it is the one whose worst vibration is least.
    omega, signs = np.array([mode[0] for mode in MODES]), np.asarray(ON_OFF.amplitudes)
    worst = lambda chosen: np.max(np.abs(np.exp(1j * np.outer(omega, 0.04 * np.asarray(chosen))) @ signs))
    place = np.asarray(ON_OFF.times) / 0.04
    choices = itertools.product(*({*np.floor([p]), *np.ceil([p])} for p in place))
    assert worst(cycles) == pytest.approx(min(map(worst, choices)), rel=1e-12)
    assert np.abs(cycles - place).max() < 1
    for cycle in cycles:
        assert f"{cycle * 0.04:.6g}" in table


def test_on_off_cannot_carry():
    for shaper, options, words in [
        (SHAPER, dict(sample_time=0.01, modes=MODES), "amplitudes must be 1, -1, ..., 1"),
        (ON_OFF, dict(sample_time=0.5, modes=MODES), "two of the switches .* fall together"),
        (ON_OFF, dict(sample_time=0.01, modes=[]), "modes is empty"),
        (ON_OFF, dict(sample_time=0.01, modes=[9.0]), "modes must be pairs"),
        (ON_OFF, dict(sample_time=0.01, modes=[(-9.0, 0.0)]), "modes: omega must be greater than 0"),
        (ON_OFF, dict(sample_time=0.01, modes=[(9.0, 1.5)]), "modes: zeta must be at least 0"),
        (ON_OFF, dict(sample_time=0.01), "format 'on_off' needs modes"),
        (ON_OFF, dict(sample_time=0.0, modes=MODES), "sample_time must be greater than 0"),
    ]:
        with pytest.raises(ValueError, match=words):
            export(shaper, "on_off", **options)


# Dialects


def test_dialects_hold_the_same_block(source, table, commands):
    """Put together again, CODESYS's and TwinCAT's halves are the block of the standard; so is Siemens's."""
    made = lambda dialect: export(SHAPER, "structured_text", sample_time=CYCLE, name="Crane", dialect=dialect)
    assert made("iec") == source
    plain = re.sub(r"\s+", " ", re.sub(r"\(\*.*?\*\)", "", source, flags=re.S))
    codesys = made("codesys")
    assert not codesys.rstrip().endswith("END_FUNCTION_BLOCK")
    halves = ElementTree.fromstring(made("twincat").encode())
    twincat = (halves.findtext("POU/Declaration") or "") + (halves.findtext("POU/Implementation/ST") or "")
    for text in (codesys, twincat):
        joined = re.sub(r"\s+", " ", re.sub(r"\(\*.*?\*\)", "", f"{text} END_FUNCTION_BLOCK ", flags=re.S))
        assert joined == plain
    tia = made("tia")
    assert "FUNCTION_BLOCK \"Crane\"\n{ S7_Optimized_Access := 'TRUE' }\nVERSION : 0.1\n" in tia
    declared, body = re.sub(r"\(\*.*?\*\)", "", tia, flags=re.S).split("\nBEGIN\n")
    variables = set(re.findall(r"^    (\w+) : ", declared, re.M))
    # Each of the block's own variables is marked, and nothing else is.
    assert set(re.findall(r"#(\w+)", body)) <= variables
    assert [word for word in re.findall(r"(?<!#)\b[A-Za-z_]\w*", body) if word in variables] == []
    found = Block(re.sub(r'"(\w+)"\n\{.*\}\nVERSION.*\n', r"\1\n", tia).replace("\nBEGIN\n", "").replace("#", ""))
    np.testing.assert_array_equal(shaped(found, commands), shaped(Block(source), commands))
    assert "#Switches[#Upcoming]" in export(ON_OFF, "on_off", sample_time=0.04, modes=MODES, dialect="tia")
    with pytest.raises(ValueError, match="dialect must be one of"):
        made("basic")


def test_labels_of_a_case_are_no_variables():
    """A label and a comment that look like a declaration: neither is marked, nor keeps a name from the block."""
    block = "FUNCTION_BLOCK Way\nVAR\n    State : INT;\nEND_VAR\n"
    body = "CASE State OF\n    1 : State := 1;\nEND_CASE;\nEND_FUNCTION_BLOCK\n"
    found = in_dialect(f"(*\n    Way : of a block\n*)\n{block}{body}", "Way", "tia")
    assert "CASE #State OF\n    1 : #State := 1;" in found
    assert "    State : INT;" in found


# By a compiler for controllers


DRIVER = """
#include <stdio.h>
#include "POUS.h"
#include "POUS.c"
#define SET(name) __SET_VAR(data->, name,, value)
#define PUT(name) __SET_VAR(data->, name,, values)
static CRANE block, *data = &block;
TIME __CURRENT_TIME;
BOOL __DEBUG;
int main(void) {
    char what;
    int i;
    double value;
    __ARRAY_OF_LREAL_3 values;
    CRANE_init__(data, 0);
    while (scanf(" %c", &what) == 1) {
        if (what == 'a' || what == 't') {
            for (i = 0; i < 3; ++i) if (scanf("%lf", &values.table[i]) != 1) return 1;
            if (what == 'a') { PUT(AMPLITUDES); } else { PUT(TIMES); }
            continue;
        }
        if (scanf("%lf", &value) != 1) return 1;
        if (what == 'y') { SET(CYCLETIME); }
        if (what == 'b') { SET(BYPASS); }
        if (what != 'c') continue;
        SET(COMMAND);
        CRANE_body__(data);
        printf("%.17g %d\\n", __GET_VAR(data->SHAPED), __GET_VAR(data->ERROR));
    }
    return 0;
}
"""


def matiec() -> tuple[str, Path] | None:
    """The compiler of MATIEC, on the path, and its libraries, in MATIEC_LIB or beside it."""
    program = shutil.which("iec2c")
    library = Path(os.environ.get("MATIEC_LIB", Path(program).parent / "lib")) if program else None
    return (program, library) if program and library and (library / "C" / "iec_std_lib.h").exists() else None


@pytest.mark.slow
def test_a_compiler_for_controllers_runs_it(tmp_path):
    """By MATIEC: a hundred thousand cycles, bypass, amplitudes, times and cycle time changed in mid-move."""
    found = matiec()
    if found is None or shutil.which("cc") is None:
        pytest.skip("no MATIEC (iec2c)")
    program, library = found
    text = export(SHAPER, "structured_text", tmp_path / "crane.st", sample_time=CYCLE, name="Crane")
    (capacity,) = map(int, re.findall(r"Capacity : DINT := (\d+)", text))
    for command in (
        [program, "-I", str(library), "-T", str(tmp_path), "crane.st"],
        ["cc", "-O1", "-w", "-I", str(library / "C"), "-I", ".", "main.c", "-o", "main", "-lm"],
    ):
        (tmp_path / "main.c").write_text(DRIVER, encoding="utf-8")
        built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert built.returncode == 0, built.stderr
    rng, count = np.random.default_rng(5), 100_000
    commands = np.cumsum(rng.normal(size=count))
    slow, even = (1.3 * np.asarray(SHAPER.times)).tolist(), [0.3, 0.3, 0.4]
    changes = {20_000: ("b 1", None, CYCLE), 30_000: ("b 0", SHAPER, CYCLE)}
    changes[40_000] = (f"t {' '.join(map(repr, slow))}", js.Shaper(SHAPER.amplitudes, slow), CYCLE)
    changes[60_000] = (f"a {' '.join(map(repr, even))}", js.Shaper(even, slow), CYCLE)
    changes[80_000] = ("y 0.04", js.Shaper(even, slow), 0.04)
    assert min(np.diff(list(changes))) > capacity
    orders, parts, shaper, cycle, begin = [], [], SHAPER, CYCLE, 0
    for k, value in enumerate(commands.tolist()):
        if k in changes:
            parts.append((begin, k, shaper, cycle))
            (order, shaper, cycle), begin = changes[k], k
            orders.append(order)
        orders.append(f"c {value!r}")
    parts.append((begin, count, shaper, cycle))
    run = subprocess.run(["./main"], cwd=tmp_path, input="\n".join(orders), capture_output=True, text=True)
    shaped_by_it, errors = np.array([line.split() for line in run.stdout.splitlines()], float).T
    assert not errors.any()
    # Every change of the command goes through the shaper in force when it comes.
    expected, moves = np.full(count, commands[0]), np.diff(commands, prepend=commands[0])
    for begin, end, shaper, cycle in parts:
        own = np.where((np.arange(count) >= begin) & (np.arange(count) < end), moves, 0.0)
        taps = np.ones(1) if shaper is None else shaper.digitise(cycle, "split")
        expected += np.cumsum(own) + np.convolve(own, np.cumsum(taps) - 1)[:count]
    np.testing.assert_allclose(shaped_by_it, expected, rtol=0, atol=2e-12)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["source", "table"])
def test_a_parser_of_others_reads_it(which, request):
    """By blark, the parser of SLAC for TwinCAT's Structured Text."""
    blark = pytest.importorskip("blark.parse")
    parsed = blark.parse_source_code(request.getfixturevalue(which))
    assert parsed.exception is None
    assert parsed.transform().items[0].name == {"source": "Crane", "table": "Hoist"}[which]


@pytest.mark.slow
def test_a_parser_of_others_reads_twincats_file(tmp_path):
    parse = pytest.importorskip("blark.parse").parse
    path = tmp_path / "Crane.TcPOU"
    export(SHAPER, "structured_text", path, sample_time=CYCLE, name="Crane", dialect="twincat")
    results = list(parse(path))
    assert [result.exception for result in results] == [None] * len(results)
    assert {result.identifier for result in results} == {"Crane/declaration", "Crane/implementation"}
    assert results[0].transform().items[0].name == "Crane"
