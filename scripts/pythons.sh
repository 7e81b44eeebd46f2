#!/usr/bin/env bash
# A run of 1 s with nodes on every Python of 3.10 to 3.13 that is found, on PATH or among pyenv's, and
# on the wheels of every ROS 2 distribution: the environment from constraints/, `flexarm run`, `flexarm
# verify`, and on Jazzy the tests marked `essential`. Before that: constraints/ is what scripts/lock.sh
# writes. After it: the bytes of all runs are the same.
#
# Two stages run at a time, each with a line at its end. One that cannot run says why; of one that fails
# the output is shown, and the exit status is 1. The environments are kept, in .venvs.
#
# With PYTHON DISTRIBUTION: that stage alone, for this script itself, with the directory $work.
set -u
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# The longest first.
stages='3.12 jazzy
3.10 kilted
3.11 kilted
3.12 kilted
3.13 kilted'
export UV=$PWD/${VENV:-.venv}/bin/uv ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
exec 3>&1
failed=0

# Print the interpreter of that version; pyenv's python3.10 looks into PYENV_VERSION.
interpreter() {
    PYENV_VERSION=$1 "python$1" -c 'import sys; print(sys._base_executable)' 2>/dev/null
}

# Print why no wheels can be tried here, if so.
obstacle() {
    if [ -n "${ROS_DISTRO:-}" ]; then
        echo "ROS 2 $ROS_DISTRO is sourced"
    elif [ "$(uname -s)-$(uname -m)" != Linux-x86_64 ]; then
        echo "no wheels for $(uname -sm)"
    fi
}

# The parts of a stage, each with PYTHON and DISTRIBUTION; the environment has only what they need.
environment() { PYTHON=$(interpreter "$1") VENV=$venv WHEELS=$2 EXTRAS=ros,test scripts/env.sh; }
run() { "$venv/bin/flexarm" run fls_tip --set duration=1 --no-pictures --out "$out"; }
verify() { "$venv/bin/flexarm" verify "$out"; }
digest() { "$venv/bin/flexarm" digest "$out" >"$out.digest"; }
tests() {
    [ "$2" = jazzy ] || return 0
    "$venv/bin/python" -m pytest -m 'essential and not slow' >"$out.tests"
    passed=$?
    cat "$out.tests" >&3 # in one piece, as another stage may say something meanwhile
    return "$passed"
}

versions() {
    "$venv/bin/python" -c 'import platform; from importlib.metadata import version
print(platform.python_version(), "with rclpy", version("ros-rclpy"))'
}

# Print one line: PYTHON DISTRIBUTION RESULT.
say() { printf 'Python %-4s %-7s %s\n' "$@"; }

# Do a part; where it fails, show what it said.
attempt() {
    "$@" >"$work/log.$$" 2>&1 && return
    failed=1
    cat "$work/log.$$"
    return 1
}

stage() { # stage PYTHON DISTRIBUTION
    venv=.venvs/$2-$1 out=$work/$2-$1
    if [ -z "$(interpreter "$1")" ]; then
        say "$@" "cannot run: no python$1 on PATH or among pyenv's"
        return
    fi
    for part in environment run verify digest tests; do
        if ! attempt "$part" "$@"; then
            say "$@" "FAILED: $part"
            return 1
        fi
    done
    say "$@" "ok: $(versions), $SECONDS s"
}

# Show the digests of the runs, and whether they are the same.
same_bytes() {
    cd "$work" || return
    grep . ./*.digest
    [ "$(cat ./*.digest | sort -u | wc -l)" -le 1 ]
}

if [ $# -gt 0 ]; then
    stage "$@"
    exit
fi
work=$(mktemp -d)
export work
trap 'rm -rf "$work"' EXIT
reason=$(obstacle)
if [ -n "$reason" ]; then
    echo "Runs on every Python: cannot run: $reason"
    exit 0
fi
if attempt scripts/lock.sh --check; then
    echo 'constraints/: ok'
else
    echo 'constraints/: FAILED: not what scripts/lock.sh writes'
fi
xargs -L 1 -P 2 scripts/pythons.sh <<<"$stages" || failed=1
attempt same_bytes || echo 'FAILED: same_bytes'
exit "$failed"
