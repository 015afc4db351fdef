"""What the manifest says of an object."""

from uniart_jax.data import object_records


def test_very_many_repairs_are_counted():
    some = [f"joint '{k}': its axis is zero; held fixed" for k in range(3)]
    assert object_records.listed(some) == " | ".join(some)
    many = object_records.listed(some * 500)
    assert len(many) <= object_records.MAX_TEXT + 40 and many.endswith(" more")
    shown = many.count(" | ")
    assert f"and {1500 - shown} more" in many
    assert object_records.listed(["a\ud800b\nc"]) == "a?b c"
