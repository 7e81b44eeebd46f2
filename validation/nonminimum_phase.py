"""The nonminimum-phase response: a torque step at the shoulder with the elbow held.

Everything is linear: the arm about straight links, elbow locked.  The response
of a point is summed over the arm's modes in closed form, zeros are those of
the transfer function from the shoulder's torque to the point's displacement
across the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig, eigh
from scipy.optimize import brentq

from flexarm_ros.core.modes import LinearArm, linearise
from flexarm_ros.core.parameters import RunConfig
from validation.motion import Array, full_plant
from validation.report import Section

WAVE_SPEED = 288.33
"""m/s, (15) of the paper: the speed of longitudinal waves."""

LOCATIONS = (1.0, 2.0, 3.0, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 6.75, 7.0, 7.5, 8.0, 8.5, 9.0)


def held(hub: float, modes: int = 6) -> LinearArm:
    """Return the straight arm with its elbow locked."""
    plant = full_plant(modes=modes, hub_inertia=(hub, 0.0))
    return linearise(RunConfig(plant=plant), 0.0).lock(False, True)


def step_response(arm: LinearArm, location: float, times: Array) -> Array:
    """Return the height (m) of a point after a step of 1 N m at the shoulder."""
    squares, shapes = eigh(arm.stiffness, arm.mass)
    gains = (arm.point(location)[1] @ shapes) * (arm.torque[:, 0] @ shapes)
    response = 0.5 * gains[0] * times**2
    for square, gain in zip(squares[1:], gains[1:], strict=True):
        response = response + gain / square * (1.0 - np.cos(math.sqrt(square) * times))
    return np.asarray(response)


@dataclass(frozen=True)
class Reversal:
    """Lowest height (m a N m), and when the point is back at 0 for good (s)."""

    depth: float
    time: float


def reversal(arm: LinearArm, location: float, step: float = 2e-5) -> Reversal:
    """Return how far and how long a point goes the wrong way; zeros where it does not."""
    times = np.arange(0.0, 1.5, step)
    height = step_response(arm, location, times)
    below = np.flatnonzero(height < 0.0)
    if not len(below):
        return Reversal(0.0, 0.0)
    last = int(below[-1])
    part = height[last] / (height[last] - height[last + 1])
    return Reversal(float(height.min()), float(times[last] + part * step))


def squared_zeros(arm: LinearArm, location: float) -> Array:
    """Return the squares of the transfer function's zeros, 1/s^2, complex.

    A negative real square is a pair on the imaginary axis; a positive one a
    pair of real zeros, one of them in the right half plane; a complex one
    belongs to four, two of them there.
    """
    size = len(arm.mass)
    left, right = np.zeros((size + 1, size + 1)), np.zeros((size + 1, size + 1))
    left[:size, :size] = arm.stiffness
    left[:size, size] = -arm.torque[:, 0]
    left[size, :size] = arm.point(location)[1]
    right[:size, :size] = -arm.mass
    values = eig(left, right, right=False)
    return np.asarray(values[np.isfinite(values) & (np.abs(values) < 1e8)])


def right_half_zeros(arm: LinearArm, location: float) -> list[complex]:
    """Return the zeros in the right half plane with imaginary part >= 0, nearest first."""
    zeros = []
    for square in squared_zeros(arm, location):
        root = complex(np.sqrt(complex(square)))
        root = root if root.real > 0.0 else -root
        if root.real > 1e-3 * abs(root) and root.imag >= -1e-6 * abs(root):
            zeros.append(root)
    return sorted(zeros, key=abs)


def first_real_zero(arm: LinearArm, location: float) -> float:
    """Return the lowest real zero in the right half plane, rad/s; inf without one."""
    found = (z.real for z in right_half_zeros(arm, location) if abs(z.imag) < 1e-6 * abs(z))
    return min(found, default=math.inf)


def exact_real_zero(location: float, length: float = 9.0) -> float:
    """Return the lowest real zero, rad/s, of a uniform pinned-free beam, without any modes.

    At a real s the solutions of the beam's equation are exp(r x) with
    EI r^4 = -rho s^2; a unit moment acts at x = 0, where w = 0, and the other
    end is free.  The zero is where w(location) changes sign; it does not
    depend on the hub.
    """
    rigidity, density = 1676.0, 0.335

    def height(s: float) -> float:
        unit = (density * s**2 / rigidity) ** 0.25
        roots = unit * np.exp(0.25j * math.pi * np.array([1.0, 3.0, 5.0, 7.0]))
        scale = np.exp(-np.maximum(roots.real, 0.0) * length)  # growing ones from the far end
        far = np.exp(roots * length) * scale
        matrix = np.array([scale, roots**2 * scale, roots**2 * far, roots**3 * far])
        parts = np.linalg.solve(matrix, np.array([0.0, -1.0 / rigidity, 0.0, 0.0]))
        return float(np.sum(parts * scale * np.exp(roots * location)).real)

    grid = np.geomspace(2.0, 5000.0, 4000)
    values = np.array([height(s) for s in grid])
    first = int(np.flatnonzero(values[1:] * values[:-1] < 0.0)[0])
    return float(brentq(height, grid[first], grid[first + 1]))


def _zero(value: complex) -> str:
    return (
        f"{value.real:.1f}"
        if abs(value.imag) < 1e-6 * abs(value)
        else (f"{value.real:.0f} +- {value.imag:.0f}i")
    )


def run() -> Section:
    """Compute the tables."""
    section = Section("Nonminimum-phase response")
    for hub in (0.0, 8.0):
        arm, coarse = held(hub), held(hub, 4)
        section.say(
            f"Step of 1 N m at the shoulder, elbow held straight, hub {hub:g} kg m^2, N = 6 "
            "(N = 4): depth of the reversal, time until the point is above 0 for good, zeros in "
            "the right half plane (nearest three), the lowest real one of the exact beam, and the "
            "paper's delay:"
        )
        rows = []
        for location in LOCATIONS:
            fine, rough = reversal(arm, location), reversal(coarse, location)
            zeros = right_half_zeros(arm, location)[:3]
            delay = location / WAVE_SPEED
            rows.append(
                [
                    location,
                    f"{1e3 * fine.depth:.4f}",
                    f"{1e3 * fine.time:.1f} ({1e3 * rough.time:.1f})",
                    "; ".join(_zero(zero) for zero in zeros) or "none",
                    f"{exact_real_zero(location):.2f}",
                    f"{1e3 * delay:.1f}",
                    f"{fine.time / delay:.1f}",
                ]
            )
        section.table(
            ["location, m", "depth, mm", "time, ms", "zeros, rad/s", "exact", "delay, ms", "ratio"],
            rows,
        )
    for location in (6.75, 9.0):
        error = first_real_zero(held(0.0, 4), location) / exact_real_zero(location) - 1.0
        section.check(abs(error) < 0.01, f"zero at {location} m: {error:.2%}")
    tip, middle = reversal(held(0.0), 9.0).time, reversal(held(0.0), 6.75).time
    section.check(abs(tip / 0.267876 - 1.0) < 0.01, f"tip: {tip} s")
    section.check(abs(middle / 0.0886483 - 1.0) < 0.01, f"6.75 m: {middle} s")
    return section
