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

"""The live view: what a browser and RViz are sent, and that no run waits for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import csv
import json
import os
from pathlib import Path
import signal
import struct
import subprocess
import sys
import threading
import xml.etree.ElementTree as ET

from flexarm_ros import scenario
from flexarm_ros.core.arm.arm_line import ArmLine
from flexarm_ros.core.arm.kinematics import rigid_point
from flexarm_ros.nodes.view.urdf import transforms, urdf
from nodetools import Asker, flexarm, flexarm_here, wait_for
import numpy as np
import pytest
from repository import ROOT


@pytest.fixture
def viewer(ros_domain: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start `flexarm view` and yield its process and the address it serves."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'view', '--port', '0', '--foxglove-port', '0'],
        stdout=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, '')
        address = next(line.split()[1] for line in lines if line.startswith('open ws://'))
        yield process, address
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)


class Browser:
    """A client of the server, as Foxglove and Lichtblick are."""

    def __init__(self, socket) -> None:
        self._socket = socket
        self.topics: dict[int, str] = {}
        while len(self.topics) < 3:
            message = json.loads(self._socket.recv(timeout=60))
            if message['op'] == 'advertise':
                self.topics |= {c['id']: c['topic'] for c in message['channels']}
        wanted = [{'id': number, 'channelId': number} for number in self.topics]
        self._socket.send(json.dumps({'op': 'subscribe', 'subscriptions': wanted}))
        self.frames: dict[str, list[tuple[int, bytes]]] = {t: [] for t in self.topics.values()}

    def listen(self, seconds: float = 0.2) -> None:
        """Take what has come."""
        try:
            data = self._socket.recv(timeout=seconds)
        except TimeoutError:
            return
        if isinstance(data, bytes) and data[0] == 1:
            number, stamp = struct.unpack_from('<IQ', data, 1)
            self.frames[self.topics[number]].append((stamp, data[13:]))


@contextmanager
def browser_at(address: str) -> Iterator[Browser]:
    from websockets.sync.client import connect

    with connect(address, subprotocols=['foxglove.sdk.v1'], max_size=None) as socket:
        yield Browser(socket)


def rows_of(run: Path) -> dict[int, dict[str, float]]:
    """Return the rows of ``trajectory.csv`` by their stamp, ns."""
    with open(run / 'trajectory.csv', newline='') as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    return {10**9 + k * 10**6: row for k, row in enumerate(rows)}


@pytest.mark.nodes
def test_browser_and_rviz_see_the_arm_bend(
    tmp_path: Path, ros_domain: int, rclpy_node, viewer
) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is an optional extra')
    from visualization_msgs.msg import Marker, MarkerArray

    node, executor = rclpy_node
    seen: list[list[Marker]] = []
    node.create_subscription(MarkerArray, '/viewer/markers', lambda m: seen.append(m.markers), 100)
    done: list = []
    words = ('run', 'fls_mid', '--set', 'duration=0.4', '--set', 'plant.modes=2', '--rtf', '0.02',
             '--domain', ros_domain, '--no-pictures', '--out', tmp_path / 'run')  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    with browser_at(viewer[1]) as browser:
        run.start()
        try:

            def enough() -> bool:
                executor.spin_once(timeout_sec=0.05)
                browser.listen()
                return len(seen) > 5 and len(browser.frames['/arm']) > 5

            wait_for(enough, 90, 'frames in the browser and in RViz')
            assert Asker(node, executor).assign('plant', 'real_time_factor', 0.0).successful
        finally:
            run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    rows = rows_of(tmp_path / 'run')
    assert all(browser.frames[topic] for topic in ('/arm/scene', '/arm/frames', '/arm'))
    for stamp, data in browser.frames['/arm']:
        shown, row = json.loads(data), rows[stamp]
        for key in ('theta1', 'delta1', 'delta2', 'tip_x', 'tip_y', 'lambda'):
            assert shown[key] == row[key]
    for markers in seen:
        named = {m.ns: m for m in markers}
        stamp = named['link2'].header.stamp
        row = rows[stamp.sec * 10**9 + stamp.nanosec]
        end, elbow = named['link2'].points[-1], named['link2'].points[0]
        assert (end.x, end.y) == (row['tip_x'], row['tip_y'])
        assert (elbow.x, elbow.y) == (row['elbow_x'], row['elbow_y'])
        assert named['link1'].points[-1] == elbow
        assert named['link1'].header.frame_id == 'base'


@pytest.mark.nodes
def test_a_run_does_not_wait_for_a_viewer_that_stands_still(
    tmp_path: Path, ros_domain: int, rclpy_node, viewer
) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is an optional extra')
    process, _ = viewer
    os.kill(process.pid, signal.SIGSTOP)
    done = flexarm_here('run', 'pd_tip', '--set', 'duration=1.2', '--domain', ros_domain,
                        '--no-pictures', '--out', tmp_path / 'run')  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(rows_of(tmp_path / 'run')) == 1200


@pytest.mark.nodes
def test_a_taken_port_is_named(ros_domain: int, viewer) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is an optional extra')
    port = viewer[1].rpartition(':')[2]
    done = flexarm('view', '--port', '0', '--foxglove-port', port)
    assert done.returncode == 2
    assert f'port {port}' in done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.nodes
def test_bad_options_of_the_view() -> None:
    for words, said in (
        (('--rate', '0'), 'rate'),
        (('no_such_scenario',), 'no_such_scenario'),
    ):
        done = flexarm('view', '--no-server', *words)
        assert done.returncode == 2, done.stderr
        assert said in done.stderr
        assert len(done.stderr.splitlines()) <= 2


@pytest.mark.parametrize('model', ['eq14', 'full'])
def test_line_of_the_arm_ends_at_elbow_and_tip(model: str) -> None:
    from flexarm_ros.core.run.make_plant import make_plant

    config = scenario.load('pd_tip', [f'plant.model={model}', 'plant.modes=2'])
    plant = make_plant(config)
    q, qd = plant.q.copy(), plant.qd.copy()
    straight = ArmLine(config.plant).at(q, qd)
    x, y, _, _ = rigid_point(*config.plant.length, q[0], q[1], 0.0, 0.0)
    assert straight[-1] == pytest.approx((x, y), abs=1e-12)
    assert len(straight) == 25
    steps = np.diff(np.array(straight), axis=0)
    assert np.hypot(*steps.T) == pytest.approx(4.5 / 12, abs=1e-12)
    q[2] = 0.3
    bent = ArmLine(config.plant).at(q, qd)
    assert bent[0] == (0.0, 0.0)
    assert np.hypot(*np.subtract(bent[6], straight[6])) > 1e-3  # bent along its length


def test_skeleton_and_urdf_agree_with_the_rigid_arm() -> None:
    config = scenario.load(
        'pd_tip', ['plant.length=[4.5, 3.0]', 'tip_sensor.location=7.5', 'trajectory.side=8.0']
    )
    x = y = angle = 0.0
    for step in transforms(config, 0.3, 0.7):
        x, y = x + step.x * np.cos(angle), y + step.x * np.sin(angle)
        angle += step.angle
    assert (x, y) == pytest.approx(rigid_point(4.5, 3.0, 0.3, 0.7, 0.0, 0.0)[:2], abs=1e-12)
    robot = ET.fromstring(urdf(config))
    assert {link.get('name') for link in robot.iter('link')} >= {'base', 'link1', 'link2', 'tool'}
    joints = {joint.get('name'): joint for joint in robot.iter('joint')}
    assert {'shoulder', 'elbow'} <= set(joints)  # the names of joint_states
    origin = joints['elbow'].find('origin')
    assert origin is not None
    assert origin.get('xyz') == '4.5 0 0'


def test_layout_shows_what_is_sent() -> None:
    from flexarm_ros.nodes.view.foxglove import _schema, FRAMES, layout, NUMBERS, SCENE
    import yaml

    names = set(_schema()['properties'])
    document = json.loads(layout().read_text())
    shown = [panel.get('paths', []) for panel in document['configById'].values()]
    paths = [path['value'] for panel in shown for path in panel]
    assert {path.partition('.')[2] for path in paths} <= names
    assert {path.partition('.')[0] for path in paths} == {NUMBERS}
    assert set(document['configById']['3D!arm']['topics']) == {SCENE, FRAMES}

    def panels(tree: object) -> Iterator[str]:
        if isinstance(tree, str):
            yield tree
        else:
            assert isinstance(tree, dict)
            yield from panels(tree['first'])
            yield from panels(tree['second'])

    assert set(panels(document['layout'])) == set(document['configById'])
    rviz = yaml.safe_load(layout().with_name('flexarm.rviz').read_text())
    shown = rviz['Visualization Manager']['Displays']
    topics = [d['Topic']['Value'] for d in shown if 'Topic' in d]
    assert topics == ['/viewer/markers']


@pytest.mark.nodes
def test_a_second_run_is_shown_once_its_nodes_were_heard(ros_domain: int) -> None:
    """Not with the first run's participants: the arm may be another one."""
    from diagnostic_msgs.msg import DiagnosticStatus
    from flexarm_ros.core.parameters.sections import RunConfig
    from flexarm_ros.core.run.parts import recorded_roles
    from flexarm_ros.nodes.runtime.joining.config_exchange import dump_sections
    from flexarm_ros.nodes.runtime.joining.status import Phase, PLANT, Status, TOPIC
    from flexarm_ros.nodes.view.viewer import ViewerNode
    from flexarm_ros.wire.topics import per_tick_topics, STATE
    import rclpy
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState

    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    config = RunConfig()
    state = per_tick_topics(config)[STATE]
    rclpy.init()
    own = ('port:=-1', 'foxglove_port:=-1')
    viewer = ViewerNode(['viewer', '--ros-args', *(word for o in own for word in ('-p', o))])
    run = rclpy.create_node('run')
    statuses = run.create_publisher(DiagnosticStatus, TOPIC, latched)
    states = run.create_publisher(JointState, state.name, latched)

    def tell(role: str, number: int) -> None:
        told = Status(role, f'{role}{number}', f'/{role}', Phase.RUNNING, extra={
            PLANT: f'plant{number}'}, parameters=dump_sections(config, role))  # fmt: skip
        statuses.publish(told.to_message())

    def move(tick: int) -> None:
        values = [0.1] * len(state.codec.fields)
        states.publish(state.codec.encode(1_000_000_000 + tick * 1_000_000, *values))

    try:
        for role in recorded_roles(config):
            tell(role, 1)
        move(5)
        wait_for(viewer.step, 30, 'a frame of the first run')
        tell('plant', 2)

        def heard() -> bool:
            viewer.step()
            return viewer._told['plant'].identity == 'plant2'

        wait_for(heard, 30, 'the second plant')
        assert set(viewer._told) == {'plant'}
        move(3)
        shown: list[bool] = []

        def arrived() -> bool:
            shown.append(viewer.step())
            return viewer.scene.frame() is not None

        wait_for(arrived, 30, 'a state of the second run')
        assert shown[-1] is False
        for role in recorded_roles(config):
            tell(role, 2)

        def goes_on() -> bool:
            move(4)
            return viewer.step()

        wait_for(goes_on, 30, 'a frame of the second run')
        assert set(viewer._told) == set(recorded_roles(config))
    finally:
        viewer.close()
        viewer.destroy_node()
        run.destroy_node()
        rclpy.shutdown()
