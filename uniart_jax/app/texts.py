"""What the page shows, as HTML: pictures, stages, objects with their sliders, checks, sentences.

All that comes from files or people is escaped. Classes are those of ``page.css``.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from uniart_jax.app.check_words import CheckLine, check_groups, verdict_lines
from uniart_jax.app.making import STAGES, Analysis, Made
from uniart_jax.app.part_words import ReadPart, read_parts
from uniart_jax.export.words import counted
from uniart_jax.voxels.kind import kind_of

FILES = "gradio_api/file="  # where Gradio serves files, relative to the page
CUT_OUT = {
    "alpha": "The picture says itself what is the object.",
    "plain": "A plain background was cut away.",
    "rembg": "Cut out by rembg; look whether it is right.",
    "network": "Cut out by the model's mask network; look whether it is right.",
    "grabcut": "Cut out by GrabCut; look whether it is right.",
    "table": "Made of the table's boxes; it is all that the model is shown.",
    "none": "Nothing was cut away: the whole picture counts as the object. Cut the object out for "
    "a better result, or pip install 'uniart_jax[photo]'.",
}


def file_address(path: Path) -> str:
    """Where the page finds a file of its session."""
    return FILES + quote(path.as_posix(), safe="/:")


def sentence_html(text: str) -> str:
    """What went wrong, for the place where a result would be."""
    return f'<p class="ua-trouble" role="alert">{html.escape(text)}</p>'


def look_html(seen: Analysis) -> str:
    """The cut-out and, beside it, the parts as they are read, or as a table says."""
    alone = seen.picture is None
    told = CUT_OUT.get(seen.way, "")
    if seen.background == "keep" and seen.way == "none":
        told = "Nothing is cut away, as asked."
    alt, title = "The object, cut out of the picture", "Cut-out"
    if alone:
        alt, title = "The table's boxes as a plain picture", "Plain picture"
    figures = [_figure(seen.shown, alt, title, told)]
    if seen.drawn is not None and seen.layout is not None:
        alt = "The parts' boxes and joint axes, drawn over the picture"
        told = "Boxes; axes in white; the way that each moving part goes."
        title = "Parts of the table" if seen.edited else "Parts as they are read"
        figures.append(_figure(seen.drawn, alt, title, told))
        layout = seen.layout.normalized()[0] if alone else seen.layout
        figures.append(_parts_html(str(kind_of(layout)), read_parts(layout), not alone))
    else:
        figures.append('<p class="ua-soft">This checkpoint reads no parts ahead.</p>')
    return f'<div class="ua-look">{"".join(figures)}</div>'


def hint_html(checkpoint: str) -> str:
    """What stands where the picture will be looked at, before there is one."""
    known = (
        "This model is small and knows furniture and appliances, seen from the front; expect "
        "little of photographs and of other things."
    )
    told = f" {known}" if checkpoint == "nano" else ""
    start = (
        "Drop a picture of one object on the left, or pick an example; or give a table of parts."
    )
    return f'<p class="ua-hint">{start}{told}</p>'


def stages_html(planned: Mapping[str, int], begun: Mapping[str, int], now: str | None) -> str:
    """The stages in order: those that are over, the one that goes on (``now``) and those to come.

    Args:
      planned: stage -> how often it comes. begun: stage -> how often it has begun. now: the stage
        that goes on; None: all are over.
    """
    items = []
    for stage, times in planned.items():
        count = begun.get(stage, 0)
        over = count - (stage == now)
        state = "now" if stage == now else "done" if over >= times or now is None else "ahead"
        several = f" <small>{count} of {times}</small>" if times > 1 and count else ""
        current = ' aria-current="step"' if stage == now else ""
        items.append(f'<li class="{state}"{current}>{html.escape(STAGES[stage])}{several}</li>')
    over = sum(begun.values()) - (now is not None)
    percent = 100 if now is None else round(100 * over / max(sum(planned.values()), 1))
    bar = (
        f'<div class="ua-bar" role="progressbar" aria-label="Progress" aria-valuenow="{percent}">'
        f'<i style="width:{percent}%"></i></div>'
    )
    return f'<div class="ua-stages">{bar}<ol>{"".join(items)}</ol></div>'


def waiting_html() -> str:
    """What stands in the stages' place until a request's turn comes."""
    return '<p class="ua-soft" role="status">Waiting for its turn: one picture at a time.</p>'


def objects_html(made: Sequence[Made]) -> str:
    """Each object's offline page, side by side, with what was found and the sum of its checks."""
    cards = []
    for one in made:
        page = file_address(one.folder / "view.html")
        title = f"The object of seed {one.seed}, with a slider for every joint"
        lines = "".join(_line(line) for line in verdict_lines(one.report.get("validation")))
        cards.append(
            f'<section class="ua-object"><iframe src="{html.escape(page)}" title="{title}">'
            f"</iframe><p><b>{html.escape(_upper(one.found))}</b> "
            f'<span class="ua-soft">{counted(len(one.report["parts"]), "part")}, seed {one.seed}'
            f"</span></p><ul>{lines}</ul></section>"
        )
    many = " ua-many" if len(made) > 1 else ""
    return f'<div class="ua-objects{many}">{"".join(cards)}</div>'


def checks_html(made: Sequence[Made], failed: Sequence[str]) -> str:
    """Every check of every object in plain words, failed ones first, and samples that could not be
    made."""
    blocks = [sentence_html(f"Not made: {line}") for line in failed]
    for one in made:
        found = one.report.get("validation")
        if not found:
            continue
        groups = "".join(
            f"<section><h4>{html.escape(_upper(title))}</h4>"
            f"<ul>{''.join(_line(line) for line in lines)}</ul></section>"
            for title, lines in check_groups(found).items()
        )
        several = f", seed {one.seed}" if len(made) > 1 else ""
        checks = [check for group in found.values() for check in group.values()]
        passed = sum(bool(check["passed"]) for check in checks)
        told = f"{passed} of {len(checks)} checks passed{several}"
        opened = " open" if passed < len(checks) else ""
        blocks.append(
            f'<details class="ua-checks"{opened}><summary>{told}</summary>'
            f'<div class="ua-groups">{groups}</div></details>'
        )
    return "".join(blocks)


def _line(line: CheckLine) -> str:
    why = f'<span class="ua-why">{html.escape(line.reason)}</span>' if line.reason else ""
    state, word = ("pass", "passed: ") if line.passed else ("fail", "failed: ")
    hidden = (
        f'<span class="ua-hidden">{word}</span>'  # the mark is a colour and a sign of the style
    )
    return f'<li class="ua-{state}">{hidden}{html.escape(line.asks)}{why}</li>'


def _figure(path: Path, alt: str, title: str, told: str) -> str:
    return (
        f'<figure><img src="{html.escape(file_address(path))}" alt="{html.escape(alt)}">'
        f"<figcaption><b>{html.escape(title)}</b> {html.escape(told)}</figcaption></figure>"
    )


def _parts_html(kind: str, parts: Sequence[ReadPart], sure: bool) -> str:
    """``sure``: also how sure the network is."""
    confidence = [f"confidence {part.confidence:.2f}" if sure else "" for part in parts]
    rows = "".join(
        f'<li><i style="background:{part.color}"></i><b>{html.escape(part.name)}</b>'
        f'<span class="ua-soft">{told}</span>'
        f"<span>{html.escape(part.motion)}</span></li>"
        for part, told in zip(parts, confidence, strict=True)
    )
    moving = sum(part.moves for part in parts)
    moves = f"{moving} of them {'moves' if moving == 1 else 'move'}"
    title = f"{_upper(kind)}: {counted(len(parts), 'part')}, {moves}"
    return f'<section class="ua-parts"><h4>{title}</h4><ul>{rows}</ul></section>'


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
