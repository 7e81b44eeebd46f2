#!/bin/sh
# Write constraints/: every version of every dependency, for CPython 3.10 to 3.13 on x86_64 Linux;
# the wheels of each ROS 2 distribution in a file of its name, all else in python.txt. Versions that
# are there are kept as long as they fit.
#
# With --upgrade: take the newest versions. With --check: write nothing; show what would change, and
# fail if anything would.
# UV=/path/to/uv chooses the resolver, where .venv cannot be built for want of a lock.
set -eu
cd -- "$(dirname -- "$0")/.."
uv=$(command -v "${UV:-$PWD/${VENV:-.venv}/bin/uv}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
upgrade=
[ "${1:-}" != --upgrade ] || upgrade=$1

# Print every version, with the wheels of a distribution.
resolve() { # resolve DISTRIBUTION RCLPY
    mkdir "$work/$1"
    cp setup.py "$work/$1/"
    cat >"$work/$1/pyproject.toml" <<'END'
[tool.uv]
environments = ["sys_platform == 'linux' and platform_machine == 'x86_64' and implementation_name == 'cpython' and python_full_version < '3.14'"]
END
    # Below 80 setuptools still has the commands that `colcon build --symlink-install` calls.
    printf '%s\n' 'setuptools>=68,<80' wheel "ros-rclpy==$2.*" >"$work/$1/more.in"
    cat constraints/python.txt "constraints/$1.txt" >"$work/$1/lock.txt"
    (
        cd "$work/$1"
        "$uv" --quiet pip compile --universal --python-version 3.10 --no-python-downloads --all-extras \
            $upgrade --no-header --no-annotate setup.py more.in -o lock.txt >/dev/null
    )
    # The platform is the same for every line; only what tells the Pythons apart is kept.
    sed -E \
        -e "s/ and (implementation_name == 'cpython'|platform_machine == 'x86_64'|sys_platform == 'linux'|platform_python_implementation != 'PyPy')//g" \
        -e "s/ ; python_full_version < '3.14'$//" \
        -e "s/ and python_full_version < '3.14'//" \
        -e "s/python_full_version (<|>=) '(3\.[0-9]+)'/python_version \1 '\2'/g" \
        -e "s/python_full_version == '(3\.[0-9]+)\.\*'/python_version == '\1'/" \
        "$work/$1/lock.txt"
}

# Make one file of the versions that are read.
write() { # write NAME WHAT
    {
        printf '# %s, for CPython 3.10 to 3.13 on x86_64 Linux.\n' "$2"
        printf '# Written by scripts/lock.sh from setup.py; not edited by hand.\n'
        cat
    } >"$work/new/$1.txt"
}

mkdir "$work/new"
while read -r name rclpy; do
    resolve "$name" "$rclpy" >"$work/$name.all"
    grep '^ros-' "$work/$name.all" | write "$name" "The wheels of ROS 2 $name"
    grep -v '^ros-' "$work/$name.all" >"$work/$name.rest"
    # What the distributions share is resolved once for each; a difference would need files of its own.
    [ ! -e "$work/rest" ] || cmp "$work/rest" "$work/$name.rest"
    mv "$work/$name.rest" "$work/rest"
done <<'END'
kilted 9.1
jazzy 7.1
END
write python 'Every version but those of ROS 2' <"$work/rest"

if [ "${1:-}" = --check ]; then
    diff -u constraints "$work/new"
else
    cp "$work/new/"* constraints/
fi
