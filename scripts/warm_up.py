"""Compile the hot loops into their caches, so that the first run starts at once.

The laws that plan a motion take nearly a minute to compile; they are left to the first run that
asks for one.
"""

from flexarm_ros import scenario
from flexarm_ros.core.control import PLANNING
from flexarm_ros.core.warmup import warm_up

for name in scenario.shipped():
    config = scenario.load(name, [])
    if config.controller.law not in PLANNING:
        warm_up(config)
