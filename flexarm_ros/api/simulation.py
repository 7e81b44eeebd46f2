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

"""``fa.configure`` and ``fa.simulate``: configure and simulate a scenario from Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import os
from pathlib import Path
import time
from typing import Any

from flexarm_ros import scenario as scenarios
from flexarm_ros.api.numbers import finite_array
from flexarm_ros.api.run import load, Run, table_of
from flexarm_ros.bag import outputs
from flexarm_ros.bag import simulation as recorded
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.core.control import Law
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.results.columns import header
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.core.run.results.trajectory_rows import Row, Rows
from flexarm_ros.core.run.state import Block
from flexarm_ros.scenario.errors import suggestion
from flexarm_ros.scenario.plugins.registry import register, section_names
import numpy as np
from numpy.typing import ArrayLike

Section = Mapping[str, Any]
Scenario = str | os.PathLike[str] | Mapping[str, Section] | RunConfig
"""A shipped scenario's name, a file, ``{section: {key: value}}``, or a result of ``configure``."""

OWN = '/**'
TORQUES = 'rows t, tau1, tau2 (s, N m, N m) of finite numbers, shape (n, 3)'


def configure(
    scenario: Scenario,
    *,
    duration: float | None = None,
    seed: int | None = None,
    law: type[Law] | str | None = None,
    torques: ArrayLike | None = None,
    **sections: Section | None,
) -> RunConfig:
    """
    Return a complete, checked scenario with some of its parameters changed.

    Parameters
    ----------
    scenario
        The name of a shipped scenario (``flexarm list``), a file, ``{section: {key: value}}``
        or a ``RunConfig``.
    duration, seed
        Short for ``run={"duration": ..., "seed": ...}``; s, and the seed of every noise.
    law
        Short for ``controller={"law": ...}``, or a class derived from
        ``flexarm_ros.core.control.Law``: it is used under its ``NAME``, by default that of the
        class, and its own parameters are ``controller={"NAME": {...}}``.
    torques
        Rows ``t, tau1, tau2`` (s, N m, N m), shape ``(n, 3)``: applied in open loop, interpolated
        linearly, instead of a control law.
    **sections
        ``{key: value}`` for a section of the scenario, keys and values as in the file:
        ``plant={"payload_mass": 1.0}``; ``run`` is the section ``/**``.  The value ``None``
        removes a key.  The section of an optional part, of an installed package too, adds the
        part.

    Raises
    ------
    ScenarioError
        One line that names the key, the value and what is allowed.

    """
    data = _sections(sections)
    short = (('run', 'duration', duration), ('run', 'seed', seed), ('controller', 'law', law))
    for section, key, value in short:
        if value is not None:
            value = register(value) if isinstance(value, type) else value
            data.setdefault(section, {})[key] = value
    if isinstance(scenario, RunConfig):
        config = scenario
    elif isinstance(scenario, Mapping):
        return _with_torques(_merged(scenario, data), (), torques)
    else:
        config = scenarios.load(scenario)
    if torques is None and not data:
        return config
    if torques is None:
        return scenarios.with_values(config, data=data)
    return _with_torques(_merged(scenarios.to_dict(config), data), config.torques, torques)


def simulate(
    scenario: Scenario,
    *,
    duration: float | None = None,
    seed: int | None = None,
    law: type[Law] | str | None = None,
    torques: ArrayLike | None = None,
    out: str | os.PathLike[str] | None = None,
    **sections: Section | None,
) -> Run:
    """
    Simulate a scenario in this process, without ROS, and return the run.

    The numbers equal those of ``flexarm run`` and ``flexarm simulate`` bit for bit.  An unstable
    run is returned too: ``run.stable`` is False.

    Parameters
    ----------
    scenario, duration, seed, law, torques, **sections
        As for :func:`configure`.
    out
        A new directory for bag, ``trajectory.csv`` and ``summary.json``; by default nothing is
        written.

    Raises
    ------
    ScenarioError
        For a bad scenario or value, before anything is simulated or written.
    BagError
        If ``out`` exists already or cannot be written.

    """
    config = configure(
        scenario, duration=duration, seed=seed, law=law, torques=torques, **sections
    )
    name = Path(scenario).stem if isinstance(scenario, (str, os.PathLike)) else 'run'
    if out is None:
        return _simulate(config, name)
    recorded.simulate(config, out, name)
    return load(out)


def _simulate(config: RunConfig, name: str) -> Run:
    """Simulate a scenario and keep the result in memory."""
    loop = ClosedLoop(config)
    rows, metrics = Rows(config), Metrics(config)
    tables, wall_s = [np.empty((0, len(header(config))))], 0.0
    for block, seconds in _timed(loop_blocks(loop)):
        wall_s += seconds
        tables.append(rows.table(block))
        metrics.add_table(tables[-1])
    unstable = None
    if loop.unstable is not None and loop.unstable_tick is not None:
        unstable = (loop.unstable_tick, loop.unstable)
    summary = outputs.summary_of(config, metrics.result(), Provenance.here(name), wall_s, unstable)
    return Run(name, table_of(np.concatenate(tables), header(config)), outputs.finite(summary))


def _timed(blocks: Iterator[Block]) -> Iterator[tuple[Block, float]]:
    """Yield each block with the wall time, s, that it took."""
    while True:
        start = time.perf_counter()
        block = next(blocks, None)
        if block is None:
            return
        yield block, time.perf_counter() - start


def _sections(sections: Mapping[str, Section | None]) -> dict[str, dict[str, Any]]:
    """Return the given sections as data, checked by name."""
    known = ['run' if name == OWN else name for name in section_names()]
    for name in sections:
        if name not in known:
            raise scenarios.ScenarioError(
                f'{name}: unknown section{suggestion(name, known)} (allowed: {", ".join(known)})'
            )
    return {name: _plain(name, keys) for name, keys in sections.items() if keys is not None}


def _plain(section: str, keys: Any) -> dict[str, Any]:
    """Return values as in a file: NumPy types become Python's, nested keys dotted."""
    if not isinstance(keys, Mapping):
        raise scenarios.ScenarioError(f'{section}: {keys!r} is not a map of keys')
    plain: dict[str, Any] = {}
    for key, value in keys.items():
        if isinstance(value, Mapping):
            inner = _plain(f'{section}.{key}', value)
            plain.update({f'{key}.{name}': held for name, held in inner.items()})
        else:
            plain[str(key)] = _value(value)
    return plain


def _value(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_value(item) for item in value]
    return value


def _merged(base: Mapping[str, Section], data: Mapping[str, Section]) -> dict[str, dict[str, Any]]:
    merged = {
        'run' if section == OWN else section: _plain(section, keys)
        for section, keys in base.items()
    }
    for section, keys in data.items():
        merged[section] = {**merged.get(section, {}), **keys}
    return merged


def _with_torques(
    data: dict[str, dict[str, Any]], held: tuple[Row, ...], torques: ArrayLike | None
) -> RunConfig:
    """Return the scenario of ``data``, in open loop if there are torques."""
    if torques is None:
        return scenarios.from_dict(data, torques=held, user=True)
    try:
        rows = finite_array('torques', torques, (-1, 3), TORQUES)
    except ValueError as error:
        raise scenarios.ScenarioError(str(error)) from None
    data.setdefault('controller', {})['law'] = 'open_loop'
    return scenarios.from_dict(data, torques=rows.tolist(), user=True)
