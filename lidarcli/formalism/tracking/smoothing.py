"""Where a body was and how fast, by what was seen of it before and after: a Kalman filter forth and back."""

from __future__ import annotations

from typing import Any

from lidarcli import native

ACCELERATION = 0.15
"""[m²/s³] Spectral density of a body's acceleration."""
SPEED_AT_FIRST = 1.0
"""[m/s] Standard deviation of a velocity before anything is known."""


class Smoother:
    """Room for the sightings of one body along one axis."""

    def __init__(self, most: int) -> None:
        self.owner: list[Any] = []
        self.most = most
        self.x = native.doubles(self.owner, most)
        self.v = native.doubles(self.owner, most)
        self.xx = native.doubles(self.owner, most)
        self.xv = native.doubles(self.owner, most)
        self.vv = native.doubles(self.owner, most)
        """What is known at each sighting by those before it and itself."""

    def smooth(self, time: Any, z: Any, var: Any, v: Any, v_var: Any, state: Any, keep: int) -> None:
        """Fill v and v_var, the velocity at each sighting and its variance; z becomes the place.

        Parameters
        ----------
        time, z, var : (N,) when, where along the axis [m], and its variance [m²]; float64
        v, v_var : (N,) [m/s], [m²/s²], to be filled
        state : (6,) time, x, v and their covariance xx, xv, vv after the sighting before; xx < 0: none. It becomes that
            after sighting `keep` - 1
        """
        run(
            self,
            native.at_doubles(time),
            native.at_doubles(z),
            native.at_doubles(var),
            native.at_doubles(v),
            native.at_doubles(v_var),
            native.at_doubles(state),
            len(time),
            keep,
        )


def run(
    room: Smoother, time: Any, z: Any, var: Any, v: Any, v_var: Any, state: Any, count: int, keep: int
) -> None:
    """Forth, then back (Rauch, Tung and Striebel)."""
    begin = time[0]
    place, speed, xx, xv, vv = z[0], 0.0, var[0], 0.0, SPEED_AT_FIRST * SPEED_AT_FIRST
    known = state[3] >= 0.0
    if known:
        begin, place, speed, xx, xv, vv = state[0], state[1], state[2], state[3], state[4], state[5]
    for i in range(count):
        if i > 0 or known:
            dt = time[i] - begin
            place += dt * speed
            xx += dt * (2.0 * xv + dt * vv) + ACCELERATION * dt * dt * dt / 3.0
            xv += dt * vv + 0.5 * ACCELERATION * dt * dt
            vv += ACCELERATION * dt
            off, s = z[i] - place, xx + var[i]
            if off * off > 6.0 * s:
                s = off * off / 6.0
            gain, gain_v = xx / s, xv / s
            place += gain * off
            speed += gain_v * off
            vv -= gain_v * xv
            xv -= gain * xv
            xx -= gain * xx
        begin = time[i]
        room.x[i], room.v[i] = place, speed
        room.xx[i], room.xv[i], room.vv[i] = xx, xv, vv
        if i == keep - 1:
            state[0], state[1], state[2], state[3], state[4], state[5] = begin, place, speed, xx, xv, vv
    z[count - 1], v[count - 1], v_var[count - 1] = place, speed, vv
    for back in range(1, count):
        i = count - 1 - back
        dt = time[i + 1] - time[i]
        a, b, d = room.xx[i], room.xv[i], room.vv[i]
        ahead_xx = a + dt * (2.0 * b + dt * d) + ACCELERATION * dt * dt * dt / 3.0
        ahead_xv = b + dt * d + 0.5 * ACCELERATION * dt * dt
        ahead_vv = d + ACCELERATION * dt
        size = ahead_xx * ahead_vv - ahead_xv * ahead_xv
        if size <= 0.0:
            size = 1e-30
        # Gain: the covariance of now and ahead, over that of ahead.
        g_xx = ((a + dt * b) * ahead_vv - b * ahead_xv) / size
        g_xv = (b * ahead_xx - (a + dt * b) * ahead_xv) / size
        g_vx = ((b + dt * d) * ahead_vv - d * ahead_xv) / size
        g_vv = (d * ahead_xx - (b + dt * d) * ahead_xv) / size
        off_x = z[i + 1] - (room.x[i] + dt * room.v[i])
        off_v = v[i + 1] - room.v[i]
        z[i] = room.x[i] + g_xx * off_x + g_xv * off_v
        v[i] = room.v[i] + g_vx * off_x + g_vv * off_v
        # Of the variance only that of the speed is asked for: what is known of the place ahead is taken as certain.
        v_var[i] = max(
            d
            - g_vx * (ahead_xx * g_vx + ahead_xv * g_vv)
            - g_vv * (ahead_xv * g_vx + ahead_vv * g_vv)
            + g_vv * g_vv * v_var[i + 1],
            0.0,
        )
