"""One batch ahead of the step, and never ahead of what is saved."""

import numpy as np
import pytest
import toy_run

from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.prefetch import Prefetch


class Numbers:
    """0, 1, 2, ... up to ``end``; its state is one dictionary that it goes on changing."""

    def __init__(self, end=10):
        self.state, self.end = {"next": 0}, end

    def __next__(self):
        number = self.state["next"]
        if number == self.end:
            raise StopIteration
        self.state["next"] += 1
        return number

    def get_state(self):
        return self.state

    def set_state(self, state):
        self.state = dict(state)


def test_one_batch_waits_on_the_device_and_no_more():
    put = []
    ahead = Prefetch(Numbers(), lambda batch: put.append(batch) or batch * 10)
    assert put == []
    assert next(ahead) == 0
    for _ in range(3):
        ahead.fetch()
    assert put == [0, 1]
    assert [next(ahead), next(ahead)] == [10, 20]


def test_the_position_is_that_of_the_last_batch_used():
    batches = Numbers()
    ahead = Prefetch(batches, lambda batch: batch)
    assert ahead.get_state() == {"next": 0}
    for used in range(1, 4):
        next(ahead)
        ahead.fetch()
        assert ahead.get_state() == {"next": used}
        assert batches.get_state() == {"next": used + 1}
    ahead.set_state({"next": 7})  # what waited belongs to another place
    assert next(ahead) == 7


@pytest.mark.parametrize("where", ["made", "sent"])
def test_an_error_waits_for_its_turn(where):
    def put(batch):
        if batch == 2:
            raise RuntimeError("cannot be sent")
        return batch

    ahead = Prefetch(Numbers(end=2 if where == "made" else 10), put)
    for expected in range(2):
        assert next(ahead) == expected
        ahead.fetch()
    assert ahead.get_state() == {"next": 2}  # still to be saved
    with pytest.raises(StopIteration if where == "made" else RuntimeError):
        next(ahead)


def test_a_run_draws_ahead_and_saves_where_it_is(tmp_path):
    """In the middle of a run the batch after the saved one has been drawn; the checkpoint does not
    count it."""
    seen, drawn = [], {}

    class Watched(Checkpoints):
        def save(self, step, state, iterator=None, *, wait=False):
            drawn[step] = (len(seen), iterator.get_state())
            super().save(step, state, iterator, wait=wait)

    original = toy_run.make_batches(seen)
    stage = toy_run.make_stage(6, 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("uniart_jax.training.checkpoints.Checkpoints", Watched)
        toy_run.train(tmp_path, stage, original)
    assert {step: count for step, (count, _) in drawn.items()} == {2: 3, 4: 5, 6: 6}
    for step, (_, position) in drawn.items():
        again = toy_run.make_batches(fresh := [])
        again.set_state(position)
        next(again)
        other = toy_run.make_batches(straight := [])
        for _ in range(step + 1):
            next(other)
        np.testing.assert_array_equal(fresh[0], straight[step])
