"""What README, docs and benchmarks show runs as it stands there; their links lead somewhere."""

import importlib.util
import os
import re
from pathlib import Path

import jax
import numpy as np
import pytest

from uniart_jax import __version__
from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.stages import STAGES
from uniart_jax.voxels.typed_batches import PictureBatch

ROOT = Path(__file__).parent.parent


PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", FENCED.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_page_is_in_the_menu_of_the_documentation():
    menu = re.findall(r"^ +- ([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)
    assert {page.name for page in (ROOT / "docs").glob("*.md")} <= set(menu)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_relative_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", FENCED.sub("", page.read_text())):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_pages_named_in_code_exist():
    sources = [
        path
        for folder in ("uniart_jax", "configs", "tests", "benchmarks", "tools", "examples")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    named = {name for path in sources for name in re.findall(r"docs/\w+\.md", path.read_text())}
    assert "docs/architecture.md" in named
    assert not {name for name in named if not (ROOT / name).is_file()}


def test_the_index_lists_every_page():
    listed = set(re.findall(r"\]\((\w+\.md)\)", (ROOT / "docs" / "index.md").read_text()))
    assert listed | {"index.md"} == {page.name for page in (ROOT / "docs").glob("*.md")}


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().split()) <= 900


def test_the_headers_of_configs_are_short():
    for path in sorted((ROOT / "configs").rglob("*.py")):
        header = path.read_text().split('"""')[1].splitlines()
        assert len(header) <= 12 and max(map(len, header)) <= 100, path.name


def test_the_shipped_model_is_that_of_its_config():
    shipped = Checkpoint(ROOT / "uniart_jax" / "pretrained" / "nano").config
    config = load_config(ROOT / "configs" / "nano.py")
    for part in ("model", "sample_structure", "sample_latent"):
        assert getattr(shipped, part) == getattr(config, part), part


def test_the_research_example(monkeypatch):
    section = (ROOT / "docs" / "architecture.md").read_text().split("## Research")[1]
    section = section.split("\n## ")[0]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    monkeypatch.chdir(ROOT)
    names: dict = {}
    exec(code, names)
    assert names["velocity"].shape == names["x"].shape


def test_the_loss_of_ones_own_of_the_tutorial(monkeypatch, tmp_path):
    section = (ROOT / "docs" / "tutorial.md").read_text().split("## 9. A loss of your own")[1]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    stage, training = code.split("config = ua.config(", 1)
    for name, value in STAGES.items():
        monkeypatch.setitem(STAGES, name, value)  # and put back
    names: dict = {}
    exec(stage, names)
    config = load_config("debug")
    assert type(STAGES["structure_vae"]) is names["Focal"] and len(STAGES) == 7
    network = build("structure_vae", config.model)
    loss = STAGES["structure_vae"].loss(network, config, tmp_path, {})
    batch = PictureBatch(occupancy=np.zeros((2, *(config.model.grid.resolution,) * 3), bool))
    step = jax.value_and_grad(loss, has_aux=True)
    (value, logged), _ = jax.eval_shape(step, network.abstract(), batch, jax.random.key(0))
    assert value.shape == () and set(logged) == {"focal", "kl"}
    assert training.rstrip().endswith('"runs/focal").fit("structure_vae")')


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n == "latent_flow" else pytest.mark.slow) for n in NETWORKS],
)
def test_benchmark_cases_fit_the_networks(name):
    path = ROOT / "benchmarks" / "networks.py"
    spec = importlib.util.spec_from_file_location("networks", path)
    assert spec is not None and spec.loader is not None
    networks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(networks)
    model = load_config(ROOT / "configs" / "nano.py").model
    network, loss, inputs = networks.case(name, model, 1)
    assert jax.eval_shape(loss, network.abstract(), *inputs).shape == ()


def test_the_version_to_cite_is_the_packages():
    text = (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^version: (.*)$", text, re.MULTILINE)[1] == __version__
    assert re.search(r"^license: (.*)$", text, re.MULTILINE)[1] == "Apache-2.0"
    assert f"\n## {__version__}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.fixture
def try_docs(monkeypatch):
    """``make try-docs`` runs all commands; here it is only tested what it takes for one."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    return importlib.import_module("try_docs")


def test_the_commands_of_the_documents_are_found_and_most_of_them_run(try_docs):
    text = (
        "a\n\n```\nuniart prepare x \\\n  --out y   # why\n```\n\n```\nsome output\n```\n\n"
        "```python\nprint(1)\n```\nwords\n\n```\nno output\n```\n"
    )
    shell, python = try_docs.commands("d.md", text)
    assert shell == ("d.md", 4, "uniart prepare x --out y", False, 0.0, "some output\n")
    assert python == ("d.md", 13, "print(1)\n", True, 0.0, "")
    found = [c for d in try_docs.DOCUMENTS for c in try_docs.commands(d, (ROOT / d).read_text())]
    assert {c.document for c in found} == set(try_docs.DOCUMENTS)
    tried = [c for c in found if not c.left_out]
    run = {c.text.split("\n")[0] for c in tried}
    assert "python train.py --config configs/debug.py" in run
    assert "uniart layout examples/images/oven.png --out out/layout" in run
    assert "uniart export ASSET --out OUT --size 0.8" in run  # with stand-ins
    assert len(tried) >= 32
    assert [f"{c.document}:{c.line}" for c in tried if not c.stated] == []  # no time beside it
    assert sum(bool(c.shown) for c in tried) >= 13
    long = [c for c in found if re.search("hours|of its own|sets up", c.left_out)]
    readme = [c for c in long if c.document == "README.md"]
    assert len(readme) >= 6 and all(c.stated for c in readme)


def test_output_is_held_against_what_a_document_shows(try_docs):
    said = "  a  hinge: 1.50 rad\nloss 2.0  0.3 samples/s\n"
    assert try_docs.missing("a hinge: 1.55 rad\nloss 2.1  9.1 samples/s\n", said) == []
    for shown in ("a hinge: 1.75 rad", "a knob: 1.50 rad", "a hinge: 1.50 rad, 2", "a hinge: rad"):
        assert try_docs.missing(f"loss 2.0  1 samples/s\n{shown}\n", said) == [shown]
    assert try_docs.missing("error 0.004, 1e-4\n", "error 0.005, 1e-4\n") == []
    for said in ("error 0.02, 1e-4", "error 0.004, 1e-2"):
        assert try_docs.missing("error 0.004, 1e-4\n", said) == ["error 0.004, 1e-4"]
    assert try_docs.missing("5 parts\n", "# parts\n") == ["5 parts"]


def test_a_command_is_run_with_stand_ins_and_its_failure_is_told(try_docs, tmp_path):
    environment = {"PYTHONPATH": str(ROOT), "PATH": os.defpath}
    shell = try_docs.Command("d.md", 1, "echo ASSET --out OUT; exit 3", False)
    told = try_docs.run(shell, tmp_path, environment)
    assert told.code == 3 and told.said == "out/sample --out out/of-ones-own\n"
    assert told.took > 0 and told.processors >= 0
    piped = try_docs.Command("d.md", 1, "(echo a; exit 3) | cat", False)
    assert try_docs.run(piped, tmp_path, environment).code == 3
    python = try_docs.Command("d.md", 1, "ua.nothing = 3\nx.show()\nprint(ua.nothing)", True)
    told = try_docs.run(python, tmp_path, environment)
    assert told.code == 0 and told.said == "3\n"


@pytest.mark.parametrize(
    ("line", "stated"),
    [
        ("python x.py --count 9 s   # 28 s", 28),
        ("x  # 40 s: every stage, four steps", 40),
        ("y = 3  # about 2 minutes, once", 120),
        ("x  # 6 hours: all stages", 21600),
        ("x --steps 30", 0),
        ("x  # why 4 of them", 0),
    ],
)
def test_times_stated_beside_commands(try_docs, line, stated):
    assert try_docs.seconds(line) == stated
