"""``uniart app``: a page on this machine where a picture becomes an object.

    page (Gradio) -> making: look at the picture, make objects, a zip -> texts (HTML) -> page
    sessions: whose files are whose, and when they are removed

Only ``page`` and ``serve`` import Gradio (the extra ``app``).
"""
