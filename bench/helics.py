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
The same lock-step of six processes in HELICS, a co-simulation framework, beside ours.

Six federates in Python, one process each, over the ``ipc`` core: no physics, no checks, nothing
recorded.  A tick has three phases, as time offsets: the plant publishes its state, sensors and
trajectory answer, the controller answers them; the recorder reads all of it.  ``helics`` is not a
requirement of this package: ``pip install helics``; without it this part says so.

``python -m bench.helics ROLE TICKS NAME`` is one federate of the federation ``NAME``.
"""

from __future__ import annotations

from importlib.util import find_spec
import os
from statistics import median
import subprocess
import sys
import time

from bench.launch import nodes
from bench.table import markdown, Part, Ratio
from flexarm_ros import scenario
from flexarm_ros.core.run.parts import roles
from flexarm_ros.nodes.runtime.topics.graph import readers
from flexarm_ros.wire.topics import per_tick_topics

TICKS = 4000
ROUNDS = 5
GOAL = 2.5
LIMIT_S = 120.0
PERIOD = 0.001

CONFIG = scenario.load('fls_tip')
TOPICS = per_tick_topics(CONFIG)
INPUTS = {
    role: tuple(dict.fromkeys(t.node for t in TOPICS if role in readers(t.name, CONFIG)))
    for role in roles(CONFIG)
}
"""Federate -> those whose values it reads at each tick."""

PHASE = {'plant': 0, 'controller': 2, 'recorder': 3}
"""Quarter of the tick in which a federate has its turn; the others in 1."""

WIDTH = {'plant': 12, 'controller': 2}
"""Number of float64 that a federate publishes; the others 4, the recorder none."""


def federate(role: str, ticks: int, name: str) -> None:
    """Be one federate; the plant prints its wall time, s, from the first tick to the last."""
    import helics as h

    info = h.helicsCreateFederateInfo()
    h.helicsFederateInfoSetCoreTypeFromString(info, 'ipc')
    h.helicsFederateInfoSetCoreInitString(info, f'--federates=1 --broker_address={name}')
    quarter = PERIOD / 4
    h.helicsFederateInfoSetTimeProperty(info, h.helics_property_time_delta, quarter)
    me = h.helicsCreateValueFederate(role, info)
    output = None
    if role != 'recorder':
        output = h.helicsFederateRegisterGlobalPublication(me, role, h.helics_data_type_vector, '')
    inputs = [h.helicsFederateRegisterSubscription(me, source, '') for source in INPUTS[role]]
    values = [0.5] * WIDTH.get(role, 4)
    h.helicsFederateEnterExecutingMode(me)
    start = time.monotonic()
    for tick in range(ticks):
        h.helicsFederateRequestTime(me, (4 * tick + PHASE.get(role, 1) + 1) * quarter)
        for source in inputs:
            h.helicsInputGetVector(source)
        if output is not None:
            h.helicsPublicationPublishVector(output, values)
    took = time.monotonic() - start
    h.helicsFederateDisconnect(me)
    if role == 'plant':
        print(took, flush=True)
    h.helicsFederateFree(me)
    h.helicsCloseLibrary()


def federation(ticks: int) -> float:
    """Run a broker and the six federates; return the wall time of a tick, us."""
    name = f'bench{os.getpid()}'
    program = f"""
import time, helics as h
broker = h.helicsCreateBroker('ipc', {name!r}, '-f {len(INPUTS)} --local_interface={name}')
print('ready', flush=True)
while h.helicsBrokerIsConnected(broker): time.sleep(0.05)
"""
    started = [
        subprocess.Popen(
            [sys.executable, '-c', program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            text=True,
        )
    ]  # fmt: skip
    try:
        started[0].stdout.readline()
        for role in reversed(INPUTS):
            started.append(
                subprocess.Popen(
                    [sys.executable, '-m', 'bench.helics', role, str(ticks), name],
                    stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                )
            )  # fmt: skip
        told, _ = started[-1].communicate(timeout=LIMIT_S)  # the plant is the last
        return float(told.split()[-1]) / ticks * 1e6
    finally:
        for process in started:
            process.kill()
            process.communicate()


def measure() -> Part:
    """Run both in turns."""
    if find_spec('helics') is None:
        return Part('helics', [], ['Not measured: `helics` is not installed.'])
    theirs, ours = [], []
    for _ in range(ROUNDS):
        theirs.append(federation(TICKS))
        ours.append(nodes(TICKS).wall_us)
    ratio = median(a / b for a, b in zip(theirs, ours, strict=True))
    how = f'median of {ROUNDS} pairs, {TICKS} ticks each; theirs without physics and recorder'
    ratios = [
        Ratio(
            'real-time factor of six processes, ours / HELICS',
            f'{1e6 * PERIOD / median(ours):.2f}', f'{1e6 * PERIOD / median(theirs):.2f}', ratio,
            GOAL, True, how,
        )
    ]  # fmt: skip
    rows = [
        (name, f'{median(each):.0f}', f'{min(each):.0f}')
        for name, each in (('ours, recorder on', ours), ('HELICS, `ipc`', theirs))
    ]
    return Part('helics', ratios, [markdown(('six processes', 'us a tick, median', 'best'), rows)])


if __name__ == '__main__':
    federate(sys.argv[1], int(sys.argv[2]), sys.argv[3])
