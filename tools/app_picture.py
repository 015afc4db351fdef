"""The picture of the page in docs/app.md: `uniart app` in headless Chromium.

    python tools/app_picture.py docs/app.png [--image FILE] [--joint door_1] [--open .75]

The image is dropped on the page, the object made with the page's defaults, and one of its joints
moved by its slider. Two minutes on one core. Needs Gradio (the extra ``app``) and Chromium
(tests/chromium.py says where it is looked for).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "app")]

from chromium import Page, chromium  # noqa: E402
from driven_page import make, patient, show, upload  # noqa: E402

WIDTH = 1280  # pixels of the page
LONGEST = 1800.0  # seconds until the object counts as lost: all networks are loaded and compiled
FRAME = "document.querySelector('#objects iframe')"


def picture(address: str, image: Path, joint: str, share: float) -> Image.Image:
    """The whole page at an address, once an image has become an object and a joint was moved.

    Args:
      share: of the joint's range, from its lower end.
    """
    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile)) as page:
        show(page, address)
        page.window(WIDTH, 1000)
        upload(page, image)
        patient(page, "document.querySelectorAll('#seen img').length === 2", LONGEST)
        make(page, LONGEST)
        patient(page, "document.querySelector('#checks').innerText.includes('checks')")
        open_joint(page, joint, share)
        height = page.evaluate("document.querySelector('#checks').getBoundingClientRect().bottom")
        page.window(WIDTH, round(height + page.evaluate("scrollY")) + 24)
        page.evaluate("new Promise(done => setTimeout(done, 3000))")  # the object is drawn anew
        return Image.fromarray(page.screenshot())


def open_joint(page: Page, joint: str, share: float) -> None:
    """Its slider is moved, and axes are shown.

    Raises:
      ValueError: the object has no such joint.
    """
    within = f"{FRAME}.contentWindow.document"
    slider = f"{within}.querySelector('input[name={joint}]')"
    if not page.evaluate(f"{slider} !== null"):
        there = page.evaluate(f"Object.keys({FRAME}.contentWindow.viewer.joints()).join(', ')")
        raise ValueError(f"--joint {joint}: there are {there}")
    page.evaluate(
        f"(s => {{ s.value = +s.min + {share} * (s.max - s.min);"
        " s.dispatchEvent(new Event('input', {bubbles: true})); })"
        f"({slider})"
    )
    page.evaluate(f"{within}.querySelector('#axes').click()")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--image", type=Path, default=ROOT / "examples/photograph.jpg")
    parser.add_argument("--joint", default="door_1", help="the one that is moved")
    parser.add_argument("--open", type=float, default=0.75, help="share of its range")
    given = parser.parse_args()
    from uniart_jax.app.serve import start
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    enable_compilation_cache()
    server = start()
    try:
        shot = picture(server.address, given.image.resolve(), given.joint, given.open)
    except ValueError as error:
        parser.error(str(error))
    finally:
        server.stop()
    # small; colours of few pixels are kept, which the usual method drops
    palette = shot.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    palette.save(given.out, optimize=True)
    print(f"{given.out}: {shot.width}x{shot.height}")


if __name__ == "__main__":
    main()
