"""The page of ``uniart app`` in a browser, used as a person does: for its tests, and for the
picture of it in the documentation (``tools/app_picture.py``)."""

from __future__ import annotations

import json
import time

PATIENCE = 300.0  # seconds until something counts as lost: one slow core, which others use too


def show(page, address):
    page.open("about:blank")
    page.window(1400, 1000)
    page.open(address)
    page.wait("document.querySelector('#make') !== null")
    page.wait("document.querySelector('#picture input[type=file]') !== null")


def upload(page, file):
    page.evaluate("document.querySelector('#picture button[aria-label*=lear]')?.click()")
    page.wait("document.querySelector('#picture input[type=file]') !== null")
    found = page.call(
        "Runtime.evaluate", expression="document.querySelector('#picture input[type=file]')"
    )
    page.call("DOM.setFileInputFiles", files=[str(file)], objectId=found["result"]["objectId"])


def until(holds, told, seconds=PATIENCE):
    """Wait for ``holds()``; ``told()`` says what there is instead."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, told()
        time.sleep(0.1)


def patient(page, condition, seconds=PATIENCE):
    told = lambda: f"never came true: {condition}; {text(page, 'body')}"  # noqa: E731
    until(lambda: page.evaluate(condition), told, seconds)


def text(page, selector):
    return page.evaluate(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''")


def press(page):
    """The button, once it can be pressed."""
    patient(page, "!document.querySelector('#make').disabled")
    page.evaluate("document.querySelector('#make').click()")


def make(page, seconds=PATIENCE):
    press(page)
    patient(page, "document.querySelector('#objects iframe') !== null", seconds)
    frames = "[...document.querySelectorAll('#objects iframe')]"
    patient(page, f"{frames}.every(f => f.contentWindow.viewer)", seconds)


def write(page, words):
    """The table's text, as one who types it and then clicks elsewhere."""
    page.evaluate(
        "(words => { const box = document.querySelector('#table textarea'); box.focus();"
        "Object.getOwnPropertyDescriptor(HTMLTextAreaElement.prototype, 'value').set"
        ".call(box, words); box.dispatchEvent(new Event('input', {bubbles: true})); box.blur(); })"
        f"({json.dumps(words)})"
    )


def move_slider(page, name):
    """A joint to its upper end by the keyboard, inside the object's frame -> its coordinate."""
    frame = "document.querySelector('#objects iframe').contentWindow"
    page.evaluate(f"{frame}.document.querySelector('input[name={name}]').focus()")
    for kind in ("keyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=kind, key="End", code="End", windowsVirtualKeyCode=35
        )
    return page.evaluate(f"{frame}.viewer.joints().{name}")
