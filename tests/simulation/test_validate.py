"""Whole assets through ``validate``: sound ones pass, every planted fault is caught by the name of
its check and of its joint or part."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import pytest
from planted_assets import (
    BODY,
    DOOR,
    HINGE,
    MJCF,
    STOVE,
    cabinet,
    chest,
    door_mesh,
    jar,
    link,
    pantry,
    robot,
    slider,
    write,
)

from uniart_jax.simulation import validate as module
from uniart_jax.simulation.summary import is_sound, verdicts
from uniart_jax.simulation.validate import validate

pytest.importorskip("mujoco", reason="pip install 'uniart_jax[mujoco]'")
BOTH = [
    pytest.param("mujoco"),
    pytest.param("pybullet", marks=(pytest.mark.pybullet, pytest.mark.slow)),
]


def failed(result: dict) -> dict[str, str]:
    """check -> reason of all that failed."""
    every = verdicts(result).values()
    return {
        n: c.get("reason", "") for checks in every for n, c in checks.items() if not c["passed"]
    }


@pytest.mark.usefixtures("mujoco_here")
@pytest.mark.parametrize("engine", BOTH)
@pytest.mark.parametrize(("make", "checks"), [
    (cabinet, {"hinge_opening", "slider_pulling", "flip_and_rotate"}),
    (chest, {"hinge_opening", "flip_and_rotate"}),
    (jar, {"hinge_opening"}),
])  # fmt: skip
def test_a_sound_asset_passes(tmp_path, engine, make, checks):
    result = validate(make(tmp_path / "a"), engines=[engine])
    assert is_sound(result), failed(result)
    assert checks <= set(result["engines"][engine])
    for group in verdicts(result).values():
        assert all(set(verdict) == {"passed", "value", "limit"} for verdict in group.values())


@pytest.mark.slow
@pytest.mark.parametrize("engine", BOTH)
def test_what_is_behind_a_door_moves_once_it_is_open(tmp_path, engine):
    result = validate(pantry(tmp_path / "a"), engines=[engine])
    assert is_sound(result), failed(result)
    assert result["joints"][engine]["tray_slide"]["after"] == ["door_hinge"]
    assert result["joints"][engine]["door_hinge"]["after"] == []
    motions = [m["joints"] for m in result["motions"][engine]]
    assert ["door_hinge", "tray_slide"] in motions and ["tray_slide"] not in motions
    locked = failed(validate(pantry(tmp_path / "b", locked=True), engines=[engine]))
    assert "'door' and 'tray'" in locked["sweep"] and "'tray_slide'" in locked["slider_pulling"]


def blocked(folder):
    bar = ([-0.45, 0.2, 0.24], [0.02, 0.1, 0.5])
    return cabinet(folder, body=[*BODY, bar])


def buried(folder):
    thick = [([0.1, 0.375, 0.24], [0.2, 0.75, 0.46])]
    shelf = [([0, 0, -0.25], [0.5, 0.7, 0.9])]
    return cabinet(folder, body=[*BODY, *shelf], door=[*DOOR, *thick])


def meshed(**fault):
    return lambda folder: cabinet(folder, visual=door_mesh(folder, **fault))


ZERO = link("door", DOOR)[link("door", DOOR).index("<inertia ") :].partition("/>")[0]
FAULTS = {
    "inverted axis": (lambda f: cabinet(f, axis=(0, 0, -1)), {"sweep": "'door_hinge'", "hinge_opening": "'door_hinge'"}),  # noqa: E501
    "blocked door": (blocked, {"sweep": "'body' and 'door'", "hinge_opening": "'door_hinge'"}),
    "zero inertia": (
        lambda f: cabinet(f, change=(ZERO, '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"')),  # noqa: E501
        {"inertia": "link 'door'"},
    ),
    "zero mass": (lambda f: cabinet(f, change=(f'value="{solid_mass():.9g}"', 'value="0"')), {"inertia": "link 'door'"}),  # noqa: E501
    "gap": (lambda f: cabinet(f, at=[HINGE[0] - 0.1, *HINGE[1:]]), {"gaps": "part 'door'"}),
    "flipped normals": (meshed(flipped=True), {"normals": "link 'door'"}),
    "open mesh": (meshed(hole=True), {"watertight": "link 'door'"}),
    "limit beyond collision": (lambda f: cabinet(f, limits=(0, 4.2)), {"sweep": "'door_hinge'"}),
    "drawer through the back": (lambda f: cabinet(f, drawer=(-0.2, 0.3)), {"overlap": "'body' and 'drawer'"}),  # noqa: E501
    "missing mesh": (meshed(absent=True), {"meshes": "'door.obj'"}),
    "self-intersecting collision": (buried, {"overlap": "'body' and 'door'"}),
    "NaN in the file": (lambda f: cabinet(f, limits=(0, "nan")), {"finite": "joint 'door_hinge'", "reads": "door_hinge"}),  # noqa: E501
    "NaN in a mesh": (meshed(nan=True), {"finite_meshes": "door.obj"}),
    "no collision shape": (
        lambda f: cabinet(f, change=(link("door", DOOR).partition("<collision>")[2].partition("</link>")[0], "<geometry/></collision>")),  # noqa: E501
        {"collision": "link 'door'"},
    ),
    "falls open": (lambda f: cabinet(f, axis=(0, -1, 0)), {"stands": "door_hinge"}),
}  # fmt: skip


def solid_mass() -> float:
    from planted_assets import solid

    return solid(DOOR)[0]


@pytest.mark.usefixtures("mujoco_here")
@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_caught_by_name(tmp_path, fault):
    make, expected = FAULTS[fault]
    result = validate(make(tmp_path / "a"), engines=["mujoco"])
    found = failed(result)
    assert not is_sound(result)
    for name, words in expected.items():
        assert words in found[name]
    json.dumps(result, allow_nan=False)


@pytest.mark.slow
@pytest.mark.pybullet
@pytest.mark.parametrize(
    "fault",
    [
        "inverted axis",
        "blocked door",
        "zero mass",
        "limit beyond collision",
        "self-intersecting collision",
        "NaN in the file",
        "falls open",
    ],
)
def test_pybullet_catches_it_too(tmp_path, fault):
    make, expected = FAULTS[fault]
    result = validate(make(tmp_path / "a"), engines=["pybullet"])
    found = failed(result)
    for name, words in expected.items():
        assert words in found[name]


@pytest.mark.slow
@pytest.mark.pybullet
@pytest.mark.parametrize(
    "make", [cabinet, chest, jar, FAULTS["inverted axis"][0], FAULTS["limit beyond collision"][0]]
)
def test_both_engines_tell_the_same_numbers(tmp_path, make):
    joints = validate(make(tmp_path / "a"), engines=["mujoco", "pybullet"])["joints"]
    assert joints["mujoco"] and set(joints["mujoco"]) == set(joints["pybullet"])
    for name, ours in joints["mujoco"].items():
        theirs = joints["pybullet"][name]
        for key in ("kind", "part", "range", "rest", "goal"):
            assert ours[key] == theirs[key]
        assert ours["sweep"] == pytest.approx(theirs["sweep"], abs=0.005)
        assert ours["free"] == pytest.approx(theirs["free"], abs=0.11)  # a step
        assert ours["depth"] == pytest.approx(theirs["depth"], abs=0.005)
        if (
            ours["sweep"] <= 0.01
        ):  # what runs into something depends on the file's filters, which differ
            assert ours["reached"] == pytest.approx(theirs["reached"], abs=0.05)


def test_a_file_that_breaks_an_engine_is_a_failed_check(tmp_path, monkeypatch):
    asset = slider(tmp_path / "a")
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\nkill -SEGV $$\n")
    broken.chmod(0o755)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", str(broken))
        assert "crashed (SIGSEGV)" in failed(validate(asset, engines=["mujoco"]))["loads"]
    broken.write_text("#!/bin/sh\nsleep 60\n")
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", str(broken))
        patch.setattr(module, "SECONDS", 0.02)
        assert "not done after" in failed(validate(asset, engines=["mujoco"]))["loads"]
    refused = write(
        tmp_path / "b",
        robot(
            link("a", DOOR),
            '<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>',
        ),
    )
    assert "'b'" in failed(validate(refused, engines=["mujoco"]))["reads"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no limit of processor time")
def test_an_engine_is_stopped_by_the_time_that_it_computes_not_by_the_clock(tmp_path, monkeypatch):
    """One that a busy machine keeps waiting for three times the limit is judged; one that computes
    without end is not waited for."""
    asset, worker = slider(tmp_path / "a"), sys.executable
    slow, endless = tmp_path / "slow", tmp_path / "endless"
    slow.write_text(f'#!/bin/sh\nsleep 9\nexec {worker} "$@"\n')
    endless.write_text(
        f"#!{worker}\nfrom uniart_jax.simulation import worker\n"
        "worker.load = lambda *_: [None for _ in iter(int, 1)]\n"
        "import sys\nworker.main(*sys.argv[3:])\n"
    )
    monkeypatch.setattr(module, "SECONDS", 3.0)
    for path in (slow, endless):
        path.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(slow))
    judged = validate(asset, engines=["mujoco"])
    assert judged["engines"]["mujoco"]["loads"]["passed"] and judged["joints"]["mujoco"]
    monkeypatch.setattr(sys, "executable", str(endless))
    start = time.monotonic()
    said = failed(validate(asset, engines=["mujoco"]))["loads"]
    assert "not done after 3 s of processor time" in said
    assert time.monotonic() - start < 10 * 3.0


@pytest.mark.skipif(sys.platform == "win32", reason="no named pipes")
@pytest.mark.parametrize("end", ["parent", "pipe"])
def test_a_worker_that_blocks_ends_with_its_parent(tmp_path, end):
    """``parent``: it is killed while the worker's input stays open; ``pipe``: the input ends, the
    parent lives."""
    if end == "parent" and sys.platform != "linux":
        pytest.skip("by prctl")
    job = tmp_path / "job"
    os.mkfifo(job)
    taken, held = os.pipe()
    worker = [
        sys.executable,
        "-m",
        "uniart_jax.simulation.worker",
        str(job),
        str(tmp_path / "result"),
    ]
    code = f"import subprocess; subprocess.Popen({worker}, stdin={taken}).wait()"
    parent = subprocess.Popen([sys.executable, "-c", code], pass_fds=[taken])
    os.close(taken)
    feed = os.open(job, os.O_WRONLY)  # once the worker waits for its job
    try:
        time.sleep(0.2)
        os.write(feed, b" ")
        if end == "parent":
            parent.terminate()
        else:
            os.close(held)
        with pytest.raises(BrokenPipeError):  # nobody reads any more
            for _ in range(100):
                os.write(feed, b" ")
                time.sleep(0.05)
    finally:
        parent.kill()
        parent.wait()
        os.close(feed)
        if end == "parent":
            os.close(held)


def test_an_mjcf_is_simulated(tmp_path):
    """By a process of its own, as everyone's is."""
    path = tmp_path / "flap.xml"
    path.write_text(MJCF.format(sign=-1, upper=1.5))
    result = validate(path)
    assert is_sound(result), failed(result)
    assert set(result["joints"]["mujoco"]) == {"flap_hinge"}


@pytest.mark.usefixtures("mujoco_here")
def test_a_fault_of_an_mjcf_is_found_and_pybullet_says_why_it_does_not_look(tmp_path):
    path = tmp_path / "flap.xml"
    path.write_text(MJCF.format(sign=1, upper=1.57))
    others = ["pybullet"] if module.importlib.util.find_spec("pybullet") else []
    result = validate(path, engines=["mujoco", *others])
    assert "'flap' and 'frame'" in failed(result)["sweep"]
    assert all("URDF" in result["not_run"][name] for name in others)


@pytest.mark.usefixtures("mujoco_here")
def test_mujoco_takes_the_mjcf_beside_a_urdf(tmp_path):
    asset = cabinet(tmp_path / "a")
    (asset / "object.xml").write_text(MJCF.format(sign=-1, upper=1.5))
    result = validate(asset, engines=["mujoco"])
    assert is_sound(result), failed(result)
    assert set(result["joints"]["mujoco"]) == {"flap_hinge"} and result["asset"] == "object.urdf"
    (asset / "object.xml").rename(tmp_path / "elsewhere.xml")
    (asset / "object.xml").symlink_to(tmp_path / "elsewhere.xml")
    with pytest.raises(ValueError, match="allow_outside=True"):
        validate(asset, engines=["mujoco"])


@pytest.mark.usefixtures("mujoco_here")
def test_a_hand_turns_the_dial_that_lifts_the_burner(tmp_path):
    path = tmp_path / "stove.xml"
    path.write_text(STOVE)
    result = validate(path, engines=["mujoco"])
    assert is_sound(result), failed(result)
    (name, told), *others = result["joints"]["mujoco"].items()
    assert (name, told["kind"], others) == ("burner_slide", "screw", [])
    (motion,) = result["motions"]["mujoco"]
    assert max(motion["force"]) < 5  # N; pushing the burner itself takes a hundred times as much


@pytest.mark.usefixtures("mujoco_here")
def test_nothing_outside_the_folder_is_read(tmp_path):
    door_mesh(tmp_path)
    shown = '<visual><geometry><mesh filename="../door.obj"/></geometry></visual>'
    asset = cabinet(tmp_path / "a", visual=shown)
    with pytest.raises(ValueError, match="allow_outside=True"):
        validate(asset, engines=["mujoco"])
    assert is_sound(validate(asset, engines=["mujoco"], allow_outside=True))
    collides = cabinet(
        tmp_path / "b",
        change=(
            "</link>",
            '<collision><geometry><mesh filename="../door.obj"/></geometry></collision></link>',
        ),
    )
    with pytest.raises(ValueError, match="allow_outside=True"):
        validate(collides, engines=["mujoco"])
    (tmp_path / "c.xml").write_text(
        '<mujoco><asset><mesh name="m" file="../x/door.obj"/></asset><worldbody/></mujoco>'
    )
    with pytest.raises(ValueError, match="allow_outside=True"):
        validate(tmp_path / "c.xml", engines=["mujoco"])


@pytest.mark.parametrize(
    ("content", "words"), [("", "empty"), ("<robot", "not XML"), ("<a/>", "<a>")]
)
def test_what_is_no_asset_is_one_line(tmp_path, content, words):
    path = tmp_path / "object.urdf"
    path.write_text(content)
    with pytest.raises(ValueError, match=words) as caught:
        validate(tmp_path, engines=["mujoco"])
    assert "\n" not in str(caught.value)


def test_engines_that_are_not_there(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="choose of mujoco, pybullet"):
        validate(tmp_path, engines=["gazebo"])
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="pip install mujoco"):
        validate(tmp_path)
    with pytest.raises(FileNotFoundError):
        monkeypatch.undo()
        validate(tmp_path / "nothing", engines=["mujoco"])


@pytest.mark.usefixtures("mujoco_here")
@pytest.mark.slow
def test_what_is_written_is_complete_and_the_same_twice(tmp_path):
    asset = slider(tmp_path / "a", friction=1.0)
    first = validate(asset, engines=["mujoco"], out=tmp_path / "out")
    second = validate(asset, engines=["mujoco"])
    assert first == second
    assert json.loads((tmp_path / "out/validation.json").read_text()) == first
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "validation.json",
        "validation.png",
    ]
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="cannot write there"):
        validate(asset, engines=["mujoco"], out=tmp_path / "file")
