"""Layouts from a vision-language model: any program that is shown a picture and a prompt."""

import json
import sys

import numpy as np
import pytest
from PIL import Image
from test_answers import CHEST

from uniart_jax.inference.ask_layout import APART, _guess, ask_command, ask_layout, prompt
from uniart_jax.inference.camera_fit import _convex_pieces, outline
from uniart_jax.voxels.layout import Layout

CAMERA = np.array([np.sin(0.6), np.cos(0.6), 0.35, 1.5, 0.33, 0.0, 0.0])


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    """[H, W, 4] of a chest, cut out."""
    closed = json.loads(json.dumps(CHEST | {"schema": 1, "units": "m"}))
    closed.pop("view")
    shape = _convex_pieces(Layout.from_json(json.dumps(closed)).normalized()[0])
    image = np.full((128, 128, 4), 200, np.uint8)
    image[..., 3] = 255 * outline(CAMERA, shape, 128)
    return image


def test_a_layout_is_told_and_gets_the_camera_of_the_picture(picture):
    shown = []

    def model(text, path):
        with Image.open(path) as image:
            shown.append((text, image.size, image.getpixel((0, 0)), path.name))
        return json.dumps(CHEST)

    layout = ask_layout(picture, model, CAMERA, name="chest")
    assert shown == [(prompt(), (768, 768), (235, 235, 235), "chest.png")]
    assert layout.names == ("body", "lid") and not layout.metres
    assert layout.size == pytest.approx(1.02, rel=0.2)
    assert layout.joints[1].angle == pytest.approx((-0.7, 0.8))
    assert np.abs(layout.camera[:3] - CAMERA[:3]).max() < 0.2


def test_a_model_is_asked_again_with_what_was_wrong(picture):
    answers, asked, said = ["{}", "no", json.dumps(CHEST)], [], []

    def model(text, path):
        asked.append(text)
        return answers[len(asked) - 1]

    assert len(ask_layout(picture, model, say=said.append)) == 2
    assert said == ["layout: there is no JSON object"] * 2
    assert asked[0] == prompt() and "could not be used: layout: there is no JSON" in asked[1]
    assert asked[2].rstrip().endswith("no")
    with pytest.raises(ValueError, match="ask: the model's answer is no text, but NoneType"):
        ask_layout(picture, lambda text, path: None)
    with pytest.raises(ValueError, match="the last: layout: 2 parts; give 1 at most"):
        ask_layout(picture, lambda text, path: json.dumps(CHEST), most=1)
    long = []
    with pytest.raises(ValueError, match="3 answers"):
        ask_layout(picture, lambda text, path: long.append(len(text)) or "x" * 300_000)
    assert max(long) < 40_000
    with pytest.raises(ValueError, match="ask: 3 answers were no layout; the last: layout: there"):
        ask_layout(picture, lambda text, path: "no")


def test_the_guess_is_a_mean_unless_network_and_model_are_far_apart():
    angles = lambda code: np.array([np.arctan2(code[0], code[1]), code[2]])  # noqa: E731
    seen = angles(CAMERA)
    np.testing.assert_allclose(angles(_guess(seen + 0.3, CAMERA)), seen + 0.1)
    far = seen + [APART + 0.1, 0.2]
    np.testing.assert_allclose(angles(_guess(far, CAMERA)), far)
    np.testing.assert_allclose(angles(_guess(far, None)), far)
    assert _guess(None, CAMERA) is CAMERA and _guess(None, None) is None
    behind = np.array(
        [np.sin(3.1), np.cos(3.1), 0.2, 1, 0.3, 0, 0]
    )  # across the seam at 180 degrees
    across = angles(_guess((-3.0, 0.2), behind))[0]
    assert np.cos(across - (3.1 + (2 * np.pi - 6.1) / 3)) == pytest.approx(1)


def test_a_program_is_a_model(tmp_path):
    script = tmp_path / "model.py"
    script.write_text("import sys\nprint(sys.argv[1:], sys.stdin.read())\n")
    told = ask_command(f"{sys.executable} {script} -a {{image}}")("a prompt", tmp_path / "x y.png")
    assert told == f"['-a', '{tmp_path}/x y.png'] a prompt\n"
    told = ask_command(f"{sys.executable} {script} {{prompt}} {{image}}")("two words", tmp_path)
    assert told == f"['two words', '{tmp_path}'] \n"


def test_what_goes_wrong_with_a_program_is_said_in_one_line(tmp_path):
    with pytest.raises(ValueError, match="give a command"):
        ask_command("  ")
    with pytest.raises(ValueError, match="is no command"):
        ask_command("llm 'a")
    with pytest.raises(FileNotFoundError, match="there is no program 'no-such-program'"):
        ask_command("no-such-program {image}")("prompt", tmp_path)
    fails = f"{sys.executable} -c \"import sys; sys.exit('no key\\nwas set')\""
    with pytest.raises(ValueError, match="ended with 1: no key was set"):
        ask_command(fails)("prompt", tmp_path)
    (tmp_path / "text").write_text("no program")
    for cannot in (tmp_path, tmp_path / "text"):
        with pytest.raises(ValueError, match="cannot be run"):
            ask_command(str(cannot))("prompt", tmp_path)
    latin = f"{sys.executable} -c \"import sys; sys.stdout.buffer.write(b'\\xff')\""
    assert ask_command(latin)("prompt", tmp_path) == "\ufffd"
    sleeps = f'{sys.executable} -c "import time; time.sleep(60)"'
    with pytest.raises(ValueError, match=r"gave no answer in 0\.2 s"):
        ask_command(sleeps, timeout=0.2)("prompt", tmp_path)
