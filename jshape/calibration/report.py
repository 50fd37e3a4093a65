"""A whole calibration: Klipper's table and choice, jshape's two offers, what all are worth, and the files to keep."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from jshape import _check
from jshape._blas import one_thread
from jshape._files import write_results, write_text
from jshape._types import Progress
from jshape.calibration.family import tune_firmware
from jshape.calibration.fit import HIGHEST, OFFERED, fit_all
from jshape.calibration.modes import Mode, identify, remaining_of, step_response
from jshape.calibration.recommend import Choice, cost, percent, recommend
from jshape.calibration.score import CEILING, ZETAS, Bins, Rated, vibration
from jshape.calibration.smoothing import CORNER_SPEED, rounded
from jshape.calibration.spectrum import NEARLY, WINDOW, Spectrum
from jshape.calibration.tuned import LEAST, Tuned, judged, tune
from jshape.export import export
from jshape.export.firmware import REPRAP, SINCE, klipper_section, reprapfirmware
from jshape.export.firmware import kalico as kalico_list
from jshape.export.text import comment
from jshape.klipper import DAMPING, highest_zeta
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
        stock: the best that the same Klipper can compute, with tuned parameters.
        offer: the tuned one, a list of impulses.
        smooth: the best of Kalico's smooth shapers; ``None`` unless asked for.
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
    stock: Tuned
    offer: Tuned
    smooth: Tuned | None
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
        """Klipper's, those that a firmware computes with tuned parameters, and the tuned list of impulses."""
        tuned = {"klipper_tuned": self.stock, "kalico_smooth": self.smooth, "tuned": self.offer}
        return [*self.fits, *(dataclasses.replace(of.rated, name=name) for name, of in tuned.items() if of)]

    @property
    def message(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The tuned shaper compared with the recommended one, and what speaks against the records."""
        doubts = [
            f"; {spectrum.name}: {100 * NEARLY:.0f} % of its power lie within {WINDOW:g} s, as after a single blow;"
            " damping ratios need a test that shakes at all frequencies in turn (of a ring-down: jshape identify)"
            for spectrum in self.spectra
            if spectrum.transient
        ]
        return self._comparison + "".join(doubts)

    @property
    def _comparison(self) -> str:
        if not self.converged:
            return self.offer.message
        best, mine = self.choice.best, self.offer.rated
        modes = f"simulated, the identified modes keep {percent(self.simulated[mine.name])}"
        modes += f" (with {best.name} {percent(self.simulated[best.name])})"
        return f"tuned: {cost(mine, best)}; {modes}; {self.offer.message}"

    @property
    def why(self) -> list[str]:
        """The reason for the choice of the shaper in the lines to paste, in two lines."""
        best, mine = self.choice.best, self.stock.rated
        if not self.stock.converged or (mine.name == best.name and mine.frequency == best.frequency):
            return [f"Why this one: it is Klipper's own choice; {self.choice.reason}.", "Tuned, no other is better."]
        blur, faster = mine.smoothing / best.smoothing - 1, mine.max_accel / max(best.max_accel, 1e-9) - 1
        return [
            f"Why this one: it rounds corners by {mine.smoothing:.4f} mm, {best.label} by {best.smoothing:.4f} mm: "
            f"{_change(blur)}, {_change(faster)} acceleration;",
            f"it leaves {percent(mine.vibration)} of the measured vibration, that one {percent(best.vibration)}.",
        ]


def _change(ratio: float) -> str:
    return f"{abs(100 * ratio):.1f} % {'more' if ratio > 0 else 'less'}"


@one_thread()
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
    kalico: bool = False,
    progress: Progress | None = None,
) -> Calibration:
    """Fit Klipper's shapers, recommend one, and tune two of the same vibration for all spectra together.

    One is what stock Klipper computes by itself, with tuned parameters; the other a list of impulses.

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
        kalico: whether Kalico's smooth shapers are tuned, too.
        progress: called along the way.

    Raises:
        ValueError: as ``fit``, ``recommend`` and ``tune`` do.
    """
    _check.require(zeta, "zeta", lambda z: 0 < z <= 0.3, "be over 0, up to 0.3")
    _check.function(progress, "progress")
    _check.not_negative(corner_speed, "corner_speed")
    zetas = tuple(zeta / DAMPING * usual for usual in ZETAS)
    if progress is not None:
        progress("Klipper's shapers", 0, 0, math.inf)
    kinds = [kind for kind in OFFERED if zeta <= highest_zeta(kind, version)]
    fits = fit_all(spectra, kinds, version=version, zeta=zeta, zetas=zetas, corner_speed=corner_speed, highest=highest)
    choice = recommend(fits, version)
    ceiling = max(CEILING, highest)
    if vibration is None and smoothing is None:
        # As judged with the same frequency shift: no more than the recommended one leaves there.
        bins = Bins(spectra, zetas, shift, ceiling)
        vibration = min(bins.worst(choice.best.amplitudes, choice.best.times), 1 - 1e-9)
    common: Any = dict(vibration=vibration, smoothing=smoothing, shift=shift, zetas=zetas, corner_speed=corner_speed)
    own: Any = dict(zeta=zeta, highest=highest, progress=progress, **common)
    stock = tune_firmware(spectra, version=version, **own)
    if vibration is not None and stock.rated.smoothing >= choice.best.smoothing:
        recommended = judged(choice.best, spectra, True, "Klipper's own choice", shift, zetas, ceiling)
        stock = recommended if recommended.worst <= vibration else stock
    smooth = tune_firmware(spectra, version="kalico", **own) if kalico else None
    offer = tune(
        spectra,
        duration=max(fitted.duration for fitted in fits) if duration is None else duration,
        impulses=impulses,
        ceiling=ceiling,
        least=least,
        starts=starts,
        seed=seed,
        progress=progress,
        **common,
    )
    modes = [identify(spectrum, ceiling) for spectrum in spectra]
    found = Calibration(list(spectra), modes, fits, choice, stock, offer, smooth, {}, version, zeta, ceiling)
    for rated in found.shapers:
        found.simulated[rated.name] = max(remaining_of(rated.amplitudes, rated.times, part) for part in modes)
    return found


def write(found: Calibration, folder: Path, axis: str, reprap: bool = False, kalico: bool = False) -> list[str]:
    """Write numbers, shapers, lines to paste and figures into a folder.

    Args:
        found: what is written.
        folder: of the results.
        axis: of the printer, ``"x"`` or ``"y"``.
        reprap: whether ``paste.txt`` has RepRapFirmware's line, too.
        kalico: whether it has Kalico's lines, too.

    Returns:
        The files' names.
    """
    names = ["results.json", "paste.txt"]
    write_results(folder, numbers(found))
    write_text(folder / "paste.txt", lines(found, axis, reprap, kalico))
    (folder / "shapers").mkdir(exist_ok=True)
    for rated in found.shapers:
        export(rated.shaper, "json", folder / "shapers" / f"{rated.name}.json", name=rated.name)
        export(rated.shaper, "csv", folder / "shapers" / f"{rated.name}.csv")
        names += [f"shapers/{rated.name}.json", f"shapers/{rated.name}.csv"]
    for name, figure in figures(found):
        plot.save(figure, folder / f"{name}.png")
        names += [f"{name}.png", f"{name}.pdf"]
    return names


class Picture(NamedTuple):
    """The curves of a calibration over the frequency.

    Attributes:
        spectra: name, frequencies (Hz) and density over its greatest, of each record.
        after: the same of the first record after the recommended shaper, with that shaper's name.
        left: name, frequencies (Hz) and residual vibration (%), of five shapers at most.
        modes: of the first record, Hz.
    """

    spectra: list[tuple[str, np.ndarray, np.ndarray]]
    after: tuple[str, np.ndarray, np.ndarray]
    left: list[tuple[str, np.ndarray, np.ndarray]]
    modes: list[float]


def picture(found: Calibration, points: int = 800) -> Picture:
    """The curves of a calibration.

    Args:
        found: the calibration.
        points: of each shaper's curve.
    """
    spectra = [(s.name, s.frequencies, s.density / s.density.max()) for s in found.spectra]
    _, f, p = spectra[0]
    best = found.choice.best
    after = (best.name, f, p * vibration(best.amplitudes, best.times, f, found.zeta))
    f = np.linspace(1, found.ceiling, points)
    left = [(r.name, f, 100 * vibration(r.amplitudes, r.times, f, found.zeta)) for r in _shown(found)]
    return Picture(spectra, after, left, [mode.frequency for mode in found.modes[0]])


def figures(found: Calibration) -> Iterator[tuple[str, Axes]]:
    """Each figure by its name: spectrum and shapers over the frequency, and the step response."""
    yield "calibration", plot.calibration(*picture(found))
    modes, shown = found.modes[0], _shown(found)
    slowest = 1 / min(mode.frequency for mode in modes)
    t = np.linspace(0, max(r.duration for r in shown) + 2 * slowest, 800)
    impulses = [("unshaped", [1.0], [0.0]), *((r.name, r.amplitudes, r.times) for r in shown)]
    steps = [(name, 1e3 * t, step_response(a, times, modes, t)) for name, a, times in impulses]
    yield "step", plot.curves(steps, ("time (ms)", "position over the step"))


def _shown(found: Calibration) -> list[Rated]:
    """Five shapers at most: the tuned one, the recommended one and those whose scores are next."""
    others = sorted(
        (r for r in found.shapers if r.name != "tuned"), key=lambda r: (r.name != found.choice.best.name, r.score)
    )
    shown = {"tuned", *(r.name for r in others[:4])}
    return [r for r in found.shapers if r.name in shown]


def lines(found: Calibration, axis: str, reprap: bool = False, kalico: bool = False) -> str:
    """Lines to paste into the configuration of a firmware, for one axis.

    Args:
        found: what is written.
        axis: of the printer, ``"x"`` or ``"y"``.
        reprap: whether RepRapFirmware's lines are asked for.
        kalico: whether Kalico's are.

    Raises:
        ValueError: for an axis other than ``"x"`` and ``"y"``.
    """
    _check.one_of(axis, "axis", ("x", "y"))
    best, tuned, smooth = found.choice.best, found.offer.shaper, found.smooth
    stock = found.stock.rated if found.stock.converged else best
    parts = [_section(stock, axis, [*found.why, *([SINCE] if "(" in stock.name else [])])]
    if "(" in stock.name:
        older = _section(best, axis, ["For an older Klipper, its own choice:"])
        parts.append("".join(f"# {line}\n" for line in older.replace("# ", "").splitlines()))
    lists = "Klipper takes no list of impulses; Kalico and RepRapFirmware do."
    parts.append(f"# Paste the lines above into printer.cfg. {lists}\n")
    others: list[Any] = [(reprapfirmware, dict(firmware=version)) for version in REPRAP if reprap]
    if kalico:
        others.append((kalico_list, dict(axis=axis)))
    for write_lines, options in others:
        try:
            parts.append(write_lines(tuned, **options))
        except ValueError as error:
            parts.append(f"; tuned: {error}\n")
    if kalico and smooth is not None and smooth.converged:
        parts.append(_section(smooth.rated, axis, ["For Kalico, branch bleeding-edge-v2, its smooth shaper:"]))
    return "\n".join(parts)


def _section(rated: Rated, axis: str, about: list[str]) -> str:
    """Klipper's section for a shaper that it computes itself, after lines about it."""
    zeta = None if rated.name.startswith("smooth_") else rated.zeta
    section = klipper_section(rated.name, f"{rated.frequency:.2f}", zeta, axis)
    return comment("#", about) + f"{section}# and in [printer], at most: max_accel: {rounded(rated.max_accel)}\n"


def axes_together(found: dict[str, Calibration]) -> str:
    """One section of Klipper's configuration for all axes, and the acceleration that suits all.

    Args:
        found: the calibration of each axis.
    """
    best = {axis: each.stock.rated if each.stock.converged else each.choice.best for axis, each in found.items()}
    sections = [_section(rated, axis, []).splitlines() for axis, rated in best.items()]
    settings = [line for section in sections for line in section if not line.startswith(("#", "["))]
    about = [f"All axes together, {' and '.join(best)}:"]
    about += [SINCE] if any("(" in rated.name for rated in best.values()) else []
    least = min(rounded(rated.max_accel) for rated in best.values())
    limit = f"# and in [printer], at most: max_accel: {least}"
    return comment("#", about) + "\n".join(["[input_shaper]", *settings, limit, ""])


def numbers(found: Calibration) -> dict[str, Any]:
    """All numbers of a calibration, as plain data."""
    return {
        "klipper": found.version,
        "zeta": found.zeta,
        "spectra": [spectrum.name for spectrum in found.spectra],
        "modes": [[dataclasses.asdict(mode) for mode in modes] for modes in found.modes],
        "units": {"frequency": "Hz", "times": "s", "smoothing": "mm", "max_accel": "mm/s^2", "vibration": "fraction"},
        "shapers": [_record(rated, found.simulated[rated.name]) for rated in found.shapers],
        "klipper_tuned": {"name": found.stock.rated.name, **_judges(found.stock)},
        "recommended": found.choice.best.name,
        "reason": found.choice.reason,
        "costs": found.choice.costs,
        "tuned": _judges(found.offer),
        "versions": {name: version_of(name) for name in ("jshape", "numpy", "scipy")},
    }


def _judges(tuned: Tuned) -> dict[str, Any]:
    names = ("worst", "finer", "simulated")
    return {"status": tuned.status.value, "message": tuned.message, **{name: getattr(tuned, name) for name in names}}


def _record(rated: Rated, simulated: float) -> dict[str, Any]:
    about = dataclasses.asdict(rated)
    lists = {name: np.asarray(about[name]).tolist() for name in ("amplitudes", "times")}
    return {**about, **lists, "score": rated.score, "modes_left": simulated}
