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

"""Keys of a run as a whole: section ``/**``, its pace, and the recorder."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class RunParameters:
    """Section ``/**``: parameters that all nodes of a run share."""

    control_period: float = _key(
        0.001, 'float', 's', 'control period, one tick', low=0.0, low_open=True,
        high=3600.0, whole_ns=True, paper='0.001',
    )  # fmt: skip
    duration: float = _key(
        16.0, 'float', 's', 'simulated time of the run, an integer number of ticks', low=0.0,
        low_open=True, high=1.0e7, whole_ns=True, paper='16.0',
    )  # fmt: skip
    sync: str = _key(
        'lockstep', 'str', '', 'lockstep: barrier at every tick; free: paced by the wall clock',
        choices=('lockstep', 'free'),
    )  # fmt: skip
    seed: int = _key(0, 'int', '', 'seed of every noise source', low=0, high=2**31 - 1)
    record: bool = _key(True, 'bool', '', 'true: wait for a recorder; false: run without one')
    start_timeout: float = _key(
        60.0, 'float', 's', 'timeout for participants to join, wall time', low=0.1, high=86400.0
    )
    tick_timeout: float = _key(
        5.0, 'float', 's', 'timeout for participants to answer a tick, wall time',
        low=0.01, high=86400.0,
    )  # fmt: skip
    on_invalid: str = _key(
        'error', 'str', '', 'error: an invalid message ends the run; ignore: it is counted',
        choices=('error', 'ignore'),
    )  # fmt: skip
    clock_rate: float | None = _key(
        None, 'float', 'Hz', 'rate of `/clock`, an integer number of ticks per message, the first '
        'at tick 0; 0 or not set: every tick', low=0.0, high=1e9,
    )  # fmt: skip


@dataclass(frozen=True)
class PaceParameters:
    """
    Pacing of a run's nodes: in section ``/**`` or ``plant``, and parameters of the plant.

    They do not affect the numbers of a run: a simulation ignores them, and no bag records them.
    """

    real_time_factor: float = _key(
        0.0, 'float', '', 'limit the run to this multiple of real time; 0: no limit',
        low=0.0, high=1e6, live=True,
    )  # fmt: skip
    step_ticks: int = _key(
        1, 'int', '', 'ticks of a paused run per call of the service `plant/step`', low=1,
        high=10**9, live=True,
    )  # fmt: skip
    start_paused: bool = _key(
        False, 'bool', '', 'true: the run waits before tick 0 for the service `plant/pause` '
        '(data: false) or `plant/step`',
    )  # fmt: skip
    realtime_priority: int = _key(
        10, 'int', '', 'with `sync: free`, SCHED_FIFO priority that the plant requests for '
        'its loop; other nodes except the recorder request half of it; 0: none', low=0, high=99,
    )  # fmt: skip
    realtime_cpu: int = _key(
        -1, 'int', '', 'with `sync: free`, number of the CPU that the plant binds its loop to; '
        '-1: any', low=-1, high=4095,
    )  # fmt: skip
    lock_memory: bool = _key(
        True, 'bool', '', "with `sync: free`, the plant's process requests that its memory is "
        'not paged out (mlockall)',
    )  # fmt: skip


@dataclass(frozen=True)
class RecorderParameters:
    """Section ``recorder``: the bag."""

    compression: str = _key(
        'zstd', 'str', '', "compression of the bag's chunks", choices=('none', 'lz4', 'zstd')
    )
    chunk_time: float = _key(
        0.2, 'float', 's', 'simulated time between flushed chunks', low=0.0, low_open=True,
        high=3600.0,
    )  # fmt: skip
