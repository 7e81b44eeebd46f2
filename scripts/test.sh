#!/usr/bin/env bash
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

# The tests: those that start no nodes side by side (TEST_JOBS, 2), then the others one at a time, so
# that the nodes of a run have the machine to themselves. Arguments go to both. Exit status as
# pytest's: 5 where neither part had a test.
set -u
cd "$(dirname "${BASH_SOURCE[0]}")/.."

failed=0 empty=0
part() {
    "${VENV:-.venv}/bin/python" -m pytest "$@"
    case $? in
    0) ;;
    2) exit 2 ;; # Ctrl-C, or a test file that cannot be read
    5) empty=$((empty + 1)) ;;
    *) failed=1 ;;
    esac
}

part -n "${TEST_JOBS:-2}" --dist loadfile -m 'not slow and not nodes' "$@"
part -m 'not slow and nodes' "$@"
[ "$empty" -lt 2 ] || exit 5
exit "$failed"
