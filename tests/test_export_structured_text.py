"""The function blocks, cycle by cycle, by a small interpreter; their grammar by a parser of others where there is one.

The interpreter knows the statements that the blocks use and is strict where controllers are: types, array bounds.
"""

import itertools
import math
import re
from typing import Any

import numpy as np
import pytest

import jshape as js
from jshape.export import export
from jshape.export.structured_text import real

KINDS = {"LREAL": float, "DINT": int, "BOOL": bool}
TOKEN = re.compile(r"\d+\.\d+(?:E[+-]?\d+)?|\d+|[A-Za-z_]\w*|:=|<>|<=|>=|\.\.|[-+*/()\[\],:;=<>]|\S")
PYTHON = {"AND": "and", "OR": "or", "NOT": "not", "<>": "!=", "=": "==", "TRUE": "True", "FALSE": "False"}
PYTHON |= {"ABS": "abs", "LREAL_TO_DINT": "to_dint", "DINT_TO_LREAL": "float"}


class Numbers(list):
    """An array of a controller: of one type, without negative indices."""

    def __init__(self, kind, items):
        super().__init__(items)
        self.kind = kind

    def __getitem__(self, index):
        assert 0 <= index < len(self), f"index {index} of {len(self)}"
        return super().__getitem__(index)

    def __setitem__(self, index, value):
        assert 0 <= index < len(self), f"index {index} of {len(self)}"
        assert type(value) is self.kind, (value, self.kind)
        super().__setitem__(index, value)


class Block:
    """An instance of the one function block of a source; its variables are attributes, a call is a cycle."""

    def __init__(self, source, to_dint=round):
        text = re.sub(r"\(\*.*?\*\)", "", source, flags=re.S)
        ((self.__dict__["block"], inner),) = re.findall(r"FUNCTION_BLOCK (\w+)(.*)END_FUNCTION_BLOCK", text, re.S)
        self.__dict__["kinds"] = {}
        for section in re.findall(r"VAR(?:_INPUT|_OUTPUT)?\b(.*?)END_VAR", inner, re.S):
            for declaration in filter(str.strip, section.split(";")):
                self.declare(declaration)
        body = inner[inner.rindex("END_VAR") + len("END_VAR") :]
        self.__dict__["tokens"] = TOKEN.findall(body)
        lines = ["def run(v):", *self.statements(1, {None}), "    return"]
        space = {"to_dint": to_dint}
        exec("\n".join(lines), space)
        self.__dict__["run"] = space["run"]

    def declare(self, text):
        form = r"\s*(\w+)\s*:\s*(?:ARRAY \[0\.\.(\d+)\] OF )?(\w+)\s*(?::=\s*(.+?))?\s*"
        found = re.fullmatch(form, text, re.S)
        assert found, text
        name, array, kind, value = found.groups()
        kind = self.kinds[name] = KINDS[kind]
        read = lambda word: kind(word == "TRUE") if kind is bool else kind(word)
        if array is None:
            self.__dict__[name] = kind() if value is None else read(value)
            return
        size = int(array) + 1
        items = [kind()] * size if value is None else [read(word) for word in value.strip("[]").split(",")]
        assert len(items) == size
        self.__dict__[name] = Numbers(kind, items)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def __setattr__(self, name, value):
        if isinstance(self.__dict__[name], Numbers):
            value = Numbers(self.kinds[name], value)
        else:
            assert type(value) is self.kinds[name], (name, value)
        self.__dict__[name] = value

    def __call__(self, **inputs):
        for name, value in inputs.items():
            setattr(self, name, value)
        self.run(self)

    def take(self, *wanted):
        token = self.tokens.pop(0)
        assert not wanted or token in wanted, (token, wanted, self.tokens[:9])
        return token

    def expression(self, *ends):
        words = []
        while self.tokens[0] not in ends:
            word = self.take()
            words.append(PYTHON.get(word) or (f"v.{word}" if word in self.kinds else word))
            assert word[0].isdigit() or not word[0].isalpha() or word in PYTHON or word in self.kinds, word
        self.take(*ends)
        return " ".join(words)

    def statements(self, depth, ends):
        lines, pad = [], "    " * depth
        while (self.tokens[0] if self.tokens else None) not in ends:
            word = self.take()
            if word == "IF":
                lines.append(f"{pad}if {self.expression('THEN')}:")
                lines += self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
                while (word := self.take("ELSIF", "ELSE", "END_IF")) != "END_IF":
                    lines.append(f"{pad}else:" if word == "ELSE" else f"{pad}elif {self.expression('THEN')}:")
                    lines += self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
                self.take(";")
            elif word == "FOR":
                index = self.take()
                assert self.kinds[index] is int
                self.take(":=")
                first, last = self.expression("TO"), self.expression("DO")
                lines.append(f"{pad}for v.{index} in range({first}, {last} + 1):")
                lines += self.statements(depth + 1, {"END_FOR"})
                self.take("END_FOR")
                self.take(";")
            elif word == "RETURN":
                lines.append(f"{pad}return")
                self.take(";")
            else:
                assert word in self.kinds, word
                target = f"v.{word}"
                if self.tokens[0] == "[":
                    self.take("[")
                    target += f"[{self.expression(']')}]"
                self.take(":=")
                lines.append(f"{pad}{target} = {self.expression(';')}")
        return lines


def shaped(block, commands, **inputs):
    found = []
    for command in commands:
        block(Command=float(command), **inputs)
        found.append(block.Shaped)
    return np.array(found)


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
    for name in ("Function", "at", "1st", "a__b", "ü", "TON"):
        with pytest.raises(ValueError, match="name must"):
            export(SHAPER, "structured_text", sample_time=CYCLE, name=name)
    with pytest.raises(ValueError, match="method must be one of"):
        export(SHAPER, "structured_text", sample_time=CYCLE, method="best")


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


@pytest.mark.slow
@pytest.mark.parametrize("which", ["source", "table"])
def test_a_parser_of_others_reads_it(which, request):
    """By blark, the parser of SLAC for TwinCAT's Structured Text."""
    blark = pytest.importorskip("blark.parse")
    parsed = blark.parse_source_code(request.getfixturevalue(which))
    assert parsed.exception is None
    assert parsed.transform().items[0].name == {"source": "Crane", "table": "Hoist"}[which]
