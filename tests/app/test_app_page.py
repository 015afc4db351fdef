"""The page in a browser: a picture in, an object with sliders and a zip out; nothing else is
asked."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
import zipfile
from pathlib import Path
from types import SimpleNamespace

import mujoco
import pytest
from chromium import chromium
from driven_page import (
    PATIENCE,
    make,
    move_slider,
    patient,
    press,
    show,
    text,
    until,
    upload,
    write,
)
from PIL import Image
from toy_pipeline import ToyPipeline

from uniart_jax.app import serve
from uniart_jax.app.sessions import Sessions
from uniart_jax.cli import exit_on_error
from uniart_jax.cli.app import app
from uniart_jax.models.checkpoint import PRETRAINED

ROOT = Path(__file__).parents[2]
OVEN = ROOT / "examples" / "images" / "oven.png"
needs_gradio = pytest.mark.skipif(
    not serve.has_gradio(), reason="needs Gradio: pip install 'uniart-jax[app]'"
)
shipped = pytest.mark.skipif(
    not (PRETRAINED / "nano" / "config.json").is_file(), reason="no shipped weights here"
)


def test_without_gradio_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(serve, "has_gradio", lambda: False)
    assert exit_on_error(app) == 2
    said = capsys.readouterr()
    *_, last = said.err.splitlines()
    assert last == "error: app: needs Gradio: pip install 'uniart-jax[app]'"


@pytest.mark.parametrize("port", [0, -1, 65536])
def test_no_such_port(port):
    with pytest.raises(ValueError, match=r"--port must be in 1\.\.65535"):
        serve.free_port(port)


def test_the_next_free_port_is_taken():
    import socket

    with socket.socket() as taken:
        taken.bind((serve.HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert port < serve.free_port(port) < port + serve.PORTS


@needs_gradio
def test_no_such_checkpoint_is_one_line(capsys):
    assert exit_on_error(lambda: app(checkpoint="nowhere", browser=False)) == 2
    said = [x for x in capsys.readouterr().err.splitlines() if not x.startswith("·")]
    assert len(said) == 1 and "nowhere" in said[0]


@pytest.fixture(scope="module")
def toy():
    """The page, with a pipeline that takes no time."""
    if not serve.has_gradio():
        pytest.skip("needs Gradio: pip install 'uniart-jax[app]'")
    pipeline = ToyPipeline()
    server = serve.Server(pipeline, "toy", serve.free_port(7930))
    server.pipeline = pipeline
    yield server
    server.stop()
    assert not server.sessions.root.exists()


@pytest.fixture
def opened(toy, tmp_path):
    with chromium(tmp_path / "profile") as page:
        show(page, toy.address)
        yield page
        check_requests(page, toy.address)


def check_requests(page, address):
    """All that was asked for came from the page's own server, and no policy was hurt."""
    known = (address, "data:", "blob:", "about:")
    assert [url for url in page.requests if not url.startswith(known)] == []
    assert not [error for error in page.errors if "Content Security Policy" in error]


def joined(page):
    """How many requests of the page the server has put into its queue."""
    name = "performance.getEntriesByType('resource').filter(e => e.name.includes('/queue/join'))"
    return page.evaluate(f"{name}.filter(e => e.responseEnd > 0).length")


def download(page, folder):
    """What the button gives, unpacked: the folder of files in it."""
    folder.mkdir()
    page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
    page.evaluate("document.querySelector('#take').click()")
    until(lambda: list(folder.glob("*.zip")), lambda: list(folder.iterdir()))
    with zipfile.ZipFile(next(folder.glob("*.zip"))) as archive:
        archive.extractall(folder / "out")
    return folder / "out"


def joints_of(urdf):
    """Joint -> its range, as MuJoCo reads the file."""
    model = mujoco.MjModel.from_xml_path(str(urdf))
    return {model.joint(i).name: model.jnt_range[i].tolist() for i in range(model.njnt)}


def gone(sessions, name, left=0):
    """Until no file has that name and so many pages are open."""
    until(
        lambda: not list(sessions.root.rglob(name)) and len(sessions.all()) <= left,
        lambda: list(sessions.root.rglob("*")),
    )


@pytest.mark.browser
def test_an_example_becomes_an_object_and_a_zip(opened, toy, tmp_path):
    patient(opened, "document.querySelector('#seen')?.innerText.includes('pick an example')")
    assert opened.evaluate("document.querySelector('#make').disabled")
    patient(opened, "document.querySelector('#examples button img') !== null")
    opened.evaluate("document.querySelector('#examples button img').click()")
    patient(opened, "document.querySelectorAll('#seen img').length === 2")
    patient(opened, "[...document.querySelectorAll('#seen img')].every(i => i.naturalWidth > 100)")
    assert "2 parts, 1 of them moves" in text(opened, "#seen")
    make(opened)
    assert toy.pipeline.asked[-1]["seed"] == 0 and toy.pipeline.asked[-1]["steps"] is None
    assert toy.pipeline.asked[-1]["layout"].parents == (1, -1)  # as it was read, not as its text
    assert "1 drawer" in text(opened, "#objects") and "checks passed" in text(opened, "#checks")
    assert opened.evaluate("document.querySelectorAll('#stages li.done').length") == 8
    assert move_slider(opened, "drawer_1") == pytest.approx(0.3, abs=0.01)
    out = download(opened, tmp_path / "taken")
    (urdf,) = out.rglob("object.urdf")
    assert joints_of(urdf)["drawer_1_joint"][1] == pytest.approx(0.3, abs=0.01)


@pytest.mark.browser
def test_bad_uploads_are_one_sentence(opened, tmp_path):
    bad = {
        "words.png": (b"these are words", "not an image"),
        "empty.png": (b"", "the file is empty"),
        "half.png": (OVEN.read_bytes()[:3000], "truncated or damaged"),
        "x.svg": (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "not an image"),
    }
    for name, (data, says) in bad.items():
        (tmp_path / name).write_bytes(data)
        upload(opened, tmp_path / name)
        trouble = "document.querySelector('#seen .ua-trouble')"
        patient(opened, f"{trouble}?.innerText.includes({json.dumps(name)})")
        told = text(opened, "#seen .ua-trouble")
        assert told.startswith(f"image '{name}': {says}") and "\n" not in told
        assert opened.evaluate("document.querySelector('#make').disabled")
    huge = tmp_path / "huge.png"
    with huge.open("wb") as file:
        file.truncate(65 * 1024**2)
    upload(opened, huge)  # Gradio itself refuses it
    patient(opened, "document.body.innerText.includes('exceed the maximum allowed size')")
    upload(opened, OVEN)  # and it goes on
    patient(opened, "document.querySelectorAll('#seen img').length === 2")


@pytest.mark.browser
def test_a_second_request_waits_and_files_go_with_their_page(opened, toy, tmp_path):
    mine = tmp_path / "mine.png"
    Image.open(OVEN).resize((90, 90)).save(mine)
    toy.pipeline.go.clear()
    asked = len(toy.pipeline.asked)
    try:
        upload(opened, mine)
        patient(opened, "!document.querySelector('#make').disabled")
        with chromium(tmp_path / "other") as other:
            show(other, toy.address)
            upload(other, OVEN)
            patient(other, "!document.querySelector('#make').disabled")
            press(opened)
            now = "document.querySelector('#stages li.now')?.innerText"
            patient(opened, f"{now}?.startsWith('Which voxels')")
            before = joined(other)
            press(other)
            until(lambda: joined(other) > before, lambda: other.requests)
            assert "Waiting for its turn" in text(other, "#stages")
            assert text(opened, "#stages li.now").startswith("Which voxels")
            assert len(toy.pipeline.asked) == asked + 1
            toy.pipeline.go.set()
            for page in (opened, other):
                patient(page, "document.querySelector('#objects iframe') !== null")
            assert len(toy.pipeline.asked) == asked + 2
    finally:
        toy.pipeline.go.set()
    assert list(toy.sessions.root.rglob("mine.png"))
    opened.open("about:blank")
    gone(toy.sessions, "mine.png")
    assert not list(toy.sessions.made.iterdir())
    assert list(toy.sessions.root.rglob("oven.png"))  # an example


@pytest.mark.browser
def test_an_upload_whose_turn_never_came_goes_with_its_page(opened, toy, tmp_path):
    late = tmp_path / "late.png"
    Image.open(OVEN).resize((80, 80)).save(late)
    toy.pipeline.go.clear()
    try:
        upload(opened, OVEN)
        press(opened)
        patient(opened, "document.querySelector('#stages li.now') !== null")
        with chromium(tmp_path / "other") as other:
            show(other, toy.address)
            upload(other, late)
            names = lambda: [f.name for s in toy.sessions.all() for f in s.uploads]  # noqa: E731
            until(lambda: "late.png" in names(), names)
        gone(toy.sessions, "late.png", left=1)  # while the model is still busy with the other page
        assert opened.evaluate("document.querySelector('#objects iframe') === null")
    finally:
        toy.pipeline.go.set()


@pytest.mark.browser
def test_a_table_is_edited_or_stands_alone(opened, toy):
    table = "document.querySelector('#table textarea')?.value"
    upload(opened, OVEN)
    patient(opened, "document.querySelectorAll('#seen img').length === 2")
    opened.evaluate("document.querySelector('#table button').click()")
    patient(opened, f"{table}?.includes('drawer_1')")
    read = opened.evaluate(table)
    write(opened, read[:-1])
    patient(opened, "document.querySelector('#seen .ua-trouble') !== null")
    assert "not valid JSON" in text(opened, "#seen .ua-trouble")
    patient(opened, "document.querySelector('#make').disabled")
    write(opened, read.replace("drawer_1", "tray"))
    patient(opened, "document.querySelector('#seen .ua-parts')?.innerText.includes('tray')")
    make(opened)
    assert toy.pipeline.asked[-1]["layout"].names == ("part_0", "tray")
    examples = "[...document.querySelectorAll('#table button')]"
    opened.evaluate(f"{examples}.find(b => b.innerText.trim() === 'chest').click()")
    patient(opened, "document.querySelector('#seen')?.innerText.includes('Plain picture')")
    patient(opened, "document.querySelector('#picture input[type=file]') !== null")
    patient(opened, "document.querySelector('#objects iframe') === null")
    assert '"lid"' in opened.evaluate(table) and "lid" in text(opened, "#seen .ua-parts")
    make(opened)
    assert toy.pipeline.asked[-1]["layout"].names == ("body", "lid")
    upload(opened, OVEN)
    patient(opened, f"{table}.includes('drawer_1')")
    patient(opened, "document.querySelector('#seen')?.innerText.includes('as they are read')")


@needs_gradio
def test_work_for_a_page_that_was_left_stops(tmp_path):
    from uniart_jax.app.page import Desk

    sessions, pipeline = Sessions(tmp_path), ToyPipeline()
    desk, request = Desk(pipeline, sessions, "toy"), SimpleNamespace(session_hash="one")
    payload = {"path": str(shutil.copy(OVEN, tmp_path))}
    pipeline.go.clear()
    told = desk.make(payload, 1, 0, None, None, "auto", False, "", request)
    for stage in ("Looking", "Which voxels"):
        assert re.search(f'class="now"[^>]*>{stage}', next(told)[0])
    desk.leave(request)
    assert sessions.made.is_dir() and list(sessions.made.iterdir())
    pipeline.go.set()
    assert "Left" in next(told)[0]
    until(lambda: not list(sessions.made.iterdir()), lambda: list(sessions.made.iterdir()))


@needs_gradio
def test_fields_that_cannot_be_are_a_sentence(tmp_path):
    from uniart_jax.app.page import Desk

    desk = Desk(ToyPipeline(), Sessions(tmp_path), "toy")
    request = SimpleNamespace(session_hash="one")
    fields = [{"path": "/etc/hostname"}, 9, 0, None, None, "auto", False, ""]
    (told,) = desk.make(*fields, request)
    assert "samples: give 1 to 4" in told[0] and 'role="alert"' in told[0]
    fields[1] = 1
    *_, told = desk.make(*fields, request)
    assert "not one that was uploaded" in told[0] and told[4].interactive


@needs_gradio
def test_files_of_the_machine_are_not_given(toy, tmp_path):
    (tmp_path / "secret.html").write_text("secret")
    for path in (tmp_path / "secret.html", Path("/etc/hostname"), toy.sessions.made):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{toy.address}gradio_api/file={path}", timeout=PATIENCE)
        assert refused.value.code in (403, 404)
    named = urllib.request.Request(toy.address, headers={"Host": "example.com"})
    with pytest.raises(urllib.error.HTTPError) as refused:  # a name that points here
        urllib.request.urlopen(named, timeout=PATIENCE)
    assert refused.value.code == 400


@shipped
@needs_gradio
@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.timeout(2400)  # it loads and compiles all networks
def test_the_program_from_a_picture_to_a_simulator(tmp_path):
    """``uniart app`` with the shipped weights: upload, object, slider, zip, MuJoCo; then its
    end."""
    command = [sys.executable, "-m", "uniart_jax", "app", "--port", "7950", "--no-browser"]
    files = tmp_path / "tmp"
    files.mkdir()
    process = subprocess.Popen(
        command,
        env={**os.environ, "TMPDIR": str(files)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said.startswith("uniart: http://127.0.0.1:79"), process.communicate(timeout=30)
        address = said.split()[1]
        with chromium(tmp_path / "profile") as page:
            show(page, address)
            upload(page, OVEN)
            patient(page, "document.querySelectorAll('#seen img').length === 2", 600)
            make(page, 1200)
            assert "door" in text(page, "#objects")
            opening = move_slider(page, "door_1")
            assert opening > 1
            out = download(page, tmp_path / "taken")
            check_requests(page, address)
        ranges = joints_of(out / "oven" / "object.urdf")
        assert ranges["door_1_joint"][1] == pytest.approx(opening, abs=1e-3)
        assert list(files.glob("uniart-app-*"))
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=PATIENCE)
        assert process.returncode == 143 and "Traceback" not in err
        assert not list(files.glob("uniart-app-*"))
    finally:
        process.kill()
