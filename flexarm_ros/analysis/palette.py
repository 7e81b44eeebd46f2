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
The colours of figures, of the report and of the live page, declared once.

PD and FLS have a hue each; the other hues are for other laws and for runs of one case.  A hue has
three shades, ``soft``, ``base`` and ``strong``, by contrast with the ground.  The hues are near
those of Okabe and Ito (2008), which remain distinct with the common colour vision deficiencies.
On a screen every shade has a contrast of at least 3 to 1 with its ground (WCAG 2.1).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

SHADES = ('soft', 'base', 'strong')

_LIGHT = {
    'pd': '#0072b2', 'fls': '#c45100', 'green': '#007d5b', 'purple': '#a8437f', 'amber': '#8f6800',
    'slate': '#5a626b',
}  # fmt: skip
_DARK = {
    'pd': '#4ea7e0', 'fls': '#ff8a3d', 'green': '#2fcf9f', 'purple': '#e39ac4', 'amber': '#f0c85a',
    'slate': '#a3adb7',
}  # fmt: skip
HUES = tuple(_LIGHT)
LAW_HUES: Mapping[str, str] = {'pd': 'pd', 'fls': 'fls'}
"""Hues that belong to a control law and are used for no other."""
SPARE_HUES = tuple(hue for hue in HUES if hue not in LAW_HUES.values())

_TEXTS = {
    'light': {
        'bg': '#ffffff', 'fg': '#1a1d21', 'soft': '#5a626b', 'line': '#d5dae0', 'panel': '#f4f6f8',
        'accent': '#00558c', 'good': '#006b4f', 'bad': '#a82a00', 'part': '#7a5300',
        'mark': '#fff3c9', 'edge': '#00000055',
    },
    'dark': {
        'bg': '#14171a', 'fg': '#e8ebee', 'soft': '#a3adb7', 'line': '#3a424a', 'panel': '#1e2327',
        'accent': '#7cc4f5', 'good': '#4fd1a5', 'bad': '#ff9166', 'part': '#eabf5e',
        'mark': '#4a3f14', 'edge': '#00000080',
    },
}  # fmt: skip

_GROUNDS = {
    'light': (_TEXTS['light']['bg'], '#000000', 0.22),
    'dark': (_TEXTS['dark']['bg'], '#ffffff', 0.35),
    'paper': ('#ffffff', '#000000', 0.5),  # soft curves are wide there
}
"""Theme -> ground, the colour opposite to it, and the share of the ground in a soft shade."""


def color(hue: str, shade: str = 'base', theme: str = 'light') -> str:
    """Return a shade of a hue as ``#rrggbb``; ``theme``: ``light``, ``dark`` or ``paper``."""
    base = (_DARK if theme == 'dark' else _LIGHT)[hue]
    ground, far, softness = _GROUNDS[theme]
    if shade == 'soft':
        return _mixed(base, ground, softness)
    return _mixed(base, far, 0.5) if shade == 'strong' else base


def rgb(hue: str) -> tuple[float, float, float]:
    """Return red, green and blue, 0 to 1, of a hue on a light ground."""
    red, green, blue = (part / 255.0 for part in bytes.fromhex(color(hue)[1:]))
    return red, green, blue


def _mixed(first: str, second: str, part: float) -> str:
    pairs = zip(bytes.fromhex(first[1:]), bytes.fromhex(second[1:]), strict=True)
    return '#' + ''.join(f'{round(a + part * (b - a)):02x}' for a, b in pairs)


def style_sheet() -> str:
    """
    Return the variables of both themes as CSS.

    ``--pd``, ``--pd-soft``, ``--pd-strong`` and so on for each hue, ``--bg``, ``--fg`` and the
    other text colours.  The reader's theme applies unless ``data-theme`` of the document names
    one; paper has the light one.
    """
    light, dark = (_declarations(theme) for theme in ('light', 'dark'))
    chosen = ':root[data-theme="dark"]'
    return (
        f':root {{ {light} }}\n'
        f'@media screen {{ {chosen} {{ {dark} }} }}\n'
        '@media screen and (prefers-color-scheme: dark) '
        f'{{ :root:not([data-theme="light"]) {{ {dark} }} }}\n'
    )


def _declarations(theme: str) -> str:
    pairs: Iterable[tuple[str, str]] = (
        (hue if shade == 'base' else f'{hue}-{shade}', color(hue, shade, theme))
        for hue in HUES
        for shade in SHADES
    )
    held = {**_TEXTS[theme], **dict(pairs)}
    return f'color-scheme: {theme}; ' + ' '.join(f'--{key}: {held[key]};' for key in held)
