#!/usr/bin/env python3
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
Make this directory's pictures from real runs: ``.venv/bin/python docs/images/make.py``.

``report.png`` is a photograph of the report's page; without Chromium it is left as it is.
"""

from __future__ import annotations

import base64
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
CASES = [
    f'{law}_{case}' for law in ('pd', 'fls') for case in ('collocated', 'tip', 'tip_corrected')
]


def flexarm(*words: str | Path) -> None:
    """Run the command line; its output only matters where it fails."""
    command = [sys.executable, '-m', 'flexarm_ros.cli', *map(str, words)]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


def photograph(page: Path, picture: Path, work: Path) -> None:
    """Take a picture of a report's arm in motion."""
    sys.path.insert(0, str(ROOT / 'test' / 'support' / 'bags'))
    from report_browser import Browser, find_chromium

    program = find_chromium()
    if program is None:
        print('no Chromium: report.png is left as it is')
        return
    browser = Browser(program, work / 'profile')
    try:
        browser.size(1100, 900)
        browser.load(page)
        browser.js(
            "(() => { const s = document.getElementById('scrub'); s.value = 8.4;"
            "s.dispatchEvent(new Event('input'));"
            "document.getElementById('h-motion').scrollIntoView(); })()"
        )
        browser.frame()
        picture.write_bytes(base64.b64decode(browser.call('Page.captureScreenshot')['data']))
    finally:
        browser.close()


def main() -> None:
    """Simulate the paper's cases at the tip and the sweep of a how-to; draw them."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        for case in CASES:
            flexarm('simulate', case, '--no-bag', '--no-pictures', '--out', work / case)
        flexarm('report', *(work / case for case in CASES), '--out', work / 'report')
        for picture in ('paths.png', 'corners.png'):
            shutil.copy(work / 'report' / picture, HERE / picture)
        flexarm('sweep', 'latency_jitter', '--out', work / 'map')
        drawn = work / 'map' / 'pictures' / 'stable_pd_tip.png'
        shutil.copy(drawn, HERE / 'latency_jitter.png')
        pair = (work / 'pd_tip', work / 'fls_tip')
        flexarm('report', '--no-pictures', *pair, '--out', work / 'pair')
        photograph(work / 'pair' / 'report.html', HERE / 'report.png', work)


if __name__ == '__main__':
    main()
