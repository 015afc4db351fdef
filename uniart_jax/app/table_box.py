"""Where the page shows the table of parts as text, in Gradio, with tables to begin with."""

from __future__ import annotations

from typing import Any, NamedTuple

import gradio as gr

from uniart_jax.app.examples import example_tables
from uniart_jax.inference.ask_layout import prompt

HOW = (
    "Where the parts that were read are wrong: give this text and the cut-out to any chat model "
    "that takes pictures, and paste its answer into the table above."
)
ASKS = "Paste a table of parts, or take one from below. No picture is needed for it."


class TableBox(NamedTuple):
    """The text, the button that draws what it says, and the examples, where there are any."""

    text: gr.Textbox
    show: gr.Button
    examples: gr.Dataset | None


def table_box() -> TableBox:
    """The accordion, where it is called."""
    with gr.Accordion("Table of parts (edit)", open=False, elem_id="table"):
        text = gr.Textbox(
            lines=14,
            max_lines=14,
            show_label=False,
            placeholder=ASKS,
            container=False,
            elem_classes="ua-table",
        )
        show = gr.Button("Show the table", size="sm", elem_id="show")
        names = [path.stem.replace("_", " ") for path in example_tables()]
        examples = None
        if names:
            examples = gr.Dataset(
                components=[gr.Textbox(visible=False)],
                samples=[[name] for name in names],
                type="index",
                label="Tables without a picture",
                samples_per_page=len(names),
            )
    with gr.Accordion("Ask a model that sees pictures", open=False, elem_id="ask"):
        gr.Markdown(HOW)
        gr.Textbox(
            value=prompt(),
            lines=8,
            max_lines=8,
            show_label=False,
            container=False,
            interactive=False,
            buttons=["copy"],
            elem_classes="ua-table",
        )
    return TableBox(text, show, examples)


def example_text(number: Any) -> str:
    """The example of that number.

    Raises:
      ValueError: there is none.
    """
    paths = example_tables()
    if type(number) is not int or not 0 <= number < len(paths):
        raise ValueError("table: no such example")
    return paths[number].read_text("utf-8")
