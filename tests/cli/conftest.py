"""The program as its users run it, and a chest to run it on."""

import sys

import pytest
import trimesh

from uniart_jax import cli
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


@pytest.fixture
def run(monkeypatch, capsys):
    """``uniart`` with arguments: its exit code, what it wrote to stdout and to stderr."""

    def call(*arguments) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["uniart", *map(str, arguments)])
        with pytest.raises(SystemExit) as done:
            cli.main()
        out, err = capsys.readouterr()
        return int(done.value.code or 0), out, err

    return call


@pytest.fixture(scope="session")
def chest():
    """A closed block with a lid hinged at its back edge; a negative angle turns the lid into the
    block."""

    def make(angle: float = 1.4) -> ArticulatedObject:
        block = trimesh.creation.box(bounds=[[-0.3, -0.4, -0.3], [0.3, 0.4, 0.2]])
        lid = trimesh.creation.box(bounds=[[-0.3, -0.4, 0.205], [0.3, 0.4, 0.25]])
        joint = Joint([0.3, 0, 0.205], [0, 1, 0], (min(angle, 0), max(angle, 0)))
        return ArticulatedObject((Part("block", block), Part("lid", lid, 0, joint)), name="chest")

    return make
