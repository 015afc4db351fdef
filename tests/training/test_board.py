"""TensorBoard's files: written at once, and a full disk is an error where something is written."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest
from tensorboardX.proto.event_pb2 import Event, SessionLog

from uniart_jax.config import StageConfig
from uniart_jax.training.board import Board
from uniart_jax.training.dashboard import Reporter


def events(folder) -> list[Event]:
    data, found = next(folder.iterdir()).read_bytes(), []
    while data:  # a record: length, checksum, event, checksum
        size = int.from_bytes(data[:8], "little")
        found.append(Event.FromString(data[12 : 12 + size]))
        data = data[16 + size :]
    return found


def test_numbers_and_pictures_are_there_once_flushed_and_older_steps_go(tmp_path):
    threads = threading.active_count()
    board = Board(tmp_path / "a", 7)
    board.scalar("train/loss", 0.5, 8)
    board.image("seen", np.zeros((4, 6, 3)), 8)
    board.flush()
    assert threading.active_count() == threads
    _, _, begun, number, picture = events(tmp_path / "a")
    assert (begun.step, begun.session_log.status) == (7, SessionLog.START)
    (value,) = number.summary.value
    assert (number.step, value.tag, value.simple_value) == (8, "train/loss", 0.5)
    assert picture.summary.value[0].image.width == 6
    board.close()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_full_disk_names_the_log_and_leaving_says_no_more(tmp_path):
    (tmp_path / "metrics").mkdir()
    report = Reporter("toy", tmp_path, 0, StageConfig())
    report.path.symlink_to("/dev/full")
    with (
        pytest.raises(
            OSError, match=r"No space left on device: '.*toy\.jsonl or its TensorBoard file'"
        ) as error,
        report,
    ):
        report.log(1, "train", {"loss": 1.0})
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_events_that_find_the_disk_full_are_an_error_too(tmp_path, monkeypatch):
    board = Board(tmp_path, 1)
    full = open("/dev/full", "wb")  # noqa: SIM115 - closed by the board
    monkeypatch.setattr(board._writer._py_recordio_writer, "_writer", full)
    with pytest.raises(OSError, match="No space left"):
        board.scalar("train/loss", 0.5, 8)
        board.flush()
