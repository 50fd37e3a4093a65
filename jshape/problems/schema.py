"""The tables of a problem file, as they must be written."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from jshape.problems.units import has_unit, quantity


class Strict(BaseModel):
    """A table that takes the keys of its fields and no others."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
_Pair = Annotated[tuple[float, float], Field(strict=False)]


class Range(Strict):
    """An uncertain leaf: from ``low`` to ``high``, or a list of ``values``.

    Numbers are multiples of nominal, quantities with a unit absolute.
    """

    low: float | str | None = None
    high: float | str | None = None
    count: int = Field(default=41, ge=2, le=100_000)
    values: Annotated[list[float | str], Field(max_length=100_000)] | None = None

    @model_validator(mode="after")
    def _either(self) -> "Range":
        if (self.values is None) == (self.low is None and self.high is None):
            raise ValueError("give either low and high, or values")
        if self.values is None:
            if self.low is None or self.high is None:
                raise ValueError("give both low and high")
        elif not self.values:
            raise ValueError("values is empty")
        return self

    def read(self, unit: str | None) -> tuple[list[float], bool]:
        """The ends or the values, and whether they are absolute, in ``unit``, not multiples of nominal.

        Raises:
            ValueError: for a mixture of both, a wrong unit, and ends the wrong way round.
        """
        given = [self.low, self.high] if self.values is None else list(self.values)
        absolute = has_unit(given[0])
        if any(has_unit(value) != absolute for value in given):
            shown = ", ".join(map(repr, given))
            raise ValueError(f"give all with a unit, absolute, or all without, multiples of nominal, not {shown}")
        numbers = [float(quantity(value, unit if absolute else "")) for value in given]
        if self.values is None and numbers[0] >= numbers[1]:
            raise ValueError(f"low must be below high, not {self.low} and {self.high}")
        return numbers, absolute


class Design(Strict):
    """Options of a design; the fields are ``js.tune``'s arguments."""

    impulses: int = Field(default=3, ge=2, le=64)
    duration: Positive | list[float] | None = None
    time_cost: NotNegative = 0.0
    sample_time: Positive | None = None
    amplitudes: Literal["positive", "bounded", "unity", "free"] = "positive"
    limit: Positive | None = None
    objective: Literal["nominal", "worst", "mean", "cvar"] | None = None
    also: list[str] | dict[str, Any] = []
    shapers: Literal["shared", "per axis"] | list[str] = "shared"
    peak_deflection: Positive | dict[str, Positive] | None = None
    speed_limit: Positive | dict[str, Positive] | None = None
    command_overshoot: NotNegative | dict[str, NotNegative] | None = None
    starts: int = Field(default=32, ge=1, le=100_000)
    seed: int = Field(default=0, ge=0)


class Front(Strict):
    """Options of a Pareto front; the fields are ``js.pareto``'s arguments."""

    impulses: list[int] = [2, 3, 4]
    amplitudes: list[Literal["positive", "bounded", "unity", "free"]] = ["positive"]
    limit: Positive | None = None
    durations: int | list[float] = 12
    starts: int = Field(default=16, ge=1, le=100_000)


class Adapt(Strict):
    """Options of ``jshape adapt``, which tries strategies on a ``FlexibleLink`` whose load changes.

    Attributes:
        cases: the strategies.
        sample_time: s.
        period: of the square wave, from minus to plus the problem's distance and back, s.
        duration: of the experiment, s.
        changes: of the load, pairs (time, load), s and the link's unit.
        omega: with which the strategies start, rad/s.
        zeta: likewise.
        bands: of the modes, (least, greatest), rad/s.
        points: of the DFT.
        thresholds: of the DFTs, m/s².
        schedules: random ones beside the square wave, if any.
        seed: of noise and schedules.
    """

    cases: list[Literal["unshaped", "I", "I-D", "I-D-E", "state-aware", "replanning"]] = [
        "unshaped",
        "I",
        "I-D",
        "state-aware",
    ]
    sample_time: Positive = 0.005
    period: Positive = 20.0
    duration: Positive = 400.0
    changes: list[_Pair] = Field(min_length=1)
    omega: _Pair
    zeta: _Pair
    bands: Annotated[tuple[_Pair, _Pair], Field(strict=False)]
    points: int = Field(default=3000, ge=16, le=1_000_000)
    thresholds: _Pair = (150.0, 20.0)
    schedules: int = Field(default=0, ge=0, le=100_000)
    seed: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _bounded(self) -> "Adapt":
        for name, length, most in (("sample_time", self.sample_time, 1_000_000), ("period", self.period, 100_000)):
            if self.duration / length > most:
                raise ValueError(f"duration must be at most {most} times {name}, not {self.duration / length:.3g}")
        return self


class File(Strict):
    """A whole problem file."""

    title: str = ""
    distance: float | None = None
    command: dict[str, Any] | None = None
    plant: dict[str, Any]
    uncertainty: dict[str, Range] = {}
    design: Design = Field(default_factory=Design)
    pareto: Front = Field(default_factory=Front)
    adapt: Adapt | None = None

    @field_validator("uncertainty", mode="before")
    @classmethod
    def _dotted(cls, table: Any) -> Any:
        """``spring.k1 = {…}`` without quotes is a table in a table to TOML; here it is the leaf ``"spring.k1"``."""

        def flat(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
            found = {}
            for name, value in table.items():
                if isinstance(value, dict) and value and all(isinstance(inner, dict) for inner in value.values()):
                    found |= flat(value, f"{prefix}{name}.")
                else:
                    found[prefix + name] = value
            return found

        return flat(table) if isinstance(table, dict) else table

    @model_validator(mode="after")
    def _one_move(self) -> "File":
        if (self.distance is None) == (self.command is None):
            raise ValueError("give either distance (m) or a [command] table")
        return self
