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
Endpoints that the middleware never connects: incompatible QoS, or another type.

They are found in the graph rather than by rclpy's incompatible-QoS events, which name neither the
node nor a wrong type.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from flexarm_ros.nodes.runtime.topics.identity import node_of
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, qos_check_compatible, QoSCompatibility, QoSProfile

_POLICIES = {
    'effort': 'reliability',
    'volatile': 'durability',
    'deadline': 'deadline',
    'liveliness': 'liveliness',
}
"""Word in the text of `qos_check_compatible` -> the policy."""


def shown(profile: QoSProfile) -> QoSProfile:
    """
    Return the profile of an endpoint of this package as the graph shows it.

    It has no deadline and no lease: zero in the requested profile, infinite in the graph.
    """
    return QoSProfile(
        depth=profile.depth,
        reliability=profile.reliability,
        durability=profile.durability,
        deadline=Infinite,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Infinite,
    )


def connects(offered: QoSProfile, requested: QoSProfile) -> bool:
    """Whether a publisher reaches a subscription as far as QoS goes; profiles as `shown`."""
    # Compared by value: the middleware's enumeration is another object than rclpy's.
    return bool(qos_check_compatible(offered, requested)[0] != QoSCompatibility.ERROR)


def publisher_fault(node: Node, name: str, type_name: str, requested: QoSProfile) -> str:
    """
    Return why a publisher of the topic ``name`` cannot reach a subscription of ``node``.

    The text names topic, the publisher's node and the QoS policy or type.  Empty if every
    publisher in the graph can reach it.
    """
    found = node.get_publishers_info_by_topic(node.resolve_topic_name(name))
    wanted = shown(requested)
    faults = (_fault(name, type_name, e, e.qos_profile, wanted) for e in found)
    return next(filter(None, faults), '')


def subscriber_faults(
    node: Node, name: str, type_name: str, offered: QoSProfile
) -> Iterable[tuple[Any, str]]:
    """Yield each subscription of ``name`` that cannot receive from ``node``, and the reason."""
    offered = shown(offered)
    for e in node.get_subscriptions_info_by_topic(node.resolve_topic_name(name)):
        fault = _fault(name, type_name, e, offered, e.qos_profile)
        if fault:
            yield e, fault


def _fault(
    name: str, type_name: str, endpoint: Any, offered: QoSProfile, requested: QoSProfile
) -> str:
    if endpoint.topic_type != type_name:
        return f'{name}: {node_of(endpoint)} has type {endpoint.topic_type}, not {type_name}'
    if connects(offered, requested):
        return ''
    reason = qos_check_compatible(offered, requested)[1]
    reason = '; '.join(filter(None, reason.replace('ERROR: ', '').split(';')))
    reason = reason[:1].lower() + reason[1:]
    policies = [policy for word, policy in _POLICIES.items() if word in reason.lower()]
    return (
        f'{name}: incompatible QoS of {node_of(endpoint)}: {", ".join(policies) or "policy"}: '
        f'{reason}'
    )
