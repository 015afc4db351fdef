"""Which split an object belongs to. Splits stand in the manifest; no network sees one.

    none     every object is "train"
    holdout  every object is "train" or "test", whatever its category
    closed   the paper's seven categories: "train" or "test"; other categories are "other"
    open     those seven are "train" or "test"; a category of more than ``MIN_UNSEEN`` objects beside them is "unseen", a smaller one "other"

"test" are the objects of an official list, read from a file that the user has (SINGAPO's or
CAGE's), and objects that it does not name are "unlisted"; without a list, a tenth by the digest of
the object's id: adding objects moves none, and augmented variants stay with their base. The paper
names Bottle, Toilet, Chair, Laptop and TrashCan among its unseen categories, and "more than 10
objects" as the rule.
"""  # noqa: E501

from __future__ import annotations

import collections
import dataclasses
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from uniart_jax.data.sources import Entry

Rule = Literal["none", "holdout", "closed", "open"]
SEEN_CATEGORIES = (
    "StorageFurniture",
    "Table",
    "Refrigerator",
    "Dishwasher",
    "Oven",
    "WashingMachine",
    "Microwave",
)
MIN_UNSEEN = 10
TEST_SHARE = 10  # one of
# SINGAPO's and CAGE's names of the same categories
SYNONYMS = {"Storage": "StorageFurniture", "Washer": "WashingMachine", "Fridge": "Refrigerator"}
LIST_BYTES = 64 << 20


def assign(
    entries: Sequence[Entry], rule: Rule, listed: Mapping[str, str] | None = None
) -> list[Entry]:
    """The entries with their splits.

    Args:
      listed: object id -> split of an official list (``read_list``).

    Raises:
      ValueError: the list names none of the objects.
    """
    categories = [SYNONYMS.get(e.category, e.category) for e in entries]
    sizes = collections.Counter(categories)
    out = []
    for entry, category in zip(entries, categories, strict=True):
        seen = rule in ("none", "holdout") or category in SEEN_CATEGORIES
        if not seen:
            large = rule == "open" and category and sizes[category] > MIN_UNSEEN
            split = "unseen" if large else "other"
        elif listed is not None:
            split = listed.get(object_id(entry.key), "unlisted")
        elif rule == "none":
            split = "train"
        else:
            split = "test" if _digest(base_id(entry.key)) % TEST_SHARE == 0 else "train"
        out.append(dataclasses.replace(entry, split=split))
    if listed is not None and not any(entry.split in ("train", "test") for entry in out):
        raise ValueError(
            f"split list: it names none of the {len(out)} objects; its names must end in their ids "
            f"(first object: '{out[0].key}')"
        )
    return out


def read_list(path: str | Path) -> tuple[dict[str, str], list[str]]:
    """An official split: object id -> "train" or "test", and what is wrong with it.

    The file is JSON, ``{"train": [name, ...], "test": [name, ...]}``; a name ends in the object's
    id (``StorageFurniture/45135``), which may be followed by what an augmentation was called. An id
    in both halves counts as "test", so that nothing tested was trained on.

    Returns:
      (ids, warnings): one warning for ids in both halves and one for test objects that are the base
        of augmented training entries.

    Raises:
      FileNotFoundError, ValueError: no such file, or another kind of file.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"split list '{path}': no such file")
    if path.stat().st_size > LIST_BYTES:
        raise ValueError(f"split list '{path}': larger than {LIST_BYTES >> 20} MiB")
    try:
        halves: Any = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"split list '{path}': not JSON ({error})") from None
    names: dict[str, list[str]] = {}
    for half in ("train", "test"):
        found = halves.get(half) if isinstance(halves, dict) else None
        if isinstance(found, list) and all(isinstance(name, str) for name in found):
            names[half] = found
    if len(names) < 2:
        raise ValueError(
            f'split list \'{path}\': expected {{"train": [names], "test": [names]}}, as SINGAPO '
            "and CAGE write it"
        )
    train, test = ({object_id(n) for n in names[half]} for half in ("train", "test"))
    bases = {base for n in names["train"] if (base := base_id(n)) != object_id(n)}
    warnings = []
    if both := sorted(train & test):
        warnings.append(
            f"{len(both)} ids of '{path}' are in both halves and count as test: {_some(both)}"
        )
    if leaked := sorted(bases & test):
        warnings.append(
            f"{len(leaked)} of {len(test)} test ids of '{path}' are the base of augmented training "
            f"entries: {_some(leaked)}; what is trained on those has seen them"
        )
    return {**dict.fromkeys(train, "train"), **dict.fromkeys(test, "test")}, warnings


def object_id(name: str) -> str:
    """The last part of a name with folders."""
    return name.rstrip("/").rpartition("/")[2]


def base_id(name: str) -> str:
    """The PartNet-Mobility id that an augmented entry was made of: the digits that its id begins
    with (the id itself where there are none)."""
    own = object_id(name)
    digits = re.match(r"\d+", own)
    return digits[0] if digits else own


def rule_digest(rule: Rule, path: str | Path | None) -> str:
    """The rule and, with a list, the digest of its content: what ``metadata.json`` keeps."""
    if path is None:
        return rule
    return f"{rule} {hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]}"


def _digest(name: str) -> int:
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "big")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (" ..." if len(names) > 5 else "")
