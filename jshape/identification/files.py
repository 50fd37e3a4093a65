"""The files of an identification: plain numbers, the fit beside the record, a problem to tune, a figure."""

import json
from pathlib import Path

import numpy as np

from jshape._files import as_csv, digest, printable, write_results, write_text
from jshape.design.linear.minimax import minimax
from jshape.identification.planar import IdentifiedPlane
from jshape.identification.result import Identified
from jshape.reports import plot

DRIFT = 0.05
"""By what part a machine's frequencies may differ from those of the record, where nobody says more."""

PER_AXIS = 'impulses = 3\nshapers = "per axis"'

SPREAD, MOST_IMPULSES = np.linspace(-1.0, 1.0, 5), 24
"""Where in its range each frequency is while impulses are counted; and how many there may be, for the search's sake."""

_MOVES = "\n".join(
    f"""
[command.{axis}]
type = "Trapezoid"
distance = "20 mm"   # put the moves of your machine here
speed = "200 mm/s"
acceleration = "5000 mm/s²"
"""
    for axis in "xy"
)


def write(found: Identified | IdentifiedPlane, folder: Path, name: str) -> list[str]:
    """Write ``results.json``, ``problem.toml`` and, for each record, the fit as a table and as a figure.

    Args:
        found: what is written.
        folder: of the results.
        name: of the record.

    Returns:
        The files' names.
    """
    name = printable(name)
    text = problem(found, name)
    planar = isinstance(found, IdentifiedPlane)
    record = {
        "identified": name,
        "problem_digest": digest(text),
        "status": found.status.value,
        "message": found.message,
        "notes": list(found.notes),
        "units": {"omega": "rad/s", "zeta": "1"},
    }
    of_omega, of_zeta = found.interval()
    record |= {"omega_95": of_omega.T.tolist(), "zeta_95": of_zeta.T.tolist()}
    arrays = ("omega", "zeta", "gains", *(("deviations",) if planar else ("covariance", "noise", "criteria")))
    if isinstance(found, IdentifiedPlane):
        record |= {"misfit": found.misfit}
        records = dict(zip(("prediction_x", "prediction_y"), found.records, strict=True))
    else:
        record["kind"] = found.kind
        records = {"prediction": found}
    record["channels"] = list(next(iter(records.values())).names)
    write_results(folder, record | {key: getattr(found, key).tolist() for key in arrays})
    write_text(folder / "problem.toml", text)
    for stem, each in records.items():
        _write_prediction(each, folder / f"{stem}.csv")
        spectrum = each.kind == "spectrum"
        axis, modes = (each.axis / (2 * np.pi), each.omega / (2 * np.pi)) if spectrum else (each.axis, None)
        figure = plot.prediction(axis, each.values, each.predict(), each.names, modes)
        plot.save(figure, folder / f"{stem}.png")
    return ["results.json", "problem.toml", *(f"{stem}.{end}" for stem in records for end in ("csv", "png", "pdf"))]


def problem(found: Identified | IdentifiedPlane, name: str) -> str:
    """A problem file for ``jshape tune``: the plant that was measured, uncertain by the measurement's interval and by
    ``DRIFT``, and a shaper that lasts as long as ZVD."""
    planar = isinstance(found, IdentifiedPlane)
    modes = len(found.omega)
    reach = np.minimum(np.nan_to_num(1.96 * found.omega_std / found.omega), 0.45) + DRIFT
    # Every combination is a plant of its own, so that few values a mode must do where there are many modes.
    count = {1: 11, 2: 5, 3: 3}.get(modes, 2)
    uncertain = "\n".join(
        f'"omega.{i}" = {{ low = {1 - r:.4f}, high = {1 + r:.4f}, count = {count} }}' for i, r in enumerate(reach)
    )
    move = _MOVES if planar else "distance = 1.0   # m; put the move of your machine here\n"
    # Of what JSON escapes, TOML knows all but the two halves of a character.
    title = json.dumps(f"Identified from {printable(name)}", ensure_ascii=False)
    return f"""# {printable(found.message)}
title = {title}
{move}
[plant]
type = "{"PlanarModes" if planar else "ModalPlant"}"
omega = {found.omega.tolist()}   # rad/s
zeta = {found.zeta.tolist()}
gains = {(found.gains if planar else found.gains[:, 0]).tolist()}

# Multiples of the frequencies: their 95 % intervals, and {100 * DRIFT:g} % to either side for loads, poses and
# temperatures other than the record's; put here what your machine meets.
[uncertainty]
{uncertain}

[design]
amplitudes = "positive"
{PER_AXIS if planar else _time(found.omega, found.zeta, reach)}
"""


def _time(omega: np.ndarray, zeta: np.ndarray, reach: np.ndarray) -> str:
    """The time that ZVD takes, and as many impulses as help in that time against modes anywhere in their ranges."""
    zeta = np.minimum(zeta, 0.99)
    duration = float(sum(2 * np.pi / (omega * np.sqrt(1 - zeta**2))))
    ranges = omega * (1 + reach * SPREAD[:, None])
    found = minimax(ranges * (-zeta + 1j * np.sqrt(1 - zeta**2)), ranges**2, duration)
    count = max(len(found.times), 3)
    words = (
        "more would not help in this time" if count <= MOST_IMPULSES else f"{count} would leave less, and take longer"
    )
    return f"""impulses = {min(count, MOST_IMPULSES)}   # {words}
duration = {duration:.6g}   # s: a period of each mode, as ZVD takes; a longer one leaves less"""


def _write_prediction(found: Identified, path: Path) -> None:
    """The record and the fit, a line a row; complex columns as two."""
    fitted = found.predict()
    head, columns = ["omega_rad_s" if found.kind == "spectrum" else "time_s"], [found.axis]
    for i, channel in enumerate(found.names):
        for word, values in (("measured", found.values[:, i]), ("fit", fitted[:, i])):
            parts = (
                [("real", np.real(values)), ("imag", np.imag(values))] if np.iscomplexobj(values) else [("", values)]
            )
            head += [f"{channel} {word} {part}".strip() for part, _ in parts]
            columns += [part for _, part in parts]
    rows = ([repr(float(value)) for value in row] for row in zip(*columns, strict=True))
    write_text(path, as_csv(head, rows, "\r\n"))
