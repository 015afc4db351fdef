"""A module imports only from layers below its own, and light packages stay light."""

import ast
import functools
import graphlib
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "uniart_jax"
LAYERS = [
    {"objects", "runtime"},
    {"config", "procedural"},
    {"flow", "nn"},
    {"voxels"},
    {"models", "visual"},
    {"data"},
    {"export"},
    {"simulation", "weights"},
    {"inference"},
    {"pipeline", "training"},
    {"evaluation", "precompute"},
    {"app", "stages"},
    {"experiments"},
    {"cli"},
    {"__main__"},
]
LAYER = {name: level for level, names in enumerate(LAYERS) for name in names}
# The only upward imports, by decision: people expect ``save``, ``show`` and ``validate`` on an
# object. They are inside the methods, so that objects load without writers and simulators.
LAZY = {
    ("objects/object.py", f"uniart_jax.{module}")
    for module in ("export.asset", "export.show", "simulation.validate")
}
OF_THE_PACKAGE = {"__file__", "__version__"}
NO_JAX = ["objects", "voxels", "procedural", "data", "export", "simulation"]
BARE = ["nn", "models", "flow", "training"]

FILES = sorted(p for p in PACKAGE.rglob("*.py") if p.relative_to(PACKAGE).parts != ("__init__.py",))


def module_of(path: Path) -> str:
    """The name under which a file of the package is imported."""
    parts = ("uniart_jax", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


MODULES = {module_of(path) for path in FILES}


@functools.cache
def imports(path: Path) -> list[str]:
    """Modules that a file imports, wherever in it; of ``from a import b`` it is a.b where that is
    a module. ``from uniart_jax import x`` and ``uniart_jax.x`` are always uniart_jax.x."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.module and node.level == 0, f"{path}: imports are absolute"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                inside = node.module == "uniart_jax" or name in MODULES
                found.append(name if inside else node.module)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "uniart_jax":
            found.append(f"uniart_jax.{node.attr}")
    return found


def test_every_folder_has_one_layer():
    folders = {module.split(".")[1] for module in MODULES}
    assert sorted(name for names in LAYERS for name in names) == sorted(folders)
    listed = " → ".join(", ".join(f"`{name}`" for name in sorted(names)) for names in LAYERS)
    assert listed in (PACKAGE.parent / "docs/architecture.md").read_text()


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_point_downwards(path):
    name = str(path.relative_to(PACKAGE))
    own = module_of(path).split(".")[1]
    for module in imports(path):
        if not module.startswith("uniart_jax.") or (name, module) in LAZY:
            continue
        other = module.split(".")[1]
        if other == own or other in OF_THE_PACKAGE:
            continue
        assert other in LAYER, f"{name}: import {other} from the module that has it"
        assert LAYER[other] < LAYER[own], (
            f"{name} imports {module} from layer {LAYER[other]}, its own is {LAYER[own]}"
        )


def test_the_imports_that_point_upwards_are_still_there():
    for name, module in LAZY:
        assert module in imports(PACKAGE / name), f"{name} no longer imports {module}"


def test_no_imports_go_in_a_circle():
    graph = {
        module_of(path): {
            module
            for module in imports(path)
            if module in MODULES and (str(path.relative_to(PACKAGE)), module) not in LAZY
        }
        for path in FILES
    }
    graphlib.TopologicalSorter(graph).prepare()  # CycleError names the modules


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
        module_of(p)
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
