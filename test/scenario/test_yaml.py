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

"""The YAML reader against real rcl, and the writer against rcl and PyYAML."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.scenario.errors import ScenarioError
from flexarm_ros.scenario.yaml import rclyaml
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
import yaml

oracle = pytest.importorskip('rcl_oracle', reason='needs rclpy')

# Scalars as written, "@" standing for a space.
LISTED = """
1e-3 1E3 1e+3 1.e3 .5 5. +.5 -.5e-2 0.001 1_000 1_0.5 0x10 0X1f -0x10 0x1p-3 0x.8 0x1.8p1 0x 0x1p
010 08 09.5 0o17 0b101 +5 -5 ++5 1e 1e+ e5 . -. +. 0 -0 -0.0 +0.0 00 00.5 1:30 190:20:30.15
12345678901234567890 9223372036854775807 9223372036854775808 -9223372036854775808
-9223372036854775809 0x7fffffffffffffff 0xffffffffffffffff 1e308 1e309 -1e309 1e400 1e-307 1e-308
1e-320 5e-324 0e-400 0.0e999999 0x1p-1060 0x1p-1080 0x1p1024 0x1p1023 inf -inf +inf Inf INF
infinity Infinity infinit nan NaN NAN -nan nan(12) nan(a_b) nan( .inf -.inf +.inf .Inf .INF .iNF
.nan .NaN .NAN -.nan +.nan yes no Yes NO y n Y N on off On OFF oN true false True FALSE tRUE null
~ Null NULL none None 1.0.0 1,5 1e5f 1d5 1.5L 0.1e-05 2001-01-01 2001-12-14t21:59:43.10-05:00 = <<
1e0x1 0x1e2 0x1e+2 4.5 1676 square a.csv /tmp/a.csv ../b.csv 5m "1" '1' "yes" '.5' "" '' '~'
!!str@5 !!str@yes !!int@'5' !!float@5 !!float@'5' !@5 !!bool@yes &a@5
"""
TEXTS = LISTED.split()


def same(ours: Any, theirs: Any) -> bool:
    """Equal in type and value, NaN to NaN and the sign of zero included."""
    if type(ours) is not type(theirs):
        return False
    if isinstance(ours, float):
        if math.isnan(ours):
            return math.isnan(theirs)
        return ours == theirs and math.copysign(1, ours) == math.copysign(1, theirs)
    return bool(ours == theirs)


def both(lines: list[str], directory: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    text = 'plant:\n  ros__parameters:\n'
    text += ''.join(f'    k{number}: {line}\n' for number, line in enumerate(lines))
    tree = rclyaml.parse(text)
    assert tree is not None
    return rclyaml.plain(tree)['plant']['ros__parameters'], oracle.read(text, directory)


def test_scalars_mean_what_rcl_takes_them_for(tmp_path: Path) -> None:
    lines = [text.replace('@', ' ') for text in TEXTS]
    ours, theirs = both(lines, tmp_path)
    assert set(ours) == set(theirs)
    wrong = {
        lines[int(key[1:])]: (ours[key], theirs[key])
        for key in ours
        if not same(ours[key], theirs[key])
    }
    assert not wrong


NUMBERISH = st.text(alphabet='0123456789.eE+-xXpPabfinINFy_', min_size=1, max_size=9)
MAGNITUDES = st.floats(allow_nan=False).map(repr) | st.floats(allow_nan=False).map(float.hex)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(NUMBERISH | MAGNITUDES | st.integers().map(str), min_size=50, max_size=200))
def test_scalars_like_numbers_mean_what_rcl_takes_them_for(
    tmp_path: Path, texts: list[str]
) -> None:
    lines = [text for text in texts if text not in ('-',) and not text.startswith('---')]
    ours, theirs = both(lines, tmp_path)
    wrong = [(lines[int(k[1:])], ours[k], theirs[k]) for k in ours if not same(ours[k], theirs[k])]
    assert not wrong


@pytest.mark.parametrize(
    'body',
    [
        'a: |\n      5\n    b: >-\n      5\n    c: |-\n      5.5\n',
        'a: [1, 2]\n    b: [1.0, .5]\n    c: [yes, no]\n    d: [\'1\', "2"]\n',
        'a:\n      b: 1\n      c: {d: 2.5, e: x}\n    f.g: 3\n',
        '\'a\': 1\n    "b.c": 2\n    1: 3\n    1.5: 4\n    yes: 5\n',
        '? a\n    : 1\n    b: 2 # comment\n',
    ],
)
def test_structures_mean_what_rcl_takes_them_for(tmp_path: Path, body: str) -> None:
    text = f'plant:\n  ros__parameters:\n    {body}'
    tree = rclyaml.parse(text)
    assert tree is not None
    ours = flat(rclyaml.plain(tree)['plant']['ros__parameters'])
    theirs = oracle.read(text, tmp_path)
    assert ours == theirs
    assert {k: type(v) for k, v in ours.items()} == {k: type(v) for k, v in theirs.items()}


def flat(data: dict[str, Any], prefix: str = '') -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in data.items():
        found.update(
            flat(value, f'{prefix}{key}.') if isinstance(value, dict) else {prefix + key: value}
        )
    return found


@pytest.mark.parametrize(
    'text',
    [
        'plant:\n  ros__parameters:\n    a:\n',
        'plant:\n  ros__parameters:\n',
        'plant:\n  ros__parameters:\n    a: &x 1\n    b: *x\n',
        'plant:\n  ros__parameters:\n    a: [1\n',
        'plant:\n  ros__parameters:\n    ? [a]\n    : 1\n',
        'plant:\n  ros__parameters:\n\ta: 1\n',
        "plant:\n  ros__parameters:\n    a: '\n",
        'plant:\n  ros__parameters:\n    a: \x01\n',
    ],
)
def test_what_rcl_refuses_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(oracle.RclError):
        oracle.read(text, tmp_path)
    with pytest.raises(ScenarioError) as caught:
        scenario.from_text(text)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    'text',
    [
        'plant:\n  ros__parameters:\n    modes: 1\n    modes: 2\n',
        'plant:\n  ros__parameters:\n    modes: 1\n/plant:\n  ros__parameters:\n    modes: 2\n',
        'plant:\n  ros__parameters:\n    modes: 1\n---\nencoder:\n  ros__parameters: {}\n',
        '',
        '# nothing\n',
    ],
)
def test_what_rcl_reads_in_a_way_that_misleads_is_refused(text: str) -> None:
    with pytest.raises(ScenarioError):
        scenario.from_text(text)


@settings(max_examples=300, deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False))
def test_a_written_float_reads_back_exactly_everywhere(value: float) -> None:
    text = rclyaml.float_text(value)
    assert same(yaml.safe_load(text), value)
    assert same(rclyaml.resolve(text), value)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(
        st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False),
        min_size=20,
        max_size=60,
    ),
    st.lists(st.text(max_size=12).filter(lambda t: '\0' not in t), min_size=5, max_size=20),
)
def test_what_is_written_reads_alike_in_rcl_pyyaml_and_here(
    tmp_path: Path, numbers: list[float], texts: list[str]
) -> None:
    data = {f'n{i}': x for i, x in enumerate(numbers)} | {f't{i}': x for i, x in enumerate(texts)}
    text = rclyaml.write({'plant': {'ros__parameters': data | {'many': numbers}}})
    theirs = oracle.read(text, tmp_path)
    assert yaml.safe_load(text)['plant']['ros__parameters'] == data | {'many': numbers}
    tree = rclyaml.parse(text)
    assert tree is not None
    assert rclyaml.plain(tree)['plant']['ros__parameters'] == data | {'many': numbers}
    assert all(same(theirs[key], value) for key, value in data.items())
    assert theirs['many'] == numbers


@pytest.mark.parametrize('name', sorted(scenario.shipped()))
def test_nodes_read_the_normalised_scenario_as_we_do(tmp_path: Path, name: str) -> None:
    config = scenario.load(name)
    text = scenario.dump(config)
    for section, keys in scenario.to_dict(config).items():
        node = 'plant' if section == '/**' else section
        theirs = oracle.read(text, tmp_path, node)
        for key, value in keys.items():
            if value is not None:
                assert same(value, theirs[key]), (section, key)
