"""``jshape calibrate``: a printer's shaper from its accelerometer."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jshape.cli._shared import explained, prepare_jax, progress_line, results_folder, say

if TYPE_CHECKING:
    from jshape.calibration.report import Calibration


@explained()
def calibrate(
    data: Annotated[
        list[Path], typer.Argument(help="Klipper's files, raw or spectra; x or y in a name says of which axis.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; NAME-calibration, of the data, unless given.")
    ] = None,
    klipper: Annotated[
        str, typer.Option(help="Whose choice to follow: current, or 2024 for December 2024.")
    ] = "current",
    axis: Annotated[
        str | None, typer.Option(help="x or y, for the lines to paste; from the files' names if not given.")
    ] = None,
    loads: Annotated[
        bool,
        typer.Option(
            "--loads", help="Several files of an axis share a shaper: loads, empty and loaded, or places of the head."
        ),
    ] = False,
    reprapfirmware: Annotated[
        bool, typer.Option("--reprapfirmware", help="The tuned shaper's line for RepRapFirmware's config.g, too.")
    ] = False,
    kalico: Annotated[bool, typer.Option("--kalico", help="Lines for Kalico, too: the list, a smooth shaper.")] = False,
    component: Annotated[str, typer.Option(help="What counts of the acceleration: xyz, or x, y, z alone.")] = "xyz",
    zeta: Annotated[float, typer.Option(help="The printer's damping ratio, if it was measured.")] = 0.1,
    corner_speed: Annotated[float, typer.Option(help="Klipper's square corner velocity, mm/s.")] = 5.0,
    highest: Annotated[float, typer.Option(help="Hz: fit shapers up to this frequency.")] = 150.0,
    impulses: Annotated[int, typer.Option(help="Of the tuned shaper.")] = 4,
    duration: Annotated[
        float | None, typer.Option(help="s: the most it may last; the longest fitted one's else.")
    ] = None,
    vibration: Annotated[
        float | None, typer.Option(help="A fraction: the most it may leave; the recommended one's else.")
    ] = None,
    smoothing: Annotated[
        float | None, typer.Option(help="mm: limit this instead, and leave the least vibration.")
    ] = None,
    shift: Annotated[float, typer.Option(help="A fraction: how far the frequencies may be off.")] = 0.0,
    starts: Annotated[int, typer.Option(help="Starting points of the search, at most.")] = 16,
    seed: Annotated[int, typer.Option(help="Of the starting points.")] = 0,
) -> None:
    """Choose a shaper for a printer as Klipper does, say why, and tune a better one on the same spectrum."""
    from jshape._files import write_text
    from jshape.calibration.files import read

    axes = _axes(data, axis, loads)
    spectra = {which: read(files, component) for which, files in axes.items()}
    names = {which: f"{files[0].stem}-calibration" for which, files in axes.items()}
    if len(set(names.values())) < len(names):
        # Two belts, whose files are the same for both axes.
        names = {which: f"{files[0].stem}-{which}-calibration" for which, files in axes.items()}
    folders = {
        which: results_folder(out / which if out and len(axes) > 1 else out, name) for which, name in names.items()
    }
    together = out / "paste.txt" if out and len(axes) > 1 else None
    if together and together.exists() and not all((each / "results.json").exists() for each in folders.values()):
        raise ValueError(f"{together}: is not jshape's, and is left as it is; name another folder")
    prepare_jax()
    from jshape.calibration.report import axes_together, lines, write
    from jshape.calibration.report import calibrate as calibrate_printer

    options: Any = dict(
        version=klipper,
        zeta=zeta,
        corner_speed=corner_speed,
        highest=highest,
        duration=duration,
        vibration=vibration,
        smoothing=smoothing,
        impulses=impulses,
        shift=shift,
        starts=starts,
        seed=seed,
        kalico=kalico,
    )
    all_found, computed, belts = {}, {}, len(axes) > 1 and len({tuple(files) for files in axes.values()}) == 1
    for which, folder in folders.items():
        same = tuple(axes[which])
        with progress_line() as (step, progress):
            # Two belts are the same files for both axes.
            found = computed.get(same) or calibrate_printer(spectra[which], progress=progress, **options)
            step("files")
            files = write(found, folder, which, reprapfirmware, kalico)
        all_found[which] = found
        if same not in computed:
            _show(found, highest)
        computed[same] = found
        say(lines(found, which, reprapfirmware, kalico))
        if axis is None:
            whose = "both axes, from the belts' names" if belts else f"axis {which}, from the file's name"
            say(f"({whose}; --axis says otherwise)")
        named = dict.fromkeys(f"{Path(file).parent}/" if "/" in file else file for file in files)
        say(f"results in {folder}: {', '.join(named)}")
    if len(all_found) > 1:
        text = axes_together(all_found)
        typer.echo(f"\n{text}", nl=False)
        if together:
            write_text(together, text)
            say(f"(also in {together})")


def _axes(data: list[Path], axis: str | None, loads: bool) -> dict[str, list[Path]]:
    """The files of each axis; those of two belts, which move both axes, share a shaper that both have.

    Raises:
        ValueError: for an axis other than x and y, and for several files of one axis that are not said to be loads.
    """
    if axis not in (None, "x", "y"):
        raise ValueError(f"--axis must be x or y, not {axis!r}")
    from jshape.calibration.files import axis_of, is_belt

    if axis is None and all(map(is_belt, data)):
        return {"x": data, "y": data}
    axes: dict[str, list[Path]] = {}
    for path in data:
        axes.setdefault(axis or axis_of(path), []).append(path)
    for which, files in axes.items():
        if len(files) > 1 and not loads:
            words = " and ".join(map(str, files))
            raise ValueError(
                f"{words}: are all of axis {which}; --loads makes one shaper for them, loads or places of the head"
            )
    return axes


MEASURE = (
    "how much of the vibration that was measured, as far as it rises above a twentieth of its peak, remains at the "
    "worst of three damping ratios (Klipper's own measure)."
)
OTHER_MEASURE = "what a simulation of the resonances keeps, with nothing left out; of use to compare, not to limit."


def _range(frequency: float, highest: float) -> str:
    """The range that a mode's frequency (Hz) is not in, and what follows."""
    if frequency < 35:
        return "what some firmware takes (Prusa's ends at 35 Hz below); Klipper and Kalico take it"
    return f"the range of shapers' frequencies, up to {highest:g} Hz; --highest raises it"


def _show(found: "Calibration", highest: float) -> None:
    """The table, why the recommended shaper won, what each other would cost, and what the tuned one brings."""
    from jshape.calibration.files import is_belt
    from jshape.calibration.recommend import percent
    from jshape.calibration.smoothing import rounded
    from jshape.reports.tables import new_console, say, show_table

    console = new_console()
    for spectrum, modes in zip(found.spectra, found.modes, strict=True):
        words = ", ".join(f"{m.frequency:.1f} Hz (ζ {m.zeta:.3f}, {100 * m.share:.0f} %)" for m in modes)
        say(console, f"{spectrum.name}: modes at {words}")
        for mode in modes:
            if not 35 <= mode.frequency <= highest:
                say(console, f"  {mode.frequency:.1f} Hz lies outside {_range(mode.frequency, highest)}")
    if len(found.modes) == 2 and all(is_belt(Path(spectrum.name)) for spectrum in found.spectra):
        one, other = (modes[0].frequency for modes in found.modes)
        apart = 100 * abs(one - other) / min(one, other)
        words = "both axes share a shaper for them; equal tension brings them together"
        say(console, f"the belts' strongest modes are {apart:.1f} % apart: {words}")
    headings = ["Hz", "vibration\nleft", "smoothing\n(mm)", "max_accel\n(mm/s²)", "duration\n(ms)", "score"]
    rows = []
    for rated in found.shapers:
        cells = [
            "" if rated.frequency is None else f"{rated.frequency:.1f}",
            percent(rated.vibration),
            f"{rated.smoothing:.5f}",
            f"{rounded(rated.max_accel)}",
            f"{1e3 * rated.duration:.2f}",
            f"{rated.score:.6f}",
            percent(found.simulated[rated.name]),
        ]
        best = rated is found.choice.best
        rows.append((rated.name + (" *" if best else ""), cells))
    show_table(console, "shaper", [*headings, "modes\nleft"], rows, bold=(f"{found.choice.best.name} *", "tuned"))
    say(console, f"vibration left: {MEASURE}")
    say(console, f"modes left: {OTHER_MEASURE}")
    say(console, f"* recommended by Klipper ({found.version}): {found.choice.best.label}: {found.choice.reason}")
    for name, words in found.choice.costs.items():
        say(console, f"  {name} instead: {words}")
    say(console, found.message)
    offer = found.offer
    say(
        console,
        f"  checked: {percent(offer.finer)} on a grid ten times finer, {percent(offer.simulated)} by simulation in time"
        f"{'' if offer.worst == offer.rated.vibration else f', {percent(offer.worst)} with the frequency shift'}\n",
    )
