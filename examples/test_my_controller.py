"""A controller node under test: `pytest examples/test_my_controller.py` (docs/testing.md)."""

import sys
from pathlib import Path

MY_CONTROLLER = [sys.executable, Path(__file__).parent / "minimal_controller.py"]


def test_it_holds_the_arm(flexarm_run):
    flight = flexarm_run(
        "pd_collocated",
        {"duration": 1.0, "plant.payload_mass": 0.5},
        nodes={"controller": MY_CONTROLLER},
    )
    assert flight.stable, flight.problem
    assert flight["ticks"] == 1000
    assert flight["max_torque"] < 700.0  # N m
    assert flight["max_deflection"] < 0.5  # m
    assert flight.verify().same  # our plant and sensors did what they should
