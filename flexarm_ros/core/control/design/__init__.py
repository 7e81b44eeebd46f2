"""What the tip laws are computed from before the first tick: plans, gains and filters.

Everything here runs once, when a law is made, and its results steer the run.
So it keeps to the loop's rule: plain compiled loops, no BLAS or LAPACK, the
same bits in every process.
"""
