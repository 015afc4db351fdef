"""Folders of assets matched by name, whatever strangers put into them."""

from __future__ import annotations

import functools
import os
import unicodedata

import numpy as np
import pytest
import toy_assets

from uniart_jax.evaluation.pairs import (
    Missing,
    find_pairs,
    find_references,
    fingerprint,
    read_sets,
)
from uniart_jax.objects.load import load_object


def found(pred, ref, **options):
    pairs, surplus = find_pairs(pred, find_references(ref, **options), **options)
    return {pair.name: pair.samples for pair in pairs}, surplus


def test_names_samples_missing_and_surplus(tmp_path):
    pred, ref = tmp_path / "pred", tmp_path / "ref"
    for name in ("one", "several", "absent", "empty", "with space"):
        toy_assets.write(ref / name, "body")
    (ref / "lone.urdf").write_text(toy_assets.urdf("body"))
    (ref / "pictures").mkdir()  # not an asset
    toy_assets.write(pred / "one", "body")
    toy_assets.write(pred / "with space", "body")
    toy_assets.write(pred / "surplus", "body")
    toy_assets.write(pred / "lone", "body")
    for i in (0, 2, 10):
        toy_assets.write(pred / "several" / f"sample-{i}", "body")
    (pred / "several" / "notes").mkdir()
    (pred / "empty" / "meshes").mkdir(parents=True)
    pairs, surplus = found(pred, ref)
    assert list(pairs) == ["absent", "empty", "lone", "one", "several", "with space"]
    assert surplus == ["surplus"]
    assert [p.name for p in pairs["several"]] == ["sample-0", "sample-2", "sample-10"]
    assert pairs["one"] == (pred / "one",) and pairs["lone"] == (pred / "lone",)
    assert isinstance(pairs["absent"][0], Missing) and "holds no asset" in pairs["empty"][0].why


def test_names_agree_whichever_system_wrote_them(tmp_path):
    composed = "Tür ②"
    toy_assets.write(tmp_path / "ref" / composed, "body")
    toy_assets.write(tmp_path / "pred" / unicodedata.normalize("NFD", composed), "body")
    toy_assets.write(tmp_path / "ref" / "b", "body")
    pairs, surplus = found(tmp_path / "pred", tmp_path / "ref")
    assert not surplus and not isinstance(pairs[unicodedata.normalize("NFC", composed)][0], Missing)


def test_single_assets(tmp_path):
    door = toy_assets.write(tmp_path / "door", "body")
    other = tmp_path / "other.urdf"
    other.write_text(toy_assets.urdf("body"))
    assert found(other, door) == ({"door": (other,)}, [])
    assert found(door, other) == ({"other": (door,)}, [])
    samples = [toy_assets.write(tmp_path / "photo" / f"sample-{i}", "body") for i in (0, 1)]
    assert found(tmp_path / "photo", door) == ({"door": tuple(samples)}, [])
    of_that_name = toy_assets.write(tmp_path / "set" / "door", "body")
    toy_assets.write(tmp_path / "set" / "chair", "body")
    assert found(tmp_path / "set", door) == ({"door": (of_that_name,)}, ["chair"])
    with pytest.raises(ValueError, match="is one asset, but there are 2 references"):
        found(door, tmp_path / "set")


@pytest.mark.parametrize(
    ("pred", "ref", "said"),
    [
        ("nowhere", "good", "PRED .*no such file or folder"),
        ("good", "nowhere", "REF .*no such file or folder"),
        ("empty", "good", "no prediction in it"),
        ("good", "empty", "no reference in it"),
        ("good", "stranger", "predictions are called 'a', 'b', references 'x', 'y'"),
    ],
)
def test_what_cannot_be_compared_is_said(tmp_path, pred, ref, said):
    for folder, names in (("good", "ab"), ("stranger", "xy")):
        for name in names:
            toy_assets.write(tmp_path / folder / name, "body")
    (tmp_path / "empty").mkdir()
    with pytest.raises((ValueError, FileNotFoundError), match=said) as caught:
        found(tmp_path / pred, tmp_path / ref)
    assert "\n" not in str(caught.value)


def test_links_that_lead_out_are_followed_only_on_request(tmp_path):
    ref, pred = tmp_path / "ref", tmp_path / "pred"
    for name in ("a", "b", "c"):
        toy_assets.write(ref / name, "body")
    toy_assets.write(pred / "a", "body")
    (pred / "b").symlink_to(ref / "b")  # the answer itself
    (pred / "c").mkdir()
    (pred / "c" / "sample-0").symlink_to(ref / "c")
    pairs, _ = found(pred, ref)
    for name in "bc":
        assert "leads out" in pairs[name][0].why
    pairs, _ = found(pred, ref, allow_outside=True)
    assert pairs["b"] == (pred / "b",) and pairs["c"] == (pred / "c" / "sample-0",)
    with pytest.raises(ValueError, match=r"reference 'b' .* leads out"):
        find_references(pred)


def test_objects_in_memory(tmp_path):
    obj = load_object(toy_assets.write(tmp_path / "door", "body", "lid"))
    made = functools.partial(load_object, tmp_path / "door")
    pairs, surplus = found({"a": obj, "b": [made, obj], "z": obj}, {"a": obj, "b": made, "c": obj})
    assert pairs["a"] == (obj,) and pairs["b"] == (made, obj) and surplus == ["z"]
    assert isinstance(pairs["c"][0], Missing)
    for bad in ("", "..", "a/b", "two\nlines"):
        with pytest.raises(ValueError, match="a folder can have"):
            find_references({bad: obj})


def test_sets(tmp_path):
    file = tmp_path / "sets.json"
    assert read_sets(tmp_path, ["a", "b"]) == {}
    file.write_text('{"a": "closed", "b": "open", "elsewhere": "open"}')
    assert read_sets(tmp_path, ["a", "b", "c"]) == {"a": "closed", "b": "open"}
    for bad, said in (
        ('{"a": "ajar"}', "closed"),
        ("[1]", "closed"),
        ("{", "not JSON"),
        ('{"z": "open"}', "none of"),
    ):
        file.write_text(bad)
        with pytest.raises(ValueError, match=said):
            read_sets(tmp_path, ["a"])


def test_fingerprints_change_with_what_they_are_of(tmp_path):
    door = toy_assets.write(tmp_path / "door", "body", "lid")
    before = fingerprint(door)
    assert fingerprint(door) == before
    (door / "object.urdf").write_text(toy_assets.urdf("body", "lid", angle=1.25))
    changed = fingerprint(door)
    assert changed != before
    os.utime(door / "object.urdf", (1, 1))
    assert fingerprint(door) != changed
    one, two = load_object(door), load_object(door)
    assert (
        fingerprint(one) == fingerprint(two) != fingerprint(one.transformed(np.diag([2, 2, 2, 1])))
    )
    (door / "object.urdf").write_text(toy_assets.urdf("body", "lid", angle=1.0))
    assert fingerprint(load_object(door)) != fingerprint(one)
    kinds = [functools.partial(load_object, name) for name in ("a", "a", "b")]
    assert fingerprint(kinds[0]) == fingerprint(kinds[1]) != fingerprint(kinds[2])


def test_a_sample_without_an_asset_is_a_failure(tmp_path):
    pred, ref = tmp_path / "pred", tmp_path / "ref"
    toy_assets.write(ref / "one", "body")
    toy_assets.write(pred / "one" / "sample-0", "body")
    (pred / "one" / "sample-1").mkdir()
    (pred / "one" / "sample-2").mkdir()
    (pred / "one" / "sample-2" / "preview.png").write_bytes(b"")
    (pred / "one" / "pictures").mkdir()
    pairs, _ = found(pred, ref)
    good, *bad = pairs["one"]
    assert good == pred / "one" / "sample-0"
    assert [b.why for b in bad] == ["sample-1: no asset in it", "sample-2: no asset in it"]
