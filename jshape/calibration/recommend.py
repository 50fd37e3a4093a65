"""Which shaper Klipper recommends, and what each of the others would cost."""

import dataclasses
from collections.abc import Sequence

from jshape import _check
from jshape.calibration.score import Rated
from jshape.klipper import VERSIONS


@dataclasses.dataclass(frozen=True)
class Choice:
    """The shaper that Klipper recommends among several, and how the others compare.

    Attributes:
        best: the recommended shaper.
        reason: why it is recommended, in words.
        costs: name of each other shaper → its benefits and costs compared with the best, in words.
    """

    best: Rated
    reason: str
    costs: dict[str, str]


def recommend(fits: Sequence[Rated], version: str = "current") -> Choice:
    """Klipper's choice among fitted shapers, in their order.

    The next replaces the best so far if its score is 1.2 times lower, or 1.05 times lower with a smoothing 1.1 times
    lower, or, in the current version, if both its vibration and its smoothing are lower. If a ZV wins, the first other
    that leaves 1.1 times less vibration takes its place.

    Args:
        fits: fitted shapers.
        version: Klipper's, ``"current"`` or ``"2024"``.

    Raises:
        ValueError: for no shapers or an unknown version.
    """
    _check.one_of(version, "version", VERSIONS)
    _check.instances(fits, "fits", Rated, "a list of fitted shapers")
    if not fits:
        raise ValueError("fits is empty: there is nothing to choose from")
    best, reason = fits[0], "no other is better"
    for other in fits[1:]:
        won = better(other, best, version)
        if won:
            best, reason = other, won
    if best.name == "zv":
        for other in fits:
            if other.name != "zv" and 1.1 * other.vibration < best.vibration:
                reason = (
                    f"by Klipper's margins none is better than {best.label}, but that leaves "
                    f"{percent(best.vibration)}; it is the first to leave less"
                )
                best = other
                break
    return Choice(best, reason, {other.name: cost(other, best) for other in fits if other is not best})


def better(other: Rated, best: Rated, version: str) -> str | None:
    """The reason for which a shaper replaces the best so far in Klipper's choice; ``None`` where it does not.

    Args:
        other: the next shaper.
        best: so far.
        version: Klipper's.
    """
    words = f"its score is {best.score / other.score:.3g} times lower than that of {best.label}"
    if other.score * 1.2 < best.score:
        return words
    if other.score * 1.05 < best.score and other.smoothing * 1.1 < best.smoothing:
        return f"{words}, and it smooths {100 * (1 - other.smoothing / best.smoothing):.0f} % less"
    if version == "current" and other.vibration < best.vibration and other.smoothing < best.smoothing:
        return f"it both leaves less vibration and smooths less than {best.label}"
    return None


def cost(other: Rated, best: Rated) -> str:
    """Benefits and costs of ``other`` compared with ``best``, in words."""
    klipper = other.frequency is not None
    change = other.smoothing / best.smoothing - 1
    blur = f"{abs(100 * change):.1f} % {'more' if change > 0 else 'less'} smoothing"
    allowed = other.max_accel / best.max_accel - 1 if best.max_accel > 0 else 0.0
    speed = f"{abs(100 * allowed):.1f} % {'more' if allowed > 0 else 'less'} acceleration"
    left = f"{percent(other.vibration)} of the vibration left instead of {percent(best.vibration)}"
    ratio = other.score / best.score
    # Klipper's comparisons go from shaper to shaper and ask for a margin, so that the best score need not win.
    words = f"score {ratio:.3g} times that of {best.name}" + (
        ", no margin wide enough" if klipper and ratio < 1 else ""
    )
    return f"{left}, {blur}, {speed}; {words}"


def percent(fraction: float) -> str:
    """A small fraction as a person reads it: two significant digits, 0 as 0."""
    return f"{100 * fraction:.2g} %"
