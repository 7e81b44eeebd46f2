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

"""Natural frequencies against exact ones: tables, dynamic stiffness, published arms."""

from __future__ import annotations

from dataclasses import replace
import json
import math

from flexarm_ros.cli import main
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig
from flexarm_ros.stability.modes import JOINTS, linearise, natural_frequencies
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from validation import dynamic_stiffness, frequencies
from validation.dynamic_stiffness import Chain
from validation.motion import full_plant

LIMIT = 0.005

# The reference solutions' table, theta2 = 0, no hubs; rad/s.
STRAIGHT = {
    'locked': [3.0703, 19.2412, 53.8760, 105.5750],
    'free': [40.2176, 69.5835, 149.6460, 201.3070],
    'elbow-locked': [13.4637, 43.6309, 91.0324, 155.6710],
    'shoulder-locked': [8.6184, 53.8547, 77.5661, 174.5240],
}


def found(plant: PlantParameters, theta2: float, joints: str) -> np.ndarray:
    return natural_frequencies(RunConfig(plant=plant), theta2, joints)


@pytest.mark.parametrize('joints', JOINTS)
def test_the_oracle_itself_against_the_table(joints: str) -> None:
    exact = dynamic_stiffness.frequencies(Chain(), 0.0, *JOINTS[joints])
    assert exact == pytest.approx(STRAIGHT[joints], rel=1e-5)


def test_the_oracle_finds_every_root_of_a_single_beam() -> None:
    """A chain straight and locked is one beam of 9 m; roots of its own equation."""
    unit = math.sqrt(1676.0 / 0.335) / 9.0**2

    def roots(function) -> list[float]:
        grid = np.linspace(1.0, 26.0, 500)
        values = [function(z) for z in grid]
        return [brentq(function, a, b) for a, b, u, v in
                zip(grid, grid[1:], values, values[1:], strict=False) if u * v < 0.0]  # fmt: skip

    clamped = [z**2 * unit for z in roots(lambda z: math.cos(z) + 1.0 / math.cosh(z))]
    pinned = [z**2 * unit for z in roots(lambda z: math.sin(z) - math.cos(z) * math.tanh(z))]
    for joints, exact in (('locked', clamped), ('elbow-locked', pinned)):
        chain = dynamic_stiffness.frequencies(Chain(), 0.0, *JOINTS[joints], count=7)
        assert chain == pytest.approx(exact[:7], rel=1e-7)


@pytest.mark.parametrize('joints', JOINTS)
@pytest.mark.parametrize('hub', [0.0, 8.0])
def test_first_four_within_half_a_percent_with_four_functions(joints: str, hub: float) -> None:
    """At every elbow angle, also those where the basis was not fitted."""
    plant = full_plant(modes=4, hub_inertia=(hub, hub))
    for theta2 in np.linspace(-math.pi, math.pi, 37):
        exact = frequencies.exact(hub, abs(float(theta2)), joints)
        assert found(plant, float(theta2), joints)[:4] == pytest.approx(exact, rel=LIMIT)


@pytest.mark.parametrize('joints', JOINTS)
def test_first_four_against_the_table(joints: str) -> None:
    for modes in (4, 5, 6):
        assert found(full_plant(modes=modes), 0.0, joints)[:4] == pytest.approx(
            STRAIGHT[joints], rel=LIMIT
        )


@pytest.mark.parametrize(
    'keys',
    [
        {'payload_mass': 0.5, 'payload_inertia': 0.1},
        {'link_end_mass': 2.0, 'link_end_inertia': 0.5, 'payload_mass': 1.0},
        {'length': (3.0, 6.0), 'mass_density': (1.0, 0.2), 'flexural_rigidity': (5000.0, 800.0)},
        {'hub_inertia': (1.0, 8.0)},
        # With rigid parts four functions reach 0.6 %, five 0.05 %.
        {'modes': 5, 'hub_radius': (0.6, 0.3), 'end_offset': (0.4, 0.7), 'link_end_mass': 1.0},
    ],
)
def test_other_arms_are_as_accurate(keys) -> None:
    plant = full_plant(**{'modes': 4, **keys})
    chain = Chain(
        plant.length, plant.mass_density, plant.flexural_rigidity, plant.hub_inertia,
        (plant.link_end_mass, plant.payload_mass), (plant.link_end_inertia, plant.payload_inertia),
        plant.hub_radius, plant.end_offset,
    )  # fmt: skip
    for theta2 in (0.0, 1.1, 2.6):
        for joints, locked in JOINTS.items():
            exact = dynamic_stiffness.frequencies(chain, theta2, *locked)
            assert found(plant, theta2, joints)[:4] == pytest.approx(exact, rel=LIMIT)


@pytest.mark.parametrize('basis', ['arm_modes', 'craig_bampton', 'clamped_free'])
def test_one_link_by_itself(basis: str) -> None:
    """Four functions serve the clamped link's four; the pinned one's fourth needs a fifth."""
    five, six = frequencies.single_link(basis, 5), frequencies.single_link(basis, 6)
    assert np.abs(five['clamped-free']).max() < LIMIT
    assert np.abs(six['clamped-free']).max() < LIMIT
    assert np.abs(frequencies.single_link(basis, 5)['pinned-free'][:2]).max() < LIMIT
    assert np.abs(six['pinned-free'][:3]).max() < LIMIT
    if basis == 'arm_modes':
        four = frequencies.single_link(basis, 4)
        assert np.abs(four['clamped-free']).max() < LIMIT
        assert np.abs(four['pinned-free'][:3]).max() < LIMIT
        assert np.abs(five['pinned-free']).max() < LIMIT


@pytest.mark.parametrize('basis', ['craig_bampton', 'clamped_free'])
@pytest.mark.parametrize('joints', JOINTS)
def test_frequencies_fall_towards_the_exact_ones(basis: str, joints: str) -> None:
    """Rayleigh-Ritz: these bases contain those of fewer functions."""
    exact, before = frequencies.exact(0.0, 1.0, joints), np.full(4, np.inf)
    for modes in (2, 3, 4, 5, 6):
        now = found(full_plant(modes=modes, basis=basis), 1.0, joints)[:4]
        assert np.all(now >= exact * (1.0 - 1e-9))
        assert np.all(now <= before * (1.0 + 1e-9))
        before = now


def test_clamped_free_modes_converge_like_1_over_n_where_a_link_is_carried() -> None:
    theta2 = 0.5 * math.pi
    exact = frequencies.exact(0.0, theta2, 'locked')[1]
    errors = {
        (basis, n): found(full_plant(modes=n, basis=basis), theta2, 'locked')[1] / exact - 1.0
        for basis in ('clamped_free', 'craig_bampton', 'arm_modes')
        for n in (3, 6)
    }
    assert errors['clamped_free', 3] / errors['clamped_free', 6] == pytest.approx(2.0, rel=0.1)
    assert errors['clamped_free', 6] > 0.05
    assert errors['craig_bampton', 6] < 1e-4
    assert errors['arm_modes', 6] < 1e-4


@pytest.mark.parametrize('name', list(frequencies.DE_LUCA))
def test_de_luca_and_siciliano_1991(name: str) -> None:
    """To the digits that they print."""
    rigidity, published = frequencies.DE_LUCA[name]
    hertz = found(frequencies.de_luca(rigidity), 0.5 * math.pi, 'locked')[:2] / (2.0 * math.pi)
    assert [round(float(f), 2) for f in hertz] == pytest.approx(published, abs=0.011)


@pytest.mark.parametrize('model', ['eq14', 'full'])
@pytest.mark.parametrize('joints', JOINTS)
def test_frequencies_are_those_of_the_linear_arm(model: str, joints: str) -> None:
    """The elimination of the free joints against the eigenvalues with the rigid modes kept."""
    config = RunConfig(plant=PlantParameters(model=model, modes=3, hub_inertia=(2.0, 1.0)))
    arm = linearise(config, 0.8).lock(*JOINTS[joints])
    squares = eigh(arm.stiffness, arm.mass, eigvals_only=True)
    rigid = 2 - sum(JOINTS[joints])
    assert np.abs(squares[:rigid]).max(initial=0.0) < 1e-6
    expected = np.sqrt(squares[rigid:])
    assert natural_frequencies(config, 0.8, joints) == pytest.approx(expected, rel=1e-9)


def test_elbow_angle_counts_as_its_cosine_only() -> None:
    plant = full_plant(modes=3)
    for joints in JOINTS:
        one = found(plant, 0.7, joints)
        assert found(plant, -0.7, joints) == pytest.approx(one, rel=1e-12)
        assert found(plant, 0.7 + 2.0 * math.pi, joints) == pytest.approx(one, rel=1e-12)


def test_hub_of_a_locked_joint_does_not_matter() -> None:
    plant = full_plant(modes=3, basis='craig_bampton')
    heavy = replace(plant, hub_inertia=(50.0, 70.0))
    assert found(heavy, 0.4, 'locked') == pytest.approx(found(plant, 0.4, 'locked'), rel=1e-12)


def modes(*words: str) -> list[str]:
    sets = ['plant.model=full', 'plant.modes=4', 'plant.hub_inertia=[0, 0]']
    return ['modes', 'fls_tip', *words, *(word for key in sets for word in ('--set', key))]


@pytest.mark.parametrize('joints', JOINTS)
def test_command_in_json(joints: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(modes('--joints', joints, '--elbow', '0', '--json')) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer['joints'] == joints
    assert answer['elbow'] == 0.0
    assert answer['frequencies_rad_s'][:4] == pytest.approx(STRAIGHT[joints], rel=LIMIT)


def test_command_as_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(modes('--elbow', '1.5708')) == 0
    out = capsys.readouterr().out
    assert 'model full, 4 modes a link, arm_modes' in out
    assert 'joints locked, elbow 1.5708 rad' in out
    assert out.count('rad/s') == 8


@pytest.mark.parametrize('words', [['--elbow', 'east'], ['--elbow', 'nan'], ['--joints', 'loose']])
def test_command_refuses_bad_usage(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(modes(*words)) == 2
    told = capsys.readouterr().err
    assert words[0] in told
    assert words[1] in told
