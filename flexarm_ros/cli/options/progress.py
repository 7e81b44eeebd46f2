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

"""Progress of runs on standard error: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import sys
import time
from types import TracebackType
from typing import Any, TypeVar

from flexarm_ros.core.parameters.sections import RunConfig

_LINE_EVERY_S = 5.0

_Self = TypeVar('_Self', bound='_Shown')


class _Shown:
    """A rich bar if standard error is a terminal; otherwise ``say`` prints lines."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._last_line = time.monotonic()
        self._bar: Any = None
        self._task: Any = None

    def say(self, text: str) -> None:
        """Print one line, above the bar if there is one."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            print(text, file=sys.stderr, flush=True)

    def _line_is_due(self) -> bool:
        now = time.monotonic()
        if now - self._last_line < _LINE_EVERY_S:
            return False
        self._last_line = now
        return True

    def _show(self, done: int, total: int, note: str) -> None:
        self._bar.update(self._task, completed=done, total=total, note=note)

    def __enter__(self: _Self) -> _Self:
        if sys.stderr.isatty():
            self._open_bar()
        return self

    def _open_bar(self) -> None:
        # Imported here: it takes 50 ms and is not needed in pipes.
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        self._bar = Bar(
            TextColumn('{task.description}'),
            BarColumn(),
            TextColumn('{task.fields[note]}'),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task(self._name, total=None, note='')
        self._bar.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


class Progress(_Shown):
    """Shows the simulated time, real-time factor and remaining time of one run."""

    def __init__(self, config: RunConfig, name: str) -> None:
        super().__init__(name)
        self._period, self._duration = config.run.control_period, config.run.duration
        self._start: float | None = None
        self._first = 0
        self._work = self._timing = ''

    def timing(self, text: str) -> None:
        """Set what is known of the timing of a free-running run."""
        self._timing = text

    def work(self, text: str, share: float) -> None:
        """Show a step after the run and the completed share of it."""
        if text != self._work:
            self._work, self._last_line = text, -math.inf
        if self._bar is not None:
            self._show(round(100 * share), 100, text)
        elif self._line_is_due():
            self.say(f'{self._name}: {text}: {share:.0%} done')

    def update(self, ticks: int, total: int) -> None:
        """Set the number of completed ticks; timing starts with the first."""
        now = time.monotonic()
        if self._start is None:
            if ticks > 0:
                self._start, self._first = now, ticks
                self._last_line = now  # the rate is unknown before
            return
        wall = now - self._start
        factor = (ticks - self._first) * self._period / wall if wall > 0.0 else 0.0
        note = f'{ticks * self._period:.2f} of {self._duration:g} s simulated'
        if factor > 0.0:
            shown = f'{factor:.1f}' if factor >= 1.0 else f'{factor:.2g}'
            note += f', {shown} times real time'
        if self._timing:
            note += f', {self._timing}'
        if self._bar is not None:
            self._show(ticks, total, note)
        elif self._line_is_due():
            left = (total - ticks) * self._period
            self.say(f'{self._name}: {note}' + (f', {left / factor:.0f} s left' if factor else ''))


class CountProgress(_Shown):
    """Shows the number of completed runs and the remaining time."""

    def __init__(self, name: str, total: int, done: int = 0) -> None:
        super().__init__(name)
        self._total, self._first = total, done
        self._start = time.monotonic()

    def update(self, done: int) -> None:
        """Set the number of completed runs."""
        if self._bar is not None:
            self._show(done, self._total, f'{done} of {self._total} runs')
        elif self._line_is_due():
            note = f'{self._name}: {done} of {self._total} runs'
            if done > self._first:
                each = (time.monotonic() - self._start) / (done - self._first)
                note += f', {each * (self._total - done):.0f} s left'
            self.say(note)


class FitProgress(_Shown):
    """Shows the iteration of a fit and the longest remaining time."""

    def update(self, search: Any) -> None:
        """Take a `flexarm_ros.identification.estimate.search.Search` in progress."""
        left = search.seconds_left
        start = f'start {search.start + 1} of {search.starts}, ' if search.starts > 1 else ''
        note = (
            f'round {search.round + 1} of 2, {start}iteration {search.iterations}, '
            f'{search.evaluations} trials, cost {search.best_cost:.6g}'
        )
        if self._bar is not None:
            self._show(search.iterations, search.most_iterations, note)
        elif self._line_is_due():
            self.say(f'{self._name}: {note}' + (f', at most {left:.0f} s left' if left else ''))
