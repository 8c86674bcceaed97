"""Where things stand: imports go one way, modules have names of their own, numba in engine/."""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from agents import NEEDED

ROOT = Path(__file__).parents[1]
WORKSHOP = "workshop/jansen_workshop"
ORDER = (
    ["arrays", "checks", "files", "cli.loading", "cli.process", "registration", "uniform"],
    ["engine"],
    ["robot", "terrain"],
    ["dynamics"],
    ["plants"],
    ["world"],
    ["tasks.task", "tasks.information"],
    ["policies.pid", "policies.policy"],
    ["scoring.metrics"],
    ["envs"],
    ["tasks"],
    ["policies"],
    ["scoring"],
    ["sb3", "viewer", "paper"],
    ["cli"],
    ["__main__"],
    ["jansen_workshop"],
    ["agents.training"],
    ["agents.pack"],
    ["agents.export"],
    ["agents"],  # the other commands
    ["benchmarks", "examples", "experiments", "train"],
)
"""Parts of the project: each may import those of its own line and of lines above."""
RANK = {part: rank for rank, parts in enumerate(ORDER) for part in parts}
FILES = [
    path
    for folder in ("jansen_env", "agents", "benchmarks", "examples", "experiments", WORKSHOP)
    for path in sorted((ROOT / folder).rglob("*.py"))
    if path != ROOT / "jansen_env" / "__init__.py"  # what users import, from everywhere
] + [ROOT / "train.py"]


def part_of(module: str) -> str | None:
    """The part that a module belongs to; None for one of another project."""
    if module in ("agents", "agents.need"):  # whose modules are named beside it
        return None
    names = [name for name in module.split(".") if name != "jansen_env"]
    for part in (".".join(names[:2]), *names[:1]):
        if part in RANK:
            return part
    return None


def imported(path: Path) -> set[str]:
    """All modules that a file imports, also within functions."""
    modules = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules.add(node.module)
            modules |= {f"{node.module}.{name.name}" for name in node.names}
    return modules


def test_agents_ask_for_all_packages_that_they_import():
    """Packages that the package itself needs are exempt, and those that have extras of
    their own.
    """
    paths = [path for path in FILES if path.is_relative_to(ROOT / "agents")]
    packages = {name.split(".")[0] for path in paths for name in imported(path)}
    others = {"agents", "jansen_env", "jansen_workshop"}
    others |= {"gymnasium", "numpy", "safetensors", "typing_extensions"}
    others |= {"jinja2", "onnx", "onnxruntime", "pymoo", "pandas", "ray"}
    assert packages - others - sys.stdlib_module_names <= {*NEEDED}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_in_one_direction(path):
    root = ROOT / "workshop" if path.is_relative_to(ROOT / "workshop") else ROOT
    relative = path.relative_to(root)
    part = part_of(".".join(relative.with_suffix("").parts))
    assert part is not None, "a part that ORDER does not name"
    wrong = [m for m in imported(path) if RANK.get(part_of(m) or "", 0) > RANK[part]]
    assert not wrong


def test_modules_have_names_of_their_own():
    tests = [path for path in (ROOT / "tests").rglob("*.py") if path.name != "conftest.py"]
    names = Counter(path.name for path in [*FILES, *tests])
    assert [n for n, count in names.items() if count > 1 and not n.startswith("__")] == []


def test_numba_is_for_the_build_alone():
    for path in FILES:
        uses = {"llvmlite", "numba"} & {module.split(".")[0] for module in imported(path)}
        assert not uses or path == ROOT / "jansen_env" / "engine" / "build.py"


def test_walking_does_not_import_numba():
    code = (
        "import sys, gymnasium, jansen_env; env = gymnasium.make('JansenWalker-v0'); env.reset();"
        "env.step([0.0]); sys.exit('numba' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
