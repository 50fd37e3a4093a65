"""``js.identify``: a record in, modes with their uncertainty out.

found = js.identify(times, values)                   # a ring-down: rad/s, damping ratios, how many there are
found.omega, found.omega_std, found.zeta, found.message
shaper = js.design.linear.multi_mode(list(zip(found.omega, found.zeta)))
js.tune(found.plant, 1.0, impulses=3)
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jshape import _check
from jshape._blas import one_thread
from jshape._types import ArrayLike, Progress
from jshape.identification import records
from jshape.identification._projection import STEEPEST, AbstractFamily, Fit, fit
from jshape.identification._search import search
from jshape.identification._uncertainty import is_white
from jshape.identification.free_vibration import free_part, require_decay
from jshape.identification.records import Record, RecordError, Where
from jshape.identification.result import MEASURED, Identified, of_position
from jshape.identification.ring_down import RingDown
from jshape.identification.spectrum import FrequencyResponse, PowerSpectrum
from jshape.identification.step import after_the_step, driven_residue, step_residue
from jshape.identification.sweep import Sweep
from jshape.status import Status

KINDS = ("ring-down", "step", "sweep", "spectrum")

SUSPECT = 6
"""So many modes are reported as suspect: some may stand for a part of the record that is of another kind."""


@one_thread()
def identify(
    times: ArrayLike,
    values: Any,
    *,
    kind: str = "ring-down",
    inputs: Any = None,
    modes: int | None = None,
    measured: str = "position",
    names: Sequence[str] | None = None,
    progress: Progress | None = None,
    where: Where = records.row,
) -> Identified:
    """Modes of a machine from a measured record: frequencies, damping ratios, their uncertainty and their number.

    The fit is maximum likelihood for white noise in each channel; where the residuals turn out correlated the
    uncertainty allows for that. Neighbouring frequencies of a power spectral density always count as correlated.

    Args:
        times: s, increasing, evenly spaced but for gaps, shape (rows,); of a spectrum frequencies, rad/s.
        values: shape (rows,) or (rows, channels); channels share the modes. Of a spectrum complex values are a
            frequency response, real ones a power spectral density (of what noise shakes).
        kind: ``"ring-down"``, free vibration, perhaps after some rest; ``"step"``, what follows a step of the command;
            ``"sweep"``, any motion whose command is recorded with it; ``"spectrum"``.
        inputs: the command at the same times, needed by a sweep; a step without it begins at the first sample and
            yields shares of the vibration instead of gains, or is a ring-down where the machine rests at first.
        modes: how many; by Bayes's information criterion unless given.
        measured: what the channels are: ``"position"``, ``"velocity"`` or ``"acceleration"``. Gains are those of a
            position, in its unit: of an accelerometer in m/s² and a command in m, none.
        names: of the channels.
        progress: called before each further mode.
        where: says where a row stands, for messages.

    Raises:
        RecordError: a ``ValueError``, for a record that cannot be used (``check_record`` lists why), of a sensor whose
            range was too small, or in which no vibration stands out.
        ValueError: for wrong arguments.

    Source: Golub and Pereyra (1973), variable projection; Djurić (1996), the number of modes.
    """
    _check.one_of(kind, "kind", KINDS)
    _check.one_of(measured, "measured", MEASURED)
    modes = None if modes is None else _check.count(modes, "modes")
    if kind in ("ring-down", "spectrum") and inputs is not None:
        raise ValueError(f'inputs: a {kind} takes none; kind="step" and kind="sweep" do')
    if kind == "sweep" and inputs is None:
        raise ValueError('inputs must be given for kind="sweep": the command that drove the machine')
    record = records.check_record(times, values, inputs, names, where, spectrum=kind == "spectrum")
    if kind == "spectrum" and np.isrealobj(record.values) and len(record.names) > 1:
        # Channels added up: every mode is in some of them, and one error serves all frequencies.
        total = np.mean(record.values / np.max(record.values, axis=0), axis=1, keepdims=True)
        record = dataclasses.replace(record, values=total, names=("mean of the channels, each over its peak",))
    size, rest = 1.0, None
    if kind == "sweep":
        record = records.longest_stretch(record)
    elif record.inputs is not None:
        at, size = after_the_step(record.inputs)
        if len(record.axis) - at < records.FEWEST:
            raise RecordError(f"inputs: too short a record, {len(record.axis) - at} samples from the step on")
        rest = np.mean(record.values[:at], axis=0)
        record = record.part(slice(at, None))
    if kind in ("ring-down", "step") and record.inputs is None:
        free = free_part(record, every=kind == "step")
        record, kind = free, kind if free.rows[0] == record.rows[0] else "ring-down"
    if kind != "spectrum":
        records.require_range(record)
    if kind == "ring-down":
        require_decay(record)
    family, centre, scale = _family(record, kind)
    found, criteria = search(family, modes, progress)
    if isinstance(family, PowerSpectrum):
        # The error of a power is in proportion to what is expected there, which is known only now.
        for _ in range(2):
            level = found.fitted(family)[:, 0]
            family = PowerSpectrum(family.axis, family.data, np.maximum(level, 0.05 * family.data[:, 0]))
            found = fit(family, found.omega, found.zeta, found.noise)
    result = _result(record, kind, family, found, criteria, centre, scale, size, modes, measured)
    return dataclasses.replace(result, _rest=rest)


def _family(record: Record, kind: str) -> tuple[AbstractFamily, np.ndarray, np.ndarray]:
    """The shapes for that kind of record, its values scaled to 1, the centre and the scale of each channel."""
    values = record.values
    scale = np.max(np.abs(values), axis=0)
    if kind == "spectrum":
        kind_of = FrequencyResponse if np.iscomplexobj(values) else PowerSpectrum
        return kind_of(record.axis, values / scale), np.zeros(len(scale)), scale
    centre = scale * np.mean(values / scale, axis=0)
    scale = np.max(np.abs(values / scale - centre / scale), axis=0) * scale
    data = (values - centre) / scale
    if kind == "sweep":
        assert record.inputs is not None
        return Sweep(record.axis, data, record.inputs), centre, scale
    return RingDown(record.axis, data), centre, scale


def _result(
    record: Record,
    kind: str,
    family: AbstractFamily,
    found: Fit,
    criteria: np.ndarray,
    centre: np.ndarray,
    scale: np.ndarray,
    size: float,
    modes: int | None,
    measured: str,
) -> Identified:
    """The modes among what was fitted, in the record's units, with everything that is to be said about them."""
    if not len(found.omega):
        raise RecordError(f"values: no vibration stands out in this {kind} of {len(record.axis)} samples")
    count, covariance = len(found.omega), found.covariance(family.reach)
    spread = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    inside = (found.omega > 1.02 * family.lowest) & (found.omega < 0.995 * family.highest)
    vibrates = inside & (found.zeta < 0.98 * STEEPEST) & (spread < 0.2 * found.omega)
    if not vibrates.any():
        raise RecordError(f"values: no vibration stands out in this {kind}; only drifts do")
    notes = list(record.notes)
    for i in np.nonzero(~vibrates)[0]:
        notes.append(
            f"left out as no vibration: {found.omega[i] / 2 / np.pi:.4g} Hz, damping ratio {found.zeta[i]:.2g}"
        )
    kept = np.nonzero(vibrates)[0]
    kept = kept[np.argsort(found.omega[kept])]
    omega, zeta = found.omega[kept], found.zeta[kept]
    place = np.concatenate([kept, count + kept])
    begin, width = family.background.shape[1], family.columns(omega[0], zeta[0])[0].shape[1]
    factors = [found.factors[begin + i * width : begin + (i + 1) * width] for i in kept]
    residues = np.stack([family.residue(part) for part in factors]) * scale
    gains, more = _gains(record, kind, omega, zeta, residues, size, measured)
    covariance = covariance[np.ix_(place, place)]
    explained = 1 - found.squares / np.maximum(np.sum((family.weights[:, None] * family.data) ** 2, axis=0), 1e-300)
    notes += more + _warnings(record, kind, family, found, omega, zeta, explained)
    deviation = np.sqrt(np.diag(covariance))
    described = [
        f"{w / 2 / np.pi:.5g} ± {1.96 * s / 2 / np.pi:.2g} Hz, damping {z:.4g} ± {1.96 * d:.2g}"
        for w, z, s, d in zip(omega, zeta, deviation, deviation[len(omega) :], strict=False)
    ]
    if kind == "step" and record.inputs is None and np.any(zeta > 0.3):
        notes.append(
            "the step is taken to be at the first sample: what is damped strongly may be a short rest before it"
        )
    if modes is None and len(found.omega) >= SUSPECT:
        notes.append(f"{len(found.omega)} modes are many: perhaps this is no {kind}, or not all of it is")
    how = "as asked for" if modes is not None else "by Bayes's criterion"
    message = f"{len(omega)} mode{'s' if len(omega) > 1 else ''} ({how}; 95 % intervals): {'; '.join(described)}"
    if not found.converged:
        message = f"did not converge; {message}"
    noise = found.noise if isinstance(family, PowerSpectrum) else found.noise * scale
    return Identified(
        kind, omega, zeta, covariance, residues, gains, noise, criteria,
        Status.CONVERGED if found.converged else Status.STOPPED, message, tuple(notes),
        record.axis, record.values, record.inputs, record.names, measured, family, found, (centre, scale),
    )  # fmt: skip


def _gains(
    record: Record, kind: str, omega: np.ndarray, zeta: np.ndarray, residues: np.ndarray, size: float, measured: str
) -> tuple[np.ndarray, list[str]]:
    """Each mode's part of the payload, modes × channels, and a note where a channel is not what was measured."""
    residues = of_position(residues, omega, zeta, measured)
    known = record.inputs is not None or np.iscomplexobj(record.values)
    if not known and kind != "step":
        return np.abs(residues) / np.sum(np.abs(residues), axis=0), []
    unit = step_residue(zeta) if kind == "step" else driven_residue(omega, zeta)
    ratio = residues / (size * unit[:, None])
    gains = np.where(ratio.real < 0, -1.0, 1.0) * np.abs(ratio)
    if not known:
        total = np.sum(gains, axis=0)
        return gains / np.where(np.abs(total) > 0.1 * np.sum(np.abs(gains), axis=0), total, 1.0), []
    notes = []
    for name, channel in zip(record.names, ratio.T, strict=True):
        aside = np.abs(channel.imag) > 0.5 * np.abs(channel)
        if aside.any():
            which = ", ".join(f"{w / 2 / np.pi:.4g} Hz" for w in omega[aside])
            notes.append(f"{name}: out of phase with a {measured} at {which} (a speed, a delay): gains are sizes only")
        elif measured == "position" and (channel.real < 0).all():
            otherwise = 'measured="acceleration" (--measured acceleration) gives a position\'s gains'
            notes.append(f"{name}: against the input in every mode, as an acceleration is; {otherwise}")
    return gains, notes


def _warnings(
    record: Record, kind: str, family: AbstractFamily, found: Fit, omega: np.ndarray, zeta: np.ndarray,
    explained: np.ndarray,
) -> list[str]:  # fmt: skip
    notes = []
    for name, share in zip(record.names, explained, strict=False):
        if share < 0.7:
            notes.append(f"{name}: the modes explain {100 * max(share, 0.0):.0f} % of it only")
    if kind != "spectrum":
        near = omega > 0.8 * family.highest
        if near.any():
            notes.append(f"{omega[near][0] / 2 / np.pi:.4g} Hz is close to half the sampling rate: perhaps an alias")
        middle = np.median(np.abs(found.residuals), axis=0) / 0.6745
        far = (np.abs(found.residuals) > 8 * np.maximum(middle, 1e-12)).any(axis=1) & (middle > 1e-9).all()
        if far.any():
            at = record.where(int(record.rows[np.argmax(far)]))
            more = f", and {far.sum() - 1} others" if far.sum() > 1 else ""
            notes.append(f"{at}is an outlier of the fit{more}")
    elif isinstance(family, PowerSpectrum):
        gap = float(np.median(np.diff(record.axis)))
        if np.any(2 * zeta * omega < 4 * gap):
            notes.append(
                "a peak is narrower than four frequency steps: its damping ratio is no more than an upper bound"
            )
    if not is_white(found.residuals) and kind != "spectrum":
        notes.append("the residuals are no white noise (a drift, a nonlinearity, a filter): intervals allow for it")
    return notes
