#!/usr/bin/env bash
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
