"""Command lines whose files are odd: encodings, values of wrong types, and what is no file at all.

``odd_command`` makes a command line with its files; within ``without_computing`` it ends where it would compute.
"""

import copy
import datetime
import importlib
import json
import os
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from experiments.reliability.damage import damaged
from experiments.reliability.records import MOVES, SHAPER, accelerations, vibration
from jshape._files import described, digest_of_arrays, read_arrays
from jshape.problems.reading import shipped
from jshape.problems.starters import STARTERS
from jshape.problems.starters import text as started
from jshape.shaper import Shaper

COMPUTED = "here it would compute"

COMPUTES = (
    *(
        ("jshape.design.tuning.tune", "tune"),
        ("jshape.design.tuning.pareto", "pareto"),
        ("jshape.sweeps.sweep", "sweep"),
    ),
    *(("jshape.reports.report", "build"), ("jshape.simulation.simulate", "simulate"), ("jshape_envs.apg", "train")),
    *(("jshape.adaptive.closed_loop.report", "experiment"), ("jshape.calibration.report", "calibrate")),
    *(("jshape_envs.evaluate", "evaluate"), ("jshape_envs.film", "episode_film")),
    *(("jshape.identification.from_csv", "identify"), ("jshape.trajectories.shaping", "shape")),
)
"""What takes seconds: modules and functions."""

WRONG = (
    *(True, 0, -1, 2, 3.5, -0.0, float("nan"), float("inf"), 10**18, 1e308, 5e-324, "", "x", "1", "1 m", "inf m"),
    *([], [[]], [1], [1, 2], [2, 1], [[1, 2], [3, 4]], ["x"], [True], ["1 m", "2 m"], [1, "x"], [0.0] * 65),
    *({}, {"low": 1}, {"low": 0.5, "high": 2, "count": 3}, {"values": [1, 2]}, {"type": "Step"}, {"x": "1 m"}),
    *({"type": "Duffing", "k1": 1, "k3": 1}, {"": 1}, {"a": {"b": {"c": 1}}}, "x" * 1000, "Duffing", "worst", "free"),
    *(datetime.date(1979, 5, 27), datetime.time(7, 32), datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)),
)
"""Values of every type, in the place of any other one."""

TABLES: dict[str, dict[str, Any]] = {
    "design": dict(
        impulses=3, duration=1.0, time_cost=0.0, sample_time="10 ms", amplitudes="positive", limit=1.0, also=[],
        objective="worst", shapers="shared", peak_deflection=1.0, speed_limit=1.0, command_overshoot=0.1, starts=2,
        seed=0,
    ),
    "pareto": dict(impulses=[2, 3], amplitudes=["positive"], limit=1.0, durations=3, starts=2),
    "adapt": dict(
        cases=["I"], sample_time=0.005, period=20.0, duration=40.0, changes=[[1.0, 2.0]], omega=[9.0, 70.0],
        zeta=[0.01, 0.01], bands=[[4.0, 14.0], [50.0, 105.0]], points=300, thresholds=[150.0, 20.0], schedules=0,
        seed=0,
    ),
}  # fmt: skip
"""All keys of the tables that every problem file may have."""

ENDS = ("\r", "\r\n", "\r\r\n", "\n\r", "\n\n", "\x85", "\u2028", "\f", "\v", "\x1c", " ", "\u202e\n", "")

CODES = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "utf-7", "cp500", "latin-1")

CHANGED = ((",", ";"), (",", "\t"), (",", ",\u00a0"), (",", ",\u200b"), ("-", "\u2212"), (",", '","'), ("0.", "0,"),
           ("0.1", "inf"), ("0.1", "1e999"), ("0.1", "1d5"), ("1", "\uff11"), ("1", "\u0661"),
           (",", ",\0"))  # fmt: skip
"""Characters of other programs, countries and scripts in the place of those that are meant."""

CONTENTS = (b"", b"\n", b"\0", b"1", b"{}", b"null", b"NaN", b"[]", b"[" * 100_000, b'{"a":' * 100_000, b"1" * 100_000,
            b"0." + b"1" * 100_000, b"," * 5000 + b"\n1,2\n", b"sep=,\n", b"\xef\xbb\xbf" * 2, b'"' * 3)  # fmt: skip

ENVIRONMENTS = ("DuffingPayload", "CranePayload", "FlexibleLinkPayload", "HoistingCrane")

_open: list[int] = []
"""Pipes of the last command line."""


def encoded(text: str, random: np.random.Generator) -> bytes:
    """A text as other programs, countries and accidents write it."""
    kind = random.random()
    if kind < 0.1:
        return CONTENTS[random.integers(len(CONTENTS))]
    if kind < 0.2:
        # Everything in one line, many times.
        return text.replace("\n", " ").encode() * int(random.integers(2, 50))
    if kind < 0.6:
        text = text.replace(*CHANGED[random.integers(len(CHANGED))])
    text = text.replace("\n", ENDS[random.integers(len(ENDS))]) if random.random() < 0.5 else text
    content = text.encode(CODES[random.integers(len(CODES))] if random.random() < 0.5 else "utf-8", "replace")
    end = (b"", b"", b"\0", b"\x1a", b"\xed\xa0\x80", b"\xb5\xe9")[random.integers(6)]
    return content[: len(content) - int(random.integers(3))] + end


def places(value: Any, at: tuple = ()) -> Iterator[tuple]:
    """The keys and indices of all that a table or list holds, at any depth."""
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*at, key)
        if isinstance(inner, dict | list):
            yield from places(inner, (*at, key))


def exchange(value: Any, random: np.random.Generator) -> None:
    """Put something of another type in the place of one of the things in a table or list, or take it away."""
    found = list(places(value))
    if not found:
        return
    *outer, last = found[random.integers(len(found))]
    for key in outer:
        value = value[key]
    if random.random() < 0.1 and isinstance(value, dict):
        value[f"{last}x"] = value.pop(last)
    else:
        value[last] = copy.deepcopy(WRONG[random.integers(len(WRONG))])


def toml(value: Any) -> str:
    """A value as TOML, tables in braces."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool | str):
        return json.dumps(value)
    return value.isoformat() if isinstance(value, datetime.date | datetime.time) else repr(value)


def problem(random: np.random.Generator) -> str:
    """A problem file of which one to three values are of wrong types."""
    known = [path.read_text(encoding="utf-8") for name, path in shipped().items() if name != "own_plant"]
    known += [started(starter) for starter in STARTERS]
    tables = tomllib.loads(known[random.integers(len(known))])
    name = list(TABLES)[random.integers(len(TABLES))]
    if random.random() < 0.5:
        some = {key: value for key, value in TABLES[name].items() if name == "adapt" or random.random() < 0.7}
        tables[name] = tables.get(name, {}) | copy.deepcopy(some)
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        exchange(tables, random)
    return "\n".join(f"{json.dumps(key)} = {toml(value)}" for key, value in tables.items()) + "\n"


def policy(random: np.random.Generator) -> bytes:
    """A policy's file: damaged, or with a digest that is right and a header or arrays that are not."""
    from jshape_envs.policy import FORMAT, POLICIES

    kept = sorted(POLICIES.glob("*.npz"))
    path, kind = kept[random.integers(len(kept))], random.random()
    if kind < 0.4:
        return damaged(path.read_bytes(), random) if kind < 0.3 else path.read_bytes()
    about, arrays = read_arrays(path, FORMAT)
    name = list(arrays)[random.integers(len(arrays))]
    if kind < 0.8:
        exchange(about, random)
    elif kind < 0.85:
        del arrays[name]
    else:
        array = arrays[name]
        changed = (
            array * np.nan,
            array.astype("complex64"),
            array.astype("U5"),
            array.ravel()[:2],
            array[None],
            array[:0],
        )
        arrays[name] = changed[random.integers(len(changed))]
    header = json.dumps({"format": FORMAT, "about": about, "arrays": described(arrays)}, default=str)
    file = BytesIO()
    np.savez(file, allow_pickle=False, header=header, digest=digest_of_arrays(header, arrays), **arrays)
    return file.getvalue()


def odd_place(folder: Path, name: str, content: bytes, random: np.random.Generator) -> Path:
    """What stands where a file is expected: a folder, a link that leads nowhere or in a circle, a pipe, a device."""
    path, odd = folder / name, int(random.integers(9))
    if odd == 0:
        path.mkdir()
    elif odd == 1:
        path.symlink_to(("nothing", name, folder, "real")[random.integers(4)])
        (folder / "real").write_bytes(content)
    elif odd == 2:
        # As <(...) of a shell; a pipe holds no more.
        ours, theirs = os.pipe()
        os.write(theirs, content[:60_000])
        os.close(theirs)
        _open.append(ours)
        return Path(f"/dev/fd/{ours}")
    elif odd == 3:
        known = ("", ".", "..", "/", "~", "/dev/null", "/dev/full", "/dev/fd/999", "/proc/self/mem", "/proc/1/root")
        return Path(known[random.integers(len(known))])
    elif odd == 4:
        return folder / ("x" * int(random.integers(250, 300)))
    elif odd == 5:
        return folder / "/".join(["y" * 200] * 30)
    else:
        names = ("new\nline\x1b[31m", "\udcff", "[bold]$x^2_{\\frac", "-dash", "a" * 240)
        path = folder / f"{names[random.integers(len(names))]}{path.suffix}"
        path.write_bytes(content)
        return Path(path.name) if odd == 6 else path
    return path


def odd_command(random: np.random.Generator, folder: Path) -> list[str]:
    """A command line with an odd file, or for an odd place."""
    while _open:
        os.close(_open.pop())
    (folder / "shaper.json").write_text(SHAPER, encoding="utf-8")
    out = odd_place(folder, "out", b"content", random) if random.random() < 0.2 else folder / "results"
    commands: tuple[Callable[..., list[str]], ...] = (
        _of_problem,
        _of_problem,
        _of_problem,
        *[_of_record] * 2,
        _of_shaper,
        _of_policy,
    )
    return [*commands[random.integers(len(commands))](random, folder), "--out", str(out)]


def _given(random: np.random.Generator, folder: Path, name: str, content: bytes) -> str:
    """The path of a file; one time in five, of something else in its place."""
    if random.random() < 0.2:
        return str(odd_place(folder, name, content, random))
    (folder / name).write_bytes(content)
    return str(folder / name)


def _of_problem(random: np.random.Generator, folder: Path) -> list[str]:
    text = problem(random) if random.random() < 0.8 else shipped()["paper_001"].read_text(encoding="utf-8")
    content = encoded(text, random) if random.random() < 0.1 else text.encode()
    command = ("tune", "compare", "sweep", "pareto", "adapt", "animate")[random.integers(6)]
    given = [command, _given(random, folder, "problem.toml", content)]
    option = {
        "tune": "--start",
        "sweep": ("--shaper", "--store")[random.integers(2)],
        "animate": "--shaper",
        "pareto": "--store",
    }
    if command in option and random.random() < 0.3:
        given += [option[command], str(odd_place(folder, "other.json", SHAPER.encode(), random))]
    return given


def _of_record(random: np.random.Generator, folder: Path) -> list[str]:
    kind = random.random()
    if kind < 0.4:
        text = vibration(random)
        given = ["identify", _given(random, folder, "record.csv", encoded(text, random))]
        kinds = ("ring-down", "step", "sweep", "spectrum", "frequency-response")
        given += ["--kind", kinds[random.integers(5)]]
        options = (["--input", "2"], ["--columns", "1,2"], ["--sample-rate", "100"], ["--columns", "\uff11"], [])
        return given + options[random.integers(5)]
    if kind < 0.7:
        return ["calibrate", _given(random, folder, "raw_data_x.csv", encoded("\n".join(accelerations()), random))]
    if kind < 0.85:
        return ["shape", _given(random, folder, "moves.csv", encoded(MOVES, random)), str(folder / "shaper.json")]
    points = [{"positions": [0.1 * i, 0.0], "time_from_start": {"sec": i, "nanosec": 0}} for i in range(4)]
    moves = {"joint_names": ["a", "b"], "points": points}
    exchange(moves, random)
    text = json.dumps(moves, default=str)
    return ["shape", _given(random, folder, "moves.json", text.encode()), str(folder / "shaper.json")]


def _of_shaper(random: np.random.Generator, folder: Path) -> list[str]:
    shaper, name = json.loads(SHAPER), ("shaper.json", "shaper.csv", "shaper.npz")[random.integers(3)]
    if random.random() < 0.7:
        exchange(shaper, random)
    text = json.dumps(shaper, default=str) if random.random() < 0.6 else "time,amplitude\n0.0,0.1\n0.5,0.9\n"
    content = encoded(text, random) if random.random() < 0.5 else text.encode()
    formats = ("json", "csv", "c99", "scipy", "numpy", "structured_text", "matlab", "klipper", "fmu", "reprapfirmware")
    given = ["export", _given(random, folder, f"a-{name}", content), "--format", formats[random.integers(10)]]
    return [*given, "--sample-time", "0.01", *([] if random.random() < 0.5 else ["--force"])]


def _of_policy(random: np.random.Generator, folder: Path) -> list[str]:
    command = ("evaluate", "animate")[random.integers(2)]
    environment = ENVIRONMENTS[random.integers(len(ENVIRONMENTS))]
    return [command, environment, "--policy", _given(random, folder, "policy.npz", policy(random))]


@contextmanager
def without_computing() -> Iterator[None]:
    """Whatever takes seconds is refused in a line; closed forms are one shaper, figures are drawn by no process."""

    def refused(*_: Any, **__: Any) -> Any:
        raise ValueError(COMPUTED)

    @contextmanager
    def nobody() -> Iterator[Callable[..., None]]:
        yield refused

    with ExitStack() as stack:
        for module, name in COMPUTES:
            stack.enter_context(patch.object(importlib.import_module(module), name, refused))
        closed = importlib.import_module("jshape.design.closed_forms")
        stack.enter_context(
            patch.object(closed, "closed_forms", lambda *_: ({"zv": Shaper([0.5, 0.5], [0.0, 0.5])}, {}))
        )
        report = importlib.import_module("jshape.reports.report")
        stack.enter_context(patch.object(report, "rehearse", lambda *_: None))
        stack.enter_context(patch.object(importlib.import_module("jshape.cli.tune"), "artist", nobody))
        yield
