"""Every node, every fault, early, in the middle and late: how such a run ends."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest
from faulttools import OWN, SIGNALS, check_end, faulty_run
from nodetools import ROLES

pytestmark = pytest.mark.nodes

EARLY, MIDDLE, LATE = 3, 250, 495
CASES = list(product(ROLES, (*SIGNALS, *OWN), (EARLY, MIDDLE, LATE)))
QUICK = [
    ("plant", "kill", EARLY), ("plant", "raise", MIDDLE), ("encoder", "pause", EARLY),
    ("encoder", "exit", MIDDLE), ("tip_sensor", "raise", LATE), ("trajectory", "exit", EARLY),
    ("controller", "kill", MIDDLE), ("controller", "pause", LATE), ("recorder", "kill", LATE),
    ("recorder", "raise", EARLY),
]  # fmt: skip
"""Every node, every fault and every time at least once."""


@pytest.mark.parametrize(("role", "fault", "tick"), QUICK)
def test_a_fault_ends_the_run(
    role: str, fault: str, tick: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = faulty_run(monkeypatch, tmp_path / "run", role, fault, tick)
    check_end(done, role, fault, tick)


@pytest.mark.slow
@pytest.mark.parametrize(("role", "fault", "tick"), [c for c in CASES if c not in QUICK])
def test_every_other_fault_ends_the_run(
    role: str, fault: str, tick: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = faulty_run(monkeypatch, tmp_path / "run", role, fault, tick)
    check_end(done, role, fault, tick)


def test_the_quick_cases_cover_each_node_fault_and_time() -> None:
    assert len(CASES) == 72
    for place, values in enumerate((ROLES, (*SIGNALS, *OWN), (EARLY, MIDDLE, LATE))):
        assert {case[place] for case in QUICK} == set(values)
