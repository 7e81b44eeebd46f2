"""Compile the hot loops into their caches, so that the first run starts at once."""

from flexarm_ros import scenario
from flexarm_ros.core.warmup import warm_up

for name in scenario.shipped():
    warm_up(scenario.load(name, []))
