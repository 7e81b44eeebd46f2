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

"""A suite on the terminal: a live table during the run, the verdicts at the end."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli.options.output import format_metric

if TYPE_CHECKING:
    from flexarm_ros.launcher.suite import CaseResult, SuiteResult
    from flexarm_ros.scenario.suites.suite import Case, Suite

_COLUMNS = ('rms_error', 'max_error', 'overshoot', 'tip_max_error', 'rtf')

_MOST_VALUES = 4


class SuiteTable:
    """Shows each case's state: a table on a terminal, else one line per change of state."""

    def __init__(self, suite: Suite) -> None:
        self._states = {case.name: 'waiting' for case in suite.cases}
        self._lock = threading.Lock()
        self._live: Any = None

    def update(self, case: Case, text: str) -> None:
        """Set the state of a case; thread-safe."""
        with self._lock:
            if self._states[case.name] == text:
                return
            self._states[case.name] = text
            if self._live is not None:
                self._live.update(self._table())
            elif not text.endswith('%'):
                print(f'{case.name}: {text}', file=sys.stderr, flush=True)

    def _table(self) -> Any:
        from rich.table import Table
        from rich.text import Text

        table = Table('case', 'state')
        for name, state in self._states.items():  # as Text: brackets in a name are not markup
            table.add_row(Text(name), Text(state))
        return table

    def __enter__(self) -> SuiteTable:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.live import Live

            self._live = Live(
                self._table(), console=Console(stderr=True), transient=True, refresh_per_second=4
            )
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()


def print_result(result: SuiteResult) -> None:
    """Print the table of metrics, the failures, the comparisons and the claims."""
    _print_cases(result.cases)
    for case in result.cases:
        for outcome in case.outcomes:
            if not outcome.holds:
                print(f'  {case.case.name}: {outcome.text}')
    for outcome in result.comparisons:
        print(f'compare  {"holds" if outcome.holds else "FAILS"}: {outcome.text}')
    for text, verdict, failed, outcomes in result.claims:
        print(f'claim    {text}: {verdict}{" (not as expected)" if failed else ""}')
        for outcome in outcomes:
            mark = {True: 'yes', False: 'no ', None: '?  '}[outcome.holds]
            print(f'           {mark} {outcome.text}')
    passed = sum(case.passed for case in result.cases)
    print(f'{passed} of {len(result.cases)} cases passed; suite {_word(result.passed)}')


def _print_cases(cases: list[CaseResult]) -> None:
    header = ['case', 'result', *_COLUMNS]
    rows = [
        [
            c.case.name,
            _result(c),
            *(format_metric(_short(c.metrics.get(name))) for name in _COLUMNS),
        ]
        for c in cases
    ]
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    for row in [header, *rows]:
        cells = [f'{cell:<{width}}' for cell, width in zip(row, widths, strict=True)]
        print('  '.join(cells).rstrip())


def _result(case: CaseResult) -> str:
    parts = ['pass' if case.passed else 'FAIL']
    if not case.metrics.get('stable'):
        parts.append('not stable')
    if case.metrics.get('external'):
        parts.append(f'external: {" ".join(case.metrics["external"])}')
    return ', '.join(parts)


def _short(value: Any) -> Any:
    """Return a list's first values: a long run has hundreds of switches of direction."""
    return value[:_MOST_VALUES] if isinstance(value, list) else value


def _word(passed: bool) -> str:
    return 'passes' if passed else 'FAILS'
