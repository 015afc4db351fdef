"""Splits: which objects are trained on, and official lists that leak."""

from __future__ import annotations

import json

import pytest

from uniart_jax.config import DataConfig
from uniart_jax.data import splits
from uniart_jax.data.sources import Entry
from uniart_jax.stages.checks import overlapping


def entries(category, count, start=0):
    return [Entry(f"{category}/{start + k}", category) for k in range(count)]


def test_closed_set_is_the_seven_categories():
    made = splits.assign([*entries("Oven", 200), *entries("Toilet", 50)], "closed")
    assert {e.split for e in made[200:]} == {"other"}
    tested = [e for e in made[:200] if e.split == "test"]
    assert 8 <= len(tested) <= 35 and {e.split for e in made[:200]} == {"train", "test"}
    # adding objects moves none
    more = splits.assign([*entries("Oven", 400), *entries("Toilet", 50)], "closed")
    assert [e.split for e in more[:200]] == [e.split for e in made[:200]]


def test_open_set_holds_out_whole_categories():
    made = splits.assign(
        [*entries("StorageFurniture", 30), *entries("Toilet", 11), *entries("Mouse", 10)], "open"
    )
    found = {c: {e.split for e in made if e.category == c} for c in ("Toilet", "Mouse")}
    assert found == {"Toilet": {"unseen"}, "Mouse": {"other"}}
    assert {e.split for e in made[:30]} <= {"train", "test"}
    none = splits.assign(entries("Toilet", 3), "none")
    assert {e.split for e in none} == {"train"}


def test_official_lists(tmp_path):
    path = tmp_path / "data_split.json"
    halves = {
        "train": ["Oven/1", "Oven/2", "Oven/3/augmented"[:6] + "_aug7", "Oven/4"],
        "test": ["Oven/2", "Oven/3", "Table/9"],
    }
    path.write_text(json.dumps(halves))
    listed, warnings = splits.read_list(path)
    assert listed["2"] == "test" and listed["1"] == "train" and listed["3"] == "test"
    assert len(warnings) == 2
    assert "1 ids" in warnings[0] and "in both halves" in warnings[0] and ": 2" in warnings[0]
    assert "1 of 3 test ids" in warnings[1] and "base of augmented" in warnings[1]
    made = splits.assign([*entries("Oven", 6, 1), *entries("Mouse", 1)], "closed", listed)
    assert [e.split for e in made] == [
        "train",
        "test",
        "test",
        "train",
        "unlisted",
        "unlisted",
        "other",
    ]
    assert splits.rule_digest("closed", path) != splits.rule_digest("closed", None) == "closed"


@pytest.mark.parametrize(
    "text", ["", "[]", '{"train": []}', '{"train": [1], "test": []}', "[" * 200_000]
)
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "list.json"
    path.write_text(text)
    with pytest.raises(ValueError, match="split list") as caught:
        splits.read_list(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(FileNotFoundError, match="no such file"):
        splits.read_list(tmp_path / "nowhere")


def test_variants_stay_with_their_base():
    names = [f"Oven/{45000 + k}{end}" for k in range(200) for end in ("", "_aug1", "_aug2")]
    made = splits.assign([Entry(name, "Oven") for name in names], "holdout")
    assert all(len({e.split for e in made[k : k + 3]}) == 1 for k in range(0, 600, 3))
    assert {e.split for e in made} == {"train", "test"}


def test_a_list_of_other_names_is_refused():
    with pytest.raises(ValueError, match="names none of the 3 objects"):
        splits.assign(entries("Oven", 3), "closed", {"77": "train"})


@pytest.mark.parametrize(
    ("validation", "split", "shown", "meet"),
    [
        ("a", "", "", True),
        ("a", "", "test", True),
        ("a", "train", "test", False),
        ("a", "train,test", "test", True),
        ("./a", "train", "train", True),
        ("b", "", "", False),
        ("", "", "", False),
    ],
)
def test_validation_among_the_training_records_is_seen(validation, split, shown, meet):
    data = DataConfig(records="a", validation=validation, split=split, validation_split=shown)
    assert overlapping(data) == meet
