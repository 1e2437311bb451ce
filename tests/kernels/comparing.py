"""Run as a program, with logs as arguments: detect over random scenes and those logs, comparing every call of a kernel.

Each call goes to both, the compiled function and the one it stands for, with arguments of its own; whatever they return
or leave in their arguments must agree bit for bit. Prints the number of calls by function as JSON.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from lidarcli import kernels

CALLS: Counter[str] = Counter()


def comparing(plain: Callable[..., Any]) -> Callable[..., Any]:
    """A stand-in for `kernels.compiled`."""
    fast = _compiled(plain)
    name = f"{plain.__module__}.{plain.__qualname__}"
    if fast is plain:
        return plain

    def both(*args: Any, **kwargs: Any) -> Any:
        own_args, own_kwargs = copy.deepcopy((args, kwargs))
        expected = plain(*own_args, **own_kwargs)
        result = fast(*args, **kwargs)
        same(f"result of {name}", result, expected)
        same(f"arguments of {name}", (args, kwargs), (own_args, own_kwargs))
        CALLS[name] += 1
        return result

    return both


def same(what: str, one: Any, other: Any) -> None:
    """Raise AssertionError where two values differ in a type, a shape or a bit."""
    assert type(one) is type(other), f"{what}: {type(one)} for {type(other)}"
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, f"{what}: {one.dtype} for {other.dtype}"
        assert one.shape == other.shape, f"{what}: {one.shape} for {other.shape}"
        if one.tobytes() != other.tobytes():
            # Two NaN may differ in their bits.
            nan = one.dtype.kind == "f"
            at = np.flatnonzero(~((one == other) | nan & (one != one) & (other != other)).ravel())
            zero = np.flatnonzero((np.signbit(one) != np.signbit(other)).ravel()) if nan else at
            assert not len(at), (
                f"{what}: {len(at)} values differ, first {one.flat[at[0]]!r} for {other.flat[at[0]]!r}"
            )
            finite = zero[~np.isnan(one.ravel()[zero])]
            assert not len(finite), f"{what}: the sign of zero differs at {finite[:5]}"
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), what
        for index, (a, b) in enumerate(zip(one, other, strict=True)):
            same(f"{what}[{index}]", a, b)
    elif isinstance(one, dict):
        assert one.keys() == other.keys(), what
        for key in one:
            same(f"{what}[{key!r}]", one[key], other[key])
    elif dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            same(f"{what}.{field.name}", getattr(one, field.name), getattr(other, field.name))
    else:
        assert one == other or (one != one and other != other), f"{what}: {one!r} for {other!r}"


_compiled = kernels.compiled
kernels.compiled = comparing

# Only now, so that the functions are marked with the stand-in.
from lidarcli.formalism import Parameters, detect  # noqa: E402
from lidarcli.logs import open_log  # noqa: E402
from lidarcli.logs.base import ReadReport  # noqa: E402
from lidarcli.logs.batches import ReadOptions, read_batches  # noqa: E402
from lidarcli.simulate.generate import simulate_sweep_arrays  # noqa: E402
from lidarcli.simulate.random_scenes import FAULTS, KINDS, SENSORS, random_scene, sensor_with  # noqa: E402
from lidarcli.sweeps import RangeRules, concatenate, normalise  # noqa: E402
from lidarcli.tables.rows import objects_rows, sweeps_rows  # noqa: E402
from tests.kernels.odd import odd_batches  # noqa: E402

PARAMETERS = [
    Parameters.for_profile("robust"),
    Parameters.for_profile("paper"),
    Parameters.for_profile("robust", walls=True, group_gap=0.45),
    Parameters.for_profile("robust", max_gap=0, min_beams=1),
]


def main(logs: list[str], scenes: int = 6) -> None:
    """Compare on every kind of scene, sensor and fault, and on the logs."""
    for kind in KINDS:
        for sensor in SENSORS.values():
            for noise, lost in FAULTS:
                raw = concatenate(
                    [
                        simulate_sweep_arrays(
                            random_scene(kind, seed, sensor_with(sensor, noise, lost)), 2, seed
                        )[0]
                        for seed in range(scenes)
                    ]
                )
                batch = normalise(raw, np.arange(len(raw)), RangeRules())
                for parameters in PARAMETERS:
                    detect(batch, parameters, per_beam=parameters.walls)
    for batch in odd_batches():
        for parameters in PARAMETERS:
            found = detect(batch, parameters)
            objects_rows("log", batch, found)
            sweeps_rows("log", batch, found)
    for log in logs:
        with open_log(log) as source:
            for batch in read_batches(source, ReadOptions(), ReadReport()):
                for parameters in PARAMETERS:
                    detect(batch, parameters)
    print(json.dumps(CALLS))


if __name__ == "__main__":
    main(sys.argv[1:])
