"""A controller node under test: `pytest examples/test_my_controller.py` (docs/testing.md)."""

import sys
from pathlib import Path

MY_CONTROLLER = [sys.executable, Path(__file__).parent / "minimal_controller.py"]


def test_it_brings_the_arm_to_its_goal(flexarm_run):
    flight = flexarm_run(
        "pd_collocated",
        {"duration": 1.0, "plant.payload_mass": 0.5, "plant.initial_position": [-2.4, 0.2]},
        nodes={"controller": MY_CONTROLLER},
    )
    assert flight.stable, flight.problem
    assert flight["max_torque"] < 250.0  # N m
    assert flight["max_deflection"] < 0.2  # m
    assert abs(flight.trajectory["theta1"][-1] - -2.496) < 0.02  # rad
    assert flight.verify().same  # our plant and sensors did what they should
