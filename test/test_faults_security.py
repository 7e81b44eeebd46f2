"""DDS-Security: the wheels' Fast DDS has none, and says so before a node is there."""

from __future__ import annotations

from pathlib import Path

import pytest
from nodetools import finish, start_node, write_scenario

pytestmark = pytest.mark.nodes


def test_security_that_cannot_be_had_is_refused_in_one_line(
    tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "keys" / "enclaves").mkdir(parents=True)
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path / "keys"))
    file = write_scenario(tmp_path / "s.yaml", "pd_tip")
    node = start_node("controller", file)
    (text,) = finish([node])
    assert node.returncode in (1, 2)
    assert "Traceback" not in text
    # Where Fast DDS has it, the empty keystore is what is wrong.
    assert "security" in text.lower(), text
