"""A whole calibration: Klipper's table and choice, jshape's offer, what both are worth, and the files to keep."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jshape import _check
from jshape._files import write_results, write_text
from jshape._types import Progress
from jshape.calibration.fit import HIGHEST, fit_all
from jshape.calibration.modes import Mode, identify, remaining_of, step_response
from jshape.calibration.recommend import Choice, cost, percent, recommend
from jshape.calibration.score import CEILING, ZETAS, Bins, Rated, vibration
from jshape.calibration.smoothing import CORNER_SPEED, rounded
from jshape.calibration.spectrum import Spectrum
from jshape.calibration.tuned import LEAST, Tuned, tune
from jshape.export import export
from jshape.export.firmware import REPRAP, klipper, reprapfirmware
from jshape.klipper import DAMPING
from jshape.reports import plot
from jshape.status import Result, Status


@dataclasses.dataclass(frozen=True)
class Calibration(Result):
    """A printer's shapers: Klipper's and the tuned one.

    Attributes:
        spectra: measured.
        modes: of each spectrum.
        fits: Klipper's shapers, each at its best frequency.
        choice: the one that Klipper recommends.
        offer: the tuned one.
        simulated: for each shaper, the share of the identified modes that remains after its last impulse in a
            simulation, in the spectrum where that is most.
        version: Klipper's.
        zeta: the printer's damping ratio.
        ceiling: Hz, up to which the spectra count.
    """

    spectra: list[Spectrum]
    modes: list[list[Mode]]
    fits: list[Rated]
    choice: Choice
    offer: Tuned
    simulated: dict[str, float]
    version: str
    zeta: float
    ceiling: float

    @property
    def status(self) -> Status:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The tuned shaper's."""
        return self.offer.status

    @property
    def shapers(self) -> list[Rated]:
        """Klipper's, then the tuned one."""
        return [*self.fits, self.offer.rated]

    @property
    def message(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """What the tuned shaper brings beside the recommended one."""
        if not self.converged:
            return self.offer.message
        best, mine = self.choice.best, self.offer.rated
        modes = f"simulated, the identified modes keep {percent(self.simulated[mine.name])}"
        modes += f" (with {best.name} {percent(self.simulated[best.name])})"
        return f"tuned: {cost(mine, best)}; {modes}; {self.offer.message}"


def calibrate(
    spectra: Sequence[Spectrum],
    *,
    version: str = "current",
    zeta: float = DAMPING,
    corner_speed: float = CORNER_SPEED,
    highest: float = HIGHEST,
    duration: float | None = None,
    vibration: float | None = None,
    smoothing: float | None = None,
    impulses: int = 4,
    shift: float = 0.0,
    least: float = LEAST,
    starts: int = 16,
    seed: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """Fit Klipper's shapers, recommend one, and tune a shaper of the same vibration for all spectra together.

    Args:
        spectra: measured, that share the shaper.
        version: Klipper's, ``"current"`` or ``"2024"``.
        zeta: the printer's damping ratio, if it has been measured: shapers are made for it and judged at 0.75, 1 and
            1.5 times it, as Klipper does around 0.1.
        corner_speed: mm/s.
        highest: Hz, up to which shapers are fitted.
        duration: the most that the tuned shaper may last, s; the longest of the fitted ones unless given.
        vibration: the most that it may leave; the recommended shaper's unless given, or ``smoothing`` is limited.
        smoothing: the most, mm.
        impulses: of the tuned shaper, at least 2.
        shift: fraction by which all frequencies may be off.
        least: amplitude of each impulse.
        starts: of the search, at most.
        seed: of the starts.
        progress: called along the way.

    Raises:
        ValueError: as ``fit``, ``recommend`` and ``tune`` do.
    """
    if not 0 < zeta <= 0.3:
        raise ValueError(f"zeta must be over 0, up to 0.3, not {zeta!r}")
    _check.not_negative(corner_speed, "corner_speed")
    zetas = tuple(zeta / DAMPING * usual for usual in ZETAS)
    if progress is not None:
        progress("Klipper's shapers", 0, 0, math.inf)
    fits = fit_all(spectra, version=version, zeta=zeta, zetas=zetas, corner_speed=corner_speed, highest=highest)
    choice = recommend(fits, version)
    ceiling = max(CEILING, highest)
    if vibration is None and smoothing is None:
        # As judged with the same frequency shift: no more than the recommended one leaves there.
        bins = Bins(spectra, zetas, shift, ceiling)
        vibration = min(bins.worst(choice.best.amplitudes, choice.best.times), 1 - 1e-9)
    offer = tune(
        spectra,
        duration=max(fitted.duration for fitted in fits) if duration is None else duration,
        vibration=vibration,
        smoothing=smoothing,
        impulses=impulses,
        shift=shift,
        zetas=zetas,
        corner_speed=corner_speed,
        ceiling=ceiling,
        least=least,
        starts=starts,
        seed=seed,
        progress=progress,
    )
    modes = [identify(spectrum, ceiling) for spectrum in spectra]
    simulated = {
        rated.name: max(remaining_of(rated.amplitudes, rated.times, part) for part in modes)
        for rated in [*fits, offer.rated]
    }
    return Calibration(list(spectra), modes, fits, choice, offer, simulated, version, zeta, ceiling)


def write(found: Calibration, folder: Path, axis: str, reprap: bool = False) -> list[str]:
    """Write numbers, shapers, lines to paste and figures into a folder.

    Args:
        found: what is written.
        folder: of the results.
        axis: of the printer, ``"x"`` or ``"y"``.
        reprap: whether ``paste.txt`` has RepRapFirmware's line, too.

    Returns:
        The files' names.
    """
    names = ["results.json", "paste.txt"]
    write_results(folder, numbers(found))
    write_text(folder / "paste.txt", lines(found, axis, reprap))
    (folder / "shapers").mkdir(exist_ok=True)
    for rated in found.shapers:
        export(rated.shaper, "json", folder / "shapers" / f"{rated.name}.json", name=rated.name)
        export(rated.shaper, "csv", folder / "shapers" / f"{rated.name}.csv")
        names += [f"shapers/{rated.name}.json", f"shapers/{rated.name}.csv"]
    for name, figure in figures(found):
        plot.save(figure, folder / f"{name}.png")
        names += [f"{name}.png", f"{name}.pdf"]
    return names


def figures(found: Calibration) -> Iterator[tuple[str, Figure]]:
    """Each figure by its name: spectrum and shapers over the frequency, and the step response."""
    modes, zeta = found.modes[0], found.zeta
    shown = _shown(found)
    spectra = [(s.name, s.frequencies, s.density / s.density.max()) for s in found.spectra]
    _, f, p = spectra[0]
    best = found.choice.best
    after = (best.name, f, p * vibration(best.amplitudes, best.times, f, zeta))
    f = np.linspace(1, found.ceiling, 800)
    left = [(r.name, f, 100 * vibration(r.amplitudes, r.times, f, zeta)) for r in shown]
    yield "calibration", plot.calibration(spectra, after, left, [mode.frequency for mode in modes])
    slowest = 1 / min(mode.frequency for mode in modes)
    t = np.linspace(0, max(r.duration for r in shown) + 2 * slowest, 800)
    impulses = [("unshaped", [1.0], [0.0]), *((r.name, r.amplitudes, r.times) for r in shown)]
    steps = [(name, 1e3 * t, step_response(a, times, modes, t)) for name, a, times in impulses]
    yield "step", plot.curves(steps, ("time (ms)", "position over the step"))


def _shown(found: Calibration) -> list[Rated]:
    """Five shapers at most: the tuned one, the recommended one and those whose scores are next."""
    others = sorted(
        (r for r in found.shapers if r.name != "tuned"), key=lambda r: (r is not found.choice.best, r.score)
    )
    return [r for r in found.shapers if r.name == "tuned" or r in others[:4]]


def lines(found: Calibration, axis: str, reprap: bool = False) -> str:
    """What to paste: Klipper's choice into ``printer.cfg``, the tuned impulses into RepRapFirmware's ``config.g``.

    Args:
        found: what is written.
        axis: of the printer, ``"x"`` or ``"y"``.
        reprap: whether RepRapFirmware's line is asked for.

    Raises:
        ValueError: for an axis other than ``"x"`` and ``"y"``.
    """
    best, tuned = found.choice.best, found.offer.shaper
    firmware = klipper(best.shaper, axis=axis, firmware=found.version)
    parts = [f"{firmware}# and in [printer], at most: max_accel: {rounded(best.max_accel):d}\n"]
    words = "Paste these lines into printer.cfg. Klipper takes its own shapers alone, not the tuned one"
    parts.append(f"# {words}{'' if reprap else '; RepRapFirmware does (--reprapfirmware)'}.\n")
    for version in REPRAP if reprap else ():
        try:
            parts.append(reprapfirmware(tuned, firmware=version))
        except ValueError as error:
            parts.append(f"; tuned: {error}\n")
    return "\n".join(parts)


def numbers(found: Calibration) -> dict[str, Any]:
    """Everything that is a number, as plain data."""
    offer = found.offer
    return {
        "klipper": found.version,
        "zeta": found.zeta,
        "spectra": [spectrum.name for spectrum in found.spectra],
        "modes": [[dataclasses.asdict(mode) for mode in modes] for modes in found.modes],
        "units": {"frequency": "Hz", "times": "s", "smoothing": "mm", "max_accel": "mm/s^2", "vibration": "fraction"},
        "shapers": [_record(rated, found.simulated[rated.name]) for rated in found.shapers],
        "recommended": found.choice.best.name,
        "reason": found.choice.reason,
        "costs": found.choice.costs,
        "tuned": {
            "status": offer.status.value,
            "message": offer.message,
            **{name: getattr(offer, name) for name in ("worst", "finer", "simulated")},
        },
        "versions": {name: version_of(name) for name in ("jshape", "numpy", "scipy")},
    }


def _record(rated: Rated, simulated: float) -> dict[str, Any]:
    about = dataclasses.asdict(rated)
    lists = {name: np.asarray(about[name]).tolist() for name in ("amplitudes", "times")}
    return {**about, **lists, "score": rated.score, "modes_left": simulated}
