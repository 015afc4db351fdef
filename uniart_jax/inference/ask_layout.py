"""Layouts from a vision-language model: any program that is shown a picture and a prompt, and
answers. Its answer is read, refused where it is wrong, and gets the camera that fits the picture.

The layout network knows the families that it was trained on; a vision-language model knows what a
faucet is, and what it can do.
"""

from __future__ import annotations

import functools
import shlex
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

import numpy as np
from PIL import Image

from uniart_jax.data.images import MARGIN, crop
from uniart_jax.inference.answers import read_answer
from uniart_jax.inference.camera_fit import USUAL, with_camera
from uniart_jax.voxels.layout import MOST_PARTS, Layout

SIDE = 768  # pixels of the picture that is shown
TRIES = 3  # answers that are asked for, where they cannot be used
APART = np.radians(40.0)  # between the views of network and model: the model's is taken
TRUST = 2.0  # weight of the network's view, the model's 1, where they are nearer
GRAY = 235
ECHOED = 20_000  # characters of an answer that the model is shown again
AGAIN = (
    "Your last answer, below, could not be used: {problem}. Answer once more, with the whole JSON."
)
Ask = Callable[[str, Path], str]  # prompt and picture -> answer


def prompt() -> str:
    """What a model is asked."""
    return resources.files("uniart_jax.inference").joinpath("layout_prompt.md").read_text("utf-8")


def ask_command(line: str, timeout: float = 600.0) -> Ask:
    """A program as a model: ``{image}`` in its words is the picture's path, ``{name}`` that of its
    file without suffix, ``{prompt}`` the prompt, which it gets on its standard input else. It runs
    without a shell.

    Raises:
      ValueError: the line is no command; from the model: the program fails, or takes too long.
      FileNotFoundError: from the model: there is no such program.
    """
    try:
        words = shlex.split(line)
    except ValueError as error:
        raise ValueError(f"ask: '{line}' is no command ({error})") from None
    if not words:
        raise ValueError('ask: give a command, such as "llm -a {image}"')

    def ask(text: str, picture: Path) -> str:
        told = any("{prompt}" in word for word in words)
        values = {"{image}": str(picture), "{name}": picture.stem, "{prompt}": text}
        filled = [functools.reduce(lambda w, v: w.replace(*v), values.items(), w) for w in words]
        try:
            done = subprocess.run(
                filled, input=None if told else text, capture_output=True,
                encoding="utf-8", errors="replace",
                timeout=timeout, check=False, stdin=subprocess.DEVNULL if told else None,
            )  # fmt: skip
        except FileNotFoundError:
            raise FileNotFoundError(f"ask: there is no program '{words[0]}'") from None
        except OSError as error:
            raise ValueError(f"ask: '{words[0]}' cannot be run ({error.strerror})") from None
        except subprocess.TimeoutExpired:
            raise ValueError(f"ask: '{words[0]}' gave no answer in {timeout:g} s") from None
        if done.returncode:
            said = " ".join((done.stderr or done.stdout).split())[-300:]
            raise ValueError(f"ask: '{words[0]}' ended with {done.returncode}: {said}")
        return done.stdout

    return ask


def ask_layout(
    cut_out: np.ndarray,
    ask: Ask,
    guess: np.ndarray | None = None,
    margin: float = MARGIN,
    say: Callable[[str], None] = lambda problem: None,
    name: str = "picture",
    most: int = MOST_PARTS,
) -> Layout:
    """The layout of an object that a vision-language model tells.

    Args:
      cut_out: [H, W, 4] uint8, the object cut out. ask: the model; it is asked again, with what is
        wrong, where its answer is no layout. guess: the layout network's camera code [7], or None.
      margin: of the crop that networks see (``data.images.crop``). say: called with what was wrong.
      name: of the picture's file, without its suffix. most: parts that are taken.

    Returns:
      In object units, as the picture shows it, with its camera, its size and the parts' names.

    Raises:
      ValueError: none of ``TRIES`` answers is a layout. What ``ask`` raises.
    """
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / f"{Path(name).name}.png"
        shown_picture(cut_out, margin).save(picture)
        answer = _answer(picture, ask, say, most)
    return told_layout(answer, cut_out, guess, margin, most)


def told_layout(
    text: str,
    cut_out: np.ndarray,
    guess: np.ndarray | None = None,
    margin: float = MARGIN,
    most: int = MOST_PARTS,
) -> Layout:
    """``ask_layout`` of an answer that is there already.

    Raises:
      ValueError: one line that says what is wrong with it.
    """
    layout, view = read_answer(text, most)
    return with_camera(layout, cut_out, _guess(view, guess), margin)


def shown_picture(cut_out: np.ndarray, margin: float = MARGIN) -> Image.Image:
    """What the model sees: the square crop of an image [H, W, 4] uint8, over light gray, so that it
    is plain which object is meant."""
    return Image.fromarray(crop(cut_out, SIDE, margin, GRAY))


def _answer(picture: Path, ask: Ask, say: Callable[[str], None], most: int) -> str:
    """The first answer that is a layout."""
    text, problem = prompt(), ""
    for _ in range(TRIES):
        told = ask(text, picture)
        if not isinstance(told, str):
            raise ValueError(f"ask: the model's answer is no text, but {type(told).__name__}")
        try:
            read_answer(told, most)
            return told
        except ValueError as error:
            problem = str(error)
            say(problem)
            text = f"{prompt()}\n{AGAIN.format(problem=problem)}\n\n{told.strip()[:ECHOED]}\n"
    raise ValueError(f"ask: {TRIES} answers were no layout; the last: {problem}")


def _guess(told: Sequence[float] | None, seen: np.ndarray | None) -> np.ndarray | None:
    """A camera code [7]: the network's, its azimuth and elevation drawn to what the model tells, or
    those that the model tells where they are far apart."""
    if told is None:
        return seen
    azimuth, elevation = told
    if seen is None:
        return np.array([np.sin(azimuth), np.cos(azimuth), elevation, 1.0, USUAL, 0.0, 0.0])
    apart = np.remainder(azimuth - np.arctan2(seen[0], seen[1]) + np.pi, 2 * np.pi) - np.pi
    if abs(apart) <= APART:
        share = TRUST / (1 + TRUST)
        azimuth, elevation = azimuth - share * apart, (1 - share) * elevation + share * seen[2]
    return np.array([np.sin(azimuth), np.cos(azimuth), elevation, *seen[3:]])
