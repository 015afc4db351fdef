"""A place in the data is one number, whoever makes the batches."""

import numpy as np
import pytest

from uniart_jax.data.order import OnePass, ShuffledOrder, spread
from uniart_jax.data.stream import Batches


def load(draw):
    return {"number": np.array(draw.number), "records": draw.records}


def batches(workers=0, batch_size=2):
    order = ShuffledOrder(np.arange(7), np.zeros(7, np.int64), batch_size, seed=0)
    return Batches(order, load, workers)


def taken(iterator, number):
    return [next(iterator)["records"].tolist() for _ in range(number)]


@pytest.mark.parametrize(
    ("before", "after", "begun"),
    [
        (0, 0, 1),
        (0, 2, 0),
        *(pytest.param(*n, 1, marks=pytest.mark.slow) for n in ((0, 2), (2, 0), (2, 3))),
    ],
)
def test_resuming_gives_what_would_have_come_with_any_number_of_workers(before, after, begun):
    straight = taken(iter(batches()), 9)
    first = iter(batches(before))
    assert taken(first, 5) == straight[:5]
    assert first.get_state() == {"batch": 5, "batch_size": 2}
    again = iter(batches(after))
    taken(again, begun)  # what was drawn before belongs to another place
    again.set_state(first.get_state())
    assert taken(again, 4) == straight[5:]


def test_a_place_of_other_batches_is_refused():
    one = iter(batches())
    next(one)
    with pytest.raises(ValueError, match="batches of 2 items, the config has 3; keep batch_size"):
        iter(batches(batch_size=3)).set_state(one.get_state())
    with pytest.raises(ValueError, match="of another version"):
        iter(batches()).set_state({"next_index": 4})


def test_a_pass_ends():
    order = OnePass(np.arange(5), np.array([1, 1, 2, 2, 2]), 2)
    seen = [batch["records"].tolist() for batch in Batches(order, load)]
    assert seen == [[0, 1], [2, 3], [4, -1]]


@pytest.mark.parametrize(
    ("number", "most", "found"),
    [
        (5, None, [0, 1, 2, 3, 4]),
        (5, 9, [0, 1, 2, 3, 4]),
        (5, 3, [0, 2, 4]),
        (5, 1, [0]),
        (0, 3, []),
    ],
)
def test_spread(number, most, found):
    assert spread(number, most) == found
