"""``js.identify_planar``: the modes of a machine that moves in a plane, from a record of each of its axes."""

import dataclasses

import numpy as np

from jshape import _check
from jshape.identification.result import AbstractIdentified, Identified, of_position
from jshape.identification.step import step_residue
from jshape.plants import PlanarModes
from jshape.status import Status

NEAR = 0.03
"""Two records' frequencies that differ by less, relative to either, are of one mode, as are those within three standard
deviations; but not those that differ by more than these and are driven along x and along y alone, as two modes are."""

TWO = 0.1
"""Two modes have one frequency where the matrix of its gains has a second eigenvalue of more than this part of the
first one."""


@dataclasses.dataclass(frozen=True)
class IdentifiedPlane(AbstractIdentified):
    """Modes of a machine that moves in a plane, ascending.

    Attributes:
        omega: undamped natural frequencies, rad/s, shape (modes,).
        zeta: damping ratios, shape (modes,).
        deviations: standard deviations of the frequencies, rad/s, and of the damping ratios, shape (2, modes).
        gains: what ``PlanarModes`` takes: b_ij of each mode along x and y, shape (modes, 2).
        misfit: of the records' gains beside b_i b_iᵀ, relative to the greatest of them.
        status: ``STOPPED`` where the fit of a record did not converge.
        message: what was found.
        notes: on the records and on what the modes leave unexplained.
        records: of the move along x and along y.
    """

    omega: np.ndarray
    zeta: np.ndarray
    deviations: np.ndarray
    gains: np.ndarray
    misfit: float
    status: Status
    message: str
    notes: tuple[str, ...]
    records: tuple[Identified, Identified]

    @property
    def omega_std(self) -> np.ndarray:
        """Standard deviation of each frequency, rad/s."""
        return self.deviations[0]

    @property
    def zeta_std(self) -> np.ndarray:
        """Standard deviation of each damping ratio."""
        return self.deviations[1]

    @property
    def free(self) -> float:
        """Degrees of freedom of the deviations: those of the record that has fewer."""
        return min(record.free for record in self.records)

    @property
    def plant(self) -> PlanarModes:
        """The modes as a plant."""
        return PlanarModes(self.omega, self.zeta, self.gains)


def identify_planar(along_x: Identified, along_y: Identified, *, measured: str = "position") -> IdentifiedPlane:
    """Modes of a machine that moves in a plane, from a move along x and one along y, each measured along both.

    A mode that vibrates along b = (b_x, b_y) is driven by a command along x in proportion to b_x, and moves the payload
    by b: the records' gains of it, one row for each command, are b bᵀ. Its direction and size are those of the nearest
    such matrix; frequencies and damping ratios are the means of both records', weighted by their variances.

    Args:
        along_x: identified while the machine moved along x, with two channels: along x, then along y; of kind
            ``"step"``, with or without its input, ``"sweep"`` or a frequency response. A step without its input counts
            as one forwards.
        along_y: likewise while it moved along y.
        measured: ``"acceleration"`` where records that were identified as positions are an accelerometer's, in m/s².

    Raises:
        ValueError: for records of another kind or number of channels, and for a mode that moves against its command.

    Source: Ewins (2000), Modal Testing, Section 4: the residues of a mode are the products of its components.
    """
    _check.one_of(measured, "measured", ("position", "acceleration"))
    records = along_x, along_y
    rows = [_gains(record, name, own, measured) for own, (name, record) in enumerate(zip("xy", records, strict=True))]
    pairs = _paired(along_x, along_y, rows)
    matrices = np.zeros((len(pairs), 2, 2))
    found = np.full((len(pairs), 2, 2, 2), np.nan)
    for i, pair in enumerate(pairs):
        for axis, mode in enumerate(pair):
            if mode is not None:
                record = records[axis]
                matrices[i, axis] = rows[axis][mode]
                found[i, axis] = [[v[mode] for v in each] for each in _estimates(record)]
    sizes, vectors = np.linalg.eigh((matrices + np.swapaxes(matrices, 1, 2)) / 2)
    notes = [note for record in records for note in record.notes]
    (omega, omega_std), (zeta, zeta_std) = (_mean(found[:, :, i], notes if i == 0 else []) for i in range(2))
    for frequency, (_, size) in zip(omega / 2 / np.pi, sizes, strict=True):
        if size <= 0:
            raise ValueError(
                f"along_x and along_y: the mode of {frequency:.4g} Hz moves against its command; "
                "check the signs and the order of the channels, and what was measured"
            )
    # Modes of one frequency, as of a head that is as stiff along x as along y, are seen as one, of rank two.
    kept = np.stack([sizes[:, 0] > TWO * sizes[:, 1], sizes[:, 1] > 0], axis=1)
    mode, which = np.nonzero(kept)
    gains = vectors[mode, :, which] * np.sqrt(sizes[mode, which])[:, None]
    omega, omega_std, zeta, zeta_std = (values[mode] for values in (omega, omega_std, zeta, zeta_std))
    gains *= np.where(gains[np.arange(len(gains)), np.argmax(np.abs(gains), axis=1)] < 0, -1.0, 1.0)[:, None]
    rest = matrices.copy()
    np.subtract.at(rest, mode, gains[:, :, None] * gains[:, None, :])
    misfit = float(np.max(np.abs(rest)) / np.max(np.abs(matrices)))
    if misfit > 0.1:
        notes.append(f"the records disagree on the modes' directions by {100 * misfit:.0f} % of the greatest gain")
    reach = gains.T @ gains
    if np.max(np.abs(reach - np.eye(2))) > 0.05:
        carried = f"{reach[0, 0]:.3g} of a move along x, {reach[1, 1]:.3g} along y, {reach[0, 1]:.2g} across"
        notes.append(f"the modes carry {carried}, for 1, 1 and 0: other modes were not found, or gains are off")
    order = np.argsort(omega)
    described = [
        f"{omega[i] / 2 / np.pi:.5g} ± {1.96 * omega_std[i] / 2 / np.pi:.2g} Hz, damping {zeta[i]:.4g}, "
        f"along {np.degrees(np.arctan2(gains[i, 1], gains[i, 0])):.3g}°"
        for i in order
    ]
    converged = all(record.converged for record in records)
    message = f"{len(omega)} mode{'s' if len(omega) > 1 else ''} (95 % intervals): {'; '.join(described)}"
    return IdentifiedPlane(
        omega[order], zeta[order], np.stack([omega_std, zeta_std])[:, order], gains[order], misfit,
        Status.CONVERGED if converged else Status.STOPPED, message if converged else f"did not converge; {message}",
        tuple(dict.fromkeys(notes)), records,
    )  # fmt: skip


def _estimates(record: Identified) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Frequencies and damping ratios, each with its standard deviation."""
    return (record.omega, record.omega_std), (record.zeta, record.zeta_std)


def _gains(record: Identified, name: str, own: int, measured: str) -> np.ndarray:
    """Of each mode in a position along x and along y for a command of size 1, shape (modes, 2).

    Args:
        record: what was identified.
        name: of the axis that moved.
        own: its index.
        measured: what the channels are where they were taken for positions.
    """
    _check.instance(record, f"along_{name}", Identified, "what identify returns")
    if record.gains.shape[1] != 2:
        raise ValueError(f"along_{name} must have two channels, along x and along y, not {', '.join(record.names)}")
    known = record.inputs is not None or np.iscomplexobj(record.values)
    if not known and record.kind != "step":
        raise ValueError(
            f"along_{name}: a {record.kind} does not say how much the command moved each mode; "
            'kind="step", and kind="sweep" with its input, do'
        )
    gains = record.gains
    if not known:
        residues = of_position(record.residues, record.omega, record.zeta, record.measured)
        ratio = residues / step_residue(record.zeta)[:, None]
        gains = np.where(ratio.real < 0, -1.0, 1.0) * np.abs(ratio)
    if measured == "acceleration" and record.measured == "position":
        # The residue at the pole λ is λ² times that of the position, and |λ| is ω.
        gains = -gains / record.omega[:, None] ** 2
    if known:
        return gains
    total = float(np.sum(gains[:, own]))
    if not total > 0.1 * np.sum(np.abs(gains[:, own])):
        raise ValueError(
            f"along_{name}: the modes do not add up to a move along {name}; "
            "check the signs and the order of the channels, and what was measured"
        )
    return gains / total


def _paired(along_x: Identified, along_y: Identified, rows: list[np.ndarray]) -> list[tuple[int | None, int | None]]:
    """The modes of both records, each with the other's nearest where that is the same mode; ``rows``: their gains."""
    apart = np.abs(along_x.omega[:, None] - along_y.omega)
    spread = np.hypot(along_x.omega_std[:, None], along_y.omega_std)
    same = apart < np.maximum(NEAR * np.minimum(along_x.omega[:, None], along_y.omega), 3 * spread)
    # Of one mode the two rows of gains are alike, so that the matrix has rank one.
    matrices = np.stack(np.broadcast_arrays(rows[0][:, None], rows[1][None]), axis=2)
    sizes = np.linalg.eigvalsh((matrices + np.swapaxes(matrices, 2, 3)) / 2)
    same &= (apart <= 3 * spread) | (sizes[..., 0] <= TWO * sizes[..., 1])
    same &= apart == apart.min(axis=0, keepdims=True)
    same &= apart == apart.min(axis=1, keepdims=True)
    pairs: list[tuple[int | None, int | None]] = [(int(i), int(j)) for i, j in np.argwhere(same)]
    pairs += [(int(i), None) for i in np.flatnonzero(~same.any(axis=1))]
    return pairs + [(None, int(j)) for j in np.flatnonzero(~same.any(axis=0))]


def _mean(found: np.ndarray, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """The mean of both records' values, weighted by their variances, and its standard deviation.

    Args:
        found: value and deviation, NaN where a record has none, shape (modes, records, 2).
        notes: to which modes are added whose records differ by more than their noise allows.
    """
    values, variances = found[..., 0], np.maximum(found[..., 1], 1e-12 * np.abs(found[..., 0]) + 1e-300) ** 2
    weights = np.where(np.isnan(values), 0.0, 1 / np.where(np.isnan(values), 1.0, variances))
    total = np.sum(weights, axis=1)
    mean = np.sum(np.where(weights > 0, values, 0.0) * weights, axis=1) / total
    half = np.nan_to_num(np.abs(values[:, 0] - values[:, 1])) / 2
    apart = 2 * half > 3 * np.sqrt(np.nansum(variances, axis=1))
    for first, second in values[apart] / 2 / np.pi:
        notes.append(f"a mode is at {first:.5g} Hz along x and at {second:.5g} Hz along y: intervals hold both")
    return mean, np.where(apart, np.maximum(half, np.sqrt(1 / total)), np.sqrt(1 / total))
