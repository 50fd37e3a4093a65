"""``jshape identify``: the modes of a machine from a CSV file of it."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jshape.cli._shared import Out, explained, prepare_jax, progress_line, results_folder, say

if TYPE_CHECKING:
    from jshape.identification.result import AbstractIdentified


@explained()
def identify(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="DATA", help="A CSV file; separators and decimal commas are recognised."),
    ],
    columns: Annotated[
        str | None,
        typer.Option(help="Time and channels, by name or number, as in t,x,y or 1,3; all columns unless given."),
    ] = None,
    kind: Annotated[
        str,
        typer.Option(
            help="ring-down, step, sweep, spectrum (a power spectral density) or frequency-response (channels as "
            "pairs of columns, real and imaginary); frequencies in Hz."
        ),
    ] = "ring-down",
    input_: Annotated[
        str | None, typer.Option("--input", help="Column of the command: for a sweep, or a step with gains.")
    ] = None,
    modes: Annotated[int | None, typer.Option(help="How many modes; by Bayes's criterion unless given.")] = None,
    sample_rate: Annotated[
        float | None, typer.Option(help="Samples a second, Hz: times are counted, and a column of times is left out.")
    ] = None,
    along_y: Annotated[
        Path | None,
        typer.Option(
            help="A second file: DATA is then of a move along x, this one of a move along y, both of a step or with "
            "--input, with two channels, along x and along y. The machine has both axes."
        ),
    ] = None,
    measured: Annotated[
        str | None,
        typer.Option(
            help="Whether the channels are position, velocity or acceleration; as their names say if not given."
        ),
    ] = None,
    out: Out = None,
) -> None:
    """Find a machine's frequencies and damping ratios, with their uncertainty, and write a problem file for them."""
    data, *others = files
    if others:
        raise ValueError(f"{others[0]}: a second file is named by --along-y, of a move along y; or run once for each")
    if kind == "sweep" and input_ is None:
        raise ValueError("--input must name the column of the command: a sweep is what drives the machine")
    prepare_jax()
    from jshape._files import check_unedited
    from jshape.identification.files import write
    from jshape.identification.from_csv import identify_csv
    from jshape.identification.planar import identify_planar
    from jshape.reports.tables import new_console, show_table

    folder = results_folder(out, f"{data.stem}-results")
    check_unedited(folder)
    with progress_line() as (step, progress):
        step("reading")
        records = [
            identify_csv(
                each,
                columns=None if columns is None else columns.split(","),
                kind=kind,
                inputs=input_,
                modes=modes,
                measured=measured,
                sample_rate=sample_rate,
                progress=progress,
            )
            for each in (data, along_y)
            if each is not None
        ]
        found = records[0] if along_y is None else identify_planar(*records)
        step("files")
        written = write(found, folder, data.name if along_y is None else f"{data.name} and {along_y.name}")
    for note in found.notes:
        say(f"note: {note}", err=True)
    channels = ", ".join(records[0].names)
    say(f"{data if along_y is None else f'{data}, {along_y}'} ({channels}): {found.message.split(':')[0]}")
    headings = ["frequency\n(Hz)", "\nfrom", "\nto", "damping\nratio", "\nfrom", "\nto"]
    show_table(new_console(), "mode", headings, _rows(found))
    say(f"results in {folder}: {', '.join(written)}. Next: jshape tune {folder / 'problem.toml'}")


def _rows(found: "AbstractIdentified") -> list[tuple[str, list[str]]]:
    """Each mode's number, frequency (Hz) and damping ratio with their intervals, as they are printed."""
    of_omega, of_zeta = found.interval()
    rows = []
    for mode, values in enumerate(zip(found.omega, found.zeta, of_omega.T, of_zeta.T, strict=True), 1):
        omega, zeta, ends, bounds = values
        cells = [f"{value / (2 * math.pi):.6g}" for value in (omega, *ends)]
        rows.append((str(mode), [*cells, *(f"{value:.5f}" for value in (zeta, *bounds))]))
    return rows
