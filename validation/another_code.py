"""Motions against Exudyn."""

from __future__ import annotations

from validation import exudyn_arm
from validation.cases import CASES
from validation.exudyn_arm import FINE, STIFF
from validation.motion import Difference, compare, fly, full_plant
from validation.report import Section

LIMIT = 0.01
TIP_LIMIT = 3e-3
JOLTED = ("free_bent", "free_both")
"""Motions that start with straight links at speed."""

FIVE_SECONDS = ("torques_both", "torques_opposed", *JOLTED)
"""Those of the goal for torques of 20 N m and for free flight, over 5 s."""


def difference(name: str, modes: int) -> Difference:
    """Return how far the plant is from Exudyn in a motion of :data:`CASES`."""
    case = CASES[name]
    reference = exudyn_arm.solve(case, STIFF if name in JOLTED else FINE)
    motion = fly(full_plant(modes=modes, payload_mass=case.payload), case, every=20)
    return compare(motion[: len(reference)], reference)


def run() -> Section:
    """Compute the table."""
    section = Section("Another code: Exudyn")
    rows, worst, farthest, share = [], 0.0, 0.0, 0.0
    for name, case in CASES.items():
        mesh = STIFF if name in JOLTED else FINE
        reference = exudyn_arm.solve(case, mesh)
        bent = max(abs(reference[:, 5:]).max(axis=0))
        for modes in (2, 4, 6):
            motion = fly(full_plant(modes=modes, payload_mass=case.payload), case, every=20)
            found = compare(motion[: len(reference)], reference)
            shares = (f"{100.0 * value:.2f}" for value in (*found.angles, *found.deflections))
            rows.append(
                [name, f"{100.0 * bent / 4.5:.1f}", modes, *shares, f"{1e3 * found.tip:.2f}",
                 f"{100.0 * found.tip_of_range:.3f}"]
            )  # fmt: skip
            if modes == 4:
                worst = max(worst, *found.angles)
                share = max(share, found.tip_of_range)
                if name in FIVE_SECONDS:
                    farthest = max(farthest, found.tip)
    section.table(
        ["motion", "bends by, % of length", "N", "theta1, %", "theta2, %", "delta1, %",
         "delta2, %", "tip, mm", "tip, %"], rows,
    )  # fmt: skip
    section.goal(
        "Exudyn, seven motions, N = 4: joint angles, of their range", f"{worst:.2%}", "1 %",
        worst < LIMIT,
    )  # fmt: skip
    section.goal(
        "Exudyn, seven motions, N = 4: tip, of its range", f"{share:.3%}", "1 %", share < LIMIT
    )
    section.goal(
        "Free flight at 1.5 rad/s and torques of 20 N m over 5 s, N = 4: tip",
        f"{1e3 * farthest:.2f} mm", "3 mm", farthest < TIP_LIMIT,
    )  # fmt: skip
    return section
