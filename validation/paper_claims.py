"""The paper's claims under one changed assumption at a time: the tables of docs/paper.md.

    python validation/paper_claims.py                 # all rows; writes docs/data and docs/paper.md
    python validation/paper_claims.py --only full_3   # one row, printed

Each row flies the paper's ten cases (config/paper.yaml) with some parameters set anew and
judges the claims as they are written there, without changing a limit.  All rows take some
ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import csv
import math
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.analysis.sweep_worker import fly
from flexarm_ros.scenario import suite
from flexarm_ros.scenario.compare import Comparison
from flexarm_ros.scenario.suite import Claim

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "docs" / "data" / "paper_claims.csv"
PAGE = ROOT / "docs" / "paper.md"

MORE_CLAIMS = (
    Claim(
        "(g) FLS significantly reduces tracking errors (taken as: by a quarter)",
        tuple(
            Comparison(f"fls_{place}.{metric} < 0.75 * pd_{place}.{metric}")
            for place in ("collocated", "tip", "mid")
            for metric in ("rms_error", "max_error")
        ),
    ),
    Claim(
        "(h) With FLS the sensor at the tip is as accurate as the collocated one "
        "(taken as: below 0.02 m)",
        tuple(
            Comparison(f"abs(fls_{place}.{metric} - fls_collocated.{metric}) < 0.02")
            for place in ("tip", "tip_corrected", "mid", "mid_corrected")
            for metric in ("rms_error", "max_error")
        ),
    ),
)
"""Claims of the paper's conclusion, besides those of its section 5 in config/paper.yaml."""

PAPER_DELAYS = {"tip": 0.001238, "mid": 0.0009289}
PHYSICAL_DELAYS = {"tip": 0.0312, "mid": 0.0234}
STEPS_OF_20_US = {"tip": 0.00002476, "mid": 0.000018578}


@dataclass(frozen=True)
class Variant:
    """One row: what is set anew, in words and as ``--set`` takes it."""

    name: str
    assumption: str
    change: str
    settings: tuple[str, ...] = ()
    delays: dict[str, float] = field(default_factory=lambda: PAPER_DELAYS)
    true_tip: bool = False

    def overrides(self, case: str) -> tuple[str, ...]:
        """Return the settings of one of the ten cases."""
        place = next((place for place in self.delays if f"_{place}" in case), None)
        if place is None or self.delays == PAPER_DELAYS:
            return self.settings
        latency = f"{self.delays[place]:.9f}".rstrip("0")
        own = [f"tip_sensor.latency={latency}"]
        if case.endswith("corrected"):
            own.append(f"trajectory.delay={latency}")
        return (*self.settings, *own)

    def command(self, case: str = "fls_tip") -> str:
        """Return the command that flies one of the ten cases."""
        sets = "".join(f' --set "{text}"' if " " in text or "[" in text else f" --set {text}"
                       for text in self.overrides(case))  # fmt: skip
        return f"flexarm simulate {case}{sets}"


def hub(value: float) -> str:
    """Return the setting of both hubs' inertia."""
    return f"plant.hub_inertia=[{value:.1f}, {value:.1f}]"


VARIANTS = (
    Variant("paper", "none", "the paper's readings, 8 kg m^2 a hub"),
    Variant("true_tip", "rigid measurand", "the same runs, judged at the true tip", true_tip=True),
    Variant(
        "elastic", "rigid measurand", "the sensor sees the true point",
        ("tip_sensor.measurand=elastic",),
    ),
    Variant(
        "elastic_rates", "rigid measurand", "the same, rates from the encoders",
        ("tip_sensor.measurand=elastic", "controller.velocity_source=encoder"),
    ),
    Variant("pade2", "delay", "Pade approximation, as in the paper",
            ("tip_sensor.latency_model=pade2",)),
    Variant("physical", "delay units", "31.2 and 23.4 ms", delays=PHYSICAL_DELAYS),
    Variant(
        "physical_rates", "delay units", "31.2 and 23.4 ms, rates from the encoders",
        ("controller.velocity_source=encoder",), PHYSICAL_DELAYS,
    ),
    Variant("hub_0", "hub inertia", "none, as the paper says", (hub(0),)),
    Variant(
        "hub_0_fine", "hub inertia", "none, tick 0.02 ms, delay 1.238 ms",
        (hub(0), "control_period=0.00002"),
    ),
    Variant(
        "hub_0_fine_steps", "hub inertia", "none, tick 0.02 ms, delay 1.238 steps of it",
        (hub(0), "control_period=0.00002"), STEPS_OF_20_US,
    ),
    *(Variant(f"hub_{h}", "hub inertia", f"{h} kg m^2", (hub(h),)) for h in (4, 6, 11, 20)),
    *(
        Variant(f"eq14_{n}", "one mode", f"(14) with {n} modes a link", (f"plant.modes={n}",))
        for n in (2, 3, 4)
    ),
    *(
        Variant(
            f"full_{n}", "rigid Coriolis" if n == 1 else "rigid Coriolis, one mode",
            f"full model, {n} mode{'s' if n > 1 else ''} a link",
            ("plant.model=full", f"plant.modes={n}"),
        )
        for n in (1, 2, 3)
    ),
    Variant("damped", "no damping", "1 % of critical in every mode", ("plant.damping_ratio=0.01",)),
    Variant("elbow", "elbow branch", "theta2 < 0", ()),
    Variant("tick_01", "1 ms steps", "tick 0.1 ms", ("control_period=0.0001",)),
    Variant(
        "half_speed", "speed", "8 s a side", ("trajectory.side_time=8.0", "duration=32.0"),
    ),
)  # fmt: skip


def _other_elbow() -> tuple[str, ...]:
    """Return the start of the branch with theta2 < 0: the mirror image about the diagonal."""
    from flexarm_ros.core.trajectory import initial_angles

    theta1, theta2 = initial_angles(scenario.load("pd_tip"))
    # Both branches bend away from the line to the point by the same angle.
    line = -0.75 * math.pi  # the corner at (-6.3, -6.3) m
    return (f"plant.initial_position=[{2.0 * line - theta1!r}, {-theta2!r}]",)


def variants() -> list[Variant]:
    """Return every row; settings that must be computed are filled in."""
    return [replace(v, settings=_other_elbow()) if v.name == "elbow" else v for v in VARIANTS]


def _fly(task: tuple[str, tuple[str, ...]]) -> dict[str, Any]:
    case, overrides = task
    return fly(scenario.load(case, overrides))


def at_the_tip(claim: Claim) -> Claim:
    """Return the claim about the true tip instead of the rigid arm's."""
    texts = []
    for check in claim.checks:
        text = check.text
        for metric in ("overshoot", "rms_error", "max_error"):
            text = text.replace(f".{metric}", f".tip_{metric}")
        texts.append(Comparison(text))
    return replace(claim, checks=tuple(texts))


@dataclass(frozen=True)
class Row:
    """A variant's ten runs and the verdicts, ``{letter: (verdict, held, of)}``."""

    variant: Variant
    runs: dict[str, dict[str, Any]]
    verdicts: dict[str, tuple[str, int, int]]


def judge(variant: Variant, runs: dict[str, dict[str, Any]]) -> Row:
    """Hold the claims against ten runs."""
    found = {}
    for claim in (*suite.load("paper").claims, *MORE_CLAIMS):
        asked = at_the_tip(claim) if variant.true_tip else claim
        verdict, outcomes = asked.judge(runs)
        held = sum(outcome.holds is True for outcome in outcomes)
        found[claim.text[1]] = (verdict, held, len(outcomes))
    return Row(variant, runs, found)


def compute(chosen: list[Variant], workers: int) -> list[Row]:
    """Fly all cases of the variants and judge them."""
    cases = [case.name for case in suite.load("paper").cases]
    tasks = {(case, v.overrides(case)): None for v in chosen for case in cases}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
        for number, (task, result) in enumerate(
            zip(tasks, pool.map(_fly, list(tasks)), strict=True), start=1
        ):
            tasks[task] = result
            print(f"\r{number} of {len(tasks)} runs", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return [
        judge(v, {case: tasks[case, v.overrides(case)] or {} for case in cases}) for v in chosen
    ]


def verdict_cell(row: Row, letter: str) -> str:
    """Return a claim's verdict in a table."""
    verdict, held, of = row.verdicts[letter]
    if verdict == "not known":
        return "-"
    return {"holds": "yes", "does not hold": "**no**"}.get(verdict, f"{held} of {of}")


def overshoots(run: dict[str, Any], true_tip: bool) -> str:
    """Return a run's overshoots, or when it diverged."""
    if not run["stable"]:
        return f"diverges, tick {run['unstable_tick']}"
    return " ".join(f"{value:.3f}" for value in run["tip_overshoot" if true_tip else "overshoot"])


LETTERS = "abcdefgh"


def claims_table(rows: list[Row]) -> list[str]:
    """Return the first table of docs/paper.md: variants by claims."""
    lines = [
        "| dropped | instead | " + " | ".join(f"({x})" for x in LETTERS) + " | stable |",
        "|---|---|" + "---|" * (len(LETTERS) + 1),
    ]
    for row in rows:
        stable = sum(bool(run["stable"]) for run in row.runs.values())
        cells = [verdict_cell(row, letter) for letter in LETTERS]
        lines.append(
            f"| {row.variant.assumption} | {row.variant.change} | " + " | ".join(cells)
            + f" | {stable} of {len(row.runs)} |"
        )  # fmt: skip
    return lines


def numbers_table(rows: list[Row]) -> list[str]:
    """Return the second table: the numbers, and the command for one of the ten cases."""
    cases = ("pd_collocated", "pd_tip", "pd_tip_corrected", "fls_collocated", "fls_tip",
             "fls_tip_corrected")  # fmt: skip
    lines = [
        "| instead | " + " | ".join(cases) + " | rms, PD and FLS, tip | command (fls_tip) |",
        "|---|" + "---|" * (len(cases) + 2),
    ]
    for row in rows:
        tip = row.variant.true_tip
        rms = [row.runs[case]["tip_rms_error" if tip else "rms_error"] for case in
               ("pd_tip", "fls_tip")]  # fmt: skip
        stable = [row.runs[case]["stable"] for case in ("pd_tip", "fls_tip")]
        shown = " ".join(
            f"{value:.3f}" if fine else "-" for value, fine in zip(rms, stable, strict=True)
        )
        lines.append(
            f"| {row.variant.change} | "
            + " | ".join(overshoots(row.runs[case], tip) for case in cases)
            + f" | {shown} | `{row.variant.command()}` |"
        )
    return lines


COLUMNS = ("rms_error", "max_error", "tip_rms_error", "tip_max_error", "max_deflection",
           "max_torque")  # fmt: skip


def write_csv(rows: list[Row], path: Path) -> None:
    """Write every run's numbers, one a line, six digits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        switches = [f"{name}[{i}]" for name in ("overshoot", "tip_overshoot") for i in range(3)]
        writer.writerow(
            ["variant", "case", "stable", "unstable_tick", *COLUMNS, *switches, "command"]
        )
        for row in rows:
            for case, run in row.runs.items():
                values = [run[name] for name in COLUMNS]
                for name in ("overshoot", "tip_overshoot"):
                    values += [*run[name], None, None, None][:3]
                unstable = run["unstable_tick"]
                writer.writerow(
                    [row.variant.name, case, str(run["stable"]).lower(),
                     "" if unstable is None else unstable,
                     *("" if v is None else f"{v:.6g}" for v in values),
                     row.variant.command(case)]
                )  # fmt: skip


def replace_table(text: str, name: str, lines: list[str]) -> str:
    """Return ``text`` with what stands between the marks of table ``name`` replaced."""
    begin, end = f"<!-- table {name} -->\n", f"<!-- end {name} -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise SystemExit(f"{PAGE}: no marks of table {name}")
    return before + begin + "\n".join(lines) + "\n" + end + after


def main() -> int:
    """Fly, judge, and write or print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", metavar="ROW", help="these rows, printed only")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    known = {variant.name: variant for variant in variants()}
    if args.only and not set(args.only) <= set(known):
        parser.error(f"rows are {', '.join(known)}")
    rows = compute([known[name] for name in args.only or known], args.workers)
    if args.only:
        print("\n".join([*claims_table(rows), "", *numbers_table(rows)]))
        return 0
    write_csv(rows, TABLE)
    text = PAGE.read_text("utf-8")
    text = replace_table(text, "claims", claims_table(rows))
    PAGE.write_text(replace_table(text, "numbers", numbers_table(rows)), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
