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

"""
Whatever a file holds, its reader answers with one line: no traceback, no hang, no flood.

By default some hundred inputs each; `pytest -m slow` tries tens of thousands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import functools
import json
import os
from pathlib import Path
import resource
import signal
import tempfile
from types import FrameType

from flexarm_ros import scenario
from flexarm_ros.bag import metadata
from flexarm_ros.bag.errors import BagError
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, specs
from flexarm_ros.scenario import reader, ScenarioError, torque_file
from flexarm_ros.scenario.suites import suite
from flexarm_ros.scenario.sweeps import sweep
from flexarm_ros.wire.topics import per_tick_topics
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
from repository import ROOT

CONFIG = ROOT / 'config'
LIMIT_S = 20.0
LIMIT_KIB = 1024 * 1024

KEYS = [f'{section}.{key}' for section, cls in SECTIONS.items() for key in specs(cls)]
WORDS = [
    *SECTIONS, *KEYS, *(key for cls in SECTIONS.values() for key in specs(cls)),
    'ros__parameters', 'cases', 'scenario', 'set', 'grid', 'expect', 'faults', 'compare',
    'claims', 'claim', 'checks', 'verdict', 'defaults', 'mode', 'name', 'at', 'node', 'action',
    'for', 'draw', 'count', 'seed', 'parameters', 'tie', 'map', 'x', 'y', 'value', 'from', 'to',
    'step', 'scale', 'log', 'uniform', 'normal', 'factor', 'choice', 'integers', 'loguniform',
    'independent', 'lt', 'gt', 'near', 'rel', 'between', 'max_error', 'overshoot[0]', 'stable',
    'fls_tip', 'pd_tip.yaml', 'simulate', 'run', 'kill', 'delay', 'holds', 'open_loop',
    'fls_tip.max_error < 1', 'square', 'hold', 'waypoints', 'full', 'elastic', 't,tau1,tau2',
]  # fmt: skip
VALUES = [
    '0', '1', '-1', '1e-3', '.5', '5.', '1e308', '1e309', '-1e308', '1e-308', '5e-324', '0x10',
    '0x1p-3', 'nan', '.nan', '.inf', '-inf', 'true', 'off', 'null', '~', "''", '""', '[]', '{}',
    '[1, 2]', '[4.5, 4.5]', '[1, [2]]', '[0, 1, 2]', '{a: 1}', '9223372036854775808', '1e9', '1e6',
    '&a 1', '*a', '!!str 1', '!!python/object:os.system x', '!<tag:x> 1', '|\n  x', '>-\n  1',
    '2001-01-01', '9' * 400, '0.' + '0' * 400 + '1', '\u00e9', '\U0001f9be', '\x85', '\u2028',
    '../../etc/passwd', '/dev/zero', '/dev/stdin', 'a' * 5000,
]  # fmt: skip
PUNCTUATION = [': ', ':', '- ', ', ', '[', ']', '{', '}', '\n', '\n  ', '\n    ', '\t', '#', "'",
               '"', '%', '@', '`', '|', '>', '?', '---\n', '...\n', '%YAML 9.9\n', '\0', '\ufeff',
               '\\', '=', '<<: ']  # fmt: skip

TOKENS = st.sampled_from([*WORDS, *VALUES, *PUNCTUATION])
SOUP = st.lists(TOKENS | st.text(max_size=4), max_size=40).map(''.join)
SCALARS = st.sampled_from(VALUES) | st.floats().map(repr) | st.integers().map(str)


@st.composite
def tree(draw: st.DrawFn, depth: int = 4) -> str:
    """Return a value in YAML's flow style, mostly well formed."""
    kind = draw(st.integers(0, 3 if depth else 1))
    if kind <= 1:
        return draw(SCALARS | st.sampled_from(WORDS))
    if kind == 2:
        return '[' + ', '.join(draw(st.lists(tree(depth - 1), max_size=4))) + ']'
    pairs = draw(st.lists(st.tuples(st.sampled_from(WORDS), tree(depth - 1)), max_size=5))
    return '{' + ', '.join(f'{key!r}: {value}' for key, value in pairs) + '}'


@st.composite
def mutated(draw: st.DrawFn, source: str) -> str:
    """Return a text, or a shipped file of that pattern, with spans cut out or replaced."""
    texts = [path.read_text() for path in sorted(CONFIG.glob(source))] if len(source) < 50 else []
    text = draw(st.sampled_from(texts or [source]))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 30)))
        text = text[:start] + draw(TOKENS | SCALARS | st.just(text[start:end] * 2)) + text[end:]
    return text


@st.composite
def plausible(draw: st.DrawFn) -> str:
    """Return a well-formed scenario of known keys with values of all kinds."""
    text = ''
    for section in draw(st.lists(st.sampled_from(list(SECTIONS)), unique=True, max_size=4)):
        keys = list(specs(SECTIONS[section]))
        text += f'{section}:\n  ros__parameters:\n    use_sim_time: true\n'
        for key in draw(st.lists(st.sampled_from(keys), unique=True, max_size=4)):
            low, high = specs(SECTIONS[section])[key][1].low, specs(SECTIONS[section])[key][1].high
            bounds = [repr(bound) for bound in (low, high) if bound is not None]
            value = draw(SCALARS | st.sampled_from([*bounds, '1', '2.5', '[1, 1]']) | tree(1))
            text += f'    {key}: {value}\n'
    return text


@contextmanager
def limits() -> Iterator[None]:
    """Fail what takes too long or too much memory."""

    def late(signum: int, frame: FrameType | None) -> None:
        raise AssertionError(f'more than {LIMIT_S} s')  # no reader catches that

    old = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, old)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < LIMIT_KIB


def answers(read: Callable[[], object]) -> object:
    """Read something; anything but a result or an error of one line is a failure."""
    with limits():
        try:
            return read()
        except (ScenarioError, BagError) as error:
            assert str(error)
            assert '\n' not in str(error)
            assert len(str(error)) < 2000
            return None


def check_scenario(text: str) -> None:
    config = answers(lambda: scenario.from_text(text))
    if isinstance(config, RunConfig):
        assert scenario.from_text(scenario.dump(config), config.torques) == config
        assert scenario.from_dict(scenario.to_dict(config), config.torques) == config


def check_suite(text: str) -> None:
    made = answers(lambda: suite.from_text(text, 's', CONFIG))
    if isinstance(made, suite.Suite):
        for case in made.cases:
            case.check({})
        for claim in made.claims:
            claim.judge({})


def check_sweep(text: str) -> None:
    made = answers(lambda: sweep.from_text(text, 's', CONFIG))
    if isinstance(made, sweep.Sweep):
        for case in (made.case(0), made.case(made.count - 1)):
            base = made.bases[case.base]
            answers(functools.partial(scenario.with_values, base, case.overrides))
        made.digest()


def check_torques(text: str) -> None:
    rows = answers(lambda: torque_file.parse_torques(text, 't.csv'))
    if isinstance(rows, tuple):
        assert torque_file.parse_torques(scenario.write_torques(rows), 't.csv') == rows


def check_override(text: str) -> None:
    answers(lambda: scenario.load('pd_tip', [text]))


def check_metadata(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'metadata.yaml'
        data = text.encode('utf-8', 'surrogatepass')
        path.write_bytes(data[: metadata.MAX_BYTES])  # a longer one is not read at all
        counts = answers(lambda: metadata.read_counts(path))
    if isinstance(counts, dict):
        assert all(isinstance(value, int) for value in counts.values())


NUMBERS = st.sampled_from(VALUES) | st.floats().map(repr)
CSV_ROWS = st.lists(st.lists(NUMBERS | st.text(max_size=3), max_size=4).map(','.join), max_size=6)
TOPICS = per_tick_topics(scenario.load('pd_tip'))
METADATA = metadata.to_yaml({
    'rosbag2_bagfile_information': metadata.bag_information(
        'bag_0.mcap', 10**9, 2 * 10**9,
        [metadata.BagTopic(t.path, t.type_name, 'RIHS01_0', t.qos, 7) for t in TOPICS[:2]], {},
    )
})  # fmt: skip
INPUTS: dict[str, tuple[Callable[[str], None], st.SearchStrategy[str]]] = {
    'scenario': (check_scenario, plausible() | mutated('*_tip*.yaml') | SOUP | tree()),
    'suite': (check_suite, mutated('smoke.yaml') | SOUP | tree()),
    'sweep': (check_sweep, mutated('location_latency.yaml') | SOUP | tree()),
    'torques': (
        check_torques,
        CSV_ROWS.map(lambda rows: 't,tau1,tau2\n' + '\n'.join(rows)) | SOUP | st.text(),
    ),
    'metadata': (check_metadata, mutated(METADATA) | SOUP | tree()),
    'override': (
        check_override,
        st.tuples(st.sampled_from([*KEYS, *WORDS]), SCALARS | tree(2) | st.text()).map('='.join)
        | SOUP,
    ),
}


def try_many(name: str, count: int) -> None:
    check, strategy = INPUTS[name]

    @settings(max_examples=count, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def run(text: str) -> None:
        check(text)

    run()


@pytest.mark.parametrize('name', INPUTS)
def test_a_reader_answers_to_anything(name: str) -> None:
    try_many(name, 150)


MANY = {'scenario': 5_000, 'suite': 5_000, 'sweep': 5_000, 'torques': 10_000, 'override': 10_000,
        'metadata': 10_000}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('name', INPUTS)
def test_a_reader_answers_to_tens_of_thousands_of_inputs(name: str) -> None:
    try_many(name, MANY[name])


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=300))
def test_bytes_of_any_kind_are_answered(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / 'any.yaml'
    path.write_bytes(data)
    for read in (scenario.load, suite.load, sweep.load, scenario.read_torques):
        answers(functools.partial(read, path))


MEGABYTE = 1024 * 1024 - 64


TROUBLE = [
    '[' * MEGABYTE,
    '{' * MEGABYTE,
    '{a: ' * (MEGABYTE // 4),
    '- ' * (MEGABYTE // 2),
    '? ' * (MEGABYTE // 2),
    'a: ' * (MEGABYTE // 3),
    '&a ' * (MEGABYTE // 3),
    '!!str ' * (MEGABYTE // 6),
    '[' + '1,' * (MEGABYTE // 2 - 2) + ']',
    '{' + ','.join(f'k{i}: 1' for i in range(80_000)) + '}',
    'plant: {ros__parameters: {length: [' + '1,' * 400_000 + ']}}',
    "'" + 'a' * MEGABYTE,
    'a' * MEGABYTE,
    'plant:' + '\n' * MEGABYTE,
    '#' * MEGABYTE,
    'plant: {ros__parameters: {modes: ' + '1' * MEGABYTE + '}}',
    '/**: {ros__parameters: {control_period: 0.' + '0' * 900_000 + '1}}',
    'a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n',
    '\n'.join(f'a{i}: &a{i} [*a{i - 1}, *a{i - 1}]' for i in range(1, 2000)),
]


@pytest.mark.parametrize('text', TROUBLE, ids=lambda text: repr(text[:12]))
@pytest.mark.parametrize('check', [check_scenario, check_suite, check_sweep])
def test_a_megabyte_of_trouble_is_answered_soon(check: Callable[[str], None], text: str) -> None:
    check(text)


@pytest.mark.parametrize('text', TROUBLE[2:8] + TROUBLE[10:], ids=lambda text: repr(text[:12]))
def test_metadata_full_of_trouble_are_answered_soon(text: str) -> None:
    """Read by PyYAML in Python, at one second a megabyte: of those alike, one."""
    check_metadata(text)


def test_a_megabyte_of_csv_is_answered_soon() -> None:
    for text in (',' * MEGABYTE, '"' * MEGABYTE, 't,tau1,tau2\n' + '0,0,0\n' * 150_000,
                 't,tau1,tau2\n0,0,' + '9' * MEGABYTE):  # fmt: skip
        check_torques(text)


SPECIAL = ['/dev/zero', '/dev/stdin', '/proc/self/mem', '\0', 'x' * 9999, 'pipe']


@pytest.mark.parametrize('path', SPECIAL, ids=lambda path: repr(path[:12]))
def test_special_files_are_not_read(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo('pipe')
    assert answers(lambda: scenario.load(path)) is None
    assert answers(lambda: suite.load(path)) is None
    assert answers(lambda: sweep.load(path)) is None
    overrides = ['controller.law=open_loop', f'controller.torque_file={json.dumps(path)}']
    assert answers(lambda: reader.load('pd_tip', overrides)) is None
