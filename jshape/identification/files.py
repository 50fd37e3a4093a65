"""The files of an identification: plain numbers, the fit beside the record, a problem to tune, a figure."""

import csv
import io
import json
from pathlib import Path

import numpy as np

from jshape._files import digest, printable, write_results, write_text
from jshape.identification.planar import IdentifiedPlane
from jshape.identification.result import Identified
from jshape.reports import plot

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
    """A problem file for ``jshape tune``: the plant that was measured, as uncertain as the measurement left it."""
    reach = np.minimum(1.96 * found.omega_std / found.omega, 0.5)
    # Every combination is a plant of its own, so that few values a mode must do where there are many modes.
    count = {1: 11, 2: 5}.get(len(reach), 3)
    uncertain = "\n".join(
        f'"omega.{i}" = {{ low = {1 - r!r}, high = {1 + r!r}, count = {count} }}'
        for i, r in enumerate(reach.tolist())
        if r > 1e-6
    )
    planar = isinstance(found, IdentifiedPlane)
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

# Multiples: the 95 % intervals of the frequencies.
[uncertainty]
{uncertain}

[design]
impulses = {3 if planar else 2 * len(found.omega) + 1}
amplitudes = "positive"
{'shapers = "per axis"' if planar else ""}
"""


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
    file = io.StringIO()
    writer = csv.writer(file)
    writer.writerow(head)
    writer.writerows([repr(float(value)) for value in row] for row in zip(*columns, strict=True))
    write_text(path, file.getvalue())
