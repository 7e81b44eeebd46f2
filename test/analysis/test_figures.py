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

"""The pictures for papers: which are written, whether they hold what they should, of what runs."""

from __future__ import annotations

import io
import os
from pathlib import Path
import shutil
import subprocess
import sys
import warnings

from flexarm_ros import scenario
from flexarm_ros.analysis.figures.corners import corner_figure
from flexarm_ros.analysis.figures.fls import fls_figure, lambda_grid
from flexarm_ros.analysis.figures.paper import paper_figures
from flexarm_ros.analysis.figures.paths import path_figure
from flexarm_ros.analysis.figures.runs import part_figure, signal_figure, write_figures
from flexarm_ros.analysis.figures.style import drawing, new_figure, Panel, panels, styles, wrap
from flexarm_ros.analysis.palette import color
from flexarm_ros.analysis.report.runs import load_run, RunError
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
import numpy as np
import pytest
from report_cases import cut_rows, edit_summary, fly, leave_pictures_empty

SHORT = ('duration=2.0', 'trajectory.side_time=0.5', 'trajectory.side=1.0')


@pytest.fixture(scope='module')
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Short runs of the paper's cases: four sides in two seconds."""
    root = tmp_path_factory.mktemp('runs')
    for law in ('pd', 'fls'):
        for case in ('collocated', 'tip', 'tip_corrected', 'mid'):
            fly(root / f'{law}_{case}', f'{law}_{case}', *SHORT)
    fly(root / 'unstable', 'fls_tip_physical')
    return root


@pytest.fixture(autouse=True)
def strict() -> None:
    """Matplotlib says in warnings what would not be seen in a picture; NumPy too."""
    warnings.simplefilter('error', UserWarning)
    warnings.simplefilter('error', RuntimeWarning)


@pytest.fixture(scope='module')
def fls_tip(runs: Path) -> dict[str, bytes]:
    """Return the pictures of one run: name -> contents."""
    out = runs / 'fls_tip' / 'new' / 'pictures'
    return {path.name: path.read_bytes() for path in write_figures([runs / 'fls_tip'], out)}


@pytest.fixture(scope='module')
def six(runs: Path) -> dict[str, Figure]:
    """Return the paper's figures of runs of all that it compares."""
    cases = [f'{law}_{case}' for law in ('pd', 'fls') for case in ('collocated', 'tip', 'mid')]
    return dict(paper_figures(panels([load_run(runs / case) for case in cases])))


@pytest.fixture(scope='module')
def four(runs: Path) -> dict[str, Figure]:
    """Return those of runs with the sensor at the tip alone."""
    cases = [f'{law}_{case}' for law in ('pd', 'fls') for case in ('collocated', 'tip')]
    return dict(paper_figures(panels([load_run(runs / case) for case in cases])))


@pytest.fixture
def empty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write empty files."""
    leave_pictures_empty(monkeypatch)


def names(paths: list[Path]) -> set[str]:
    return {path.name for path in paths}


def pairs(*stems: str) -> set[str]:
    return {f'{stem}.{kind}' for stem in stems for kind in ('png', 'svg')}


def lines(axis: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {
        str(line.get_label()).replace('\n', ' '): (line.get_xdata(), line.get_ydata())
        for line in axis.get_lines()
    }


def test_mplbackend_may_be_set_to_anything(runs: Path, tmp_path: Path) -> None:
    """A notebook's backend is inherited by its subprocesses, and may not be installed there."""
    shutil.copytree(runs / 'fls_tip', tmp_path / 'run')
    done = subprocess.run(
        [sys.executable, '-m', 'flexarm_ros.cli', 'report', str(tmp_path / 'run')],
        env={**os.environ, 'MPLBACKEND': 'nonsense'},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, '')
    assert (tmp_path / 'run' / 'report' / 'signals.svg').exists()


def test_one_run_gives_each_picture_twice(fls_tip: dict[str, bytes]) -> None:
    assert fls_tip.keys() == pairs('paths', 'corners', 'signals', 'fls')
    for name, data in fls_tip.items():
        if name.endswith('.png'):
            picture = imread(io.BytesIO(data))
            assert picture.shape[0] > 400 and picture.std() > 0.05
        else:
            assert data.startswith(b'<?xml')
            assert b'<dc:date>' not in data


def test_equal_runs_give_equal_files(
    runs: Path, fls_tip: dict[str, bytes], tmp_path: Path
) -> None:
    again = {p.name: p.read_bytes() for p in write_figures([runs / 'fls_tip'], tmp_path)}
    assert again.keys() == fls_tip.keys()
    assert [name for name in again if again[name] != fls_tip[name]] == []


RIG = (
    ('strain_gauge.output=angle', ('strain1, rad', 'strain2, rad')),
    ('strain_gauge.output=deflection', ('strain1, m', 'strain2, m')),
    ('strain_gauge.gain=[1.0,0.001]', ('strain1, 1/m', 'strain2, m/m')),
    ('imu.rate=0.0', ('imu_gyro_z, rad/s', 'imu_accel_x, m/s^2', 'imu_accel_y, m/s^2')),
    ('actuator.latency=0.0', ('applied1, N m', 'applied2, N m')),
    (
        'disturbance.force_times=[0.0] disturbance.force_x=[1.0] disturbance.force_y=[0.0]',
        ('force_x, N', 'force_y, N'),
    ),
)
"""Keys of an optional part's section, the labels of its panels."""


@pytest.mark.parametrize(('keys', 'labels'), RIG, ids=[keys.split()[0] for keys, _ in RIG])
def test_an_optional_part_has_panels_with_units(
    keys: str, labels: tuple[str, ...], tmp_path: Path
) -> None:
    run = load_run(fly(tmp_path / 'run', 'pd_tip', 'duration=0.05', *keys.split()))
    axes = part_figure(panels([run])[0]).axes
    assert tuple(axis.get_ylabel() for axis in axes) == labels
    for axis, label in zip(axes, labels, strict=True):
        (curve,) = axis.get_lines()
        assert np.array_equal(curve.get_ydata(), run.columns[label.split(',')[0]])


@pytest.mark.usefixtures('empty')
def test_optional_parts_are_drawn_for_the_runs_that_have_them(runs: Path, tmp_path: Path) -> None:
    """Of two runs with one case only that with gauges has curves and an entry in the legend."""
    with_gauges = fly(tmp_path / 'gauges', 'pd_tip', *SHORT, 'strain_gauge.noise_std=1e-6')
    both = write_figures([with_gauges, runs / 'pd_tip'], tmp_path / 'both')
    assert names(both) == pairs('paths', 'corners', 'signals', 'parts')
    assert 'parts.png' not in names(write_figures([runs / 'pd_tip'], tmp_path / 'plain'))
    figure = part_figure(panels([load_run(with_gauges), load_run(runs / 'pd_tip')])[0])
    curves = [axis.get_legend_handles_labels()[1] for axis in figure.axes]
    assert [len(texts) for texts in curves] == [1, 1]
    (entry,) = figure.axes[-1].get_legend().get_texts()
    assert curves == [[entry.get_text()]] * 2


def test_the_columns_of_an_external_part_have_their_units(tmp_path: Path) -> None:
    """Its section is not in the summary; of gauges it has what the units depend on."""
    directory = tmp_path / 'run'
    keys = ('strain_gauge.output=angle', 'strain_gauge.noise_std=1e-6', 'imu.rate=0.0')
    config = scenario.load('pd_tip', ['duration=0.05', *keys])
    held = scenario.to_dict(config, external=('imu', 'strain_gauge'))
    assert 'imu' not in held and set(held['strain_gauge']) == {'location', 'output', 'gain'}
    fly(directory, 'pd_tip', 'duration=0.05', *keys)
    edit_summary(directory, lambda s: s.update(scenario=held, external=['imu', 'strain_gauge']))
    labels = list(load_run(directory).optional())
    assert labels[:3] == ['strain1, rad', 'strain2, rad', 'imu_gyro_z, rad/s']


def test_a_column_that_no_part_declares_is_drawn_without_a_unit(tmp_path: Path) -> None:
    """As of a run with a plug-in that is not installed; its name need not be mathematical text."""
    directory = fly(tmp_path / 'run', 'pd_tip', 'duration=0.05', 'imu.rate=0.0')
    edit_summary(directory, lambda summary: summary['scenario'].update(a_plug_in={'gain': 1.0}))
    path = directory / 'trajectory.csv'
    path.write_text(path.read_text('ascii').replace('imu_gyro_z', '$_{'), 'ascii')
    assert 'parts.png' in names(write_figures([directory], tmp_path / 'out'))
    figure = part_figure(panels([load_run(directory)])[0])
    assert [axis.get_ylabel() for axis in figure.axes] == ['$_{', 'imu_accel_x', 'imu_accel_y']


@pytest.mark.usefixtures('empty')
def test_several_runs_are_grouped_as_in_the_paper(runs: Path, tmp_path: Path) -> None:
    cases = ('pd_collocated', 'pd_tip', 'pd_mid', 'fls_tip')
    written = write_figures([runs / case for case in cases], tmp_path)
    stems = {'paths', 'corners', 'signals_pd_9m', 'signals_pd_6p75m', 'signals_fls_9m', 'fls'}
    assert names(written) == pairs(*stems, 'figure_2', 'figure_3')


def test_the_paper_s_figures_have_a_picture_each_where_runs_show_them(
    runs: Path, six: dict[str, Figure], four: dict[str, Figure]
) -> None:
    def stems(*cases: str) -> list[str]:
        groups = panels([load_run(runs / case) for case in cases])
        return [stem for stem, _ in paper_figures(groups)]

    assert list(four) == ['figure_2', 'figure_3', 'figure_5', 'figure_6']
    assert list(six) == [*four, 'figure_7', 'figure_8']
    assert stems('pd_collocated', 'pd_tip', 'fls_tip') == ['figure_2', 'figure_3']
    assert stems('pd_collocated', 'pd_tip') == []


def test_the_paper_s_transients_are_its_switches(six: dict[str, Figure]) -> None:
    for stem, place, switches in (('figure_6', '9 m', '21'), ('figure_8', '6.75 m', '23')):
        shown = [axis for axis in six[stem].axes if axis.get_legend() is not None]
        for axis, law, number in zip(shown, ('PD', 'FLS'), switches, strict=True):
            head, switch = axis.get_title().splitlines()
            assert head == f'{law}, sensor at {place}'
            assert switch.startswith(f'switch {number},')
        assert shown[0].get_ylabel() == 'y, m'


def test_a_collocated_run_stands_beside_each_place_of_its_law(runs: Path) -> None:
    cases = ('pd_collocated', 'pd_tip', 'pd_mid', 'fls_collocated')
    groups = panels([load_run(runs / case) for case in cases])
    assert [(group.title, [run.name for run in group.runs]) for group in groups] == [
        ('PD, sensor at 9 m', ['pd_collocated', 'pd_tip']),
        ('PD, sensor at 6.75 m', ['pd_collocated', 'pd_mid']),
        ('FLS', ['fls_collocated']),
    ]


def test_paths_show_what_was_recorded(runs: Path) -> None:
    run = load_run(runs / 'pd_tip')
    figure = path_figure([Panel('pd', 9.0, (run,))])
    (axis,) = figure.axes
    drawn = lines(axis)
    for label, name in (
        ('reference', 'ref'), ('noncollocated (NMP)', 'rigid'), ('tip, with deflection', 'tip')
    ):  # fmt: skip
        assert np.array_equal(drawn[label][0], run.columns[f'{name}_x'])
        assert np.array_equal(drawn[label][1], run.columns[f'{name}_y'])
    assert (axis.get_xlabel(), axis.get_ylabel()) == ('x, m', 'y, m')


def test_signals_have_units_and_lambda_only_where_there_is_one(runs: Path) -> None:
    pd, fls = (load_run(runs / name) for name in ('pd_tip', 'fls_tip'))
    labels = [axis.get_ylabel() for axis in signal_figure(Panel('fls', 9.0, (fls,))).axes]
    assert len(labels) == 6 and labels[-1] == 'gain λ'
    assert all(label.endswith((', m', ', N m')) for label in labels[:-1])
    assert len(signal_figure(Panel('pd', 9.0, (pd,))).axes) == 5


def test_corners_are_one_a_switch_with_the_summary_s_overshoot(runs: Path) -> None:
    group = panels([load_run(runs / f'pd_{case}') for case in ('collocated', 'tip')])[0]
    figure = corner_figure([group])
    shown = [axis for axis in figure.axes if axis.get_legend() is not None]
    assert [axis.get_title().splitlines()[-1] for axis in shown] == [
        'switch 1, t = 0.5 s', 'switch 2, t = 1 s', 'switch 3, t = 1.5 s'
    ]  # fmt: skip
    for index, axis in enumerate(shown):
        texts = [text.get_text() for text in axis.get_legend().get_texts()]
        for run, text in zip(group.runs, texts, strict=True):
            assert f'{run.summary["overshoot"][index]:.3f} m' in text.replace('\n', ' ')
        corner = {1: (-0.5, 0.5), 2: (0.5, 0.5), 3: (0.5, -0.5)}[index + 1]
        low_x, high_x = axis.get_xlim()
        low_y, high_y = axis.get_ylim()
        assert low_x < corner[0] < high_x and low_y < corner[1] < high_y
        assert high_x - low_x == pytest.approx(high_y - low_y)


def test_cases_keep_their_colours_and_every_run_of_many_has_its_own_look(runs: Path) -> None:
    three = [load_run(runs / f'pd_{case}') for case in ('tip', 'collocated', 'tip_corrected')]
    for order in ([0, 1, 2], [2, 0, 1]):
        some = [three[i] for i in order]
        by_role = {run.role: style for run, style in zip(some, styles(some), strict=True)}
        assert by_role == {
            run.role: style for run, style in zip(three, styles(three), strict=True)
        }
    many = styles(three * 8)
    assert len({(style.color, style.dashes) for style in many}) == len(many)


def test_a_law_has_its_hue_and_spare_ones_belong_to_none(runs: Path) -> None:
    pd, fls = ([load_run(runs / f'{law}_{case}') for case in ('collocated', 'tip', 'mid')]
               for law in ('pd', 'fls'))  # fmt: skip
    assert [style.hue for style in styles(pd + fls)] == ['pd'] * 3 + ['fls'] * 3
    assert [style.hue for style in styles([fls[1], fls[1], pd[1], pd[1]])] == [
        'fls', 'green', 'pd', 'purple'
    ]  # fmt: skip
    assert styles(fls[:1])[0].color == color('fls')


def test_the_paper_s_paths_share_axes_and_show_how_far_cases_lie_apart(
    runs: Path, four: dict[str, Figure]
) -> None:
    figure = four['figure_5']
    (pd, fls), (near, far) = figure.axes[:2], figure.axes[2:4]
    assert pd.get_xlim() == fls.get_xlim() and pd.get_ylim() == fls.get_ylim()
    assert near.get_ylim() == far.get_ylim()
    tip, collocated = (load_run(runs / f'pd_{case}').columns for case in ('tip', 'collocated'))
    apart = np.hypot(*(tip[n] - collocated[n] for n in ('rigid_x', 'rigid_y')))
    assert lines(near)['noncollocated (NMP)'][1] == pytest.approx(1e3 * apart)
    widths = [curve.get_linewidth() for curve in pd.get_lines()[3:]]
    assert widths == sorted(widths, reverse=True) and widths[0] > 1.5 * widths[1]


def test_no_legend_or_inset_covers_a_curve(tmp_path: Path) -> None:
    cases = [f'{law}_{case}' for law in ('pd', 'fls') for case in ('collocated', 'tip')]
    drawn = dict(paper_figures(panels([load_run(fly(tmp_path / c, c)) for c in cases])))
    for stem in ('figure_5', 'figure_6'):
        figure = drawn[stem]
        figure.draw_without_rendering()
        for axis in figure.axes:
            legend = axis.get_legend()
            boxes = [legend.get_window_extent()] if legend else []
            boxes += [inset.get_tightbbox() for inset in axis.child_axes]
            for curve in axis.get_lines():
                if curve.get_transform().contains_branch(axis.transData):
                    points = curve.get_transform().transform(curve.get_xydata())
                    points = points[[axis.bbox.contains(*point) for point in points]]
                    assert not any(box.count_contains(points) for box in boxes), (stem, curve)
        assert stem == 'figure_6' or figure.axes[0].child_axes


@pytest.mark.parametrize(
    'text',
    ['a_scenario_with_a_name_' * 4 + ', velocity source encoder',
     'my_package.controllers.flexible:AVeryCleverTipController, sensor at 6.75 m', 'x' * 100],
)  # fmt: skip
def test_a_long_title_stays_in_its_figure(text: str) -> None:
    with drawing():
        figure = new_figure(6.4, 4.0)
        title = figure.add_subplot().set_title(wrap(text, 60))
        figure.draw_without_rendering()
        box = title.get_window_extent()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.width
    assert title.get_text().replace('\n', '').replace(' ', '') == text.replace(' ', '')


def test_fls_figure_shows_the_definition(runs: Path) -> None:
    figure = fls_figure([load_run(runs / 'fls_tip')])
    inputs, outputs = figure.axes[:2]
    texts = [[text.get_text() for text in axis.texts] for axis in (inputs, outputs)]
    assert texts == [['N', 'ZERO', 'P'], ['ZERO', 'PM', 'PMAX']]
    assert inputs.get_xlim()[0] < -5.0 and inputs.get_xlim()[1] > 5.0
    grid = lambda_grid(np.array([-1.0, 0.0, 1.0]))
    expected = np.array([[5, 3, 5], [3, 1, 3], [5, 3, 5]]) / 6.0
    assert grid == pytest.approx(expected)


def test_an_unstable_run_is_drawn_and_says_so(runs: Path, tmp_path: Path) -> None:
    written = write_figures([runs / 'unstable'], tmp_path)
    assert names(written) == pairs('paths', 'signals', 'fls')
    group = panels([load_run(runs / 'unstable')])[0]
    assert 'unstable, stopped at t = 0.0' in path_figure([group]).axes[0].get_title()


@pytest.mark.parametrize('rows', [0, 1, 600])
def test_a_run_that_was_broken_off_is_drawn(runs: Path, tmp_path: Path, rows: int) -> None:
    directory = broken_off(tmp_path / 'cut', rows)
    assert load_run(directory).rows == rows
    assert names(write_figures([directory], tmp_path / 'out')) >= pairs('paths', 'signals')


def test_a_broken_off_run_is_drawn_over_a_whole_one(runs: Path, tmp_path: Path) -> None:
    written = write_figures([broken_off(tmp_path / 'cut', 2), runs / 'pd_tip'], tmp_path / 'out')
    assert names(written) == pairs('paths', 'corners', 'signals')


def broken_off(directory: Path, rows: int) -> Path:
    """Return a run of which the first rows are left, and no metric is known."""
    fly(directory, 'pd_tip', *SHORT)
    cut_rows(directory, rows, rest='0.6,1.0,2')
    edit_summary(
        directory,
        lambda s: s.update(dict.fromkeys(s, None), scenario=s['scenario'], complete=False),
    )
    return directory


def test_values_that_are_not_finite_leave_gaps(runs: Path, tmp_path: Path) -> None:
    directory = fly(tmp_path / 'gaps', 'pd_tip', *SHORT)
    path = directory / 'trajectory.csv'
    rows = path.read_text('ascii').splitlines()
    for i, value in ((5, 'nan'), (6, 'inf'), (7, '-inf'), (8, '1e308'), (9, '')):
        cells = rows[i].split(',')
        cells[5] = cells[11] = cells[17] = value
        rows[i] = ','.join(cells)
    path.write_text('\n'.join(rows) + '\n', 'ascii')
    assert write_figures([directory], tmp_path / 'out')


def test_what_is_not_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match='not a run'):
        write_figures([tmp_path], tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
