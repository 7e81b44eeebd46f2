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

"""A suite's result as JUnit XML, for CI systems."""

from __future__ import annotations

from pathlib import Path
import xml.etree.ElementTree as ET

from flexarm_ros.bag.mcap.files import naming
from flexarm_ros.launcher.suite import NOT_STARTED, SuiteResult


def write_junit(result: SuiteResult, path: Path) -> None:
    """Write one ``testcase`` per case, comparison and claim, with stable names."""
    name = result.suite.name
    root = ET.Element('testsuite', name=name)
    for case in result.cases:
        added = _add(root, f'{name}.cases', case.case.name, case.wall_s)
        if case.not_started:
            ET.SubElement(added, 'skipped', message=NOT_STARTED)
            continue
        _fail(added, [o.text for o in case.outcomes if not o.holds])
        lines = [f'mode: {case.case.mode}', f'directory: {case.directory}']
        if case.metrics.get('external'):
            lines.append(f'external: {", ".join(case.metrics["external"])}')
        if case.metrics.get('error'):
            lines.append(f'ended with: {case.metrics["error"]}')
        _say(added, lines + [o.text for o in case.outcomes])
    for comparison, outcome in zip(result.suite.compare, result.comparisons, strict=True):
        added = _add(root, f'{name}.compare', comparison.text)
        _fail(added, [] if outcome.holds else [outcome.text])
        _say(added, [outcome.text])
    for text, verdict, failed, outcomes in result.claims:
        said = [f'verdict: {verdict}', *(o.text for o in outcomes)]
        added = _add(root, f'{name}.claims', text)
        _fail(added, said if failed else [])
        _say(added, said)
    for count, tag in (('tests', '.'), ('failures', 'failure'), ('skipped', 'skipped')):
        root.set(count, str(len(root.findall(f'testcase/{tag}'))))
    root.set('errors', '0')
    root.set('time', f'{sum(case.wall_s for case in result.cases):.3f}')
    path.parent.mkdir(parents=True, exist_ok=True)
    ET.indent(root)
    with naming(path):
        ET.ElementTree(root).write(path, encoding='utf-8', xml_declaration=True)


def _add(root: ET.Element, group: str, name: str, wall_s: float = 0.0) -> ET.Element:
    return ET.SubElement(
        root, 'testcase', classname=group, name=_printable(name), time=f'{wall_s:.3f}'
    )


def _fail(case: ET.Element, failures: list[str]) -> None:
    if failures:
        message = _printable('; '.join(failures))
        ET.SubElement(case, 'failure', message=message).text = _printable('\n'.join(failures))


def _say(case: ET.Element, lines: list[str]) -> None:
    ET.SubElement(case, 'system-out').text = _printable('\n'.join(lines))


def _printable(text: str) -> str:
    """Replace characters that XML 1.0 does not allow."""
    return ''.join(c if c in '\n\t' or (c.isprintable()) else '?' for c in text)
