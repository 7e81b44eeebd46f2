#!/usr/bin/env bash
# The tests: those that start no nodes (TEST_JOBS at a time, 2), then the others (NODE_JOBS at a time,
# 3). Arguments go to both. Exit status as pytest's: 5 where neither part had a test.
#
# A test of nodes that fails is run once more, alone, and passes if it passes then; the last line names it.
# CONTRIBUTING.md says why.
set -u
cd "$(dirname "${BASH_SOURCE[0]}")/.."

failed=0 empty=0 again=yes node_jobs=${NODE_JOBS:-3}
case " $* " in
*' -x '* | *' --exitfirst '* | *' --maxfail'*) again= ;; # the rest of the tests was not run
esac
failures=$(mktemp -d)
trap 'rm -rf "$failures"' EXIT

part() {
    "${VENV:-.venv}/bin/python" -m pytest "$@"
    case $? in
    0) ;;
    2) exit 2 ;; # Ctrl-C, or a test file that cannot be read
    5) empty=$((empty + 1)) ;;
    *) return 1 ;;
    esac
}
nodes() { part -n "$node_jobs" --dist worksteal -m 'not slow and nodes' -o "cache_dir=$failures" "$@"; }
# Print the tests that have failed at their last try.
names() { sed -n 's/^ *"\(.*\)": true,*$/\1/p' "$failures/v/cache/lastfailed" 2>/dev/null | sort; }

part -n "${TEST_JOBS:-2}" --dist worksteal -m 'not slow and not nodes' "$@" || failed=1
if ! nodes "$@"; then
    first=$(names)
    if [ -z "$first" ] || [ -z "$again" ]; then
        failed=1
    else
        printf '\nonce more, the tests of nodes that failed:\n'
        node_jobs=0 # alone
        nodes --last-failed "$@" || failed=1
        late=$(comm -23 <(echo "$first") <(names) | tr '\n' ' ')
        [ -z "$late" ] || echo "passed only at the second try: $late"
    fi
fi
[ "$empty" -lt 2 ] || exit 5
exit "$failed"
