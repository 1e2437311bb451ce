"""Parameters of the detection and of the tracking, and the check of the arrays that a detection gets.

Every parameter has a unit, a default per profile and an option on the command line.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import OptionError
from lidarcli.options.choices import AGENT_SCORE, MAX_COUNT, MIN_THING, PROFILES
from lidarcli.sweeps.range_rules import FARTHEST
from lidarcli.sweeps.types import Bool, Closure, Float64, SweepBatch
from lidarcli.system.records import asdict, dataclass, fields

Profile = Literal["robust", "paper"]


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of `detect`; the defaults are those of profile `robust`."""

    profile: Profile = "robust"
    threshold: Literal["adaptive", "mean"] | float = "adaptive"
    """d_th: `adaptive` (noise and one-sided limits), `mean` (Def. 3), or metres."""
    min_beams: int = 3
    """Least number of valid beams of a segment; a smaller one is noise."""
    max_width: float = 2.0
    """Greatest extent of an object [m]; a larger segment is background."""
    max_gap: int = 2
    """Greatest number of lost beams that are bridged where both sides continue each other."""
    group_gap: float = 0.0
    """Distance [m] below which objects become one, as the legs of a chair; 0 for never."""
    min_thing: float = MIN_THING
    """Least probability of a thing; a body below it is building."""
    walls: bool = False
    """True to report walls too: set S, shape wall."""

    @staticmethod
    def for_profile(profile: Profile = "robust", **overrides: Any) -> Parameters:
        """Return the defaults of a profile, with every override that is not None.

        Profile `paper` takes the formulas as printed: no least beam count, no greatest width, no bridged gap.

        >>> Parameters.for_profile("paper").threshold
        'mean'
        """
        if profile not in PROFILES:
            raise OptionError(f"--profile: '{profile}' is not one of {', '.join(PROFILES)}")
        unknown = set(overrides) - {field.name for field in fields(Parameters)}
        if unknown:
            raise OptionError(f"no such parameter: {', '.join(sorted(unknown))}")
        values: dict[str, Any] = {"profile": profile}
        if profile == "paper":
            values.update(threshold="mean", min_beams=1, max_width=float("inf"), max_gap=0)
        values.update({name: value for name, value in overrides.items() if value is not None})
        return Parameters(**values)

    def __post_init__(self) -> None:
        self.validate()

    def validate(self) -> None:
        """Refuse values without a meaning (`OptionError`)."""
        if isinstance(self.threshold, str):
            if self.threshold not in ("adaptive", "mean"):
                raise OptionError(f"--threshold: '{self.threshold}' is not adaptive, mean or a number of metres")
        elif not 0 <= self.threshold <= FARTHEST:
            raise OptionError(f"--threshold: {self.threshold} m is not a distance")
        for name, least, most in (
            ("min_beams", 1, MAX_COUNT),
            ("max_gap", 0, MAX_COUNT),
            ("group_gap", 0, FARTHEST),
            ("min_thing", 0, 1),
        ):
            value, option = getattr(self, name), name.replace("_", "-")
            if not value >= least:
                raise OptionError(f"--{option}: {value} is below {least}")
            if value > most:
                raise OptionError(f"--{option}: {value} is above {most:,.0f}")
        if not (0 < self.max_width <= FARTHEST or self.max_width == float("inf")):
            raise OptionError(f"--max-width: {self.max_width} m is not a width")

    def as_dict(self) -> dict[str, Any]:
        """Return plain values by name, for the metadata of the tables; an infinite width is None."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        if values["max_width"] == float("inf"):
            values["max_width"] = None
        return values


@dataclass(frozen=True, slots=True)
class TrackParameters:
    """Parameters of `track`, beside those of the detection."""

    agent_score: float = AGENT_SCORE
    """Least probability that a thing goes by itself, from which on it is an agent."""
    memory: bool = True
    """True to decide thing or building, and the shape, by all sweeps that saw an object, not anew in each."""

    def __post_init__(self) -> None:
        if not 0.0 < self.agent_score < 1.0:
            raise OptionError(f"--agent-score: {self.agent_score:g} is not between 0 and 1")

    def as_dict(self) -> dict[str, Any]:
        """Return plain values by name, for the metadata of the tables."""
        return asdict(self)


def check(batch: SweepBatch, within: Bool | None = None, sigma: Float64 | None = None) -> None:
    """Refuse a batch of S sweeps with up to B beams that the readers of logs and `range_rules.normalise` would not give.

    Parameters
    ----------
    batch : SweepBatch
    within, sigma : (S, B) and (S,), see `detect`

    Raises
    ------
    ValueError
        An array has another shape; a sweep has more beams than columns, or is a full turn of fewer than three;
        `angle_min` or `angle_increment` is NaN or infinite; a range is 0 m, negative or infinite.
    """
    _check_shapes(batch, within, sigma)
    for name in ("angle_min", "angle_increment"):
        values = getattr(batch, name)
        _refuse(batch, ~np.isfinite(values), f"{name} is {{}}, not a finite angle", values)
    beams = batch.beams
    _refuse(batch, (beams < 0) | (beams > batch.width), f"{{}} beams in {batch.width} columns", beams)
    turns = batch.closure != Closure.OPEN.value
    # The loops look at both neighbours of a beam.
    _refuse(batch, turns & (beams < 3), "a full turn of {} beams", beams)
    # NaN is neither.
    for wrong in (batch.ranges <= 0, batch.ranges == np.inf):
        if wrong.any():
            values = batch.ranges[np.arange(len(batch)), wrong.argmax(axis=1)]
            _refuse(batch, wrong.any(axis=1), "{:g} m is no range (NaN stands for none)", values)


def _check_shapes(batch: SweepBatch, within: Bool | None, sigma: Float64 | None) -> None:
    """Refuse arrays of another shape than that of their batch."""
    shape = (len(batch), batch.ranges.shape[-1])
    columns = ("beams", "closure", "angle_min", "angle_increment")
    arrays: list[tuple[str, Any, tuple[int, ...]]] = [(name, getattr(batch, name), shape[:1]) for name in columns]
    arrays += [(name, getattr(batch, name), shape) for name in ("ranges", "status", "intensities")]
    arrays += [("within", within, shape), ("sigma", sigma, shape[:1])]
    for name, values, expected in arrays:
        if values is not None and np.shape(values) != expected:
            raise ValueError(f"{name} of shape {np.shape(values)} in place of {expected}")


def _refuse(batch: SweepBatch, wrong: Any, words: str, values: NDArray[Any]) -> None:
    """Raise a `ValueError` with the value of the first sweep that is wrong."""
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(f"sweep {int(batch.sweep[row])} of {batch.topic}: {words.format(values[row])}")
