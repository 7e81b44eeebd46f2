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

"""The documentation as an offline site: ``make docs``, then docs/_build/index.html."""

from __future__ import annotations

from pathlib import Path
import sys
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from flexarm_ros.cli.version import package_version  # noqa: E402
from site_commands import Commands  # noqa: E402
from site_math import visit_block, visit_inline  # noqa: E402
from site_notebook import Notebook  # noqa: E402
from sphinx.util.inspect import TypeAliasForwardRef  # noqa: E402

project = 'flexarm_ros'
author = 'The flexarm_ros maintainers'
project_copyright = 'The flexarm_ros maintainers, Apache-2.0'
version = release = package_version()

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx.ext.viewcode']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}
exclude_patterns = ['_build', 'data', 'images']

myst_enable_extensions = ['dollarmath', 'deflist']
myst_heading_anchors = 3
# ```math is a formula here as it is on GitHub.
myst_fence_as_directive = ['math']

html_theme = 'furo'
html_title = 'flexarm_ros'
html_static_path = ['site.css']
html_css_files = ['site.css']
html_show_sphinx = False
html_copy_source = False
html_show_search_summary = False  # it would be fetched, which a page opened as a file may not
html_math_renderer = 'mathml'

autodoc_typehints = 'description'
autodoc_type_aliases = {'ArrayLike': 'ArrayLike', 'Scenario': 'Scenario', 'Section': 'Mapping'}
# In a union Sphinx shows the alias by its repr, with the name of its own class.
TypeAliasForwardRef.__repr__ = lambda alias: alias.name
autodoc_member_order = 'bysource'
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False


def escape_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Let docstrings have the bars of an absolute value, which reStructuredText would take."""
    lines[:] = [line.replace('|', '\\|') if '``' not in line else line for line in lines]


def setup(app: Any) -> None:
    """Add the list of commands, notebooks, and formulas as MathML, without scripts or fonts."""
    app.connect('autodoc-process-docstring', escape_bars)
    app.add_directive('commands', Commands)
    app.add_directive('notebook', Notebook)
    app.add_html_math_renderer('mathml', (visit_inline, None), (visit_block, None))
