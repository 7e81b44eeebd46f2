"""Natural frequencies against the exact ones, for each basis and number of functions."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from flexarm_ros.core.modes import JOINTS, natural_frequencies
from flexarm_ros.core.parameters import PlantParameters, RunConfig
from validation import dynamic_stiffness
from validation.dynamic_stiffness import Array, Chain
from validation.motion import full_plant
from validation.report import Section

ANGLES = tuple(np.linspace(0.0, math.pi, 19))
LIMIT = 0.005
BASES = ("arm_modes", "craig_bampton", "clamped_free")

SINGLE = {
    "clamped-free": (12.28119, 76.96488, 215.50390, 422.30163),
    "pinned-free": (53.85468, 174.52364, 364.12965, 622.68325),
}
"""rad/s, one link of 4.5 m: the table of the reference solutions."""

DE_LUCA = {
    "link 1, link 2 rigid, elbow at pi/2": ((1.0, 1e6), (0.48, 1.80)),
    "link 2, link 1 rigid": ((1e6, 1.0), (2.18, 15.91)),
}
"""Rigidities (N m^2) and the published frequencies, Hz."""


def de_luca(rigidity: tuple[float, float], modes: int = 4) -> PlantParameters:
    """Return De Luca and Siciliano's arm of 1991 with these rigidities."""
    return full_plant(
        modes=modes, length=(0.5, 0.5), mass_density=(0.2, 0.2), flexural_rigidity=rigidity,
        hub_inertia=(0.1, 0.0), link_end_mass=1.0, link_end_inertia=0.1, payload_mass=0.1,
        payload_inertia=0.0005,
    )  # fmt: skip


@lru_cache
def exact(hub: float, theta2: float, joints: str) -> Array:
    """Return the first four exact frequencies of the arm of design.md, rad/s."""
    shoulder, elbow = JOINTS[joints]
    return dynamic_stiffness.frequencies(Chain(hub=(hub, hub)), theta2, shoulder, elbow)


def errors(basis: str, modes: int, hub: float, joints: str) -> Array:
    """Return the largest relative error over the elbow angles of each of the first four."""
    plant = full_plant(basis=basis, modes=modes, hub_inertia=(hub, hub))
    worst = np.zeros(min(4, 2 * modes))
    for angle in ANGLES:
        found = natural_frequencies(RunConfig(plant=plant), angle, joints)[: len(worst)]
        worst = np.maximum(worst, np.abs(found / exact(hub, angle, joints)[: len(worst)] - 1.0))
    return worst


def single_link(basis: str, modes: int) -> dict[str, Array]:
    """Return the relative errors for one link: a second one that is short, stiff and light."""
    plant = full_plant(
        basis=basis, modes=modes, length=(4.5, 0.01), mass_density=(0.335, 1e-7),
        flexural_rigidity=(1676.0, 1e6),
    )  # fmt: skip
    joints = {"clamped-free": "locked", "pinned-free": "elbow-locked"}
    return {
        name: natural_frequencies(RunConfig(plant=plant), 0.3, joints[name])[:4] / values - 1.0
        for name, values in SINGLE.items()
    }


def _percent(values: Array) -> str:
    texts = (f"{100.0 * abs(value):.{3 if abs(value) < 0.1 else 0}f}" for value in values)
    return ", ".join(texts)


def run() -> Section:
    """Compute the tables."""
    section = Section("Natural frequencies")
    for hub in (0.0, 8.0):
        section.say(
            f"Largest error (%) of the first four frequencies over {len(ANGLES)} elbow angles from "
            f"0 to pi, hubs of {hub:g} kg m^2, against the dynamic stiffness matrix:"
        )
        rows = []
        for basis in BASES:
            for modes in range(1, 7):
                found = {joints: errors(basis, modes, hub, joints) for joints in JOINTS}
                rows.append([basis, modes, *(_percent(found[joints]) for joints in JOINTS)])
                if basis == "arm_modes" and modes >= 4:
                    worst = max(float(value.max()) for value in found.values())
                    section.check(worst < LIMIT, f"{basis}, {modes}: {worst:.2%} over 0.5 %")
        section.table(["basis", "N", *JOINTS], rows)
    section.say("One link by itself, errors (%) of the first four frequencies:")
    rows = []
    for basis in BASES:
        for modes in (4, 5, 6):
            found = single_link(basis, modes)
            rows.append([basis, modes, *(_percent(found[name]) for name in SINGLE)])
    section.table(["basis", "N", *SINGLE], rows)
    section.say("De Luca and Siciliano (1991), Hz, N = 4:")
    rows = []
    for name, (rigidity, published) in DE_LUCA.items():
        config = RunConfig(plant=de_luca(rigidity))
        found = natural_frequencies(config, 0.5 * math.pi, "locked")[:2] / (2.0 * math.pi)
        rows.append([name, *published, *(f"{value:.4f}" for value in found)])
        off = np.abs(found - published) - 0.005  # the published digits
        section.check(bool(np.all(off < 0.002 * found)), f"{name}: {found} Hz")
    section.table(["", "published f1", "f2", "found f1", "f2"], rows)
    return section
