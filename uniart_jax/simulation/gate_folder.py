"""A published gate over a folder of assets: which pass, and how many pass each rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import uniart_jax
from uniart_jax.data.sources import Entry, find_entries
from uniart_jax.objects.load import NAMES
from uniart_jax.simulation.measure import check
from uniart_jax.simulation.validate import gate, write

Track = Callable[[list[Entry]], Iterable[Entry]]


def assets_below(root: str | Path) -> list[Entry]:
    """The assets below a folder that is none itself, sorted by path; none where ``root`` is an
    asset, a folder with one, or nothing that can be looked at."""
    root = Path(root)
    if not root.is_dir() or any((root / name).is_file() for name in NAMES):
        return []
    try:
        found = find_entries(root, "urdf")
    except FileNotFoundError:
        return []
    alone = len(found) == 1 and (root / found[0].path).parent == root
    return [] if alone and (root / found[0].path).is_file() else found


def gate_folder(
    root: str | Path,
    *,
    name: str = "affordcraft",
    out: Path | None = None,
    allow_outside: bool = False,
    track: Track = iter,
) -> dict:
    """Put all assets below a folder through a gate, one after the other (``validate.gate``).

    Args:
      root: a folder of assets, each a folder or a file (``data.sources.find_entries``).
      name: of the gate.
      out: a folder that takes ``validation.json``; made if it is not there.
      allow_outside: also read what assets name outside their folders.
      track: wraps the assets on their way, for a progress bar.

    Returns:
      JSON values: ``gate``, ``version``; ``assets`` {path: {"passed", "articulated", "checks"
      {rule: verdict}}}; ``passed`` and ``articulated``: how many did and move; ``rules`` {rule:
      [passed, looked at]}. An asset that cannot be read fails ``loads``, with its reason, and the
      rules that need it loaded do not count it.

    Raises:
      FileNotFoundError: there are no assets. ValueError: no such gate, MuJoCo is not installed, or
      ``out`` cannot be written.
    """
    root = Path(root)
    entries = assets_below(root)
    if not entries:
        raise FileNotFoundError(f"validate: '{root}': no folder of several assets")
    assets: dict[str, dict] = {}
    for entry in track(entries):
        try:
            found = gate(root / entry.path, name=name, allow_outside=allow_outside)["gate"]
        except (ValueError, OSError) as error:
            why = " ".join(str(error).split())
            checks = {"loads": check(1, 0, False, why)}
            found = {"passed": False, "articulated": False, "checks": checks}
        assets[entry.key] = {key: found[key] for key in ("passed", "articulated", "checks")}
    rules: dict[str, list[int]] = {}
    for asset in assets.values():
        for rule, verdict in asset["checks"].items():
            counts = rules.setdefault(rule, [0, 0])
            counts[0] += bool(verdict["passed"])
            counts[1] += 1
    result = {
        "gate": name,
        "version": uniart_jax.__version__,
        "passed": sum(asset["passed"] for asset in assets.values()),
        "articulated": sum(asset["articulated"] for asset in assets.values()),
        "rules": rules,
        "assets": assets,
    }
    if out is not None:
        write(result, Path(out))
    return result
