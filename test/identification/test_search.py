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

"""Searches: from several points, stopped, killed and resumed."""

from __future__ import annotations

import json
import math
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from armtools import ARM, PERIOD
import flexarm_ros.cli as cli
from flexarm_ros.identification.estimate.fitting import Fit, fit, prepare
from flexarm_ros.identification.estimate.problem import Free, Prior, starting_points
from flexarm_ros.identification.estimate.search import Search
from flexarm_ros.identification.prediction.predict import predict
from flexarm_ros.identification.recording import Recording
from flexarm_ros.identification.setting import load_setting
import numpy as np
import pytest
from scipy.signal import lfilter

RIGIDITY = 'plant.flexural_rigidity.1'
FAR = 3.5


@pytest.fixture(scope='module')
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('arm') / 'arm.yaml'
    path.write_text(ARM)
    return path


@pytest.fixture(scope='module')
def recording(arm: Path) -> Recording:
    """Return 4 s of the arm's own strains, with noise, while both joints step to and fro."""
    t = PERIOD * np.arange(2000)
    steps = [0.4 * (t % 2.0 < 1.0), 0.3 * ((t + 0.5) % 1.6 < 0.8)]
    theta = {f'theta{j + 1}': lfilter([0.03], [1.0, -0.97], s) for j, s in enumerate(steps)}
    none = {f'strain{j}': np.zeros(len(t)) for j in (1, 2)}
    still = Recording('x', PERIOD, {**theta, **none}, dict.fromkeys(none, 'angle'))
    found = predict(still, load_setting(arm))
    random = np.random.default_rng(0)
    strains = {
        name: channel.predicted + 0.02 * channel.predicted.std() * random.standard_normal(len(t))
        for name, channel in found.channels.items()
    }
    return Recording('x', PERIOD, {**theta, **strains}, dict.fromkeys(none, 'angle'))


def searched(recording: Recording, arm: Path, rigidity: float, starts: int, **more: Any) -> Fit:
    request = prepare(
        [recording], arm, [RIGIDITY], window=None,
        overrides=[f'plant.flexural_rigidity=[{rigidity}, 0.256]'], starts=starts,
    )  # fmt: skip
    return fit(request, **more)


def test_starting_points_are_spread_and_repeat() -> None:
    free = (
        Free('a', 2.0, 0.0, math.inf),
        Free('b', 0.0, 0.0, 0.5),
        Free('c', 1.0, -math.inf, math.inf, Prior(4.0, 0.5)),
    )
    points = starting_points(free, 9)
    assert points[0] == pytest.approx([2.0, 0.0, 1.0])
    spread = points[1:]
    assert (spread >= [2.0 / 3.0, 0.0, 3.0]).all()
    assert (spread <= [6.0, 0.5, 5.0]).all()
    # One in each eighth of every interval.
    parts = [np.log(spread[:, 0] / 2.0) / np.log(9.0) + 0.5, 2.0 * spread[:, 1]]
    parts.append((spread[:, 2] - 3.0) / 2.0)
    for part in parts:
        assert sorted(np.floor(8.0 * part).astype(int)) == list(range(8))
    assert (points == starting_points(free, 9)).all()


def test_several_starts_find_what_one_does_not(arm: Path, recording: Recording) -> None:
    """A link that is much too stiff rings too fast: another cycle fits better than no ring."""
    one = searched(recording, arm, FAR, 1)
    several = searched(recording, arm, FAR, 8)
    assert one.parameters[RIGIDITY]['value'] > 1.2 * 1.44
    assert several.parameters[RIGIDITY]['value'] == pytest.approx(1.44, rel=0.01)
    assert several.channels['strain1'].fit > one.channels['strain1'].fit + 10.0


def test_a_search_from_several_points_resumes_where_it_was(
    arm: Path, recording: Recording, tmp_path: Path
) -> None:
    state, trials = tmp_path / 'search.json', [0]

    def note(search: Search) -> None:
        trials[0] = search.start

    part = searched(recording, arm, FAR, 3, report=note, stop=lambda: trials[0] == 2, state=state)
    assert not part.complete
    assert json.loads(state.read_text())['start'] == 2
    starts: list[int] = []
    searched(
        recording, arm, FAR, 3, report=lambda search: starts.append(search.start), state=state
    )
    assert set(starts) == {2}


def test_a_killed_fit_goes_on_from_its_best(
    arm: Path, recording: Recording, tmp_path: Path
) -> None:
    """SIGKILL leaves no time to write anything: the same command resumes all the same."""
    data, out = tmp_path / 'data.csv', tmp_path / 'out'
    columns = {'t_s': recording.times}
    columns.update({f'{name}_rad': values for name, values in recording.channels.items()})
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(data, table, delimiter=',', header=','.join(columns), comments='')
    words = [
        sys.executable, '-m', 'flexarm_ros.cli', 'fit', str(data), '--scenario', str(arm),
        '--free', 'plant.flexural_rigidity,plant.link_damping,plant.link_end_mass',
        '--window', 'whole', '--set', 'plant.flexural_rigidity=[1.6, 0.3]', '--no-pictures',
        '--out', str(out),
    ]  # fmt: skip
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 300.0
        while not (out / 'search.json').is_file():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.002)
    finally:
        process.kill()
        assert process.wait() == -signal.SIGKILL
    kept = json.loads((out / 'search.json').read_text())
    assert not kept['finished']
    assert not (out / 'fit.json').exists()
    assert cli.main(words[3:]) == 0
    found = json.loads((out / 'fit.json').read_text())
    assert found['complete']
    row = found['parameters'][RIGIDITY]
    assert row['value'] == pytest.approx(1.44, rel=0.01)
    assert row['start'] == 1.6
