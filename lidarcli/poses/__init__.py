"""Poses of the sensor: pose messages of a log, the tree of frames, and the choice of a source."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import NoReturn


class _NoFunction(ModuleType):
    """This package, which has the name of a command but is no function, as `lidarcli.track` and others are."""

    def __call__(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(
            "lidarcli.poses is no function: poses are in batch.poses of lidarcli.read(LOG), and the command line writes "
            "them (lidarcli poses LOG -o FILE.tum)"
        )


sys.modules[__name__].__class__ = _NoFunction
