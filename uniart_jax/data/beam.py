"""Prepared folders made by Apache Beam: one element a shard, so any runner gives the bytes that the
workers here give.

``OUT`` and the assets must be paths that every worker sees (a shared or mounted file system). The
package must be installed on the workers.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
from collections.abc import Sequence
from pathlib import Path

from uniart_jax.data.folder import Settings
from uniart_jax.data.prepare import make_shard
from uniart_jax.data.sources import Entry


def run_beam(
    out: Path,
    settings: Settings,
    shards: list[tuple[int, Sequence[Entry]]],
    options: Sequence[str] = (),
) -> None:
    """Make shards by a Beam pipeline and wait for it; give it to ``prepare(run=...)``.

    An object that crashes its worker fails its shard, and with it the run, as the runner decides;
    the workers of ``prepare`` itself survive that.

    Args:
      options: of the pipeline, as Beam's own command lines take them (``--runner=FlinkRunner``,
        ...); default: the direct runner.

    Raises:
      ValueError: Beam is not installed.
    """
    check_beam()
    import apache_beam as beam
    from apache_beam.options.pipeline_options import PipelineOptions, SetupOptions

    if settings.root:
        settings = dataclasses.replace(settings, root=str(Path(settings.root).resolve()))
    settled = PipelineOptions(list(options))
    settled.view_as(SetupOptions).save_main_session = False
    make = functools.partial(_make, out.resolve(), settings)
    with beam.Pipeline(options=settled) as pipeline:
        _ = (
            pipeline
            | "shards" >> beam.Create([(n, list(entries)) for n, entries in shards])
            | "spread" >> beam.Reshuffle()
            | "make" >> beam.Map(make)
        )


def check_beam() -> None:
    """
    Raises:
      ValueError: Beam is not installed.
    """
    if importlib.util.find_spec("apache_beam") is None:
        raise ValueError(
            "prepare: --runner beam needs Apache Beam; install it with: pip install "
            "'uniart_jax[beam]'"
        )


def _make(out: Path, settings: Settings, shard: tuple[int, list[Entry]]) -> int:
    return make_shard(out, settings, *shard)
