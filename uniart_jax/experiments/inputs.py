"""What an experiment stands on: its records, made or checked; its test sets and checkpoints, looked
at before anything is trained."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import os
from pathlib import Path

import numpy as np

from uniart_jax.config import LATENT_OF, ModelConfig
from uniart_jax.data.folder import read_manifest, read_metadata
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import RecordSource, record_rows, shard_paths
from uniart_jax.experiments.design import Arm, Records
from uniart_jax.experiments.evaluate_arm import NEEDS, test_names, test_object
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.precompute.features import write_geometric_features
from uniart_jax.procedural import SEEN_FAMILIES
from uniart_jax.runtime.files import write_text
from uniart_jax.runtime.locks import in_turn
from uniart_jax.runtime.progress import messages
from uniart_jax.stages.checks import prepared_objects

MAX_PARTS = 64
console = messages()


def make_records(records: Records, model: ModelConfig) -> None:
    """Make the records of an experiment, and their column of part features, where they are not
    there yet, on the grid of ``model``; go on with what was left unfinished.

    Raises:
      ValueError: the folder holds records of other settings, of other families, or more of them.
    """
    folder = Path(records.folder)
    with in_turn(
        folder,
        lambda: console.print(f"{folder}: another process makes these records; waiting for it"),
    ):
        if records.source:
            leave_out(Path(records.source), folder, records.leave_out, records.matched)
            return
        held = prepared_objects(folder)
        if held < records.count:
            prepare_procedural(
                folder,
                records.count,
                families=records.families or None,
                grid=dataclasses.replace(model.grid, max_parts=MAX_PARTS),
                views=records.views,
                image_size=model.image_encoder.image_size,
                processes=os.cpu_count() or 1,
            )
        else:
            check_settings(records, model, held)
        if records.part_features:
            write_geometric_features(folder)


def check_settings(records: Records, model: ModelConfig, held: int) -> None:
    """Whether the records that are there are those that an experiment makes.

    Args:
      held: how many objects lie in its folder.

    Raises:
      ValueError: they are not those that it makes.
    """
    asked = {
        "source": "procedural",
        "families": list(records.families or SEEN_FAMILIES),
        "start_seed": 0,
        "resolution": model.grid.resolution,
        "subdivisions": model.grid.subdivisions,
        "views": records.views,
        "image_size": model.image_encoder.image_size,
        "states": 1,
    }
    found = read_metadata(records.folder)
    differ = [f"{k} {found.get(k)} instead of {v}" for k, v in asked.items() if found.get(k) != v]
    if held > records.count:
        differ.append(f"{held} objects instead of {records.count}")
    if any("max_parts" in row["error"] for row in read_manifest(records.folder)):
        differ.append(f"objects left out by max_parts {found.get('max_parts')}")
    if differ:
        raise ValueError(
            f"{records.folder}: holds other records than the experiment's ({', '.join(differ)}); "
            "move that folder away"
        )


def leave_out(source: Path, folder: Path, joint_type: str, matched: bool = False) -> None:
    """Another view of prepared records: the same shards, of which those with a joint of that type
    have it as their split, the others "train".

    ``matched``: as many of each category have that split, drawn without regard to their joints:
    what a training on fewer objects of such categories is worth by itself. Nothing is touched where
    all of it is there already: another process may read it.

    Raises:
      ValueError: no record has such a joint, or all have.
    """
    rows = record_rows(source)
    has = [joint_type in {j.split(":")[0] for j in row["joints"].split()} for row in rows]
    if not any(has) or all(has):
        raise ValueError(
            f"{source}: {sum(has)} of {len(has)} records have a joint '{joint_type}'; nothing to "
            "hold apart"
        )
    if matched:
        categories, drawn = np.array([row["category"] for row in rows]), np.array(has)
        for category in np.unique(categories):
            mine = categories == category
            drawn[mine] = np.random.default_rng(0).permutation(drawn[mine])
        has = drawn.tolist()
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {
        path.name: path.resolve() for path in [*shard_paths(source), source / "metadata.json"]
    }
    for link in folder.iterdir():
        if link.is_symlink() and link.name not in wanted:
            link.unlink()
    for name, target in wanted.items():
        link = folder / name
        if not (link.is_symlink() and link.readlink() == target):
            link.unlink(missing_ok=True)
            link.symlink_to(target)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row, apart in zip(rows, has, strict=True):
        writer.writerow({**row, "split": joint_type if apart else "train"})
    manifest = folder / "manifest.csv"
    if not manifest.is_file() or manifest.read_text(encoding="utf-8") != text.getvalue():
        write_text(manifest, text.getvalue())


def records_digest(folder: str | Path) -> str:
    """Of what a prepared folder says that it holds.

    Raises:
      FileNotFoundError, ValueError: it is not a complete prepared folder.
    """
    read_metadata(folder)
    read_manifest(folder)
    files = [Path(folder) / name for name in ("metadata.json", "manifest.csv")]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()[:16]


def check_networks(name: str, arm: Arm, trained: Arm) -> None:
    """Whether an arm will have the networks that it is judged by: trained, or from a checkpoint.

    Args:
      trained: the arm whose networks they are.

    Raises:
      FileNotFoundError: a checkpoint is missing. ValueError: a network is neither trained nor taken
        from one.
    """
    try:
        found = {given: Checkpoint.find(given) for given in trained.checkpoints()}
    except FileNotFoundError as error:
        raise FileNotFoundError(
            f"arm {name}: {error}; the experiment's file, or the config that it trains, says at "
            "its head where it comes from"
        ) from None
    has = {*trained.stages}
    if not trained.stages:
        has |= {*found[trained.init].networks()}
    elif init := trained.init or trained.config.init:
        has |= {*found[init].copyable(trained.config, trained.stages)}
    if trained.other_networks_from:
        has |= {*other_networks(trained, found[trained.other_networks_from])}
    if lacking := [network for network in NEEDS[arm.pipeline_stage] if network not in has]:
        raise ValueError(
            f"arm {name}: is judged by {', '.join(lacking)}, which it neither trains nor can take "
            f"from {' or '.join(found) or 'a checkpoint'}"
        )


def other_networks(arm: Arm, source: Checkpoint, target: Checkpoint | None = None) -> list[str]:
    """The networks that an arm copies from ``other_networks_from``; no flow, since its latent
    space would differ. ``target``: the arm's own checkpoint, if it is begun."""
    found = source.copyable(arm.config, arm.stages, target)
    return [network for network in found if network not in LATENT_OF]


def check_arm(name: str, arm: Arm, trained: Arm, count: int) -> None:
    """Whether an arm can be trained and judged, as far as that can be told before: an arm must not
    fail after a training of days.

    Args:
      trained: the arm whose networks it is judged by.

    Raises:
      FileNotFoundError, ValueError: records, a split, a column or an image is missing; the arm is
        named.
    """
    try:
        if trained.stages:
            data, features = trained.config.data, trained.config.model.uniart_vae.feature_channels
            RecordSource(data.records, data.split, tuple(features))
        names = test_names(arm.tests, count)
        if not names:
            raise ValueError(f"{arm.tests.records}: no test object in it")
        if arm.tests.records:
            test_object(arm, names[0], trained.config.model)
    except (OSError, ValueError) as error:
        raise type(error)(f"arm {name}: {error}") from None
