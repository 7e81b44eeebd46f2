"""Compile what a scenario needs, or load it from the cache, before time counts."""

from __future__ import annotations

from flexarm_ros.core.loop import ClosedLoop
from flexarm_ros.core.metrics import Metrics
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.core.rows import Rows


def warm_up(config: RunConfig) -> None:
    """Call every compiled function of the loop of ``config`` once, on a loop of its own.

    Raises ``ValueError`` as :class:`ClosedLoop` does for a bad ``config``.
    """
    loop, rows, metrics = ClosedLoop(config), Rows(config), Metrics(config)
    for _ in range(2):
        record = loop.tick()
        if record is not None:
            metrics.add(
                rows.row(
                    record.k, record.q, record.qd, record.deflections[:2], record.tip[1:3],
                    record.torque,
                )
            )  # fmt: skip
    loop.plant.step(0.0, 0.0)
    metrics.result()
