"""Arbitrary input: files damaged at random, values that nobody means, arguments of any kind.

    python -m experiments.reliability.fuzz --inputs 105000      # writes fuzz.md beside itself; some of an hour

Each input must be read, or refused by a ``ValueError`` of one line (on the command line: by one line and status 2). A
file with a digest must be refused or give the very same numbers. Everything else is a fault and is listed.
"""

import argparse
import json
import math
import os
import re
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import hypothesis  # noqa: E402
import numpy as np  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

import jshape as js  # noqa: E402
from experiments import markdown  # noqa: E402
from experiments.reliability.array_files import (  # noqa: E402
    chunk_file,
    chunk_sealed_anew,
    policy_file,
    policy_sealed_anew,
)
from experiments.reliability.damage import damaged  # noqa: E402
from experiments.reliability.literals import altered, arguments, exchanged, literal  # noqa: E402
from experiments.reliability.records import accelerations, vibration  # noqa: E402
from experiments.reliability.uploads import (  # noqa: E402
    dropped_machine,
    dropped_problem,
    filmed_policy,
    machine_of_a_problem,
    shared_link,
    taken_away,
)
from jshape.calibration.files import read as read_accelerometer  # noqa: E402
from jshape.export import read_shaper  # noqa: E402
from jshape.identification.csv_file import read_csv  # noqa: E402
from jshape.identification.from_csv import identify_csv  # noqa: E402
from jshape.problems.problem import load  # noqa: E402
from jshape.problems.reading import shipped  # noqa: E402
from jshape.problems.starters import STARTERS  # noqa: E402
from jshape.problems.starters import text as started  # noqa: E402

LONGEST = 5000
"""Characters that a message may have."""

CHECKS = [hypothesis.HealthCheck.too_slow, hypothesis.HealthCheck.data_too_large]
"""What Hypothesis shall not complain of."""

REAL = 0.002
"""Share of the command line's inputs that compute something, which takes seconds each; the others end before that."""

Target = Callable[[np.random.Generator, Path], bool]
"""Makes an input and tries it in a folder; whether it was read. *Raises* ``ValueError`` where it was refused."""


class Found(NamedTuple):
    """The outcome of a target.

    Attributes:
        inputs: how many were tried.
        read: how many were taken.
        faults: messages of those that were neither taken nor refused, and how often.
        seconds: that it took.
    """

    inputs: int
    read: int
    faults: dict[str, int]
    seconds: float


class FaultError(Exception):
    """An input that was taken and gave something else than it should."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=105_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", action="append", default=[], help="a kind of input; the others' rows stay")
    given = parser.parse_args()
    kept = Path(__file__).with_suffix(".json")
    before = json.loads(kept.read_text(encoding="utf-8")) if given.only else {}
    found = {name: Found(*row) for name, row in before.items()} | run(given.inputs, given.seed, tuple(given.only))
    found = {name: found[name] for name in TARGETS if name in found}
    kept.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    title = f"{sum(each.inputs for each in found.values())} arbitrary inputs"
    command = f"python -m experiments.reliability.fuzz --inputs {given.inputs} --seed {given.seed}"
    markdown.write_beside(__file__, title, command, report(found))


def run(inputs: int, seed: int = 0, names: tuple[str, ...] = ()) -> dict[str, Found]:
    """Try so many inputs, shared out among the targets; what one of them meets does not depend on the others.

    Args:
        inputs: of all targets together; of some of them, their shares of that.
        seed: of all random numbers.
        names: of the targets; all unless given.
    """
    total = sum(share for share, _ in TARGETS.values())
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for i, (name, (share, target)) in enumerate(TARGETS.items()):
            if names and name not in names:
                continue
            place = Path(folder) / str(i)
            place.mkdir()
            count = max(1, round(inputs * share / total))
            found[name] = tried(target, count, np.random.default_rng([seed, i]), place)
            print(f"{name}: {found[name].inputs} inputs, {len(found[name].faults)} faults", flush=True)
    return found


def tried(target: Target, count: int, random: np.random.Generator, folder: Path) -> Found:
    """Give a target so many inputs."""
    begin, read, faults = time.perf_counter(), 0, Counter()
    here = os.getcwd()
    os.chdir(folder)
    try:
        for _ in range(count):
            # What is printed besides an answer is a fault, too.
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    read += target(random, folder)
                except ValueError as error:
                    message = str(error)
                    if "\n" in message or not 0 < len(message) < LONGEST:
                        faults[f"a message of {len(message)} characters: {message[:80]!r}"] += 1
                except (Exception, SystemExit) as error:
                    faults[f"{type(error).__name__}: {str(error)[:200]}"] += 1
    finally:
        os.chdir(here)
    return Found(count, read, dict(faults), time.perf_counter() - begin)


# --- files ------------------------------------------------------------------------------------------------------------


def problem_damaged(random: np.random.Generator, folder: Path) -> bool:
    """A problem file with one fault of a disk."""
    return _problem(damaged(_a_problem(random).encode(), random), folder)


def problem_altered(random: np.random.Generator, folder: Path) -> bool:
    """A problem file with one to three values or keys that nobody means."""
    return _problem(altered(_a_problem(random), random).encode(errors="surrogateescape"), folder)


def problem_exchanged(random: np.random.Generator, folder: Path) -> bool:
    """A file of ``jshape new`` with tables of another machine's or under names that nobody means."""
    one, other = (started(STARTERS[i]) for i in random.integers(len(STARTERS), size=2))
    return _problem(re.sub(r" *#.*", "", exchanged(one, other, random)).encode(), folder)


def _a_problem(random: np.random.Generator) -> str:
    paths = [path for name, path in shipped().items() if name != "own_plant"]
    text = paths[random.integers(len(paths))].read_text(encoding="utf-8")
    return "\n".join(line.partition(" #")[0] for line in text.split("\n") if not line.startswith("#"))


def _problem(content: bytes, folder: Path) -> bool:
    if b":" in content:
        # It may name a module; no code but jshape's is run here.
        raise ValueError("left out")
    path = folder / "problem.toml"
    path.write_bytes(content)
    read = load(path)
    if not all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(read.plant)):
        raise FaultError("a plant that is not finite")
    return True


def shaper_file(random: np.random.Generator, folder: Path) -> bool:
    """A shaper's file, damaged or altered."""
    shaper = js.Shaper([0.25, 0.5, 0.25], [0.0, 0.5, 1.0])
    kind, ending = [("json", ".json"), ("csv", ".csv"), ("numpy", ".npz")][random.integers(3)]
    path = folder / f"shaper{ending}"
    js.export(shaper, kind, path)
    content = path.read_bytes()
    if kind == "numpy" or random.random() < 0.5:
        path.write_bytes(damaged(content, random))
    else:
        number = str([0.25, 0.5, 1.0][random.integers(3)])
        path.write_bytes(content.replace(number.encode(), literal(random).encode(errors="surrogateescape"), 1))
    read = read_shaper(path)
    if not np.all(np.isfinite(read.amplitudes)) or not np.all(np.isfinite(read.times)):
        raise FaultError("a shaper that is not finite")
    return True


def record_file(random: np.random.Generator, folder: Path) -> bool:
    """A measured record, damaged or altered, as it is read."""
    path = _spoilt_record(random, folder)
    return bool(np.size(read_csv(path).values))


def record_identified(random: np.random.Generator, folder: Path) -> bool:
    """The same, identified."""
    found = identify_csv(_spoilt_record(random, folder), modes=1)
    if not (np.all(np.isfinite(found.omega)) and np.all(found.omega > 0)):
        raise FaultError("a frequency that is none")
    return True


def _spoilt_record(random: np.random.Generator, folder: Path) -> Path:
    path, text = folder / "record.csv", vibration(random)
    if random.random() < 0.5:
        path.write_bytes(damaged(text.encode(), random))
    else:
        lines = text.split("\n")
        lines[random.integers(len(lines))] = "".join(literal(random) for _ in range(random.integers(1, 4)))
        path.write_bytes("\n".join(lines).encode(errors="surrogateescape"))
    return path


def accelerometer_file(random: np.random.Generator, folder: Path) -> bool:
    """A printer's record of its accelerometer, damaged or altered."""
    lines = accelerations()
    if random.random() < 0.5:
        lines[random.integers(len(lines))] = literal(random)
    content = "\n".join(lines).encode(errors="surrogateescape")
    path = folder / "raw_data_x.csv"
    path.write_bytes(damaged(content, random) if random.random() < 0.7 else content)
    return bool(read_accelerometer(path))


# --- arguments --------------------------------------------------------------------------------------------------------


def constructors() -> Iterator[tuple[str, Any]]:
    """The functions called with arbitrary arguments: shapers, commands, springs, dampers, plants."""
    yield "Shaper", js.Shaper
    for name in ("Step", "Pulse", "Trapezoid", "SCurve", "Sampled", "PiecewisePolynomial"):
        yield name, getattr(js.command, name)
    for name in ("Duffing", "LinearSpring", "PowerLawSpring", "SaturatingSpring", "LinearDamper", "PowerDamper"):
        yield name, getattr(js.plants, name)
    for name in ("ModalPlant", "Crane", "Trolley", "PDController"):
        yield name, getattr(js.plants, name)


def called(random: np.random.Generator, folder: Path) -> bool:
    """A constructor with arbitrary arguments, as Hypothesis finds them: one batch of fifty, of which all are tried."""
    del folder
    known = list(constructors())
    name, kind = known[random.integers(len(known))]
    faults: list[str] = []

    @hypothesis.settings(max_examples=50, database=None, deadline=None, suppress_health_check=CHECKS)
    @hypothesis.seed(int(random.integers(2**31)))
    @hypothesis.given(st.data())
    def one(data: st.DataObject) -> None:
        given = data.draw(arguments(kind))
        try:
            made = kind(**given)
            if not all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(made)):
                faults.append(f"{name}({given}) is not finite")
        except ValueError as error:
            if "\n" in str(error):
                faults.append(f"{name}: a message of several lines")
        except Exception as error:
            faults.append(f"{name}({given}): {type(error).__name__}: {error}")

    one()
    if faults:
        raise FaultError(min(faults, key=len))
    return True


# --- the command line -------------------------------------------------------------------------------------------------


def command_line(random: np.random.Generator, folder: Path) -> bool:
    """A command with arbitrary arguments and files."""
    from experiments.reliability.commands import command

    return _ended(command(random, folder, random.random() < REAL))


def odd_files(random: np.random.Generator, folder: Path) -> bool:
    """A command whose files are odd, in a folder of its own; it ends where it would compute."""
    from experiments.reliability.odd_files import COMPUTED, odd_command, without_computing

    with tempfile.TemporaryDirectory(dir=folder) as own, without_computing():
        os.chdir(own)
        try:
            return _ended(odd_command(random, Path(own)))
        except ValueError as error:
            if COMPUTED in str(error):
                return True
            raise
        finally:
            os.chdir(folder)


def _ended(given: list[str]) -> bool:
    """Whether a command line was obeyed, and not refused in a line."""
    from typer.testing import CliRunner

    from jshape.cli import app

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = CliRunner().invoke(app, given)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise FaultError(f"{' '.join(given)[:120]!r}: {type(result.exception).__name__}: {result.exception}")
    if result.exit_code not in (0, 2):
        raise FaultError(f"{' '.join(given)[:120]!r}: status {result.exit_code}")
    said = [line for line in result.output.splitlines() if line.startswith("jshape: ")]
    if result.exit_code == 2 and len(said) != 1 and "Usage:" not in result.output:
        raise FaultError(f"{' '.join(given)[:120]!r}: {len(said)} lines of error")
    if result.exit_code == 2:
        raise ValueError(said[0] if said else "refused")
    return True


TARGETS: dict[str, tuple[float, Target]] = {
    "problem files, damaged": (15.0, problem_damaged),
    "problem files, altered": (15.0, problem_altered),
    "shaper files": (15.0, shaper_file),
    "measured records": (15.0, record_file),
    "measured records, identified": (1.0, record_identified),
    "accelerometer files": (10.0, accelerometer_file),
    "chunks of a store": (10.0, chunk_file),
    "policies": (8.0, policy_file),
    "arguments, fifty at a time": (1.0, called),
    "command line": (10.0, command_line),
    "problem files, exchanged": (5.0, problem_exchanged),
    "machines' files": (5.0, machine_of_a_problem),
    "machines' files, on a page": (5.0, dropped_machine),
    "problem files, on a page": (5.0, dropped_problem),
    "links of a page": (5.0, shared_link),
    "formats of a page": (2.0, taken_away),
    "films of damaged policies": (1.0, filmed_policy),
    "command line, odd files": (10.0, odd_files),
    "chunks with a right digest": (1.0, chunk_sealed_anew),
    "policies with a right digest": (1.0, policy_sealed_anew),
}
"""What is tried, and its share of the inputs."""


def report(found: dict[str, Found]) -> list[str]:
    """The figures, as lines of Markdown."""
    rows = [
        [name, each.inputs, each.read, each.inputs - each.read - sum(each.faults.values()), sum(each.faults.values()),
         f"{math.ceil(each.seconds)} s"]
        for name, each in found.items()
    ]  # fmt: skip
    lines = markdown.table(["input", "tried", "read", "refused in a line", "faults", "time"], rows)
    faults = [[name, words, count] for name, each in found.items() for words, count in each.faults.items()]
    if faults:
        lines += ["", *markdown.table(["input", "fault", "times"], faults)]
    return lines


if __name__ == "__main__":
    main()
