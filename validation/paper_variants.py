# Copyright 2026 The flexarm_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The rows of docs/paper.md: what is set anew in each, and the claims held against its runs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
import math
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.scenario.suites import suite
from flexarm_ros.scenario.suites.compare import MetricComparison
from flexarm_ros.scenario.suites.suite import Claim

MORE_CLAIMS = (
    Claim(
        '(g) FLS significantly reduces tracking errors (taken as: by a quarter)',
        tuple(
            MetricComparison(f'fls_{place}.{metric} < 0.75 * pd_{place}.{metric}')
            for place in ('collocated', 'tip', 'mid')
            for metric in ('rms_error', 'max_error')
        ),
    ),
    Claim(
        '(h) With FLS the sensor at the tip is as accurate as the collocated one '
        '(taken as: below 0.02 m)',
        tuple(
            MetricComparison(f'abs(fls_{place}.{metric} - fls_collocated.{metric}) < 0.02')
            for place in ('tip', 'tip_corrected', 'mid', 'mid_corrected')
            for metric in ('rms_error', 'max_error')
        ),
    ),
)
"""Claims of the paper's conclusion, besides those of its section 5 in config/paper.yaml."""

PAPER_DELAYS = {'tip': 0.001238, 'mid': 0.0009289}
PHYSICAL_DELAYS = {'tip': 0.0312, 'mid': 0.0234}
STEPS_OF_20_US = {'tip': 0.00002476, 'mid': 0.000018578}


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
        place = next((place for place in self.delays if f'_{place}' in case), None)
        if place is None or self.delays == PAPER_DELAYS:
            return self.settings
        latency = f'{self.delays[place]:.9f}'.rstrip('0')
        own = [f'tip_sensor.latency={latency}']
        if case.endswith('corrected'):
            own.append(f'trajectory.delay={latency}')
        return (*self.settings, *own)

    def command(self, case: str = 'fls_tip') -> str:
        """Return the command that runs one of the ten cases."""
        sets = ''.join(f' --set "{text}"' if ' ' in text or '[' in text else f' --set {text}'
                       for text in self.overrides(case))  # fmt: skip
        return f'flexarm simulate {case}{sets}'


def hub(value: float) -> str:
    """Return the setting of both hubs' inertia."""
    return f'plant.hub_inertia=[{value:.1f}, {value:.1f}]'


VARIANTS = (
    Variant('paper', 'none', "the paper's readings, 8 kg m^2 a hub"),
    Variant('true_tip', 'rigid measurand', 'the same runs, judged at the true tip', true_tip=True),
    Variant(
        'elastic', 'rigid measurand', 'the sensor sees the true point',
        ('tip_sensor.measurand=elastic',),
    ),
    Variant(
        'elastic_rates', 'rigid measurand', 'the same, rates from the encoders',
        ('tip_sensor.measurand=elastic', 'controller.velocity_source=encoder'),
    ),
    Variant('pade2', 'delay', 'Pade approximation, as in the paper',
            ('tip_sensor.latency_model=pade2',)),
    Variant('physical', 'delay units', '31.2 and 23.4 ms', delays=PHYSICAL_DELAYS),
    Variant(
        'physical_rates', 'delay units', '31.2 and 23.4 ms, rates from the encoders',
        ('controller.velocity_source=encoder',), PHYSICAL_DELAYS,
    ),
    Variant('hub_0', 'hub inertia', 'none, as the paper says', (hub(0),)),
    Variant(
        'hub_0_fine', 'hub inertia', 'none, tick 0.02 ms, delay 1.238 ms',
        (hub(0), 'control_period=0.00002'),
    ),
    Variant(
        'hub_0_fine_steps', 'hub inertia', 'none, tick 0.02 ms, delay 1.238 steps of it',
        (hub(0), 'control_period=0.00002'), STEPS_OF_20_US,
    ),
    *(Variant(f'hub_{h}', 'hub inertia', f'{h} kg m^2', (hub(h),)) for h in (4, 6, 11, 20)),
    *(
        Variant(f'eq14_{n}', 'one mode', f'(14) with {n} modes a link', (f'plant.modes={n}',))
        for n in (2, 3, 4)
    ),
    *(
        Variant(
            f'full_{n}', 'rigid Coriolis' if n == 1 else 'rigid Coriolis, one mode',
            f"full model, {n} mode{'s' if n > 1 else ''} a link",
            ('plant.model=full', f'plant.modes={n}'),
        )
        for n in (1, 2, 3)
    ),
    Variant(
        'damped', 'no damping', '1 % of critical in every mode', ('plant.damping_ratio=0.01',),
    ),
    Variant('elbow', 'elbow branch', 'theta2 < 0', ()),
    Variant('tick_01', '1 ms steps', 'tick 0.1 ms', ('control_period=0.0001',)),
    Variant(
        'half_speed', 'speed', '8 s a side', ('trajectory.side_time=8.0', 'duration=32.0'),
    ),
)  # fmt: skip


def _other_elbow() -> tuple[str, ...]:
    """Return the start of the branch with theta2 < 0: the mirror image about the diagonal."""
    from flexarm_ros.core.trajectory import initial_angles

    theta1, theta2 = initial_angles(scenario.load('pd_tip'))
    # Both branches bend away from the line to the point by the same angle.
    line = -0.75 * math.pi  # the corner at (-6.3, -6.3) m
    return (f'plant.initial_position=[{2.0 * line - theta1!r}, {-theta2!r}]',)


def variants() -> list[Variant]:
    """Return every row; settings that must be computed are filled in."""
    return [replace(v, settings=_other_elbow()) if v.name == 'elbow' else v for v in VARIANTS]


def at_the_tip(claim: Claim) -> Claim:
    """Return the claim about the true tip instead of the rigid arm's."""
    texts = []
    for check in claim.checks:
        text = check.text
        for metric in ('overshoot', 'rms_error', 'max_error'):
            text = text.replace(f'.{metric}', f'.tip_{metric}')
        texts.append(MetricComparison(text))
    return replace(claim, checks=tuple(texts))


@dataclass(frozen=True)
class Row:
    """A variant's ten runs and the verdicts, ``{letter: (verdict, held, of)}``."""

    variant: Variant
    runs: dict[str, dict[str, Any]]
    verdicts: dict[str, tuple[str, int, int]]


def judge(variant: Variant, runs: dict[str, dict[str, Any]]) -> Row:
    """
    Hold the claims against ten runs.

    A run that diverged has no metrics to compare but that it did: a claim about it is not known.
    """
    found = {}
    known = {case: run if run['stable'] else {'stable': False} for case, run in runs.items()}
    for claim in (*suite.load('paper').claims, *MORE_CLAIMS):
        asked = at_the_tip(claim) if variant.true_tip else claim
        verdict, outcomes = asked.judge(known)
        held = sum(outcome.holds is True for outcome in outcomes)
        found[claim.text[1]] = (verdict, held, len(outcomes))
    return Row(variant, runs, found)
