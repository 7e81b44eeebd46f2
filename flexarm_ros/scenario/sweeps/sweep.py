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
Sweep files: one scenario over grids and random draws of any parameters.

A sweep is a YAML file::

    # One line that describes it
    scenario: fls_tip                   # or a list of scenarios
    set: {duration: 16}
    grid:
      tip_sensor.latency: {from: 0.0, to: 0.05, count: 11}       # or step, or scale: log
      plant.hub_inertia: [0, 4, 8]      # one number for both joints; [4, 8]: one each
    draw:
      count: 100                        # the same draws at each point of the grid
      seed: 1
      parameters:
        plant.flexural_rigidity: {factor: [0.9, 1.1]}            # of the scenario's value
        controller.kp: {normal: [150, 10]}
        plant.length: {uniform: [4.4, 4.6], independent: true}   # each link separately
        trajectory.time_law: {choice: [constant, smooth]}
        seed: {integers: [0, 1000]}
    tie: {trajectory.delay: tip_sensor.latency}    # takes the value of the other parameter
    map: {x: tip_sensor.latency, y: plant.hub_inertia, value: max_error}   # for the figures

Computed times that must be whole nanoseconds are rounded to the nanosecond.
"""

from __future__ import annotations

from dataclasses import dataclass
import hashlib
import json
from pathlib import Path

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.metric_list import TIMING
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.files import read_text
from flexarm_ros.scenario.locate import find, first_comment, shipped, shipped_sweeps
from flexarm_ros.scenario.reader import load as load_scenario
from flexarm_ros.scenario.suites.expect import known_metric
from flexarm_ros.scenario.sweeps.axes import Draw, Parameter, read_axis, read_draw
from flexarm_ros.scenario.writer import dump
from flexarm_ros.scenario.yaml.rclyaml import parse, SequenceTree, Tree
from flexarm_ros.scenario.yaml.treeread import as_integer, as_map, as_text, overrides_of

MAX_BYTES = 1024 * 1024
MAX_CASES = 1_000_000
MAX_DRAWN = 500_000


@dataclass(frozen=True)
class SweepCase:
    """
    One run of a sweep: the values that differ in it, ``{name: text}``, and its overrides.

    ``base`` is the index of its scenario in ``Sweep.bases``, to which ``overrides`` are
    added.
    """

    index: int
    base: int
    values: dict[str, str]
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class Map:
    """Axes and value of the figures: the value over x and y (``y`` empty: a curve over x)."""

    x: str
    y: str
    value: str


@dataclass(frozen=True)
class Sweep:
    """
    A complete, checked sweep file; ``case(i)`` for i below ``count`` gives its runs.

    ``scenarios`` are names, ``bases`` the scenarios with ``set`` applied.  ``axes`` are those
    of the grid and ``draws`` the drawn values, ``{name: texts}``, each of length ``samples``.
    """

    name: str
    description: str
    scenarios: tuple[str, ...]
    bases: tuple[RunConfig, ...]
    axes: dict[str, tuple[str, ...]]
    draws: dict[str, list[str]]
    samples: int
    ties: dict[str, str]
    plan: Map | None

    @property
    def count(self) -> int:
        """Return the number of runs."""
        return self.points * self.samples

    @property
    def points(self) -> int:
        """Return the number of grid points of all scenarios; each has a run per draw."""
        total = len(self.scenarios)
        for values in self.axes.values():
            total *= len(values)
        return total

    @property
    def columns(self) -> list[str]:
        """Return the names of the values that differ from run to run."""
        return ['scenario', *self.axes, *self.draws, *self.ties]

    def case(self, index: int) -> SweepCase:
        """Return run ``index``: scenarios vary slowest, then the grid's axes, draws fastest."""
        point, sample = divmod(index, self.samples)
        base, values = self._grid_values(point)
        values |= {name: texts[sample] for name, texts in self.draws.items()}
        values |= {name: values[other] for name, other in self.ties.items()}
        settings = tuple(Parameter.named(name).override(text) for name, text in values.items())
        shown = {name: json.loads(x) if x.startswith('"') else x for name, x in values.items()}
        return SweepCase(index, base, {'scenario': self.scenarios[base], **shown}, settings)

    def point(self, number: int) -> tuple[int, tuple[str, ...]]:
        """Return a grid point's scenario (index in ``bases``) and its overrides, without draws."""
        base, values = self._grid_values(number)
        values |= {name: values[other] for name, other in self.ties.items() if other in values}
        return base, tuple(Parameter.named(name).override(text) for name, text in values.items())

    def axis_text(self, name: str, point: int) -> str:
        """Return the text of an axis at a point of the grid."""
        return self._grid_values(point)[1][name]

    def _grid_values(self, point: int) -> tuple[int, dict[str, str]]:
        values: dict[str, str] = {}
        for name in reversed(self.axes):
            point, place = divmod(point, len(self.axes[name]))
            values[name] = self.axes[name][place]
        return point, {name: values[name] for name in self.axes}

    def digest(self) -> str:
        """Return a SHA-256 of everything that determines the results, scenarios included."""
        held = [
            self.scenarios, [(dump(base), base.torques) for base in self.bases],
            list(self.axes.items()), list(self.draws.items()), self.samples,
            list(self.ties.items()),
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(held).encode()).hexdigest()


def load(path_or_name: str | Path) -> Sweep:
    """
    Read a sweep: a file, or the bare name of a shipped one.

    Keys, listed values and the scenarios are checked; whether a combination of values is
    consistent is checked when it is run.  Raises ScenarioError, one line.
    """
    path = find(path_or_name, shipped_sweeps())
    text = read_text(path, MAX_BYTES)
    return from_text(text, path.stem, path.resolve().parent, first_comment(path))


def from_text(text: str, name: str, directory: Path, description: str = '') -> Sweep:
    """Read a sweep's text; scenarios' paths are relative to ``directory``."""
    try:
        tree = parse(text)
        if tree is None:
            raise ScenarioError('the file is empty; a sweep has a scenario and a grid or draws')
        keys = ('scenario', 'set', 'grid', 'draw', 'tie', 'map')
        return _read(as_map(tree, 'sweep', keys), name, directory, description)
    except ScenarioError as error:
        raise ScenarioError(f'{clip(name)}: {error}') from None


def _read(entries: dict[str, Tree], name: str, directory: Path, description: str) -> Sweep:
    if 'scenario' not in entries:
        raise ScenarioError('scenario: missing; a shipped name, a file, or a list of them')
    if 'grid' not in entries and 'draw' not in entries:
        raise ScenarioError('grid: missing, and draw too; give at least one of them')
    sources = _sources(entries['scenario'], directory)
    base = overrides_of(entries['set'], 'set') if 'set' in entries else ()
    bases = tuple(load_scenario(source, base) for source in sources)
    names = tuple(source.stem for source in sources)
    axes = _read_grid(entries['grid']) if 'grid' in entries else {}
    samples, draws = 1, dict[str, list[str]]()
    if 'draw' in entries:
        samples, draws = _read_draws(entries['draw'], bases[0], axes)
    ties = _read_ties(entries.get('tie'), [*axes, *draws])
    plan = _read_map(entries.get('map'), axes)
    sweep = Sweep(name, description, names, bases, axes, draws, samples, ties, plan)
    if sweep.count > MAX_CASES:
        raise ScenarioError(f'{sweep.count} runs; at most {MAX_CASES}')
    return sweep


def _sources(tree: Tree, directory: Path) -> tuple[Path, ...]:
    known = shipped()
    items = tree.items if isinstance(tree, SequenceTree) else (tree,)
    sources = [find(as_text(item, 'scenario'), known, directory) for item in items]
    if not sources:
        raise ScenarioError('scenario: none; give at least one')
    names = [source.stem for source in sources]
    for name in names:
        if names.count(name) > 1:
            raise ScenarioError(f"scenario: '{clip(name)}' is used twice")
    return tuple(sources)


def _read_grid(tree: Tree) -> dict[str, tuple[str, ...]]:
    axes: dict[str, tuple[str, ...]] = {}
    count = 1
    for key, item in as_map(tree, 'grid').items():
        parameter = Parameter.named(key)
        if parameter.name in axes:
            raise ScenarioError(f'grid.{clip(key)}: given twice')
        axes[parameter.name] = read_axis(parameter, item, f'grid.{clip(key)}')
        count *= len(axes[parameter.name])
        if count > MAX_CASES:
            raise ScenarioError(f'grid.{clip(key)}: {count} runs; at most {MAX_CASES}')
    return axes


def _read_draws(
    tree: Tree, config: RunConfig, axes: dict[str, tuple[str, ...]]
) -> tuple[int, dict[str, list[str]]]:
    entries = as_map(tree, 'draw', ('count', 'seed', 'parameters'))
    for key in ('count', 'parameters'):
        if key not in entries:
            raise ScenarioError(f'draw.{key}: missing')
    count = as_integer(entries['count'], 'draw.count', 1, MAX_CASES)
    seed = as_integer(entries['seed'], 'draw.seed', 0, 2**63 - 1) if 'seed' in entries else 0
    draws: list[Draw] = []
    for key, item in as_map(entries['parameters'], 'draw.parameters').items():
        draw = read_draw(key, item, config, f'draw.parameters.{clip(key)}')
        if draw.parameter.name in axes:
            raise ScenarioError(f'draw.parameters.{clip(key)}: is in the grid already')
        if draw.parameter in [other.parameter for other in draws]:
            raise ScenarioError(f'draw.parameters.{clip(key)}: given twice')
        draws.append(draw)
    if not draws:
        raise ScenarioError('draw.parameters: none; give at least one')
    if count * len(draws) > MAX_DRAWN:
        raise ScenarioError(f'draw: {count * len(draws)} values; at most {MAX_DRAWN}')
    return count, {draw.parameter.name: draw.texts(count, seed, config) for draw in draws}


def _read_ties(tree: Tree | None, swept: list[str]) -> dict[str, str]:
    ties: dict[str, str] = {}
    for key, item in (as_map(tree, 'tie') if tree is not None else {}).items():
        name = Parameter.named(key).name
        other = Parameter.named(as_text(item, f'tie.{clip(key)}')).name
        if other not in swept:
            raise ScenarioError(f"tie.{clip(key)}: '{other}' is neither in the grid nor drawn")
        if name in swept:
            raise ScenarioError(f"tie.{clip(key)}: '{name}' is swept itself")
        ties[name] = other
    return ties


def _read_map(tree: Tree | None, axes: dict[str, tuple[str, ...]]) -> Map | None:
    numeric = [
        name for name in axes if Parameter.named(name).spec.kind in ('float', 'int', 'float2')
    ]
    if tree is None:
        if not numeric:
            return None
        return Map(numeric[0], numeric[1] if len(numeric) > 1 else '', 'max_error')
    entries = as_map(tree, 'map', ('x', 'y', 'value'))
    if 'x' not in entries:
        raise ScenarioError('map.x: missing; a numeric axis of the grid')
    found = {'y': '', 'value': 'max_error'} | {
        key: as_text(item, f'map.{key}') for key, item in entries.items()
    }
    for key in ('x', 'y'):
        if found[key]:
            found[key] = Parameter.named(found[key]).name
            if found[key] not in numeric:
                raise ScenarioError(f"map.{key}: '{found[key]}' is no numeric axis of the grid")
    if found['x'] == found['y']:
        raise ScenarioError(f"map.y: '{found['y']}' is map.x already")
    metric, _ = known_metric(found['value'], 'map.value')
    if metric in ('complete', 'problem', 'status', *(m.name for m in TIMING)):
        raise ScenarioError(f"map.value: '{metric}' cannot be drawn; take a number of the run")
    return Map(found['x'], found['y'], found['value'])
