"""Speed of the package, measured: ``make bench`` writes docs/performance.md."""
