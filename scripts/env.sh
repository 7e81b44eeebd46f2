#!/bin/sh
# Build .venv, or bring it up to date. Does nothing, quickly, when nothing has changed, but compile
# the byte code of changed sources.
#
# Without a ROS 2 install around: rclpy comes from wheels, every version pinned in constraints/.
# With one sourced (ROS_DISTRO set): rclpy comes from there, and none of its files are touched.
#
# With --check: only say, by the exit status, whether it is up to date.
# PYTHON=/path/to/python3.12 chooses the interpreter; otherwise the first suitable one is taken.
# WHEELS=jazzy takes the wheels of that distribution (kilted).
# VENV chooses another directory than .venv. For scripts/pythons.sh: EXTRAS the extras, of which no
# more is made than a run needs, UV a uv that installs in place of pip.
set -eu

cd -- "$(dirname -- "$0")/.."
venv=${VENV:-.venv}
stamp=$venv/.flexarm-env
wheels=${WHEELS:-kilted}

say() { printf '%s\n' "$*"; }
fail() {
    for line in "$@"; do printf '%s\n' "$line" >&2; done
    exit 1
}

# Every file that decides what is in .venv.
inputs() {
    cat constraints/*.txt setup.py setup.cfg package.xml scripts/env.sh scripts/link_prefix.py
    cat lib/flexarm_ros/*
    ls lib/flexarm_ros config launch resource 2>/dev/null || true
    say "root=$PWD ros=${ROS_DISTRO:-} wheels=$wheels extras=${EXTRAS:-}"
}
wanted() { inputs | sha256sum | cut -d' ' -f1; }

current() {
    [ -x $venv/bin/flexarm ] && [ -f $stamp ] && [ "$(cat $stamp)" = "$(wanted)" ] &&
        { [ -z "${PYTHON:-}" ] || [ "$("$PYTHON" -V 2>&1)" = "$($venv/bin/python -V)" ]; }
}

# Whether `$1` is a CPython that the wheels exist for.
right_version() {
    "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}
ros_works() { "$1" -c 'import rclpy' 2>/dev/null; }
has_venv() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

debian_like() { [ -r /etc/os-release ] && grep -Eq '^ID(_LIKE)?=.*(debian|ubuntu)' /etc/os-release; }
as_root() { [ "$(id -u)" = 0 ]; }

# Run a program quietly; show what it said only if it fails.
quietly() {
    log=$(mktemp)
    if ! "$@" >"$log" 2>&1; then
        cat "$log" >&2
        rm -f "$log"
        fail "make env: that was said by: $*"
    fi
    rm -f "$log"
}

# Install Debian packages if we may; otherwise name the line that does.
need() { # need WHAT PACKAGE...
    what=$1
    shift
    if debian_like && as_root && command -v apt-get >/dev/null; then
        say "make env: $what is missing; installing $*"
        export DEBIAN_FRONTEND=noninteractive
        quietly apt-get update
        quietly apt-get install -y --no-install-recommends "$@"
    elif debian_like; then
        fail "make env: $what is missing. Install it with:" "  sudo apt-get install -y $*"
    else
        fail "make env: $what is missing. Install it with your system's package manager" \
            "(on Debian and Ubuntu: sudo apt-get install -y $*)."
    fi
}

# Print the first suitable Python: the one asked for, or else that of the .venv that is there.
find_python() {
    before=$($venv/bin/python -c 'import sys; print(sys._base_executable)' 2>/dev/null || true)
    if [ -n "${PYTHON:-}" ]; then
        set -- "$PYTHON"
    else
        set -- "$before" python3 /usr/bin/python3 python3.13 python3.12 python3.11 python3.10
    fi
    for name in "$@"; do
        if command -v "$name" >/dev/null && "$suits" "$name"; then
            command -v "$name"
            return
        fi
    done
}

# Set python to an interpreter that passes the check `$1`, and whose venv module works.
choose_python() {
    suits=$1
    python=$(find_python)
    if [ -z "$python" ] && [ -z "${PYTHON:-}" ] && ! command -v python3 >/dev/null; then
        need python3 python3 python3-venv
        python=$(find_python)
    fi
    if [ -z "$python" ]; then
        if [ "$suits" = ros_works ]; then
            fail "make env: ROS 2 $ROS_DISTRO is sourced, but ${PYTHON:-no python3} imports its rclpy." \
                "Give the Python that it was built for: make env PYTHON=/usr/bin/python3" \
                "or open a shell in which no ROS 2 is sourced."
        fi
        fail "make env: ${PYTHON:-python3} is $("${PYTHON:-python3}" -V 2>&1 || true), not Python 3.10 to 3.13." \
            "Install one of these and say which: make env PYTHON=/path/to/python3.12"
    fi
    if ! has_venv "$python"; then
        need "the venv module of $python" \
            "$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')"
        has_venv "$python" || fail "make env: $python still lacks its venv module."
    fi
}

wheels_exist_here() {
    [ "$(uname -s)-$(uname -m)" = Linux-x86_64 ] && ! ldd --version 2>&1 | grep -qi musl
}

pip_install() {
    # The two variables belong to the wheels' loader: a Python that starts without them sets its
    # own library path.
    if [ -n "${UV:-}" ]; then
        "$UV" pip install --python $venv/bin/python "$@"
    else
        env -u _ROS_WHEELS_BOOTSTRAP_COMPLETE $venv/bin/python -m pip install \
            --disable-pip-version-check --no-input --progress-bar off "$@"
    fi
}

# Make .venv, unless the one that is there is whole and of the same kind: pip then installs only
# the difference.
fresh_venv() { # fresh_venv KIND [OPTION]
    kind="$1 $("$python" -V) $PWD"
    shift
    if [ -x $venv/bin/python ] && $venv/bin/python -m pip --version >/dev/null 2>&1 &&
        [ "$(cat $venv/.flexarm-kind 2>/dev/null)" = "$kind" ]; then
        return
    fi
    say "make env: building $venv with $("$python" -V) ($python)"
    "$python" -m venv --clear "$@" $venv
    printf '%s\n' "$kind" >$venv/.flexarm-kind
}

build() {
    if [ -n "${ROS_DISTRO:-}" ]; then
        case $ROS_DISTRO in
        foxy | galactic | humble | iron)
            fail "make env: ROS 2 $ROS_DISTRO is sourced; flexarm_ros needs Jazzy or later." \
                "In a shell in which no ROS 2 is sourced, make env installs its own."
            ;;
        esac
        choose_python ros_works
        say "make env: ROS 2 $ROS_DISTRO is sourced; rclpy and the messages come from there"
        fresh_venv "ros $ROS_DISTRO" --system-site-packages
        # The system's own NumPy and SciPy are kept: the messages are built against them.
        quietly pip_install "setuptools>=68,<80" wheel
        quietly pip_install --no-build-isolation -e '.[dev]'
    elif wheels_exist_here; then
        [ -f "constraints/$wheels.txt" ] ||
            fail "make env: WHEELS=$wheels: there are wheels of kilted and of jazzy."
        choose_python right_version
        fresh_venv "wheels $wheels"
        set -- -c constraints/python.txt -c "constraints/$wheels.txt"
        quietly pip_install "$@" setuptools wheel
        say "make env: installing rclpy and the rest (a minute or two)"
        quietly pip_install "$@" --no-build-isolation -e ".[${EXTRAS:-ros,dev,docs,notebook}]"
    else
        fail "make env: the rclpy wheels are for x86_64 Linux with glibc only; this is $(uname -sm)." \
            "Install ROS 2 (Jazzy or Kilted), source its setup.bash and run make again." \
            "\`flexarm simulate\` needs no ROS: python3 -m pip install . and use that anywhere."
    fi
    $venv/bin/python scripts/link_prefix.py
    if [ -z "${EXTRAS:-}" ]; then
        say "make env: compiling the hot loops"
        $venv/bin/python scripts/warm_up.py
    fi
    wanted >$stamp
    say "make env: done; for flexarm and ros2 on the path: . $venv/bin/activate"
}

# Compile the package's byte code, 0.1 s where it is up to date. Where PYTHONDONTWRITEBYTECODE is
# set, no run keeps it, and each of its processes compiles what it imports.
byte_code() { $venv/bin/python -m compileall -q flexarm_ros >/dev/null 2>&1 || true; }

if [ "${1:-}" = --check ]; then
    current || fail "make env: $venv is not up to date"
    exit 0
fi
if ! current && command -v flock >/dev/null; then
    exec 9<. # one at a time
    flock 9
fi
current || build
byte_code
