"""A headless Chromium for tests: the DevTools protocol over a pipe, no package needed.

Found as $CHROMIUM, ``chromium``, ``chromium-browser``, ``google-chrome`` or ``chrome``; without one
a test is skipped with the command that installs it.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import io
import itertools
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# WebGL in software; nothing that talks to a network by itself
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
]
PATIENCE = 300.0  # seconds until an answer counts as lost: software rendering on a busy machine


def find_chromium() -> str:
    """The program; skips the test without it."""
    candidates = [os.environ.get("CHROMIUM", ""), *NAMES]
    found = next((path for c in candidates if c and (path := shutil.which(c))), None)
    if found is None:
        pytest.skip("needs Chromium: apt-get install chromium (or CHROMIUM=/path/to/chrome)")
    return found


class Page:
    """One browser tab. ``errors`` gathers what goes wrong in it, ``requests`` every address that it
    asks for."""

    def __init__(self, write: int, read: int):
        self.write, self.read = write, read
        self.buffer = b""
        self.numbers = itertools.count(1)
        self.session: str | None = None
        self.loaded = False
        self.errors: list[str] = []
        self.requests: list[str] = []

    def open(self, url: str) -> None:
        """Load an address and wait for it."""
        if self.session is None:
            target = self.call("Target.createTarget", url="about:blank")["targetId"]
            attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
            self.session = attached["sessionId"]
            for domain in ("Page", "Runtime", "Network", "Log"):
                self.call(f"{domain}.enable")
        self.loaded = False
        self.call("Page.navigate", url=url)
        end = time.monotonic() + PATIENCE
        while not self.loaded:
            self._hear(end)

    def call(self, method: str, **parameters) -> dict:
        """One DevTools command and its answer."""
        number = next(self.numbers)
        message: dict = {"id": number, "method": method, "params": parameters}
        if self.session is not None:
            message["sessionId"] = self.session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self.write, data) :]
        end = time.monotonic() + PATIENCE
        while True:
            answer = self._hear(end)
            if answer.get("id") == number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def evaluate(self, code: str):
        """The value of a JavaScript expression; promises are awaited."""
        result = self.call(
            "Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, condition: str) -> None:
        """Until a JavaScript expression holds."""
        end = time.monotonic() + PATIENCE
        while not self.evaluate(condition):
            assert time.monotonic() < end, f"never came true: {condition}; {self.errors}"
            time.sleep(0.05)

    def window(self, width: int, height: int, *, dark: bool = False) -> None:
        """The size of the window and its colour scheme."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def mouse(self, kind: str, x: float, y: float, **more) -> None:
        """ "mousePressed", "mouseMoved" or "mouseReleased" at a pixel."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def screenshot(self) -> np.ndarray:
        """[h, w, 3] uint8, after what was asked for has been drawn."""
        self.evaluate(
            "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(() => r(1))))"
        )
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def _hear(self, end: float) -> dict:
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.read], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"Chromium did not answer within {PATIENCE:.0f} s; {self.errors}"
            data = os.read(self.read, 1 << 20)
            assert data, "Chromium ended"
            self.buffer += data
        line, _, self.buffer = self.buffer.partition(b"\0")
        message = json.loads(line)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, event: dict) -> None:
        if method == "Page.loadEventFired":
            self.loaded = True
        elif method == "Network.requestWillBeSent":
            self.requests.append(event["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(event["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(str(event["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and event["type"] in ("error", "warning"):
            self.errors.append(str([a.get("value") for a in event["args"]]))
        elif method == "Log.entryAdded" and event["entry"]["level"] == "error":
            self.errors.append(event["entry"]["text"])


@contextlib.contextmanager
def chromium(profile: Path) -> Iterator[Page]:
    """A browser with an empty profile in the folder ``profile``, ended with the block."""
    program = find_chromium()
    their_read, write = os.pipe()
    read, their_write = os.pipe()
    # the protocol is spoken on descriptors 3 and 4; ours are first moved out of the way of those
    inherited = [fcntl.fcntl(number, fcntl.F_DUPFD, 10) for number in (their_read, their_write)]
    os.close(their_read)
    os.close(their_write)
    move = (
        f"import os, sys; os.dup2({inherited[0]}, 3); os.dup2({inherited[1]}, 4); "
        "os.execv(sys.argv[1], sys.argv[1:])"
    )
    command = [sys.executable, "-S", "-c", move, program, *FLAGS, f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        command,
        pass_fds=inherited,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    for number in inherited:
        os.close(number)
    page = Page(write, read)
    try:
        yield page
        page.session = None
        page.call("Browser.close")
    finally:
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, 9)
            process.wait()
        os.close(write)
        os.close(read)
