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
The part of a node that is the same for every role: join, advance in lock-step, report, leave.

Its folders: `topics` (publishers and subscriptions), `joining` (status messages, exchange of the
scenario), `parameters` (declaration, live changes) and `process` (environment, middleware,
launcher).  Imports core, wire and scenario, the requests to Linux of
`nodes.realtime`, and no node.
"""
