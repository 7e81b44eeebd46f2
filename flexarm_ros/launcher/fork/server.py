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
A process that imports once, then forks children which act as ``python -m MODULE ...``.

``python -m flexarm_ros.launcher.fork.server`` reads a request from its standard input (JSON:
modules to import, the scenario whose compiled functions to load, and for each child its command
line and the descriptors of its standard files), forks the children, prints their process ids and
exits.  The client is `flexarm_ros.launcher.fork.parent`.

Forked children share their parent's addresses.  The processor's branch predictor works by address,
so each child finds the interpreter warmed up by the others, unlike processes started separately.
"""

from __future__ import annotations

import atexit
from collections.abc import Sequence
from contextlib import suppress
import ctypes
import gc
from importlib import import_module
import json
import os
import runpy
import signal
import sys
import threading
import traceback
from typing import Any, NoReturn
import warnings

from flexarm_ros.core.warned import allow_warnings

_LIBC = ctypes.CDLL(None, use_errno=True)
_PR_SET_MM, _PR_SET_MM_MAP = 35, 14


class _Map(ctypes.Structure):
    """The kernel's map of a process's memory: ``prctl_mm_map`` of prctl(2)."""

    _ADDRESSES = (
        'start_code', 'end_code', 'start_data', 'end_data', 'start_brk', 'brk', 'start_stack',
        'arg_start', 'arg_end', 'env_start', 'env_end', 'auxv',
    )  # fmt: skip
    _fields_ = (
        *((name, ctypes.c_uint64) for name in _ADDRESSES),
        ('auxv_size', ctypes.c_uint32),
        ('exe_fd', ctypes.c_uint32),
    )


_STAT = {'start_code': 26, 'end_code': 27, 'start_stack': 28, 'start_data': 45, 'end_data': 46,
         'start_brk': 47, 'env_start': 50, 'env_end': 51}  # fmt: skip
"""Field -> its number in ``/proc/self/stat``, see proc(5)."""

_shown: list[ctypes.Array[ctypes.c_char]] = []
"""Command lines that were given to the kernel: their memory must stay allocated."""


def show_command(words: Sequence[str]) -> None:
    """
    Set the command line of this process, as shown by ``ps`` and ``/proc``, to ``words``.

    Raises OSError if the kernel does not support it (CONFIG_CHECKPOINT_RESTORE, for CRIU).
    """
    data = b''.join(os.fsencode(word) + b'\0' for word in words)
    shown = ctypes.create_string_buffer(data, len(data))
    with open('/proc/self/stat', encoding='utf-8', errors='replace') as file:
        stat = file.read().rpartition(')')[2].split()
    known = {name: int(stat[number - 3]) for name, number in _STAT.items()}
    _LIBC.sbrk.restype = ctypes.c_void_p
    start = ctypes.addressof(shown)
    places = _Map(
        brk=_LIBC.sbrk(0), arg_start=start, arg_end=start + len(data), exe_fd=2**32 - 1, **known
    )
    size = ctypes.c_ulong(ctypes.sizeof(places))
    if _LIBC.prctl(_PR_SET_MM, _PR_SET_MM_MAP, ctypes.byref(places), size, ctypes.c_ulong(0)):
        raise OSError(ctypes.get_errno(), 'cannot show a command line')
    _shown.append(shown)


def main() -> int:
    """Serve the request on standard input; a child continues as its own command."""
    allow_warnings()  # before anything else is imported
    from flexarm_ros import scenario
    from flexarm_ros.wire.fused_step import warm_up_nodes

    request = json.load(sys.stdin)
    show_command(sys.orig_argv)  # if this fails, nothing is forked
    for name in request['modules']:
        import_module(name)
    if request['scenario']:
        warm_up_nodes(scenario.load(request['scenario'], []))
    gc.collect()
    gc.freeze()  # imported objects are shared: a collection that visits them would copy them
    gate, opener = os.pipe()
    pids: dict[str, int] = {}
    for child in request['children']:
        pid = _fork(pids)
        if pid == 0:
            os.close(opener)
            _take_files(child['files'], request['children'])
            if not os.read(gate, 1):
                return 1  # no client for this process
            os.close(gate)
            become(child['command'])
        pids[child['name']] = pid
    print(json.dumps(pids), flush=True)
    os.write(opener, b'.' * len(pids))
    os._exit(0)  # objects created by the imports belong to the children


def _fork(others: dict[str, int]) -> int:
    """Fork; on failure end the ``others`` and raise OSError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # about numpy's threads: OpenBLAS handles forks
            return os.fork()
    except OSError:
        for pid in others.values():
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        raise


def _take_files(files: Sequence[int], children: Sequence[dict[str, Any]]) -> None:
    """Make ``files`` the standard ones, and close those of the other children."""
    for number, descriptor in enumerate(files):
        os.dup2(descriptor, number)
    for descriptor in {each for child in children for each in child['files']}:
        os.close(descriptor)


def become(command: list[str]) -> NoReturn:
    """Run as ``python -m MODULE ...`` would, in a session of its own, and end."""
    os.setsid()
    show_command(command)
    sys.orig_argv[:] = command
    sys.argv[1:] = command[3:]
    status: object = 1
    try:
        runpy.run_module(command[2], run_name='__main__', alter_sys=True)
        status = 0
    except SystemExit as leave:
        status = leave.code or 0
    except BaseException:
        traceback.print_exc()
    _leave(status)


def _leave(status: object) -> NoReturn:
    """
    End as Python does, without the exit handlers of C libraries.

    That of LTTng, which rclpy links, cancels threads that a fork does not have: SIGSEGV.
    """
    if not isinstance(status, int):
        print(status, file=sys.stderr)
        status = 1
    with suppress(BaseException):
        threading._shutdown()  # waits for threads
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status & 0xFF)


if __name__ == '__main__':
    sys.exit(main())
