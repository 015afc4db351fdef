"""The ``uniart`` program as a whole: version, help that a person can read, how much is said."""

import dataclasses
import logging
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Literal

import pytest
import tyro

from uniart_jax import __version__, cli
from uniart_jax.cli import COMMANDS
from uniart_jax.cli.arguments import check_written
from uniart_jax.cli.help_texts import field_comments, joined_lines, readable, value_name
from uniart_jax.cli.verbosity import take_verbosity
from uniart_jax.runtime import progress


@pytest.fixture(autouse=True)
def loud():
    """Verbosity is of the process: as it was after each test."""
    logger = logging.getLogger("uniart_jax")
    yield
    progress.be_quiet(False)
    logger.setLevel(logging.NOTSET)


@pytest.fixture
def uniart(monkeypatch, capsys):
    """Runs the program in this process -> exit code, standard output, stderr."""

    def run(*words, program=cli.main):
        monkeypatch.setattr(sys, "argv", ["uniart", *words])
        monkeypatch.setenv("COLUMNS", "100")
        with pytest.raises(SystemExit) as stopped:
            program()
        return stopped.value.code, *capsys.readouterr()

    return run


def test_the_version(uniart):
    assert uniart("--version") == (0, f"uniart_jax {__version__}\n", "")


def test_the_package_is_the_program(uniart):
    def package():
        runpy.run_module("uniart_jax", run_name="__main__")

    assert uniart("--version", program=package) == (0, f"uniart_jax {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("evaluate", "a", "b", "--out", "gs://b/x"), "--out 'gs://b/x'"),
        (("layout", "a.png", "--out=gs://b/x"), "--out 'gs://b/x'"),
        (("train", "--config", "debug", "--workdir", "gs://b/x"), "--workdir 'gs://b/x'"),
        (("train", "--config", "debug", "--init", "gs://b/x"), "checkpoint 'gs://b/x'"),
        (("train", "--config", "debug", "--data.records", "gs://b/x"), "data.records 'gs://b/x'"),
        (("train", "--config", "debug", "--data.layouts", "gs://b/x"), "data.layouts 'gs://b/x'"),
    ],
)
def test_a_bucket_is_refused_before_a_folder_of_its_name_is_made(
    uniart, monkeypatch, tmp_path, words, named
):
    monkeypatch.chdir(tmp_path)
    code, _, told = uniart(*words)
    assert code == 2 and told.startswith(f"error: {named}: ") and "mount the bucket" in told
    assert not list(tmp_path.iterdir())


def test_training_is_a_command_like_others(uniart):
    code, said, _ = uniart("--help")
    assert code == 0 and "• train " in said and "-q" in said and "--version" in said
    code, said, _ = uniart("train", "--help")
    assert code == 0 and said.startswith("usage: uniart train [-h]")
    code, said, _ = uniart("--help", program=cli.train_main)
    assert said.startswith("usage: train.py [-h]")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_for_people(uniart, command):
    code, said, _ = uniart(command, "--help")
    assert code == 0
    assert not [puzzle for puzzle in PUZZLES if puzzle in said]


PUZZLES = ("{None", "{[", "[[", "[STR [", "default: None", "default: )", "default: '')", "``")


def test_the_help_of_a_config_shows_the_commands_options_and_its_fields(uniart):
    code, said, _ = uniart("train", "--config", "nano", "--help")
    assert code == 0 and not [puzzle for puzzle in PUZZLES if puzzle in said]
    own, fields = said.split("usage: uniart train --config nano ")
    assert own.startswith("usage: uniart train [-h]")
    for option in ("--stage {", "--workdir PATH", "--init STR", "--distributed", "--wait FLOAT"):
        assert option in own
    assert "--config NAME, --help lists them" in " ".join(own.split())
    words = " ".join(unboxed(fields).split())
    for line in (  # defaults are the config's, what is said the code's
        "--untrained STR ... --quick-compile",
        "--data.procedural INT objects to prepare in records where it is not there yet (default: ",
        "whose rows its sub-cells then point at (models.layout_decoder); 0 = none (the paper).",
        "--model.image-encoder.stem-channels INT ... each further stage halves; the last gives the "
        "tokens, the one before it what volume cells read (default: 24 48 96)",
        "--mask.betas FLOAT FLOAT (default: 0.9 0.999)",
    ):
        assert line in words


def test_a_field_has_the_comments_above_and_beside_it_alone():
    assert field_comments(Commented) == {
        "first": "Two lines, above. And beside.",
        "third": "Inside, and after.",
        "fourth": "of the base",
    }


def test_no_comment_of_a_config_is_shown_at_the_field_below_it_too(uniart):
    """tyro does so where that has none of its own."""
    fields = unboxed(uniart("train", "--config", "nano", "--help")[1]).split("usage: ")[-1]
    groups = re.split(r" options *\n", fields)[1:]
    assert len(groups) > 20
    for group in groups:
        shown = [" ".join(text.split()) for text in re.split(r"\n *--\w.*", group)[1:]]
        said = [words for text in shown if (words := text.split("(default:")[0]).count(" ") > 2]
        assert len(said) == len(set(said)), group


def unboxed(text):
    """Without the frames of a help, which are of ASCII where standard output is."""
    return re.sub(r"[│╭╮╰╯─]|--+(?= |$)", " ", text, flags=re.MULTILINE)


@dataclasses.dataclass
class Base:
    fourth: int = 4  # of the base


@dataclasses.dataclass
class Commented(Base):
    # Two lines,
    # above.
    first: int = 1  # And beside.
    second: str = "# nothing"
    third: tuple[int, ...] = (
        3,  # Inside,
    )  # and after.


def test_the_usage_names_words_that_are_given_already(uniart):
    whole = uniart("evaluate", "--help")
    assert "|procedural|" in whole[1].splitlines()[0]
    assert uniart("evaluate", "procedural", "--help") == whole
    assert uniart("evaluate", "-h", "PRED", "REF") == whole
    usage = uniart("x.png", "--help", program=cli.sample_main)[1].splitlines()[0]
    assert "PATH" in usage


@pytest.mark.parametrize("words", [("--version",), ("--help",), ("sample", "--help")])
def test_a_reader_that_has_ended_is_no_error(words):
    """As ``uniart --help | head -1``, whether what is printed fits a buffer or not."""
    reads, writes = os.pipe()
    os.close(reads)
    program = [sys.executable, "-m", "uniart_jax", *words]
    done = subprocess.run(program, stdout=writes, stderr=subprocess.PIPE, text=True)
    os.close(writes)
    assert (done.returncode, done.stderr) == (141, "")


def test_other_broken_pipes_are_errors(capsys):
    def fails():
        raise BrokenPipeError("a worker has ended")

    assert cli.exit_on_error(fails) == 2
    assert capsys.readouterr() == ("", "error: a worker has ended\n")


def command(
    images: Annotated[tuple[Path, ...], tyro.conf.Positional],
    /,
    formats: tuple[Literal["a", "b"], ...] | None = None,
    steps: int | None = None,
    size: Annotated[str | None, tyro.conf.arg(help="Metres.", metavar="METRES")] = None,
    names: tuple[str, ...] = (),
    clean: bool = False,
    seed: int = 3,
):
    """What it does."""
    return images, formats, steps, size, names, clean, seed


def test_readable_help_changes_nothing_that_is_parsed(capsys, monkeypatch):
    line = ["x.png", "y.png", "--formats", "b", "a", "--steps", "4", "--names", "u", "--clean"]
    before = [tyro.cli(command, args=args) for args in (line, ["x.png"])]
    plain = readable(command)
    assert [tyro.cli(plain, args=args) for args in (line, ["x.png"])] == before
    assert before[0][:3] == ((Path("x.png"), Path("y.png")), ("b", "a"), 4)
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        tyro.cli(plain, args=["--help"])
    said = capsys.readouterr().out
    for line in (
        "PATH [PATH ...]",
        "--formats {a,b} ...",
        "--steps INT ",
        "--size METRES",
        "--names STR ...",
        "(default: 3)",
        "(required)",
    ):
        assert line in said
    assert said.count("(default: ") == 2  # of --seed and --clean


def test_words_for_values():
    assert value_name(int | None) == "INT"
    assert value_name(tuple[Literal["u", "v"], ...]) == "{u,v} ..."
    assert value_name(Annotated[Path | None, tyro.conf.Positional]) == "[PATH]"
    assert value_name(tuple[float, float]) is None  # tyro's: FLOAT FLOAT
    assert value_name(int) is None and value_name(bool | None) is None


def test_quiet_commands_say_nothing_of_progress(capsys):
    assert take_verbosity(["sample", "-q", "x.png"]) == ["sample", "x.png"]
    assert list(progress.track("ab", "letters", 2)) == ["a", "b"]
    progress.messages().print("done")
    assert capsys.readouterr().err == ""
    assert take_verbosity(["sample"]) == ["sample"]
    progress.messages().print("done")
    assert capsys.readouterr().err == "done\n"


def test_verbose_commands_say_where_an_error_was_raised(uniart, monkeypatch, caplog):
    words = ("sample", "absent.png", "--out", "absent")
    code, _, said = uniart(*words)
    assert code == 2 and said == "error: image 'absent.png': no such file\n"
    assert not caplog.records
    code, _, said = uniart(*words, "--verbose")
    assert code == 2 and said.endswith("error: image 'absent.png': no such file\n")
    assert "read_image" in caplog.text and "Traceback" in caplog.text


def test_quiet_and_verbose_contradict(uniart):
    code, _, said = uniart("-q", "stats", "-v")
    assert code == 2 and said == "error: -q and -v contradict each other; give one of them\n"


def test_help_breaks_lines_where_the_terminal_ends_alone():
    text = """One sentence that
    goes on. Another.

    A second paragraph.

    Args:
        first: What it is,
          over three
          lines.
        second: Short.
    """
    assert joined_lines(text).splitlines() == [
        "One sentence that goes on. Another.",
        "",
        "A second paragraph.",
        "",
        "Args:",
        "    first: What it is, over three lines.",
        "    second: Short.",
    ]


def test_no_words_at_all_are_no_fault():
    check_written([])
    with pytest.raises(ValueError, match="--out"):
        check_written(["sample", "--out", "gs://bucket/run"])
