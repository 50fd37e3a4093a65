"""Faults in every write: a full disk, a file that grows too large, a read-only folder, a process that is killed.

    python -m experiments.reliability.writes      # writes writes.md beside itself; half an hour
    python -m experiments.reliability.writes --commands adapt train     # these alone, printed

Each command is run anew for each of its first eight files, with that write failing. It must end with one line and
status 2 (where it is killed: with nothing said), every file that is there must be complete, and the same command, given
again, must end as if nothing had happened.
"""

import argparse
import errno
import json
import os
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments import markdown
from experiments.reliability.records import MOVES, SHAPER, accelerations, vibration

COMMANDS = {
    "identify": ["identify", "record.csv", "--modes", "1", "--out", "out"],
    "export": ["export", "shaper.json", "--format", "c99", "--sample-time", "0.01", "--force", "--out", "out.h"],
    "sweep": ["sweep", "problem.toml", "--metric", "residual_energy", "--store", "store", "--out", "out"],
    "pareto": ["pareto", "problem.toml", "--store", "store", "--out", "out"],
    "new": ["new", "--plant", "Crane", "crane.toml"],
    "shape": ["shape", "trajectory.csv", "shaper.json", "--force", "--out", "shaped.csv"],
    "calibrate": ["calibrate", "raw_data_x.csv", "--out", "out"],
    "tune": ["tune", "problem.toml", "--out", "out"],
    "adapt": ["adapt", "link.toml", "--out", "out"],
    "train": [
        *("train", "CranePayload", "--moves", "16", "--environments", "2", "--window", "4", "--hidden", "4"),
        *("--out", "out"),
    ],
    "evaluate": ["evaluate", "CranePayload", "--policy", "zv", "--episodes", "1", "--seeds", "2", "--out", "out"],
    "animate": ["animate", "problem.toml", "--shaper", "shaper.json", "--speed", "10", "--force", "--out", "film.gif"],
    "animate, an episode": [
        *("animate", "CranePayload", "--policy", "zv", "--moves", "1", "--force", "--out", "film.gif"),
    ],
}
"""What is run."""

ERRORS = {"disk full": errno.ENOSPC, "file too large": errno.EFBIG, "read-only": errno.EROFS}

PROBLEM = """\
distance = 1.0

[plant]
type = "ModalPlant"
omega = [4.0]
zeta = [0.05]

[uncertainty]
"omega.0" = { low = 0.9, high = 1.1, count = 5 }

[design]
impulses = 2
starts = 1

[pareto]
impulses = [2]
durations = 2
starts = 1
"""

LINK = """\
distance = 0.5

[plant]
type = "FlexibleLink"
load = 10.0
zeta = [0.017, 0.019]
servo_omega = 40.0
servo_zeta = 0.9

[plant.link]
type = "TabulatedLink"
loads = [0.0, 10.0, 20.0]
omega = [[8.5, 7.3, 5.7], [74.0, 70.0, 66.0]]
length = 0.6096

[adapt]
cases = ["unshaped", "I"]
duration = 80.0
changes = [[0.0, 20.0], [40.5, 10.0]]
omega = [9.0, 70.0]
zeta = [0.017, 0.019]
bands = [[4.0, 14.0], [50.0, 105.0]]
points = 300
schedules = 1
"""

RUNNER = """\
import os, signal, sys
import jshape._files as files
from jshape.cli import app

fault, last = sys.argv[1], int(sys.argv[2])
replace, done = os.replace, []

def failing(source, target):
    # Not those of kept programs, which lie elsewhere and may fail without a word.
    if str(source).endswith(files.PARTIAL) and os.path.abspath(target).startswith(os.getcwd()):
        done.append(target)
        if len(done) == last + 1:
            if fault == "killed":
                os.kill(os.getpid(), signal.SIGKILL)
            raise OSError(int(fault), os.strerror(int(fault)), str(source))
    replace(source, target)

files.os.replace = failing
sys.argv = ["jshape", *sys.argv[3:]]
app()
"""


class Case(NamedTuple):
    """A command with one write that failed.

    Attributes:
        command: its name.
        fault: what happened.
        writes: files that were complete before.
        wrong: what was not as it should be; empty where all was.
    """

    command: str
    fault: str
    writes: int
    wrong: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", nargs="+", choices=[*COMMANDS], default=[*COMMANDS], help="these alone")
    chosen = parser.parse_args().commands
    found = list(cases(chosen))
    rows = []
    for command in chosen:
        for fault in (*ERRORS, "killed"):
            some = [case for case in found if (case.command, case.fault) == (command, fault)]
            wrong = "; ".join(f"{case.writes}: {case.wrong}" for case in some if case.wrong)
            rows.append([command, fault, len(some), wrong or "none"])
    head = ["command", "fault", "writes that failed, one by one", "of these with a half file, no line, or another end"]
    if set(chosen) == set(COMMANDS):
        command = "python -m experiments.reliability.writes"
        markdown.write_beside(__file__, "Faults in every write", command, markdown.table(head, rows))
    else:
        print("\n".join(markdown.table(head, rows)))


def cases(commands: Iterable[str]) -> Iterator[Case]:
    """These commands with every write failing in every way, until each writes no more."""
    for command in commands:
        arguments = COMMANDS[command]
        with tempfile.TemporaryDirectory() as folder:
            expected = _names(_run(Path(folder), arguments, "0", 10**6)[0])
        for fault, code in {**ERRORS, "killed": None}.items():
            # A full disk is met by every file but the last of many; the other faults by two.
            for last in range(8) if fault == "disk full" else (0, 2):
                with tempfile.TemporaryDirectory() as folder:
                    place, done = _run(Path(folder), arguments, "killed" if code is None else str(code), last)
                    if done.returncode == 0:
                        break
                    wrong = " ".join(_wrong(place, done, code) + _again(place, arguments, expected))
                    print(command, fault, last, wrong or "well", flush=True)
                    yield Case(command, fault, last, wrong)


def _run(place: Path, arguments: list[str], fault: str, last: int) -> tuple[Path, subprocess.CompletedProcess]:
    """Run a command in a new folder, with a fault at a write."""
    random = np.random.default_rng(0)
    (place / "record.csv").write_text(vibration(random), encoding="utf-8")
    (place / "shaper.json").write_text(SHAPER, encoding="utf-8")
    (place / "problem.toml").write_text(PROBLEM, encoding="utf-8")
    (place / "link.toml").write_text(LINK, encoding="utf-8")
    (place / "raw_data_x.csv").write_text("\n".join([*accelerations(), ""]), encoding="utf-8")
    (place / "trajectory.csv").write_text(MOVES, encoding="utf-8")
    run = [sys.executable, "-c", RUNNER, fault, str(last), *arguments]
    root = str(Path(__file__).parents[2])
    paths = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": paths}
    return place, subprocess.run(run, cwd=place, env=environment, capture_output=True, text=True, check=False)


def _wrong(place: Path, done: subprocess.CompletedProcess, code: int | None) -> list[str]:
    """The defects after a fault."""
    found = []
    if code is None:
        if done.returncode != -signal.SIGKILL:
            found.append(f"status {done.returncode}")
    else:
        said = [line for line in done.stderr.splitlines() if line.startswith("jshape: ")]
        if done.returncode != 2 or len(said) != 1 or os.strerror(code) not in said[0] or "Traceback" in done.stderr:
            found.append(f"status {done.returncode}, {said}")
        found += [f"left {name}" for name in _names(place) if name.endswith(".partial")]
    return found + [f"half {name}" for name in _names(place) if not whole(place / name)]


def _again(place: Path, arguments: list[str], expected: set[str]) -> list[str]:
    """The defects after the same command without a fault."""
    _, done = _run(place, arguments, "0", 10**6)
    if done.returncode:
        return [f"again: status {done.returncode}: {done.stderr[-200:]}"]
    missing = expected - _names(place)
    return [f"again: without {sorted(missing)}"] if missing else []


def _names(place: Path) -> set[str]:
    return {str(path.relative_to(place)) for path in place.rglob("*") if path.is_file()}


def whole(path: Path) -> bool:
    """Whether a file is complete, as far as its kind can say."""
    if path.suffix == ".partial":
        return True
    content = path.read_bytes()
    try:
        if path.suffix == ".json":
            json.loads(content)
        elif path.suffix == ".toml":
            tomllib.loads(content.decode())
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                list(arrays.values())
    except Exception:
        return False
    ends = {".gif": b"\x3b", ".png": b"IEND\xaeB`\x82", ".pdf": b"%%EOF\n", ".csv": b"\n", ".txt": b"\n", ".h": b"\n"}
    return content.startswith(b"CDF") if path.suffix == ".nc" else content.endswith(ends.get(path.suffix, b""))


if __name__ == "__main__":
    main()
