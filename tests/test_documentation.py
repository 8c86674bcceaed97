"""README and documentation: code blocks run, commands and links are of things that exist."""

import functools
import importlib
import re
import runpy
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from jansen_env.__main__ import COMMANDS
from jansen_env.__main__ import main as jansen_env
from jansen_env.robot import ROBOTS
from jansen_env.robot.motor import MOTORS
from jansen_workshop.__main__ import main as jansen_workshop

ROOT = Path(__file__).parents[1]
SCRIPTS = {"jansen-env": jansen_env, "jansen-workshop": jansen_workshop}
PATTERNS = ("*.md", "*/README.md", "workshop/*/README.md", "docs/**/*.md", ".github/**/*.md")
PAGES = sorted(path for pattern in PATTERNS for path in ROOT.glob(pattern))
SLOW = {"export", "judging", "loads", "policies", "predictions", "training"}
"""Pages whose Python takes more than a second."""
IDS = [str(page.relative_to(ROOT)) for page in PAGES]
NOW = [page for page in PAGES if page.name != "CHANGELOG.md"]  # pages of what is, not of what was


def blocks(page: Path, language: str) -> Iterator[tuple[int, str]]:
    """The fenced code blocks of a page in a language, with the lines they begin at."""
    text = page.read_text(encoding="utf-8")
    for match in re.finditer(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        yield text[: match.start(1)].count("\n"), match[1]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] * (page.stem in SLOW), id=page.stem)
        for page in PAGES
        if any(blocks(page, "python"))
    ],
)
def test_python_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    names: dict[str, object] = {"__name__": "__main__"}
    for line, source in blocks(page, "python"):
        exec(compile("\n" * line + source, page, "exec"), names)  # lines as in the page


def command_lines(page: Path) -> Iterator[str]:
    """Yield what a page has a reader run: lines of code blocks, and code within its text."""
    if page.name == "CHANGELOG.md":  # what was
        return
    text = re.sub(r"\\\n\s*", " ", page.read_text(encoding="utf-8"))
    fenced = re.findall(r"^```(?:bash|console)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    others = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    indented = re.findall(r"^ {4,}((?:python|jansen-env|jansen-workshop) .*)", others, re.MULTILINE)
    within_text = re.findall(r"`((?:python|jansen-env|jansen-workshop) [^`]*)`", others)
    for block in [*fenced, *indented, *(line.replace("\n", " ") for line in within_text)]:
        yield from re.split(r"\n|&&|;", block)


def commands() -> dict[tuple[str, ...], set[str]]:
    """What the pages run of this project, ``("-m", module)``, ``(script,)`` or ``("jansen-env",
    command)``, with its options."""
    options_of: dict[tuple[str, ...], set[str]] = {}
    for page in PAGES:
        for line in command_lines(page):
            words = shlex.split(line, comments=True)
            if script := next((name for name in SCRIPTS if name in words), None):
                words = words[words.index(script) :]
            elif "python" in words:
                words = words[words.index("python") + 1 :]
            else:
                continue
            program = tuple(words[: 1 if words[0].endswith(".py") else 2])
            options = {word.split("=")[0] for word in words if re.match("--?[a-z]", word)}
            options_of.setdefault(program, set()).update(options - {"-m"})
    return {program: options for program, options in options_of.items() if _has_help(program)}


def _has_help(program: tuple[str, ...]) -> bool:
    """Return whether a program is one of this project that parses its command line."""
    if program[0] in SCRIPTS:
        return True
    if program[0] == "-m":
        return program[1].split(".")[0] in ("agents", "benchmarks")
    script = ROOT / program[0]
    if not script.exists() or program[0].startswith("jansen_env/"):  # which must be imported
        return False
    source = script.read_text(encoding="utf-8")
    return "argparse" in source or "options(__doc__" in source


IN_MUJOCO = ("closed_loops.py", "mujoco_witness.py", "transfer.py")
"""Experiments that import MuJoCo."""


@pytest.mark.parametrize("program", commands(), ids=" ".join)
@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # runpy's
def test_commands_have_the_options_that_pages_use(
    program: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if program[-1] in ("agents.study", "examples/rllib_ppo.py"):
        pytest.importorskip("ray")
    if program[-1].removeprefix("experiments/") in IN_MUJOCO:
        pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(ROOT)
    monkeypatch.setattr(sys, "argv", [program[-1], "--help"])
    with pytest.raises(SystemExit) as exited:
        if program[0] in SCRIPTS:
            SCRIPTS[program[0]]([program[1], "--help"])
        elif program[0] == "-m":
            runpy.run_module(program[1], run_name="__main__")
        else:
            runpy.run_path(str(ROOT / program[0]), run_name="__main__")
    assert exited.value.code == 0
    known = re.findall(r"(?<![\w-])--?[a-z][\w-]*", capsys.readouterr().out)
    assert commands()[program] <= {*known}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_on_a_page(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The help lists all options of a command, and some page explains each of them."""
    with pytest.raises(SystemExit):
        jansen_env([command, "--help"])
    options = re.findall(r"^  (?:-\w, )?(--[a-z][\w-]*)", capsys.readouterr().out, re.MULTILINE)
    assert "--help" in options, "the help has another form"
    text = "".join(page.read_text(encoding="utf-8") for page in NOW)
    for option in {*options} - {"--help"}:
        assert re.search(rf"{option}(?![\w-])", text), option


@pytest.mark.parametrize(
    ("names", "page", "mark"), [(ROBOTS, "customise", '`"{}"`'), (MOTORS, "built_robot", "`{}`")]
)
def test_every_design_is_on_a_page(names: dict[str, object], page: str, mark: str) -> None:
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    for name in {*names} - {"ideal"}:  # a motor that is not bought
        assert mark.format(name) in text, name


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as GitHub and MyST make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:", target):
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), target
        if anchor:
            assert anchor in anchors(linked), target


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_no_line_is_a_comment_of_myst(page: Path) -> None:
    """MyST leaves a line out that begins with a per cent sign."""
    assert not re.findall(r"^\s*%.*", page.read_text(encoding="utf-8"), re.MULTILINE)


FOLDERS = (
    "agents",
    "benchmarks",
    "docs",
    "examples",
    "experiments",
    "jansen_env",
    "tests",
    "workshop",
)
ELSEWHERE = (
    "docs/EXPERIMENTS.md",
    "docs/datasets/community",
    "docs/environments/ID.md",
    "examples/verification_plots",
)
"""Files of other projects that pages name, and a name that stands for any of a kind."""
NOT_IN_FOLDERS = ("train.py", "my_random.py", "idf.py")
"""A script in the root, the example of docs/benchmark.md, and a tool of ESP-IDF."""


@pytest.mark.parametrize("page", NOW, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_are_named_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    files = [str(path) for folder in FOLDERS for path in (ROOT / folder).glob("**/*.py")]
    for name in set(re.findall(r"\w[\w/]*\.py\b", text)):
        assert name in NOT_IN_FOLDERS or any(file.endswith(f"/{name}") for file in files), name
    for name in set(re.findall(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w", text)):
        if not name.startswith(("docs/_build", *ELSEWHERE)):
            assert any(ROOT.glob(f"{name}*")) or any(page.parent.glob(f"{name}*")), name


@pytest.mark.parametrize("page", NOW, ids=lambda page: str(page.relative_to(ROOT)))
def test_tests_that_are_named_exist(page: Path) -> None:
    named = set(re.findall(r"`(test_\w+)`", page.read_text(encoding="utf-8")))
    assert named <= names_of_tests()


@functools.cache
def names_of_tests() -> frozenset[str]:
    """Return the names of all test functions."""
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    return frozenset(name for source in sources for name in re.findall(r"def (test_\w+)", source))


SOURCES = [
    path
    for folder in ("agents", "benchmarks", "examples", "jansen_env")
    for path in sorted((ROOT / folder).rglob("*.py"))
]


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_sources_name_exist(source: Path) -> None:
    """Docstrings, comments and messages name no page, test or script that does not exist."""
    text = source.read_text(encoding="utf-8")
    for name in set(re.findall(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w", text)):
        assert any(ROOT.glob(f"{name}*")), name


def missing_module(name: str) -> bool:
    """Return whether a dotted name leads to no module, nor to something that a module defines."""
    parts, path, k = name.split("."), ROOT, 0
    while k < len(parts) and (path / parts[k]).is_dir():
        path /= parts[k]
        k += 1
    if k < len(parts) and (path / f"{parts[k]}.py").exists():
        k += 1
    if k in (0, len(parts)):
        return k == 0
    found: object = importlib.import_module(".".join(parts[:k]))
    for part in parts[k:]:
        found = getattr(found, part, None)
    return found is None


def test_a_missing_module_is_found() -> None:
    assert missing_module("agents.levels") and missing_module("benchmarks.plants.main")
    assert missing_module("jansen_env.robot.motor.Motr")
    assert not missing_module("agents.design") and not missing_module("jansen_env.evaluate")
    assert not missing_module("jansen_env.robot.motor.Motor")


@pytest.mark.parametrize("page", NOW, ids=lambda page: str(page.relative_to(ROOT)))
def test_modules_that_are_named_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    tops = "|".join(folder for folder in FOLDERS if folder != "docs")
    dotted = {*re.findall(rf"(?<![\w./~-])(?:{tops})(?:\.[A-Za-z_]\w*)+(?![\w(]*/)", text)}
    for name in dotted:
        if not name.endswith((".md", ".py", ".html", ".egg")):
            assert not missing_module(name), name


@pytest.fixture
def theory(tmp_path: Path) -> Path:
    """A page with formulas, as the configuration of the documentation has them made."""
    build = pytest.importorskip("sphinx.cmd.build")
    pytest.importorskip("myst_parser")
    mathjax = ROOT / "node_modules" / "mathjax" / "es5" / "tex-svg.js"
    if not mathjax.exists():
        pytest.skip("MathJax is missing: npm install")
    configuration = (ROOT / "docs" / "conf.py").read_text(encoding="utf-8")
    script = re.search(r'^mathjax_path = "(.+)"', configuration, re.MULTILINE)
    assert (
        script
        and script[1] == mathjax.name
        and f'"../{mathjax.relative_to(ROOT)}"' in configuration
    )
    lines = [
        "extensions = ['myst_parser', 'sphinx.ext.mathjax']",
        "myst_enable_extensions = ['dollarmath']",
        f"html_static_path = [{str(mathjax)!r}]",
        script[0],
        "html_theme = 'basic'",
    ]
    (tmp_path / "conf.py").write_text("\n".join(lines))
    text = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    (tmp_path / "index.md").write_text(text, encoding="utf-8")
    shutil.copytree(ROOT / "docs" / "theory", tmp_path / "theory")  # the figures of the page
    assert build.main(["-q", "-b", "html", str(tmp_path), str(tmp_path / "html")]) == 0
    return tmp_path / "html" / "index.html"


def test_formulas_need_no_network(theory: Path, open_window: Any) -> None:
    """A browser that is offline draws them all, from a file."""
    window = open_window(offline=True)
    page = window.page
    page.goto(theory.as_uri(), wait_until="commit")
    page.wait_for_function("window.MathJax?.startup?.promise")
    page.evaluate("MathJax.startup.promise")
    formulas = page.locator(".math")
    assert formulas.count() > 40
    undrawn = "all => all.filter((each) => !each.querySelector('mjx-container svg')).length"
    assert formulas.evaluate_all(undrawn) == 0 and page.locator("[data-mjx-error]").count() == 0
    assert all(url.startswith("file:") for url in window.requests)
