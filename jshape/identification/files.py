"""The files of an identification: plain numbers, the fit beside the record, a problem to tune, a figure."""

import csv
import json
from pathlib import Path

import numpy as np

from jshape._files import MARKER
from jshape.identification.prediction_figure import prediction
from jshape.identification.result import Identified
from jshape.reports import plot


def write(found: Identified, folder: Path, name: str) -> list[str]:
    """Write ``results.json``, ``prediction.csv``, ``problem.toml`` and the figure; returns their names."""
    folder.mkdir(parents=True, exist_ok=True)
    lower, upper = found.interval()
    record = {
        "format": MARKER,
        "version": 1,
        "identified": name,
        "kind": found.kind,
        "result": found.result,
        "notes": list(found.notes),
        "units": {"omega": "rad/s", "zeta": "1"},
        "omega": found.omega.tolist(),
        "zeta": found.zeta.tolist(),
        "omega_95": lower.T.tolist(),
        "zeta_95": upper.T.tolist(),
        "covariance": found.covariance.tolist(),
        "channels": list(found.names),
        "gains": found.gains.tolist(),
        "noise": found.noise.tolist(),
        "criteria": found.criteria.tolist(),
    }
    (folder / "results.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    (folder / "problem.toml").write_text(problem(found, name), encoding="utf-8")
    _write_prediction(found, folder / "prediction.csv")
    plot.save(prediction(found), folder / "prediction.png")
    return ["results.json", "problem.toml", "prediction.csv", "prediction.png", "prediction.pdf"]


def problem(found: Identified, name: str) -> str:
    """A problem file for ``jshape tune``: the plant that was measured, as uncertain as the measurement left it."""
    numbers = lambda values: "[" + ", ".join(repr(float(v)) for v in values) + "]"
    reach = np.minimum(1.96 * found.omega_std / found.omega, 0.5)
    # Every combination is a plant of its own, so that few values a mode must do where there are many modes.
    count = {1: 11, 2: 5}.get(len(reach), 3)
    uncertain = "\n".join(
        f'"omega.{i}" = {{ low = {1 - r!r}, high = {1 + r!r}, count = {count} }}'
        for i, r in enumerate(reach.tolist())
        if r > 1e-6
    )
    return f"""# Modes identified from {json.dumps(name)}.
# {found.result}
title = {json.dumps(f"Identified from {name}")}
distance = 1.0   # m; put the move of your machine here

[plant]
type = "ModalPlant"
omega = {numbers(found.omega)}   # rad/s
zeta = {numbers(found.zeta)}
gains = {numbers(found.gains[:, 0])}

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
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows([repr(float(value)) for value in row] for row in zip(*columns, strict=True))
