"""Consecutive ticks of a run as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexarm_ros.bag.cdr import FloatArray, IntArray
from flexarm_ros.bag.topics import Topic


@dataclass(frozen=True)
class Block:
    """Whole ticks ``first``, ``first + 1``, ... of a run.

    Of each topic, in canonical order: ``stamps``, shape ``(n,)``, ns, and
    ``values``, shape ``(n, fields)``, columns as in ``topic.codec.fields``.
    """

    first: int
    stamps: tuple[IntArray, ...]
    values: tuple[FloatArray, ...]

    def __len__(self) -> int:
        return len(self.stamps[0])


def decode_ticks(topics: Sequence[Topic], first: int, ticks: Sequence[Sequence[bytes]]) -> Block:
    """Decode whole ticks, each with the messages of ``topics`` in order.

    Raises ValueError where a message cannot be decoded.
    """
    columns = [
        topic.codec.decode_block([tick[i] for tick in ticks]) for i, topic in enumerate(topics)
    ]
    return Block(first, tuple(c[0] for c in columns), tuple(c[1] for c in columns))
