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
    anchor = f' id="{escape(node["ids"][0])}"' if node.get("ids") else ""
    formula = convert(node.astext(), display="block")
    translator.body.append(f'<div class="math"{anchor}>{formula}</div>\n')
    raise SkipNode
