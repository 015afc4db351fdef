"""Checkpoints of the Hugging Face hub: ``hf:ORG/NAME`` or ``hf:ORG/NAME@REVISION``."""

from __future__ import annotations

from pathlib import Path

PREFIX = "hf:"
FILES = ("config.json", "*.safetensors", "export/config.json", "export/*.safetensors")


def hub_folder(checkpoint: str) -> Path:
    """The folder of a checkpoint in the hub's cache; what is missing there is downloaded.

    Only configs and safetensors are taken, so nothing in it can run. Cache, access token and
    offline mode are the hub's own (HF_HOME, HF_TOKEN, HF_HUB_OFFLINE).

    Raises:
      ValueError: the name is not hf:ORG/NAME, or huggingface_hub is not installed.
      FileNotFoundError: there is no such checkpoint, or it cannot be reached.
    """
    name, _, revision = checkpoint.removeprefix(PREFIX).partition("@")
    if name.count("/") != 1 or not all(name.split("/")):
        raise ValueError(f"checkpoint '{checkpoint}': give hf:ORG/NAME, or hf:ORG/NAME@REVISION")
    try:
        from huggingface_hub import snapshot_download
    except ImportError:
        raise ValueError(
            f"checkpoint '{checkpoint}': needs huggingface_hub: pip install 'uniart_jax[hub]'"
        ) from None
    try:
        return Path(snapshot_download(name, revision=revision or None, allow_patterns=list(FILES)))
    except Exception as error:  # its own kinds, and those of its HTTP library
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise FileNotFoundError(
            f"checkpoint '{checkpoint}': not on the hub or not reachable ({why})"
        ) from error
