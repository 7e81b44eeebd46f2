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

"""What the tests of forked processes start: ``python -m forkedchild WORD``."""

import ctypes
import os
import sys
import time

word = sys.argv[1]
if word == 'where':
    # Where a library is, what the process takes for its arguments, whose session it leads.
    place = ctypes.cast(ctypes.CDLL(None).getpid, ctypes.c_void_p).value
    print(place, sys.argv[1:], sys.orig_argv[1:], os.getsid(0) == os.getpid(), __name__)
elif word == 'open':
    print(len(os.listdir('/proc/self/fd')))
elif word == 'wait':
    sys.stdin.read()
elif word == 'error':
    raise OSError('nobody foresaw it')
elif word == 'sleep':
    time.sleep(60)
else:
    sys.exit(int(word))
