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
How many messages a second are recorded before one is lost, beside a bare MCAP writer.

``python -m bench.recording TOPICS KIND`` is the publisher: it reads a rate (messages a second, all
topics together) and a number of messages for each topic from standard input, publishes them, and
says on standard output how long that took.
"""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

from bench.launch import processes
from bench.table import markdown, Part, Ratio
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig, RunParameters
from flexarm_ros.wire.cdr import JointStateCodec
from flexarm_ros.wire.topics import Topic

COUNTS = (1, 10, 50)
JOINTS = {'small': 2, '10 KiB': 364}
"""Kind of message -> joints in it; a joint takes 28 bytes."""

SECONDS, FASTER, FIRST = 0.7, 1.7, 1000.0
PAUSE_NS = 20_000_000
MOST = 300_000.0


def topics(count: int, kind: str) -> list[Topic]:
    """Return ``count`` topics of one kind, with the depth of our per-tick topics."""
    codec = JointStateCodec([f'j{i:03}' for i in range(JOINTS[kind])], 'base')
    return [Topic(f'bench/t{i:02}', 'bench', codec) for i in range(count)]


def measure() -> Part:
    """Find the largest rate without loss for each number of topics and size of message."""
    rows, ratios = [], []
    for kind in JOINTS:
        for count in COUNTS:
            size = topics(count, kind)[0].codec.size
            ours, lost_at = until_loss(count, kind)
            alone, bare = write_alone(count, kind), write_bare(count, kind)
            rows.append((kind, f'{count}', f'{size}', f'{ours:.0f}', f'{lost_at}', f'{alone:.0f}',
                         f'{bare:.0f}'))  # fmt: skip
            if count == 10:
                ratios.append(
                    Ratio(
                        f'our writer / the bare `mcap` writer, 10 topics, {kind}',
                        f'{alone:.0f} /s', f'{bare:.0f} /s', alone / bare, None, True,
                        'messages a second of processor time, best of 3',
                    )
                )  # fmt: skip
    head = ('messages', 'topics', 'bytes', 'recorded without loss, /s', 'first loss at, /s',
            'our writer alone, /s', 'bare `mcap` writer, /s')  # fmt: skip
    return Part('recording', ratios, [markdown(head, rows)])


def _config() -> RunConfig:
    return RunConfig(run=RunParameters())


def until_loss(count: int, kind: str) -> tuple[float, str]:
    """Return the largest rate that was reached without loss, and the one that lost messages."""
    import rclpy

    reached, context = 0.0, rclpy.Context()
    command = [sys.executable, '-m', 'bench.recording', str(count), kind]
    with processes({'p': command}, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as (
        started,
        env,
    ):
        rclpy.init(context=context, domain_id=int(env['ROS_DOMAIN_ID']))
        try:
            recorder = _Recorder(context, count, kind)
            rate = FIRST
            while rate < MOST:
                each = max(1, round(rate * SECONDS / count))
                took, lost = recorder.record(started['p'], rate, each)
                made = each * count / took
                if lost:
                    return reached, f'{made:.0f}'
                reached = max(reached, made)
                if made < 0.8 * rate:  # the publisher can do no more
                    return reached, 'none: the publisher is at its end'
                rate *= FASTER
        finally:
            rclpy.shutdown(context=context)
    return reached, f'none up to {MOST:.0f}'


class _Recorder:
    """Takes messages in batches as the node ``recorder`` does, and writes them."""

    def __init__(self, context: Any, count: int, kind: str) -> None:
        from flexarm_ros.nodes.runtime.topics.endpoints import HOT, Waiter
        from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile
        from rclpy.node import Node

        self._topics = topics(count, kind)
        self._node = Node('bench_recorder', context=context)
        self._type = message_class(self._topics[0].type_name)
        self._subscriptions = [
            self._node.create_subscription(
                self._type, t.name, lambda _: None, qos_profile(t.qos), callback_group=HOT,
                raw=True,
            )
            for t in self._topics
        ]  # fmt: skip
        self._waiter = Waiter(context)

    def record(self, publisher: Any, rate: float, each: int) -> tuple[float, int]:
        """Have ``each`` messages a topic published at ``rate``; return the time and the lost."""
        handles = [s.handle for s in self._subscriptions]
        deadline = time.monotonic() + 60.0
        while min(h.get_publisher_count() for h in handles) < 1 and time.monotonic() < deadline:
            time.sleep(0.02)
        with (
            tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder,
            BagWriter(Path(folder) / 'bag', _config(), topics=self._topics) as writer,
        ):
            publisher.stdin.write(f'{rate} {each}\n')
            publisher.stdin.flush()
            got, last_news = [0] * len(handles), time.monotonic()
            while min(got) < each and time.monotonic() - last_news < 2.0:
                for number, handle in enumerate(handles):
                    while (taken := handle.take_message(self._type, True)) is not None:
                        writer.write(number, got[number], taken[0])
                        got[number] += 1
                        last_news = time.monotonic()
                self._waiter.wait([], PAUSE_NS)
        return float(publisher.stdout.readline()), each * len(handles) - sum(got)


def _messages(count: int, kind: str) -> tuple[list[Topic], bytes, int]:
    chosen = topics(count, kind)
    data = chosen[0].codec.encode(1, *(0.5 + i for i in range(len(chosen[0].codec.fields))))
    return chosen, data, max(1, (200_000 if kind == 'small' else 20_000) // count)


def write_alone(count: int, kind: str) -> float:
    """Return messages a second of our writer, nothing else being done."""
    chosen, data, each = _messages(count, kind)
    rates = []
    for _ in range(3):
        with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
            start = time.process_time()
            with BagWriter(Path(folder) / 'bag', _config(), topics=chosen) as writer:
                for tick in range(each):
                    for number in range(count):
                        writer.write(number, tick, data)
            rates.append(each * count / (time.process_time() - start))
    return max(rates)


def write_bare(count: int, kind: str) -> float:
    """Return messages a second of the ``mcap`` library's writer: the same bytes, zstd, chunks."""
    from mcap.writer import CompressionType, Writer

    chosen, data, each = _messages(count, kind)
    rates = []
    for _ in range(3):
        with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
            start = time.process_time()
            with open(Path(folder) / 'bare.mcap', 'wb') as file:
                writer = Writer(file, compression=CompressionType.ZSTD)
                writer.start(profile='ros2')
                schema = writer.register_schema(chosen[0].type_name, 'ros2msg', b'')
                channels = [writer.register_channel(t.path, 'cdr', schema) for t in chosen]
                for tick in range(each):
                    stamp = 1_000_000_000 + tick * 1_000_000
                    for channel in channels:
                        writer.add_message(channel, stamp, data, stamp, tick)
                writer.finish()
            rates.append(each * count / (time.process_time() - start))
    return max(rates)


def publish(count: int, kind: str) -> int:
    """Publish at the rates that come on standard input."""
    from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile
    import rclpy
    from rclpy.impl.implementation_singleton import rclpy_implementation

    rclpy.init(args=[])
    node = rclpy.create_node('bench_publisher')
    chosen, data, _ = _messages(count, kind)
    publishers = [
        node.create_publisher(message_class(t.type_name), t.name, qos_profile(t.qos))
        for t in chosen
    ]
    while min(p.get_subscription_count() for p in publishers) < 1:
        time.sleep(0.02)
    for line in sys.stdin:
        rate, each = float(line.split()[0]), int(line.split()[1])
        start = time.perf_counter()
        for round_ in range(each):
            due = start + round_ * count / rate
            if (early := due - time.perf_counter()) > 0.0:
                time.sleep(early)
            try:
                for publisher in publishers:
                    publisher.publish(data)
            except rclpy_implementation.RCLError:
                break  # the middleware takes no more: the rest counts as lost
        print(time.perf_counter() - start, flush=True)
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(publish(int(sys.argv[1]), sys.argv[2]))
