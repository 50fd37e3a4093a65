"""Command lines with arbitrary arguments."""

from pathlib import Path

import numpy as np

from experiments.reliability.damage import damaged
from experiments.reliability.literals import altered, literal
from experiments.reliability.records import SHAPER, vibration
from experiments.reliability.uploads import with_machine
from jshape.calibration.files import read
from jshape.identification.csv_file import read_csv
from jshape.problems.problem import load
from jshape.problems.reading import shipped

NUMBERS = ("0", "-1", "1", "2", "1e400", "nan", "inf", "1e-12", "1e12", "10" * 12, "", "x", "1,2", "0x10", "٣", "-0.0")

OPTIONS = {
    "export": ["--format", "--sample-time", "--method", "--mode", "--name", "--arithmetic", "--capacity", "--axis",
               "--firmware", "--tolerance", "--out", "--force", "--list"],
    "identify": ["--columns", "--kind", "--input", "--modes", "--sample-rate", "--out"],
    "calibrate": ["--klipper", "--axis", "--component", "--zeta", "--corner-speed", "--highest", "--impulses",
                  "--duration", "--vibration", "--smoothing", "--shift", "--starts", "--seed", "--out"],
    "sweep": ["--metric", "--shaper", "--samples", "--sampling", "--seed", "--store", "--out"],
    "pareto": ["--store", "--out"],
    "adapt": ["--schedules", "--seed", "--out"],
    "evaluate": ["--preset", "--context", "--policy", "--episodes", "--seeds", "--out"],
    "train": ["--preset", "--context", "--action", "--moves", "--environments", "--window", "--learning-rate",
              "--hidden", "--seed", "--out"],
    "new": ["--like"],
    "shape": ["--joint", "--sample-time", "--out", "--force"],
    "animate": ["--shaper", "--policy", "--moves", "--speed", "--out", "--force"],
    "plants": ["--help"],
}  # fmt: skip
"""Each command's options; tune and compare start processes that draw, and share pareto's reading."""

LAST = {
    "train": ["--seed", "-1"], "evaluate": ["--seeds", "0"], "shape": ["--joint", "none"],
    "animate": ["--out", "film.txt"],
}  # fmt: skip
"""What ends a command after everything else has been looked at."""

RIGHT = {
    "--format": ["json", "csv", "c99", "scipy", "numpy", "structured_text", "matlab", "on_off", "klipper", "marlin"],
    "--method": ["nearest", "split", "zeros"], "--mode": ["9.0,0.01", "9,1", "9", "0,0", "1e300,0"],
    "--arithmetic": ["float", "double", "q15", "q31"], "--axis": ["x", "y"], "--firmware": ["current", "2024", "3.6"],
    "--kind": ["ring-down", "step", "sweep", "spectrum", "frequency-response"], "--columns": ["1,2", "time,x", "9,9"],
    "--metric": ["residual_energy", "settling_time"], "--sampling": ["sobol", "normal"],
    "--preset": ["paper", "easy"], "--context": ["hidden", "observed", "noisy"], "--action": ["modal", "impulses"],
    "--policy": ["trained", "zv", "x.npz"], "--joint": ["a=", "b=shaper.json", "a=="], "--speed": ["1", "0.1"],
    "--component": ["xyz", "x"], "--klipper": ["current", "2024"],
}  # fmt: skip


def command(random: np.random.Generator, folder: Path, real: bool) -> list[str]:
    """A command line.

    Args:
        random: chooses it.
        folder: for its files.
        real: whether it may compute what takes seconds; otherwise a wrong argument makes sure that it ends before.
    """
    name = ["export", *OPTIONS][random.integers(1 + len(OPTIONS))]
    given = [name, *_operands(name, random, folder)]
    for _ in range(random.integers(0, 4)):
        option = OPTIONS[name][random.integers(len(OPTIONS[name]))]
        given += [option] if option in ("--force", "--list", "--help") else [option, _value(option, random, folder)]
    if real or name in ("export", "new", "plants") or _refused(name, given):
        return given
    # Nothing may be computed: the last argument is wrong. Every check before that is still made.
    if name in LAST:
        return [*given, *LAST[name]]
    (folder / "file").write_text("", encoding="utf-8")
    return [*given, "--out", str(folder / "file")]


def _refused(name: str, given: list[str]) -> bool:
    """Whether a command ends because of its file."""
    readers = {"identify": read_csv, "calibrate": read, **dict.fromkeys(("sweep", "pareto", "adapt", "animate"), load)}
    try:
        if name in readers and len(given) > 1:
            readers[name](given[1])
    except Exception:
        return True
    return False


def _operands(name: str, random: np.random.Generator, folder: Path) -> list[str]:
    if random.random() < 0.05:
        return []
    if name in ("sweep", "pareto", "adapt", "animate"):
        path = folder / "problem.toml"
        if random.random() < 0.2:
            return [str(with_machine(random, folder))]
        known = [one for one in shipped().values() if one.stem != "own_plant"]
        text = altered(known[random.integers(len(known))].read_text(encoding="utf-8"), random)
        path.write_bytes(text.replace(":", "").encode(errors="surrogateescape"))
        return [str(path)]
    if name in ("identify", "calibrate"):
        path = folder / "record.csv"
        path.write_bytes(damaged(vibration(random).encode(), random))
        return [str(path)]
    if name == "export":
        path = folder / "shaper.json"
        path.write_bytes(damaged(SHAPER.encode(), random) if random.random() < 0.3 else SHAPER.encode())
        return [str(path)]
    if name == "shape":
        lines = ["t [s],a [rad],b [m]", *(f"{0.01 * i:.2f},{i / 50:.6g},{-i / 70:.6g}" for i in range(30))]
        path, content = folder / "trajectory.csv", "\n".join(lines).encode()
        path.write_bytes(damaged(content, random) if random.random() < 0.7 else content)
        return [str(path), *_operands("export", random, folder)]
    if name == "plants":
        return [("", "Crane", "MJCF", "Duffing", "Step", "own", "[/]", "\U0001f600")[random.integers(8)]]
    if name == "new":
        return [str(folder / f"new{random.integers(1000)}.toml")]
    environments = ("DuffingPayload", "CranePayload", "Nothing", "", "\U0001f600")
    return [environments[random.integers(len(environments))]]


def _value(option: str, random: np.random.Generator, folder: Path) -> str:
    kind = random.random()
    if option in ("--out", "--store", "--shaper"):
        places = (
            folder / "file",
            folder / "a" / "b",
            Path("/proc/none"),
            folder / ("x" * 300),
            folder / "\udcff",
            Path(""),
        )
        return str(places[random.integers(len(places))])
    if option in RIGHT and kind < 0.6:
        return RIGHT[option][random.integers(len(RIGHT[option]))]
    return NUMBERS[random.integers(len(NUMBERS))] if kind < 0.9 else literal(random).replace("\0", "")
