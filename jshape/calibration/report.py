"""A whole calibration: Klipper's table and choice, jshape's offer, what both are worth, and the files to keep."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import numpy as np

from jshape import _check
from jshape._files import MARKER
from jshape.calibration.fit import HIGHEST, fit_all
from jshape.calibration.modes import Mode, identify, remaining_of
from jshape.calibration.recommend import Choice, cost, percent, recommend
from jshape.calibration.score import CEILING, DAMPINGS, Bins, Rated
from jshape.calibration.smoothing import CORNER_SPEED, rounded
from jshape.calibration.spectrum import Spectrum
from jshape.calibration.spectrum_figures import figures
from jshape.calibration.tuned import Tuned, tune
from jshape.export import export
from jshape.export.firmware import REPRAP, klipper, reprapfirmware
from jshape.klipper import DAMPING
from jshape.reports import plot


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Everything that was found. ``simulated``: for each shaper, what a simulation of the identified modes leaves of
    them right after the last impulse, in the spectrum where that is most."""

    spectra: list[Spectrum]
    modes: list[list[Mode]]
    fits: list[Rated]
    choice: Choice
    offer: Tuned
    simulated: dict[str, float]
    version: str
    damping: float
    ceiling: float

    @property
    def shapers(self) -> list[Rated]:
        """Klipper's, then the tuned one."""
        return [*self.fits, self.offer.rated]

    @property
    def verdict(self) -> str:
        """What the tuned shaper brings beside the recommended one."""
        if not self.offer.met:
            return self.offer.result
        best, mine = self.choice.best, self.offer.rated
        modes = f"simulated, the identified modes keep {percent(self.simulated[mine.name])}"
        modes += f" (with {best.name} {percent(self.simulated[best.name])})"
        return f"tuned: {cost(mine, best)}; {modes}; {self.offer.result}"


def calibrate(
    spectra: Sequence[Spectrum],
    *,
    version: str = "current",
    damping: float = DAMPING,
    corner_speed: float = CORNER_SPEED,
    highest: float = HIGHEST,
    duration: float | None = None,
    vibration: float | None = None,
    smoothing: float | None = None,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    **options: Any,
) -> Calibration:
    """Fit, recommend, and tune a shaper of the same vibration for all spectra together.

    ``version``: Klipper's; ``damping``: the printer's ratio, if it has been measured: shapers are made for it and
    judged at 0.75, 1 and 1.5 times it, as Klipper does around 0.1; ``corner_speed``: mm/s; ``highest``: Hz, up to
    which shapers are fitted. The tuned shaper takes no longer than ``duration`` (s; the longest of the fitted ones,
    unless given) and leaves at most ``vibration`` (the recommended shaper's) unless its ``smoothing`` (mm) is limited.
    ``options``: of ``tune``: ``impulses``, ``shift``, ``least``, ``starts``, ``seed``.

    *Raises* ``ValueError`` as ``fit``, ``recommend`` and ``tune`` do.
    """
    if not 0 < damping <= 0.3:
        raise ValueError(f"damping must be over 0, up to 0.3, not {damping!r}")
    _check.not_negative(corner_speed, "corner_speed")
    dampings = tuple(damping / DAMPING * zeta for zeta in DAMPINGS)
    progress("Klipper's shapers", 0, 0)
    shared: dict[str, Any] = dict(dampings=dampings, corner_speed=corner_speed)
    fits = fit_all(spectra, version=version, zeta=damping, highest=highest, **shared)
    choice = recommend(fits, version)
    ceiling = max(CEILING, highest)
    if vibration is None and smoothing is None:
        # As judged with the same frequency shift: no more than the recommended one leaves there.
        bins = Bins(spectra, dampings, options.get("shift", 0.0), ceiling)
        vibration = min(bins.worst(choice.best.amplitudes, choice.best.times), 1 - 1e-9)
    offer = tune(
        spectra,
        duration=max(fitted.duration for fitted in fits) if duration is None else duration,
        vibration=vibration,
        smoothing=smoothing,
        ceiling=ceiling,
        progress=lambda done, total, _: progress("tuning, start", done, total),
        **shared,
        **options,
    )
    progress("simulation of the modes", 0, 0)
    modes = [identify(spectrum, ceiling) for spectrum in spectra]
    simulated = {
        rated.name: max(remaining_of(rated.amplitudes, rated.times, part) for part in modes)
        for rated in [*fits, offer.rated]
    }
    return Calibration(list(spectra), modes, fits, choice, offer, simulated, version, damping, ceiling)


def write(found: Calibration, folder: Path, axis: str) -> list[str]:
    """Numbers, shapers, lines to paste and figures into a folder; returns the files' names."""
    (folder / "shapers").mkdir(parents=True, exist_ok=True)
    names = ["results.json", "paste.txt"]
    (folder / "results.json").write_text(json.dumps(numbers(found), indent=2) + "\n", encoding="utf-8")
    (folder / "paste.txt").write_text(lines(found, axis), encoding="utf-8")
    for rated in found.shapers:
        export(rated.shaper, "json", folder / "shapers" / f"{rated.name}.json", name=rated.name)
        export(rated.shaper, "csv", folder / "shapers" / f"{rated.name}.csv")
        names += [f"shapers/{rated.name}.json", f"shapers/{rated.name}.csv"]
    for name, figure in figures(found.spectra, found.modes[0], found.shapers, found.damping, found.ceiling):
        plot.save(figure, folder / f"{name}.png")
        names += [f"{name}.png", f"{name}.pdf"]
    return names


def lines(found: Calibration, axis: str) -> str:
    """What to paste: Klipper's choice into ``printer.cfg``, the tuned impulses into RepRapFirmware's ``config.g``.

    *Raises* ``ValueError`` for an axis other than ``"x"`` and ``"y"``.
    """
    best, tuned = found.choice.best, found.offer.shaper
    firmware = klipper(best.shaper, axis=axis, firmware=found.version)
    parts = [f"{firmware}# and in [printer], at most: max_accel: {rounded(best.max_accel):d}\n"]
    for version in REPRAP:
        try:
            parts.append(reprapfirmware(tuned, firmware=version))
        except ValueError as error:
            parts.append(f"; tuned: {error}\n")
    return "\n".join(parts)


def numbers(found: Calibration) -> dict[str, Any]:
    """Everything that is a number, as plain data."""
    offer = found.offer
    return {
        "format": MARKER,
        "version": 1,
        "klipper": found.version,
        "damping": found.damping,
        "spectra": [spectrum.name for spectrum in found.spectra],
        "modes": [[dataclasses.asdict(mode) for mode in modes] for modes in found.modes],
        "units": {"frequency": "Hz", "times": "s", "smoothing": "mm", "max_accel": "mm/s^2", "vibration": "fraction"},
        "shapers": [_record(rated, found.simulated[rated.name]) for rated in found.shapers],
        "recommended": found.choice.best.name,
        "reason": found.choice.reason,
        "costs": found.choice.costs,
        "tuned": {
            "result": offer.result,
            "met": offer.met,
            "worst": offer.worst,
            "finer": offer.finer,
            "simulated": offer.simulated,
        },
        "versions": {name: version_of(name) for name in ("jshape", "numpy", "scipy")},
    }


def _record(rated: Rated, simulated: float) -> dict[str, Any]:
    return {
        "name": rated.name,
        "frequency": rated.frequency,
        "amplitudes": np.asarray(rated.amplitudes).tolist(),
        "times": np.asarray(rated.times).tolist(),
        "vibration": rated.vibration,
        "smoothing": rated.smoothing,
        "max_accel": rated.max_accel,
        "score": rated.score,
        "modes_left": simulated,
    }
