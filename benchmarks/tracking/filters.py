"""Kalman filters of all tracks of a method at once."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps.types import Bool, Float64, Int64


class Filters:
    """T tracks whose coordinates are filtered independently of each other and alike: place, velocity, acceleration."""

    def __init__(self, start: Float64, process: Float64, measurement: float) -> None:
        """Variances of the N states at birth and of a step's process noise (N,), and of a measurement."""
        self.start, self.process, self.measurement = np.diag(start), np.diag(process), measurement
        order = len(start)
        self.state = np.empty((0, order, 2))
        """(T, N, 2) x and y of the place, of the velocity …"""
        self.covariance = np.empty((0, order, order))
        """(T, N, N) of either coordinate."""
        self.number = np.empty(0, np.int64)
        """(T,) of the tracks."""
        self.last = 0
        """The greatest number that was given."""

    @property
    def place(self) -> Float64:
        """(T, 2) [m]."""
        place: Float64 = self.state[:, 0]
        return place

    @property
    def velocity(self) -> Float64:
        """(T, 2) [m/s]."""
        velocity: Float64 = self.state[:, 1]
        return velocity

    def predict(self, seconds: Float64 | float, process: float = 1.0) -> None:
        """Go on by a time, (T,) or one for all; the process noise is multiplied by `process`."""
        order = self.state.shape[1]
        step = np.tile(np.eye(order), (len(self.number), 1, 1))
        for first in range(order - 1):
            step[:, first, first + 1] = seconds
        if order > 2:
            step[:, 0, 2] = np.square(seconds) / 2
        self.state = step @ self.state
        self.covariance = step @ self.covariance @ step.transpose(0, 2, 1) + process * self.process

    def correct(self, which: Int64, place: Float64) -> None:
        """Take the measured places (K, 2) of the tracks at these positions (K,)."""
        covariance = self.covariance[which]
        gain = covariance[:, :, 0] / (covariance[:, 0, 0] + self.measurement)[:, None]
        self.state[which] += gain[:, :, None] * (place - self.state[which, 0])[:, None, :]
        self.covariance[which] = covariance - gain[:, :, None] * covariance[:, None, 0, :]

    def add(self, place: Float64) -> Int64:
        """New tracks at these places (K, 2); returns their numbers."""
        count = len(place)
        state = np.zeros((count, *self.state.shape[1:]))
        state[:, 0] = place
        numbers = np.arange(self.last + 1, self.last + count + 1)
        self.last += count
        self.state = np.concatenate([self.state, state])
        self.covariance = np.concatenate([self.covariance, np.tile(self.start, (count, 1, 1))])
        self.number = np.concatenate([self.number, numbers])
        return numbers

    def keep(self, kept: Bool) -> None:
        """Forget the tracks that are not kept (T,)."""
        self.state, self.covariance, self.number = self.state[kept], self.covariance[kept], self.number[kept]
