"""Folders of assets: what is found in them, prepared like anything else, whatever is wrong with one
of them."""

from __future__ import annotations

import dataclasses
import os
import shutil

import numpy as np
import pytest
from test_prepare import digest

from uniart_jax import procedural
from uniart_jax.data import columns, folder, prepare, records, sources, splits
from uniart_jax.voxels.joint_code import decode_joint

SETTINGS = folder.Settings(
    source="urdf", resolution=16, subdivisions=2, views=1, image_size=16, states=2, shard_size=2
)


@pytest.fixture(scope="module")
def assets(small_pictures, tmp_path_factory):
    """<root>/<category>/<name>/object.urdf, one of them broken and one that names a missing
    mesh."""
    root = tmp_path_factory.mktemp("assets")
    for k, family in enumerate(("microwave", "table", "door")):
        obj = procedural.generate(family, k)
        obj.save(root / family / f"{k}", formats=(), collision="hull", motion=False)
    (root / "broken").mkdir()
    (root / "broken" / "a b.urdf").write_text("<robot")
    shutil.copytree(root / "table" / "1", root / "table" / "2")
    text = (root / "table" / "2" / "object.urdf").read_text()
    visual = '<visual><geometry><mesh filename="gone.obj"/></geometry></visual>'
    (root / "table" / "2" / "object.urdf").write_text(
        text.replace("<visual", f"{visual}<visual", 1)
    )
    return root


def settled(root, **changes):
    return dataclasses.replace(SETTINGS, root=str(root), **changes)


def found(root):
    return splits.assign(sources.find_entries(root, "urdf"), "none")


@pytest.fixture(scope="module")
def whole(assets, tmp_path_factory):
    """All of them prepared by one run; only read."""
    out = tmp_path_factory.mktemp("whole")
    return prepare.prepare(out, found(assets), settled(assets), processes=1, progress=False)


def test_what_is_found(assets, tmp_path):
    made = sources.find_entries(assets, "urdf")
    assert [(e.key, e.category) for e in made] == [
        ("broken/a b.urdf", "broken"),
        ("door/2", "door"),
        ("microwave/0", "microwave"),
        ("table/1", "table"),
        ("table/2", "table"),
    ]
    (alone,) = sources.find_entries(assets / "door" / "2", "urdf")
    assert (alone.key, alone.path) == ("2", ".")
    (tmp_path / "lib").mkdir()
    (tmp_path / "all.xml").write_text('<mujoco>\n<include file="lib/body.xml"/></mujoco>')
    (tmp_path / "lib" / "body.xml").write_text("<mujoco><worldbody/></mujoco>")
    (tmp_path / "lib" / "asset.xml").write_text("<mujocoinclude/>")
    (tmp_path / "lib" / "loose.urdf").write_text("<robot/>")
    found = sources.find_entries(tmp_path, "urdf")
    assert [e.key for e in found] == ["all.xml", "lib/loose.urdf"]
    (tmp_path / "gone.xml").symlink_to(tmp_path / "nowhere.xml")
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "linked").symlink_to(assets / "door")
    (tmp_path / "lib" / "round").symlink_to(tmp_path)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "object.urdf").write_text("<robot/>")
    (tmp_path / "deep" / "meta.json").write_text("[" * 200_000)
    found = sources.find_entries(tmp_path, "urdf")
    assert [e.key for e in found] == ["all.xml", "deep", "lib/loose.urdf", "linked/2"]
    with pytest.raises(FileNotFoundError, match=r"no mobility.urdf in it"):
        sources.find_entries(assets, "partnet-mobility")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        sources.find_entries(tmp_path / "nowhere", "urdf")


def test_a_bad_asset_does_not_stop_a_run(assets, tmp_path, capsys):
    out = prepare.prepare(tmp_path, found(assets), settled(assets), processes=1, progress=False)
    rows = folder.read_manifest(out)
    bad = [row for row in rows if row["error"]]
    assert [row["object"] for row in bad] == ["broken/a b.urdf"] and "not XML" in bad[0]["error"]
    assert "1 of 5 objects failed" in capsys.readouterr().err
    assert len(records.RecordSource(out)) == 8
    lost = [row for row in rows if row["object"] == "table/2"]
    assert all("gone.obj" in row["repairs"] for row in lost)
    assert (out / "contact-sheet.png").stat().st_size > 1000


def test_strict_leaves_out_what_lost_a_piece(assets, tmp_path):
    settings = settled(assets, strict=True)
    out = prepare.prepare(tmp_path, found(assets), settings, processes=1, progress=False)
    bad = {row["object"]: row["error"] for row in folder.read_manifest(out) if row["error"]}
    assert set(bad) == {"broken/a b.urdf", "table/2"}
    assert bad["table/2"].startswith("incomplete: ") and "gone.obj" in bad["table/2"]


def test_runs_that_share_a_folder_end_as_one(assets, whole, tmp_path):
    entries, settings = found(assets), settled(assets)
    for i in (2, 0, 1):
        assert not (tmp_path / "b" / "manifest.csv").exists()
        prepare.prepare(tmp_path / "b", entries, settings, processes=1, part=(i, 3), progress=False)
    assert digest(tmp_path / "b") == digest(whole)


def test_beam_makes_the_same_folder(assets, whole, tmp_path):
    pytest.importorskip(
        "apache_beam", reason="Apache Beam is absent: pip install 'uniart_jax[beam]'"
    )
    from uniart_jax.data.beam import run_beam

    entries, settings = found(assets), settled(assets)
    made = prepare.prepare(tmp_path / "b", entries, settings, run=run_beam, progress=False)
    assert digest(made) == digest(whole)


def test_orbits_stand_beside_their_records(assets, tmp_path):
    settings = settled(assets, orbit_views=5, orbit_size=24)
    out = prepare.prepare(tmp_path, found(assets), settings, processes=1, progress=False)
    source = records.RecordSource(out)
    orbits = records.open_shards(sorted(out.glob("orbit-*.arrayrecord")))
    assert len(orbits) == len(source)
    for i in (0, len(source) - 1):
        images, cameras = columns.read_orbit(orbits[i], source[i].meta["id"])
        assert np.shape(images) == (5, 24, 24, 4) and cameras.shape == (5, 4)
        assert np.ptp(cameras[:, 1]) > 1  # from above and from below
        assert (np.stack(images)[..., 3] > 0).mean((1, 2)).min() > 0.02


@pytest.mark.parametrize(("front", "turns"), [("+x", 2), ("+y", 1), ("-y", 3)])
def test_fronts_are_turned(assets, front, turns):
    """A door that swings towards its front does so towards -x, whatever its own frame says."""
    entry = sources.Entry("microwave/0", "microwave", path="microwave/0")
    plain = sources.load_entry(entry, settled(assets))
    ahead = {"+x": [1, 0, 0], "+y": [0, 1, 0], "-y": [0, -1, 0]}[front]
    turned = sources.load_entry(entry, settled(assets, front=front))
    matrix = np.linalg.matrix_power(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), turns)
    np.testing.assert_allclose(matrix @ ahead, [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(
        turned.parts[0].mesh.vertices, plain.parts[0].mesh.vertices @ matrix.T, atol=1e-9
    )


def test_other_assets_in_a_finished_folder_are_refused(assets, whole):
    entries, out, before = found(assets), whole, digest(whole)
    with pytest.raises(
        ValueError, match=r"made of other objects.*'broken/a b.urdf' where 'door/2'"
    ):
        prepare.prepare(out, entries[1:] + entries[:1], settled(assets), progress=False)
    with pytest.raises(ValueError, match="another setting: strict False"):
        prepare.prepare(out, entries, settled(assets, strict=True), progress=False)
    assert digest(out) == before


def test_records_hold_what_their_asset_says(assets, whole):
    source = records.RecordSource(whole)
    rows = [row for row in folder.read_manifest(whole) if not row["error"]]
    for row, record in zip(rows, (source[i] for i in range(len(source))), strict=True):
        truth = sources.load_entry(sources.entry_of(row, settled(assets)), settled(assets))
        types = [j.type for j in truth.joints]
        assert record.meta["joint_types"] == types and record.meta["category"] == row["category"]
        read = [decode_joint(c, b[:3]) for c, b in zip(record.codes, record.boxes, strict=True)]
        for a, b in zip(truth.joints, read, strict=True):
            if a.rotates:
                assert np.ptp(a.angle) == pytest.approx(np.ptp(b.angle), abs=1e-4)


def test_stretched_parts_keep_their_joints(assets, tmp_path):
    settings = settled(assets, part_scale=0.2, states=3)
    out = prepare.prepare(tmp_path, found(assets)[2:3], settings, processes=1, progress=False)
    plain, *stretched = (records.RecordSource(out)[i] for i in range(3))
    for record in stretched:
        assert record.meta["joint_types"] == plain.meta["joint_types"]
        shape = (
            record.boxes[:, 3:] * record.meta["scale"] / (plain.boxes[:, 3:] * plain.meta["scale"])
        )
        assert np.abs(shape - 1).max() > 0.02
        turns = record.codes[1:, 0] == 0
        np.testing.assert_allclose(
            np.ptp(record.codes[1:, 7:], axis=1)[turns],
            np.ptp(plain.codes[1:, 7:], axis=1)[turns],
            atol=1e-5,
        )
    with pytest.raises(ValueError, match=r"part scale must be in 0..0.5, got 2"):
        prepare.prepare(tmp_path / "b", found(assets), settled(assets, part_scale=2.0))
