"""``uniart app``: a page on this machine where a picture, or a table, becomes an object.

    page (Gradio) -> making: look at the picture, make objects, a zip -> texts (HTML) -> page
    table: the parts as text that people edit (table_box: where it stands)
    sessions: whose files are whose, and when they are removed

Only ``page``, ``table_box`` and ``serve`` import Gradio (the extra ``app``).
"""
