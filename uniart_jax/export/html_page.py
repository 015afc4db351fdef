"""HTML pages in one file: a template with ``{{holes}}``, and hashes for a policy (CSP) under which
nothing runs and nothing is styled but what the page itself holds."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping


def fill(template: str, holes: Mapping[str, str]) -> str:
    """The template with ``{{name}}`` replaced by ``holes[name]``, which is taken as it is: HTML.

    Raises:
      KeyError: a hole without content.
    """
    return re.sub(r"\{\{(\w+)\}\}", lambda hole: holes[hole[1]], template)


def content_hash(text: str) -> str:
    """A source expression that allows a script or style; its line ends must stay "\\n"."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
