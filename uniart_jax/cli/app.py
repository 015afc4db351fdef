"""``uniart app``: a page where a picture becomes an object."""

from __future__ import annotations

from uniart_jax.runtime.progress import messages, working


def app(checkpoint: str = "nano", port: int = 7860, browser: bool = True) -> None:
    """Open a page where a picture becomes an object with sliders (pip install 'uniart_jax[app]').
    Ctrl-C ends it.

    Args:
        checkpoint: "nano" (shipped), a folder written by training, a training WORKDIR, or
            hf:ORG/NAME of the Hugging Face hub (pip install 'uniart_jax[hub]').
        port: Where the page is served, on this machine alone; the next free one if it is taken.
        browser: Open the page in a browser.
    """
    from uniart_jax.app.serve import start
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    enable_compilation_cache()
    with working(messages(), "loading the model"):
        server = start(checkpoint, port)
    server.wait(open_browser=browser)
