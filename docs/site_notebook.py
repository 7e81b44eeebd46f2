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

"""The directive ``notebook``: an executed Jupyter notebook with its outputs, as part of a page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


def markdown(notebook: dict[str, Any]) -> list[str]:
    """Return the lines of a notebook, format 4, as Markdown with its texts and PNG pictures."""
    lines: list[str] = []
    for cell in notebook['cells']:
        text = ''.join(cell['source'])
        if cell['cell_type'] == 'markdown':
            lines += [*text.splitlines(), '']
            continue
        lines += ['```python', *text.splitlines(), '```', '']
        for output in cell['outputs']:
            lines += [*_output(output), '']
    return lines


def _output(output: dict[str, Any]) -> list[str]:
    data = output.get('data', {'text/plain': output.get('text', '')})
    if 'image/png' in data:
        return [f'![output](data:image/png;base64,{"".join(data["image/png"].split())})']
    return ['```text', *''.join(data['text/plain']).splitlines(), '```']


class Notebook(SphinxDirective):
    """The content of the notebook at a path from the root of the repository."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        path = Path(self.env.srcdir).parent / self.arguments[0]
        self.env.note_dependency(str(path))
        holder = nodes.section()
        lines = markdown(json.loads(path.read_text('utf-8')))
        title = next(i for i, line in enumerate(lines) if line.startswith('# '))
        content = StringList(lines[title + 1 :], str(path))
        self.state.nested_parse(content, self.content_offset, holder)
        return holder.children
