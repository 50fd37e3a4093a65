"""The files of an identification: plain numbers, the fit beside the record, a problem to tune, a figure."""

import csv
import io
import json
from pathlib import Path

import numpy as np

from jshape._files import digest, printable, write_results, write_text
from jshape.identification.result import Identified
from jshape.reports import plot


def write(found: Identified, folder: Path, name: str) -> list[str]:
    """Write ``results.json``, ``prediction.csv``, ``problem.toml`` and the figure.

    Args:
        found: what is written.
        folder: of the results.
        name: of the record.

    Returns:
        The files' names.
    """
    lower, upper = found.interval()
    name, text = printable(name), problem(found, name)
    record = {
        "identified": name,
        "problem_digest": digest(text),
        "kind": found.kind,
        "status": found.status.value,
        "message": found.message,
        "notes": list(found.notes),
        "units": {"omega": "rad/s", "zeta": "1"},
        "omega_95": lower.T.tolist(),
        "zeta_95": upper.T.tolist(),
        "channels": list(found.names),
    }
    arrays = ("omega", "zeta", "covariance", "gains", "noise", "criteria")
    write_results(folder, record | {name: getattr(found, name).tolist() for name in arrays})
    write_text(folder / "problem.toml", text)
    _write_prediction(found, folder / "prediction.csv")
    spectrum = found.kind == "spectrum"
    axis, modes = (found.axis / (2 * np.pi), found.omega / (2 * np.pi)) if spectrum else (found.axis, None)
    figure = plot.prediction(axis, found.values, found.predict(), found.names, modes)
    plot.save(figure, folder / "prediction.png")
    return ["results.json", "problem.toml", "prediction.csv", "prediction.png", "prediction.pdf"]


def problem(found: Identified, name: str) -> str:
    """A problem file for ``jshape tune``: the plant that was measured, as uncertain as the measurement left it."""
    reach = np.minimum(1.96 * found.omega_std / found.omega, 0.5)
    # Every combination is a plant of its own, so that few values a mode must do where there are many modes.
    count = {1: 11, 2: 5}.get(len(reach), 3)
    uncertain = "\n".join(
        f'"omega.{i}" = {{ low = {1 - r!r}, high = {1 + r!r}, count = {count} }}'
        for i, r in enumerate(reach.tolist())
        if r > 1e-6
    )
    # Of what JSON escapes, TOML knows all but the two halves of a character.
    title = json.dumps(f"Identified from {printable(name)}", ensure_ascii=False)
    return f"""# {printable(found.message)}
title = {title}
distance = 1.0   # m; put the move of your machine here

[plant]
type = "ModalPlant"
omega = {found.omega.tolist()}   # rad/s
zeta = {found.zeta.tolist()}
gains = {found.gains[:, 0].tolist()}

# Multiples: the 95 % intervals of the frequencies.
[uncertainty]
{uncertain}

[design]
impulses = {2 * len(found.omega) + 1}
amplitudes = "positive"
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
