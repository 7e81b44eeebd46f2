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
Node ``viewer``: shows a running simulation on a page of its own, in Foxglove, Lichtblick and RViz.

It is not a participant: the run does not wait for it.  It subscribes with best effort and a queue
of one, takes the newest messages ``rate`` times per second of wall time, and sleeps in between.
It gets the arm from ``lockstep/status``, or from ``--params-file`` (a replay has no
participants).
"""

from __future__ import annotations

import importlib.util
import math
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from flexarm_ros import scenario
from flexarm_ros.core.ending import handle_ending
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import recorded_roles
from flexarm_ros.nodes.runtime.joining import status
from flexarm_ros.nodes.runtime.joining.config_exchange import Disagreement, published_config
from flexarm_ros.nodes.runtime.parameters.declared import declare_own, given_parameters
from flexarm_ros.nodes.runtime.parameters.own import OWN
from flexarm_ros.nodes.runtime.process.middleware import start
from flexarm_ros.nodes.runtime.process.shutdown_watchdog import shutdown_limit
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES
from flexarm_ros.nodes.runtime.topics.graph import message_class
from flexarm_ros.nodes.view.commands import RunCommands
from flexarm_ros.nodes.view.foxglove import FoxgloveView, ViewError
from flexarm_ros.nodes.view.page import PageError, PageServer
from flexarm_ros.nodes.view.page_data import described, sent
from flexarm_ros.nodes.view.ros import RosView
from flexarm_ros.nodes.view.scene import Scene
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.topics import TIP
from rcl_interfaces.msg import ParameterEvent
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

_SETTLING_S = 1.0
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# All tip measurements between two frames, so that lost ones can be counted.
_ALL = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
_LATCHED = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


class ViewerNode(Node):
    """Subscribes to a run and shows it; `step` handles one frame."""

    def __init__(self, argv: list[str]) -> None:
        super().__init__('viewer')
        declare_own(self, 'viewer', OWN['viewer'], argv)
        self.stopping = threading.Event()
        self._told: dict[str, status.Status] = {}
        self._status = self.create_subscription(
            DiagnosticStatus, status.TOPIC, lambda _: None, _LATCHED, callback_group=HOT,
            qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self._changes = self.create_subscription(
            ParameterEvent, changes.TOPIC, lambda _: None, _LATCHED, callback_group=HOT, raw=True,
            qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self._given = given_parameters(self, 'viewer', argv).config()
        self.foxglove = self._foxglove()
        self._commands, self.page = self._page()
        self._ros = RosView(self)
        self._readers: dict[int, Any] = {}
        self._listen(self._given)
        self._shown_ns = -1
        self._described: RunConfig | None = None
        self._complete, self._since = False, math.inf

    def _foxglove(self) -> FoxgloveView | None:
        port = int(self.get_parameter('foxglove_port').value)
        if port < 0:
            return None
        if importlib.util.find_spec('foxglove') is None:
            print("no server for Foxglove: pip install 'flexarm_ros[view]'", flush=True)
            return None
        return FoxgloveView(str(self.get_parameter('host').value), port)

    def _page(self) -> tuple[RunCommands | None, PageServer | None]:
        port = int(self.get_parameter('port').value)
        if port < 0:
            return None, None
        commands = RunCommands(self._node_of)
        try:
            return commands, PageServer(str(self.get_parameter('host').value), port, commands)
        except PageError:
            commands.close()
            raise

    def _node_of(self, role: str) -> str:
        """Return the full name of the node that holds a role in the run, empty if none does."""
        told = self._told.get(role)
        return told.node if told is not None else ''

    def _listen(self, config: RunConfig) -> None:
        """Show the arm of ``config`` from now on."""
        self.scene = Scene(config, int(self.get_parameter('trail').value))
        self._ros.describe(config)
        for index, topic in self.scene.topics.items():
            if index not in self._readers:
                self._readers[index] = self.create_subscription(
                    message_class(topic.type_name), topic.name, lambda _: None,
                    _ALL if index == TIP else _NEWEST,
                    callback_group=HOT, raw=True, qos_overriding_options=NO_OVERRIDES,
                )  # fmt: skip

    def step(self) -> bool:
        """Process new messages and show them; True if there was anything to show."""
        self._hear()
        for index, subscription in self._readers.items():
            while taken := subscription.handle.take_message(subscription.msg_type, True):
                self.scene.take(index, taken[0])
        while taken := self._changes.handle.take_message(ParameterEvent, True):
            self.scene.change(bytes(taken[0]))
        frame = self.scene.frame()
        if frame is not None and not self._settled():
            frame = None
        if self.page is not None and 'plant' in self._told:
            if self.scene.config is not self._described:
                self._described = self.scene.config
                self.page.feed.put('hello', described(self._described))
            self.page.feed.put('state', self._phase())
        if frame is None or frame.stamp_ns == self._shown_ns:
            return False
        self._shown_ns = frame.stamp_ns
        self._ros.show(frame, self.scene)
        if self.foxglove is not None:
            self.foxglove.show(frame, self.scene)
        if self.page is not None:
            self.page.feed.put('frame', sent(frame, self.scene, self._phase()))
        return True

    def _settled(self) -> bool:
        """
        Whether the arm is that of the run: it is known once every node has sent its status.

        An external node sends none: one second after the first state the others suffice.
        """
        if self._complete:
            return True
        now = time.monotonic()
        self._since = min(self._since, now)
        self._complete = (
            now - self._since > _SETTLING_S
            or not self.count_publishers(status.TOPIC)
            or set(recorded_roles(RunConfig())) <= set(self._told)
        )
        return self._complete

    def _phase(self) -> str:
        plant = self._told.get('plant')
        return plant.phase.value if plant is not None else ''

    def _hear(self) -> None:
        """Process the participants' statuses; a new run has its own arm."""
        news = False
        while (taken := self._status.handle.take_message(DiagnosticStatus, False)) is not None:
            heard = status.Status.from_message(taken[0])
            if heard is None or heard.phase is status.Phase.REFUSED:
                continue
            before = self._told.get(heard.role)
            if before is None or heard.identity >= before.identity:
                if heard.role == 'plant' and before is not None:
                    self._forget(before, heard)
                self._told[heard.role] = heard
                news = news or before is None or heard.parameters != before.parameters
                news = news or heard.identity > before.identity
        if not news or 'plant' not in self._told:
            return
        texts = {role: (s.node, s.parameters) for role, s in self._told.items() if s.parameters}
        try:
            config = published_config(self._given, texts)
        except Disagreement as error:
            self.get_logger().debug(f'no scenario yet: {error}')
            return
        if config != self.scene.config:
            self._listen(config)

    def _forget(self, before: status.Status, plant: status.Status) -> None:
        """Forget the run of the plant ``before`` if ``plant`` is another one."""
        if plant.identity == before.identity:
            return
        self._complete, self._since = False, math.inf
        self._told = {
            role: told
            for role, told in self._told.items()
            if status.plant_of(told) != before.identity
        }
        self._listen(self.scene.config)  # without the state and the trail of that run

    def run(self) -> None:
        """Show frames until ``stopping`` is set."""
        period = 1.0 / float(self.get_parameter('rate').value)
        while not self.stopping.wait(period) and self.context.ok():
            self.step()

    def close(self) -> None:
        """Stop the servers."""
        if self.foxglove is not None:
            self.foxglove.close()
        if self.page is not None and self._commands is not None:
            self.page.close()
            self._commands.close()


def view(argv: list[str]) -> int:
    """Run the viewer until a signal; return 130, 143 or 129, or 2 if it cannot run."""
    try:
        start('viewer', argv)
    except ValueError as error:
        print(f'viewer: {error}', file=sys.stderr)
        return 2
    caught = 0
    try:
        node = ViewerNode(argv)

        def stop(number: int, _: Any) -> None:
            nonlocal caught
            caught = 128 + number
            node.stopping.set()

        handle_ending(stop)
        if node.page is not None:
            print(f'page: {node.page.address}', flush=True)
        if node.foxglove is not None:
            host = node.get_parameter('host').value
            print(f'open ws://{host}:{node.foxglove.port} in Foxglove or Lichtblick', flush=True)
        try:
            node.run()
        finally:
            with shutdown_limit():
                node.close()
                node.destroy_node()
    except (ViewError, PageError, scenario.ScenarioError) as error:
        print(f'viewer: {error}', file=sys.stderr)
        return 2
    finally:
        with shutdown_limit():
            rclpy.try_shutdown()
    return caught
