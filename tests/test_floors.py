"""A module imports only from floors below its own, and light packages stay light."""

import ast
import functools
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "uniart_jax"
FLOORS = [
    {"runtime"},
    {"config"},
    {"nn", "objects"},
    {"flow", "procedural", "voxels", "visual"},
    {"data", "models"},
    {"export", "weights"},
    {"inference"},
    {"pipeline", "stages", "training", "precompute"},
    {"evaluation", "simulation"},
    {"app", "experiments"},
    {"cli"},
    {"__main__"},
]
FLOOR = {name: level for level, names in enumerate(FLOORS) for name in names}
# Methods that people expect on an object import upwards inside their bodies.
LAZY = {
    ("objects/object.py", f"uniart_jax.{module}")
    for module in ("export.asset", "export.show", "simulation.validate")
}
SAME_FLOOR = {
    ("evaluation", "simulation"),
    ("precompute", "pipeline"),
    ("precompute", "training"),
    ("procedural", "visual"),
    ("procedural", "voxels"),
    ("stages", "pipeline"),
    ("stages", "precompute"),
    ("stages", "training"),
    ("visual", "voxels"),
    ("weights", "export"),
}
NO_JAX = ["objects", "voxels", "procedural", "data", "export", "simulation"]
BARE = ["nn", "models", "flow", "training"]


@functools.cache
def imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.append(node.module)
    return found


def unit(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


FILES = sorted(p for p in PACKAGE.rglob("*.py") if p.relative_to(PACKAGE).parts != ("__init__.py",))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_point_downwards(path):
    name = str(path.relative_to(PACKAGE))
    own = name.split("/")[0].removesuffix(".py")
    assert own in FLOOR, f"{name}: give it a floor in this test"
    for module in imports(path):
        if not module.startswith("uniart_jax.") or (name, module) in LAZY:
            continue
        other = unit(module)
        if other != own and (own, other) not in SAME_FLOOR:
            assert FLOOR[other] < FLOOR[own], (
                f"{name} imports {module} from floor {FLOOR[other]}, its own is {FLOOR[own]}"
            )


def test_no_two_files_import_each_other():
    edges = {
        (
            ".".join(("uniart_jax", *p.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
                ".__init__"
            ),
            m,
        )
        for p in FILES
        for m in imports(p)
        if m.startswith("uniart_jax.")
    }
    both = {
        (a, b)
        for a, b in edges
        if (b, a) in edges
        and a != b
        and (a, b) != ("uniart_jax.objects.object", "uniart_jax.export.asset")
    }
    assert not {pair for pair in both if "uniart_jax.objects.object" not in pair}


def test_data_side_never_names_jax():
    for path in FILES:
        if path.relative_to(PACKAGE).parts[0].removesuffix(".py") in [*NO_JAX, "visual"]:
            assert not [
                m for m in imports(path) if m.split(".")[0] in ("jax", "flax", "optax", "orbax")
            ], path


@pytest.mark.parametrize(
    ("packages", "banned"),
    [(NO_JAX, ["jax"]), (BARE, ["trimesh", "grain", "embreex", "tyro", "igl"])],
    ids=["no-jax", "bare"],
)
def test_what_a_package_may_load(packages, banned):
    has_pybullet = importlib.util.find_spec("pybullet") is not None
    modules = [
        ".".join(("uniart_jax", *p.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
            ".__init__"
        )
        for p in FILES
        if p.relative_to(PACKAGE).parts[0] in packages
        and not any(m.split(".")[0] == "grain" for m in imports(p))  # grain itself loads jax
        and (has_pybullet or "pybullet" not in imports(p))  # an extra
    ]
    code = (
        f"import importlib, sys\nfor m in {modules!r}: importlib.import_module(m)\n"
        f"found = [b for b in {banned!r} if b in sys.modules]\nassert not found, found"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-500:]
