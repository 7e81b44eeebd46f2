# Copyright 2026 The flexarm_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Design of the tip laws before the first tick: plans, gains and filters.

It is computed once, when a law is created, and its results determine the run.  The rule of the
loop applies: plain compiled loops, no BLAS or LAPACK, the same bits in every process.  Imports the
arm, the numerics, the parameters, the timeline and the trajectory.
"""
