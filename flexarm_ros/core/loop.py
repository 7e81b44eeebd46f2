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

"""The closed loop in one process: the lock-step order of the nodes, without them."""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.changes import Agenda
from flexarm_ros.core.compiled import FloatArray
from flexarm_ros.core.control import make_law, Sample, torque_fault
from flexarm_ros.core.parameters import changed, RunConfig
from flexarm_ros.core.plant import instability, make_plant
from flexarm_ros.core.sensors import Encoder, further_sensors, Measurement, TipSensor
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.core.trajectory import Reference

Four = tuple[float, float, float, float]


class TickRecord(NamedTuple):
    """
    What the nodes publish in one tick.

    ``q``, ``qd`` ``(n,)`` are the plant's own arrays: valid until the next
    tick.  ``deflections``: delta1, delta2 (m) and their rates (m/s).
    ``encoder``: stamp_ns, angles, rates.  ``tip``: stamp_ns, x, y, vx, vy.
    ``reference``: x, y, vx, vy as commanded.  ``torque``: N m.  ``gain``:
    lambda, or nan.
    """

    k: int
    q: FloatArray
    qd: FloatArray
    deflections: Four
    encoder: Measurement
    tip: Measurement
    reference: Four
    torque: tuple[float, float]
    gain: float
    more: tuple[Measurement, ...] = ()
    """As ``tip``, of each of the sensors at ``tip_sensor.more_locations``."""


class ClosedLoop:
    """
    Plant, sensors, trajectory and controller of one scenario.

    Tick k: the plant's state at t_k; sensors and trajectory answer for it; the
    controller answers them; the torque is held until t_k+1.  The state after
    the last tick is not computed, since nothing records it.

    After the run ``unstable`` is ``None`` or names the quantity that ended it,
    and ``unstable_tick`` the tick whose state it was; that tick is not part of
    the run.  A torque that is not finite ends the run behind its tick, and
    ``unstable`` names law and tick.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.timeline = Timeline.of(config.run)
        self.plant = make_plant(config)
        self.encoder, self.tip_sensor = Encoder(config), TipSensor(config)
        self.more_sensors = further_sensors(config)
        self.reference, self.law = Reference(config), make_law(config)
        self._agenda = Agenda(config.changes)
        self.k = 0
        self.unstable: str | None = None
        self.unstable_tick: int | None = None
        self._torque: tuple[float, float] | None = None

    def tick(self) -> TickRecord | None:
        """Run the next tick; ``None`` when the run is over or the arm unstable."""
        plant, k = self.plant, self.k
        if k >= self.timeline.ticks or self.unstable is not None:
            return None
        if self._torque is not None:
            plant.step(*self._torque)
        self.unstable = instability(plant)
        if self.unstable is not None:
            self.unstable_tick = k
            return None
        if k >= self._agenda.next:
            self._retune(k)
        q, qd, ends = plant.q, plant.qd, plant.deflections()
        encoder = self.encoder.measure(k, q, qd)
        tip = self.tip_sensor.measure(k, q, qd)
        more = tuple([sensor.measure(k, q, qd) for sensor in self.more_sensors])
        reference = self.reference.command(k)
        sample = Sample(q.tolist(), qd.tolist(), ends[:2], encoder[1:], tip[1:], reference)
        torque = self.law.torque(k, sample)
        self._torque = torque
        self.k = k + 1
        fault = torque_fault(k, torque)
        if fault is not None:
            self.unstable = f'controller ({self.config.controller.law}): {fault}'
            self.unstable_tick = self.k
        return TickRecord(k, q, qd, ends, encoder, tip, reference, torque, self.law.gain, more)

    def _retune(self, k: int) -> None:
        """Set what changes at tick ``k``: see ``RunConfig.changes``."""
        for change in self._agenda.due(k):
            self.config = changed(self.config, change)
        for part in (self.encoder, self.tip_sensor, self.reference, self.law):
            part.retune(self.config)
        for sensor in self.more_sensors:
            sensor.retune(self.config)
