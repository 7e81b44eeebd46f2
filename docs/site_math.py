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

"""Formulas as MathML, which every browser shows by itself."""

from __future__ import annotations

from html import escape
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert


def visit_inline(translator: Any, node: Any) -> None:
    """Write a formula within a line."""
    translator.body.append(convert(node.astext()))
    raise SkipNode


def visit_block(translator: Any, node: Any) -> None:
    """Write a formula on lines of its own, with its number if it has a label."""
    anchor = f' id="{escape(node["ids"][0])}"' if node.get('ids') else ''
    formula = convert(node.astext(), display='block')
    translator.body.append(f'<div class="math"{anchor}>{formula}</div>\n')
    raise SkipNode
