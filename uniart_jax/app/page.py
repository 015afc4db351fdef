"""The page itself, in Gradio: what stands where, and what happens when.

Work runs in a thread of its own and is told stage by stage; one piece of work at a time, whoever
asks. Values come from the frontend as they are (``preprocess=False``): Gradio would open pictures
with every format that Pillow knows, and say what is wrong with them in its own words.
"""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gradio as gr

from uniart_jax.app.examples import example_pictures
from uniart_jax.app.making import (
    MOST_GUIDANCE,
    MOST_SAMPLES,
    MOST_STEPS,
    Analysis,
    Options,
    analyze,
    edited,
    make,
    of_table,
    planned,
    sentence,
    told_of,
    zip_assets,
)
from uniart_jax.app.sessions import Session, Sessions
from uniart_jax.app.table import followed_layout, is_told, is_unchanged, table_text
from uniart_jax.app.table_box import example_text, table_box
from uniart_jax.app.texts import (
    checks_html,
    hint_html,
    look_html,
    objects_html,
    sentence_html,
    stages_html,
    waiting_html,
)
from uniart_jax.pipeline import Pipeline

logger = logging.getLogger(__name__)
MODEL = "model"  # the queue that all work waits in
WAITING = 20  # requests in it at most
TITLE = "uniart"
HEADER = """# uniart
A picture of one object, or a table of its parts, becomes a 3D object whose parts move. All of it
happens on this machine."""


class Left(Exception):
    """The page that asked for the work was left."""


class Desk:
    """What stands behind the page: the model, everybody's files, and the work that is asked for.

    Args:
      checkpoint: the model's name, for reports.
    """

    def __init__(self, pipeline: Pipeline, sessions: Sessions, checkpoint: str):
        self.pipeline, self.sessions, self.checkpoint = pipeline, sessions, checkpoint
        self._turn = threading.Lock()  # work of a page that was left may go on for a moment

    def came(self, payload: Any, request: gr.Request) -> tuple[Any, Any]:
        """A picture was uploaded, and goes with its page even if its turn never comes. Until it was
        looked at, the button does not work, and no table is shown: it would be of another."""
        session = self.sessions.of(str(request.session_hash))
        with contextlib.suppress(ValueError, OSError):  # ``analyze`` tells of it
            self.sessions.take(session, payload)
        return (gr.Button(interactive=False), "") if payload else (gr.skip(), gr.skip())

    def look(
        self, payload: Any, background: Any, table: Any, request: gr.Request
    ) -> tuple[Any, ...]:
        """A picture was chosen or taken away: cut-out and parts, whether the button works, and the
        table that was read; where there is no picture, a table stays if a person wrote it."""
        session = self.sessions.of(str(request.session_hash))
        nothing = ("", "", "", gr.DownloadButton(visible=False))
        if not payload:
            before = session.looked and session.looked.layout
            if before is not None and isinstance(table, str) and is_unchanged(table, before):
                table = ""
            return *self.show(None, background, table, request), *nothing, table
        try:
            seen = self._in_turn(session, lambda: self._seen(session, payload, background))
            text = "" if seen.layout is None else table_text(seen.layout)
        except Exception as error:
            told = sentence_html(self._told(error, payload))
            return told, gr.Button(interactive=False), *nothing, ""
        return look_html(seen), gr.Button(interactive=True), *nothing, text

    def show(
        self, payload: Any, background: Any, table: Any, request: gr.Request
    ) -> tuple[Any, Any]:
        """What the table's text says, drawn and in words, and whether the button works."""
        session = self.sessions.of(str(request.session_hash))
        if not payload and not str(table or "").strip():
            return hint_html(self.checkpoint), gr.Button(interactive=False)
        try:
            work = lambda: self._followed(session, payload, background, table)  # noqa: E731
            seen = self._in_turn(session, work)
        except Exception as error:
            return sentence_html(self._told(error, payload)), gr.Button(interactive=False)
        return look_html(seen), gr.Button(interactive=True)

    def pick(self, number: Any, request: gr.Request) -> tuple[Any, str]:
        """An example of a table was chosen: it is for itself, without the picture."""
        self.sessions.of(str(request.session_hash)).looked = None  # nor is it the picture's table
        return None, example_text(number)

    def make(
        self,
        payload: Any,
        samples: Any,
        seed: Any,
        steps: Any,
        guidance: Any,
        background: Any,
        check: Any,
        table: Any,
        request: gr.Request,
    ) -> Iterator[tuple[Any, ...]]:
        """The button was pressed: the stages as they come, then objects, checks and the zip."""
        session = self.sessions.of(str(request.session_hash))
        ready, busy, skip = gr.Button(interactive=True), gr.Button(interactive=False), gr.skip()
        try:
            options = Options.read(samples, seed, steps, guidance, background, check)
            plan, begun, now = planned(options), Counter[str](), None

            def work(tell: Callable[[str], None]) -> tuple[str, str, Path]:
                return self._made(session, payload, table, options, tell)

            for event in self._told_work(session, work):
                if not isinstance(event, str):
                    objects, checks, file = event
                    break
                now = event
                begun[now] += 1
                yield stages_html(plan, begun, now), skip, skip, skip, busy
            taken = gr.DownloadButton(
                f"Download {file.name} ({file.stat().st_size / 1e6:.1f} MB)",
                value=str(file),
                visible=True,
            )
            yield stages_html(plan, begun, None), objects, checks, taken, ready
        except Exception as error:
            yield sentence_html(self._told(error, payload)), skip, skip, skip, ready

    def leave(self, request: gr.Request) -> None:
        """A page was closed or loaded anew."""
        self.sessions.close(str(request.session_hash))

    def _seen(self, session: Session, payload: Any, background: Any) -> Analysis:
        """What is seen in the picture; of the same one as before, what was seen then."""
        picture = self.sessions.take(session, payload)
        before = session.looked
        if before is not None and (before.picture, before.background) == (picture, background):
            return before
        Options(background=background)  # or an error
        folder = self.sessions.fresh(session, "picture")
        session.looked = analyze(self.pipeline, picture, background, folder)
        return session.looked

    def _followed(self, session: Session, payload: Any, background: Any, table: Any) -> Analysis:
        """What is seen in the picture, if there is one, with the layout that the table's text asks
        for; of the same text as before, what was shown then."""
        seen = self._seen(session, payload, background) if payload else None
        read = None if seen is None else seen.layout
        if seen is not None and not str(table or "").strip():
            return seen
        before = session.followed
        if before is not None and before[0] is seen and before[1] == table:
            return before[2]
        if seen is not None and is_told(table):
            layout = told_of(self.pipeline, seen, table)
        else:
            layout = followed_layout(table, read)
        if seen is not None and layout is read:
            return seen
        folder = self.sessions.fresh(session, "table")
        if seen is None:
            found = of_table(self.pipeline, layout, folder)
        else:
            found = edited(self.pipeline, seen, layout, folder)
        session.followed = seen, table, found
        return found

    def _made(
        self,
        session: Session,
        payload: Any,
        table: Any,
        options: Options,
        tell: Callable[[str], None],
    ) -> tuple[str, str, Path]:
        """HTML of the objects and of their checks, and the zip."""
        tell("look")
        seen = self._followed(session, payload, options.background, table)
        folder = self.sessions.fresh(session, "object")
        made, failed = make(self.pipeline, seen, options, folder, tell, self.checkpoint)
        tell("zip")
        file = zip_assets(made, seen.stem, folder / f"{seen.stem}.zip")
        return objects_html(made), checks_html(made, failed), file

    def _told_work(
        self, session: Session, work: Callable[[Callable[[str], None]], Any]
    ) -> Iterator[Any]:
        """The stages of ``work`` as they begin (text), and then what it gives; what it raises, is
        raised."""
        events: queue.Queue[tuple[str, Any]] = queue.Queue()

        def tell(stage: str) -> None:
            if session.closed:
                raise Left
            events.put(("stage", stage))

        def run() -> None:
            try:
                events.put(("result", self._in_turn(session, lambda: work(tell))))
            except BaseException as error:
                events.put(("error", error))

        threading.Thread(target=run, daemon=True, name="uniart-app-work").start()
        while True:
            kind, value = events.get()
            if kind == "error":
                raise value
            yield value
            if kind == "result":
                return

    def _in_turn(self, session: Session, work: Callable[[], Any]) -> Any:
        with self.sessions.working(session), self._turn:
            if session.closed:
                raise Left
            return work()

    def _told(self, error: Exception, payload: Any) -> str:
        """An error as a sentence; what nobody foresaw is logged with where it was raised."""
        path = payload.get("path") if isinstance(payload, dict) else None
        text = sentence(error, Path(path) if isinstance(path, str) else None)
        if isinstance(error, ValueError | OSError | ArithmeticError | MemoryError):
            logger.info("raised here:", exc_info=error)
            return text
        if not isinstance(error, Left):
            logger.error("the page's work failed", exc_info=error)
        return f"{type(error).__name__}: {text.splitlines()[0][:300]}"


def build(desk: Desk) -> gr.Blocks:
    """The page, to be launched; ``desk`` does what it asks for."""
    flows = desk.pipeline.options()
    alike = "Same seed, same object, on the same machine."
    if any(flow.steps == 1 for flow in flows):
        alike = "The model takes one step, the same for every seed; with more steps they differ."
    with gr.Blocks(title=TITLE, analytics_enabled=False, fill_width=True) as blocks:
        gr.Markdown(f"{HEADER} Model: {desk.checkpoint}.")
        with gr.Row():
            with gr.Column(scale=1, min_width=300):
                picture = gr.Image(
                    type="filepath",
                    image_mode=None,
                    sources=["upload", "clipboard"],
                    label="Picture",
                    height=260,
                    buttons=[],
                    elem_id="picture",
                )
                if pictures := example_pictures():
                    gr.Examples(
                        [[str(path)] for path in pictures],
                        inputs=[picture],
                        label="Examples",
                        examples_per_page=len(pictures),
                        elem_id="examples",
                        api_visibility="private",
                    )
                table = table_box()
                samples = gr.Slider(
                    1,
                    MOST_SAMPLES,
                    value=1,
                    step=1,
                    label="Samples",
                    info="Side by side, with seeds one after the other.",
                )
                seed = gr.Number(0, precision=0, minimum=0, label="Seed", info=alike)
                with gr.Accordion("More options", open=False):
                    own = _own({flow.steps for flow in flows})
                    steps = gr.Number(
                        None,
                        precision=0,
                        minimum=1,
                        maximum=MOST_STEPS,
                        label="Steps",
                        info=f"Empty: the model's own ({own}); four for several samples if one.",
                    )
                    own = f"Empty: the model's own ({_own({flow.guidance for flow in flows})})."
                    guidance = gr.Number(
                        None,
                        minimum=0,
                        maximum=MOST_GUIDANCE,
                        step=0.5,
                        label="Guidance",
                        info=f"How strongly the picture is followed. {own}",
                    )
                    background = gr.Radio(
                        backgrounds(),
                        value="auto",
                        label="Background",
                    )
                    check = gr.Checkbox(True, label="Try it in physics engines")
                button = gr.Button(
                    "Make the object", variant="primary", interactive=False, elem_id="make"
                )
            with gr.Column(scale=3, min_width=320):
                seen = gr.HTML(hint_html(desk.checkpoint), elem_id="seen")
                stages = gr.HTML(elem_id="stages")
                objects = gr.HTML(elem_id="objects")
                take = gr.DownloadButton(
                    "Download", visible=False, variant="primary", elem_id="take"
                )
                checks = gr.HTML(elem_id="checks")
        asked = {"preprocess": False, "api_visibility": "private"}
        worked = {**asked, "concurrency_id": MODEL, "concurrency_limit": 1}
        quiet = {"show_progress": "minimal", "show_progress_on": [seen]}
        looked = {"trigger_mode": "always_last", **worked, **quiet}
        shown = [seen, button, stages, objects, checks, take, table.text]
        told = [picture, background, table.text]
        picture.change(
            desk.came,
            [picture],
            [button, table.text],
            queue=False,
            show_progress="hidden",
            **asked,
        ).then(desk.look, told, shown, **looked)
        background.change(desk.look, told, shown, **looked)
        gr.on([table.show.click, table.text.blur], desk.show, told, [seen, button], **looked)
        if table.examples is not None:
            table.examples.click(
                desk.pick,
                [table.examples],
                [picture, table.text],
                queue=False,
                show_progress="hidden",
                **asked,
            ).then(desk.show, told, [seen, button], **looked)
        button.click(
            lambda: (
                waiting_html(),
                gr.Button(interactive=False),
                gr.DownloadButton(visible=False),
            ),
            outputs=[stages, button, take],
            queue=False,
            show_progress="hidden",
            api_visibility="private",
        ).then(
            desk.make,
            [picture, samples, seed, steps, guidance, background, check, table.text],
            [stages, objects, checks, take, button],
            show_progress="hidden",
            **worked,
        )
        blocks.unload(desk.leave)
    blocks.queue(default_concurrency_limit=1, max_size=WAITING)
    return blocks


def backgrounds() -> list[tuple[str, str]]:
    """What may be done with the background, as it is said and as ``cut_out`` takes it."""
    ways = [("cut it away", "auto"), ("keep it", "keep")]
    if importlib.util.find_spec("rembg") is not None:
        ways.append(("cut it away by rembg", "rembg"))
    return ways


def _own(values: set) -> str:
    return " and ".join(f"{value:g}" for value in sorted(values))
