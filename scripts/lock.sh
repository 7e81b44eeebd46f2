#!/bin/sh
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

# Write constraints.txt anew: every version of every dependency, for Python 3.10 to 3.13.
# For maintainers, when versions are to move; `make test` on all four Pythons afterwards.
set -eu
cd -- "$(dirname -- "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check uv
cp setup.py "$work/"
cat >"$work/pyproject.toml" <<'END'
[tool.uv]
environments = ["sys_platform == 'linux' and platform_machine == 'x86_64' and implementation_name == 'cpython' and python_full_version < '3.14'"]
END
# Below 80 setuptools still has the commands that `colcon build --symlink-install` calls.
printf 'setuptools>=68,<80\nwheel\n' >"$work/build.in"

(
    cd "$work"
    venv/bin/uv --quiet pip compile --universal --python-version 3.10 --all-extras \
        --no-header --no-annotate setup.py build.in -o lock.txt
)
{
    cat <<'END'
# Every version that `make env` installs, for CPython 3.10 to 3.13 on x86_64 Linux.
# Written by scripts/lock.sh from setup.py; not edited by hand.
END
    # The platform is the same for every line; only what tells the Pythons apart is kept.
    sed -E \
        -e "s/ and (implementation_name == 'cpython'|platform_machine == 'x86_64'|sys_platform == 'linux'|platform_python_implementation != 'PyPy')//g" \
        -e "s/ ; python_full_version < '3.14'$//" \
        -e "s/ and python_full_version < '3.14'//" \
        -e "s/python_full_version (<|>=) '(3\.[0-9]+)'/python_version \1 '\2'/g" \
        -e "s/python_full_version == '(3\.[0-9]+)\.\*'/python_version == '\1'/" \
        "$work/lock.txt"
} >constraints.txt
