"""What `uniart inspect` and `uniart stats` say is what the records hold."""

from __future__ import annotations

import numpy as np
import pytest

from uniart_jax.cli import exit_on_error, inspect, stats
from uniart_jax.config import GridConfig
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.inspection import describe, draw_record, part_lines
from uniart_jax.objects.kinematics import Joint
from uniart_jax.visual.render import PART_COLORS


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    grid = GridConfig(16, 2)
    options = dict(families=("microwave", "table"), views=2, image_size=32, processes=1)
    return prepare_procedural(
        tmp_path_factory.mktemp("records"), 2, grid=grid, progress=False, **options
    )


def test_a_record_as_a_picture(records):
    record = RecordSource(records)[0]
    sheet = np.asarray(draw_record(record))
    for k in range(len(record.boxes)):  # every part is listed in its colour
        color = np.array([int(255 * c) for c in PART_COLORS[k]])
        assert (np.abs(sheet.astype(int) - color).max(-1) <= 1).sum() > 50
    lines = part_lines(record)
    assert len(lines) == len(record.boxes) and "root" in lines[0] and "fixed" in lines[0]
    for line, kind in zip(lines, record.meta["joint_types"], strict=True):
        assert kind in line


def test_limits_are_said_in_degrees_and_units():
    x = np.array([1.0, 0, 0])
    text = describe(Joint(np.zeros(3), x, angle=(-np.pi / 4, np.pi / 2)))
    assert text.startswith("revolute") and "-45..90 deg" in text and "+1.00 +0.00" in text
    assert "0.000..0.250" in describe(Joint(np.zeros(3), x, travel=(0.0, 0.25)))
    screw = describe(Joint(np.zeros(3), x, angle=(0.0, np.pi), travel=(0.0, 0.1)))
    assert "0..180 deg" in screw and "0.000..0.100" in screw


@pytest.mark.slow
def test_commands(records, tmp_path, capsys):
    inspect(records, index=1, out=tmp_path / "a")
    assert (tmp_path / "a" / "record.png").is_file() and (tmp_path / "a" / "object.urdf").is_file()
    assert "table-0000001-0" in capsys.readouterr().err
    stats(records)
    assert "| microwave | 1 | 0 |" in capsys.readouterr().out
    assert exit_on_error(lambda: inspect(records, index=2, out=tmp_path / "b")) == 2
    assert exit_on_error(lambda: stats(tmp_path)) == 2
    assert all(line.startswith("error: ") for line in capsys.readouterr().err.splitlines())
