"""The page on this machine: its address, its files, its end."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import socket
import tempfile
import threading
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from uniart_jax.app.sessions import SWEEP, Sessions

HOST = "127.0.0.1"
PORTS = 100  # that are tried, from the one that was asked for
LARGEST = "64mb"  # of an upload
# Neither the page nor what it shows may ask another machine for anything.
POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; frame-ancestors 'self'; form-action 'self'; base-uri 'self'"
)
QUIET = {
    "GRADIO_ANALYTICS_ENABLED": "False",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "DO_NOT_TRACK": "1",
}


def has_gradio() -> bool:
    """Whether the extra ``app`` is installed."""
    return importlib.util.find_spec("gradio") is not None


def start(checkpoint: str = "nano", port: int = 7860) -> Server:
    """Load a model and serve its page to this machine alone, until ``Server.stop``.

    Args:
      checkpoint: what ``pipeline.load`` takes.
      port: the first to try; the next free one is taken.

    Raises:
      ValueError: Gradio is not installed, or no port is free. FileNotFoundError, ValueError: of the
        checkpoint.
    """
    if not has_gradio():
        raise ValueError("app: needs Gradio: pip install 'uniart-jax[app]'")
    free = free_port(port)
    from uniart_jax.pipeline import load

    return Server(load(checkpoint), checkpoint, free)


class Server:
    """A running page. ``address``: where. ``sessions``: everybody's files."""

    def __init__(self, pipeline: Any, checkpoint: str, port: int):
        self.sessions = Sessions(Path(tempfile.mkdtemp(prefix="uniart-app-")))
        self.address = f"http://{HOST}:{port}/"
        try:
            self._blocks = _launch(pipeline, self.sessions, checkpoint, port)
        except BaseException:
            self.sessions.close_all(0)
            raise
        self._ended = threading.Event()
        threading.Thread(target=self._sweeps, daemon=True, name="uniart-app-sweeps").start()

    def wait(self, open_browser: bool = True) -> None:
        """Say the address, open it, and go on until Ctrl-C or a signal ends it; then ``stop``."""
        try:
            print(f"uniart: {self.address}  (Ctrl-C stops)", flush=True)
            if open_browser:
                webbrowser.open(self.address)
            threading.Event().wait()
        except KeyboardInterrupt:
            print("stopped")
        finally:
            self.stop()

    def stop(self) -> None:
        """End the page and remove all files."""
        self._ended.set()
        self._blocks.close(verbose=False)
        self.sessions.close_all()

    def _sweeps(self) -> None:
        while not self._ended.wait(SWEEP):
            with contextlib.suppress(OSError):  # a file that another thread removes meanwhile
                self.sessions.sweep()


def free_port(first: int) -> int:
    """The first port from ``first`` that nobody listens to on this machine.

    Raises:
      ValueError: no port of that number, or none of ``PORTS`` is free.
    """
    if not 1 <= first <= 65535:
        raise ValueError(f"app: --port must be in 1..65535, got {first}")
    for port in range(first, min(first + PORTS, 65536)):
        with socket.socket() as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((HOST, port))
            except OSError:
                continue
            return port
    raise ValueError(f"app: no port from {first} on is free; choose another --port")


def _launch(pipeline: Any, sessions: Sessions, checkpoint: str, port: int) -> Any:
    """The page, running; Gradio learns where its files go before it is imported."""
    os.environ.update(QUIET, GRADIO_TEMP_DIR=str(sessions.root))
    direct = {*filter(None, os.environ.get("NO_PROXY", "").split(",")), HOST}
    os.environ["NO_PROXY"] = os.environ["no_proxy"] = ",".join(sorted(direct))
    import gradio as gr
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware

    from uniart_jax.app.page import Desk, build

    blocks = build(Desk(pipeline, sessions, checkpoint))
    sessions.keep_present()
    system = ("system-ui", "-apple-system", "Segoe UI", "Roboto", "Arial", "sans-serif")
    mono = ("ui-monospace", "Consolas", "monospace")
    origins = [f"http://{name}:{port}" for name in (HOST, "localhost")]
    blocks.launch(
        server_name=HOST,
        server_port=port,
        share=False,
        inbrowser=False,
        prevent_thread_lock=True,
        quiet=True,
        show_error=True,
        footer_links=[],
        run_history=False,
        enable_monitoring=False,
        ssr_mode=False,
        mcp_server=False,
        pwa=False,
        max_file_size=LARGEST,
        allowed_paths=[str(sessions.made)],
        app_kwargs={
            "middleware": [
                Middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"]),
                Middleware(WithPolicy, origins=origins),
            ],
            "docs_url": None,
            "openapi_url": None,
            "redoc_url": None,
        },
        theme=gr.themes.Default(
            primary_hue="blue",
            font=[gr.themes.Font(name) for name in system],
            font_mono=[gr.themes.Font(name) for name in mono],
        ).set(block_info_text_color="*neutral_500", body_text_color_subdued="*neutral_500"),
        css=(Path(__file__).parent / "page.css").read_text("utf-8"),
    )
    return blocks


class WithPolicy:
    """ASGI middleware: every answer says what its page may load (``POLICY``), and pages of other
    origins are refused, which could upload files otherwise (a form needs no permission)."""

    def __init__(self, app: Any, origins: Sequence[str] = ()):
        self.app, self.origins = app, {origin.encode() for origin in origins}

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        asked = [v for k, v in scope.get("headers", ()) if k == b"origin"]
        if self.origins and scope["type"] == "http" and not self.origins.issuperset(asked):
            head = [(b"content-type", b"text/plain")]
            await send({"type": "http.response.start", "status": 403, "headers": head})
            await send({"type": "http.response.body", "body": b"another page's request"})
            return

        async def said(message: Any) -> None:
            if message["type"] == "http.response.start":
                policy = (b"content-security-policy", POLICY.encode())
                message = {**message, "headers": [*message.get("headers", ()), policy]}
            await send(message)

        await self.app(scope, receive, said if scope["type"] == "http" else send)
