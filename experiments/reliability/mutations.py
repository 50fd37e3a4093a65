"""The mutation score: which share of faults, seeded one at a time, the quick tests catch.

    python -m experiments.reliability.mutations --count 60 --seed 0       # writes mutations.json and mutations.md

The tree is copied to a temporary folder; there one fault after another is seeded, and the tests that can notice it run
until one fails. Faults are drawn evenly over ``ROOMS``, and in each over the kinds of faults, in an order that the seed
decides: a greater count begins with the same ones. A test that fails or a run over ``LIMIT`` catches a fault; at the
end those tests run once without any fault. What is found is kept at once, so that an interrupted run goes on where it
stopped; faults that survived are tried again, unless ``mutations.toml`` says why they are none. With ``--whole`` they
meet the whole quick set.
"""

import argparse
import hashlib
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from experiments.markdown import table
from experiments.reliability.faults import Fault, faults, seeded
from jshape._files import whole

T = TypeVar("T")

ROOT = Path(__file__).parents[2]
RECORD = Path(__file__).with_suffix(".json")
REASONS = Path(__file__).with_suffix(".toml")

COPIED = ("jshape", "envs", "experiments", "tests", "pyproject.toml", "README.md")

LIMIT = 300
"""Seconds of the processor after which a run of tests counts as caught: the fault made something endless."""

ROOMS = {
    "simulation": "jshape/simulation/*.py",
    "metrics": "jshape/metrics.py",
    "shaper": "jshape/shaper.py",
    "command": "jshape/command.py",
    "design/energy": "jshape/design/energy.py",
    "design/linear": "jshape/design/linear/*.py",
    "export": "jshape/export/*.py",
    "_files": "jshape/_files.py",
}

TESTS = {
    "jshape/simulation/angles.py": ("angles",),
    "jshape/simulation/batches.py": ("steps",),
    "jshape/simulation/components.py": ("components", "integrate"),
    "jshape/simulation/energy_profile.py": ("metrics", "papers_energy::test_energies_along_the_three_impulse_move"),
    "jshape/simulation/integrate.py": ("integrate", "components"),
    "jshape/simulation/peaks.py": ("peaks",),
    "jshape/simulation/replay.py": ("steps::test_any_tolerance_is_met", "steps"),
    "jshape/simulation/residual.py": ("metrics", "steps::test_what_is_not_met_raises_or_is_nan", "papers_energy"),
    "jshape/simulation/response.py": ("simulate",),
    "jshape/simulation/schedule.py": ("simulate::test_every_command", "simulate", "metrics"),
    "jshape/simulation/simulate.py": ("simulate", "papers_energy::test_exact_shapers_leave_nothing"),
    "jshape/simulation/solver.py": ("integrate", "simulate"),
    "jshape/simulation/steps.py": (
        "steps::test_any_tolerance_is_met",
        "steps::test_steps_go_where_the_time_is",
        "steps::test_moves_that_linearised_frequencies_get_wrong",
        "steps::test_infinite_only_where_the_plant_has_left_for_good",
        "steps",
    ),
    "jshape/simulation/trajectory.py": ("metrics", "papers_energy::test_overshoot_with_a_strong_damper"),
    "jshape/metrics.py": (
        "metrics",
        "steps::test_what_is_not_met_raises_or_is_nan",
    ),
    "jshape/shaper.py": ("shaper", "export", "export_c99"),
    "jshape/command.py": ("command", "shaper", "command_ties"),
    "jshape/design/energy.py": ("energy", "papers_energy"),
    "jshape/design/linear/minimax.py": ("linear", "linear_models::test_the_least_of_any_positive_impulses_in_any_unit"),
    "jshape/design/linear": ("linear",),
    "jshape/export/c99.py": ("export_c99", "export", "cli_export"),
    "jshape/export/firmware.py": ("export_firmware", "export", "cli_export"),
    "jshape/export/structured_text.py": ("export_structured_text", "export", "cli_export"),
    "jshape/export/on_off.py": ("export_structured_text", "export"),
    "jshape/export/equations.py": ("export_fmu",),
    "jshape/export/fmu.py": ("export_fmu",),
    "jshape/export/plant.py": ("export_fmu",),
    "jshape/export/compiler.py": ("export_fmu",),
    "jshape/export": ("export", "export_c99", "export_structured_text", "export_firmware", "cli_export"),
    "jshape/_files.py": ("files", "kept_files", "cli_outputs", "cli"),
}
"""The quick tests that can notice a fault of a file, most telling first."""


class Result(NamedTuple):
    """A fault that was tried.

    Attributes:
        room, file, line, kind, name: where and what it is.
        caught: by which test, or by the limit of time; empty if all tests passed.
        seconds: that the tests took.
    """

    room: str
    file: str
    line: int
    kind: str
    name: str
    caught: str
    seconds: float

    @property
    def key(self) -> str:
        return key(self.file, self.name)


def key(file: str, name: str) -> str:
    """The name of a fault in the files beside this one: it outlasts other changes of the module."""
    return f"{file}: {name}"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="how many faults")
    parser.add_argument("--seed", type=int, default=0, help="which ones")
    parser.add_argument("--whole", action="store_true", help="try survivors on the whole quick set")
    parser.add_argument("--minutes", type=float, default=600.0, help="begin no fault after so long")
    options = parser.parse_args(arguments)
    begin, known, reasons = time.monotonic(), read(), reasons_given()
    drawn = draw(options.count, options.seed)
    waiting = [(room, file, fault) for room, file, fault in drawn if due(known.get(key(file, fault.name)), reasons)]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        copy_tree(tree)
        for number, (room, file, fault) in enumerate(waiting, 1):
            if time.monotonic() - begin > 60 * options.minutes:
                break
            run = try_fault(tree, file, fault, tests_of(file))
            if options.whole and not run.caught:
                run = try_fault(tree, file, fault, ["tests"])
            found = Result(room, file, fault.line, fault.kind, fault.name, run.caught, round(run.seconds, 1))
            known[found.key] = found
            keep(drawn, known, reasons, options)
            about = f"{number}/{len(waiting)} {run.seconds:4.0f} s  {file}:{fault.line} {fault.name}"
            print(f"{about}: {found.caught or 'SURVIVED'}", flush=True)
        confirm(tree, known)
    keep(drawn, known, reasons, options)


Drawn = list[tuple[str, str, Fault]]
"""Rooms, files and faults."""


def draw(count: int, seed: int) -> Drawn:
    """So many faults, evenly over the rooms, and within each over the kinds; a change elsewhere draws no other ones."""

    def place(name: str) -> str:
        return hashlib.sha256(f"{seed} {name}".encode()).hexdigest()

    rooms = []
    for room, pattern in ROOMS.items():
        kinds: dict[str, Drawn] = {}
        for path in sorted(ROOT.glob(pattern)):
            file = path.relative_to(ROOT).as_posix()
            for fault in faults(path.read_text(encoding="utf-8")):
                kinds.setdefault(fault.kind, []).append((room, file, fault))

        def order(drawn):
            return place(key(drawn[1], drawn[2].name))

        groups = [sorted(kinds[kind], key=order) for kind in sorted(kinds, key=place)]
        rooms.append(list(in_turn(groups)))
    return list(itertools.islice(in_turn(rooms), count))


def in_turn(groups: Iterable[Iterable[T]]) -> Iterator[T]:
    """One of each group, then the next of each, and so on."""
    nothing = object()
    for row in itertools.zip_longest(*groups, fillvalue=nothing):
        yield from (item for item in row if item is not nothing)  # pyright: ignore[reportReturnType]


def due(known: Result | None, reasons: dict[str, str]) -> bool:
    return known is None or (not known.caught and known.key not in reasons)


def confirm(tree: Path, known: dict[str, Result]) -> None:
    """Run once more, without any fault, the tests that caught one; drop what was caught by a test that fails anyway."""
    catchers = {result.caught for result in known.values() if "::" in result.caught}
    while catchers and (wrong := try_tests(tree, sorted(catchers), limit=10 * LIMIT).caught):
        print(f"{wrong} fails without any fault", flush=True)
        for result in [result for result in known.values() if result.caught == wrong]:
            del known[result.key]
        catchers.remove(wrong)


def tests_of(file: str) -> list[str]:
    names = TESTS.get(file) or TESTS[str(Path(file).parent)]
    files = [name.partition("::") for name in names]
    return [f"tests/test_{name}.py{separator}{test}" for name, separator, test in files]


def copy_tree(target: Path) -> None:
    """A copy of the part of this checkout that the tests need."""
    unwanted = shutil.ignore_patterns("__pycache__", ".*_cache", "*.egg-info")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target / name, ignore=unwanted)
        else:
            shutil.copy2(ROOT / name, target / name)


class Run(NamedTuple):
    caught: str
    seconds: float


def try_fault(tree: Path, file: str, fault: Fault, tests: list[str]) -> Run:
    """The tests with the fault in that file of a copy of the tree, which is as before afterwards."""
    path = tree / file
    sound = path.read_text(encoding="utf-8")
    try:
        write_module(path, seeded(sound, fault))
        return try_tests(tree, tests)
    finally:
        write_module(path, sound)


def write_module(path: Path, source: str) -> None:
    path.write_text(source, encoding="utf-8")
    # Python knows compiled modules by second and size, which two faults may share.
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def try_tests(tree: Path, tests: list[str], limit: int = LIMIT) -> Run:
    """Tests of a tree, in the order given, until one fails: its name, or none.

    Raises:
        RuntimeError: where no test ran.
    """
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tree), str(tree / "envs")])}
    begin = time.monotonic()
    run = subprocess.run(
        ["bash", "-c", f'ulimit -t {limit}; exec "$@"', "tests", *command],
        cwd=tree, env=environment, capture_output=True, text=True, errors="replace",
    )  # fmt: skip
    seconds = time.monotonic() - begin
    if run.returncode in (-signal.SIGKILL, -signal.SIGXCPU):
        return Run(f"the limit of {limit} s", seconds)
    if run.returncode == 0:
        return Run("", seconds)
    # A test that is there no longer catches nothing either: it fails without any fault.
    pattern = rf"^(?:FAILED|ERROR|ERROR: not found:) (?:{re.escape(str(tree))}/)?(tests/.+?)(?: - .*)?$"
    failed = re.search(pattern, run.stdout + run.stderr, re.MULTILINE)
    if failed:
        return Run(failed[1], seconds)
    if run.returncode in (1, 2) or "ImportError while loading conftest" in run.stderr:
        return Run("the import of jshape", seconds)
    raise RuntimeError(f"pytest ended with {run.returncode}:\n{run.stdout}\n{run.stderr}")


def read() -> dict[str, Result]:
    """Stored results, by key."""
    if not RECORD.exists():
        return {}
    results = [Result(**row) for row in json.loads(RECORD.read_text(encoding="utf-8"))["results"]]
    return {result.key: result for result in results}


def reasons_given() -> dict[str, str]:
    """By key, why a fault that survives is none."""
    return tomllib.loads(REASONS.read_text(encoding="utf-8")) if REASONS.exists() else {}


def keep(drawn: Drawn, known: dict[str, Result], reasons: dict[str, str], options: argparse.Namespace) -> None:
    """Write what is known of the faults that were drawn, as JSON and as a table."""
    lines = {key(file, fault.name): fault.line for _, file, fault in drawn}
    results = [known[name]._replace(line=line) for name, line in lines.items() if name in known]
    record = {"seed": options.seed, "drawn": len(drawn), "results": [result._asdict() for result in results]}
    with whole(RECORD) as file:
        file.write(f"{json.dumps(record, indent=1, ensure_ascii=False)}\n".encode())
    with whole(RECORD.with_suffix(".md")) as file:
        file.write("\n".join([*report(results, reasons, options.seed), ""]).encode())


def report(results: list[Result], reasons: dict[str, str], seed: int) -> list[str]:
    """The score, by room and by kind, and every fault with what caught it, as lines of Markdown."""

    def outcome(result: Result) -> str:
        test = result.caught.removeprefix("tests/")
        return f"`{test}`" if result.caught else reasons.get(result.key, "**survived**")

    def share(about: str, some: list[Result]) -> list[object]:
        caught = sum(bool(result.caught) for result in some)
        none = sum(not result.caught and result.key in reasons for result in some)
        return [about, len(some), caught, none, f"{100 * caught / max(len(some) - none, 1):.1f} %"]

    head = ["", "tried", "caught", "no faults", "score"]
    rooms = [share(room, [result for result in results if result.room == room]) for room in ROOMS]
    kinds = [share(kind, [r for r in results if r.kind == kind]) for kind in sorted({r.kind for r in results})]
    rows = [(f"`{r.file}:{r.line}`", f"`{r.name}`", outcome(r)) for r in sorted(results, key=lambda r: r[1:3])]
    return [
        *("# Seeded faults", ""),
        f"{len(results)} of those that `python -m experiments.reliability.mutations --seed {seed}` draws.",
        "The score is the share that the quick tests of the room catch; faults that change no result do not count.",
        *("", *table(head, [*rooms, share("all", results)]), "", *table(head, kinds), ""),
        *table(["place", "fault", "caught by, or why it is none"], rows),
    ]


if __name__ == "__main__":
    main()
