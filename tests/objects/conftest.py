"""Reading a URDF written in the test itself."""

from __future__ import annotations

import pytest
from urdf_texts import robot

from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject


@pytest.fixture
def load(tmp_path):
    """Write a URDF's text and read it."""

    def read(*elements: str, **options) -> ArticulatedObject:
        text = elements[0] if elements[0].startswith(("<?", "<robot", "<!")) else robot(*elements)
        (tmp_path / "a.urdf").write_text(text)
        return load_object(tmp_path / "a.urdf", **options)

    return read


@pytest.fixture
def refuse(load):
    """The one line with which a URDF is refused."""

    def read(*elements: str, **options) -> str:
        with pytest.raises(ValueError) as caught:
            load(*elements, **options)
        line = str(caught.value)
        assert "\n" not in line and "a.urdf" in line
        return line

    return read


@pytest.fixture
def load_mjcf(tmp_path):
    def read(text: str, **options) -> ArticulatedObject:
        (tmp_path / "a.xml").write_text(text)
        return load_object(tmp_path / "a.xml", **options)

    return read


@pytest.fixture
def refuse_mjcf(load_mjcf):
    def read(text: str, **options) -> str:
        with pytest.raises(ValueError) as caught:
            load_mjcf(text, **options)
        line = str(caught.value)
        assert "\n" not in line and "a.xml" in line
        return line

    return read
