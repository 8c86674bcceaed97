"""README and documentation: code blocks run, commands and links are of things that exist."""

import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from jansen_env.__main__ import main as jansen_env

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("*/README.md"), *ROOT.glob("docs/**/*.md")])
IDS = [str(page.relative_to(ROOT)) for page in PAGES]


def blocks(page: Path, language: str) -> Iterator[tuple[int, str]]:
    """The fenced code blocks of a page in a language, with the lines they begin at."""
    text = page.read_text(encoding="utf-8")
    for match in re.finditer(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        yield text[: match.start(1)].count("\n"), match[1]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] * (page.stem == "export"), id=page.stem)
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


def commands() -> dict[tuple[str, ...], set[str]]:
    """What the pages run of this project, ``("-m", module)``, ``(script,)`` or ``("jansen-env",
    command)``, with its options."""
    options_of: dict[tuple[str, ...], set[str]] = {}
    for page in PAGES:
        for _, block in blocks(page, "(?:bash|console)"):
            for line in re.split(r"\n|&&|;", block.replace("\\\n", " ")):
                words = shlex.split(line, comments=True)
                if "jansen-env" in words:
                    words = words[words.index("jansen-env") :]
                elif "python" in words:
                    words = words[words.index("python") + 1 :]
                else:
                    continue
                program = tuple(words[: 1 if words[0].endswith(".py") else 2])
                options = {word.split("=")[0] for word in words if re.match("--?[a-z]", word)}
                options_of.setdefault(program, set()).update(options - {"-m"})
    return {p: options for p, options in options_of.items() if p[-1] not in ("pip", "pytest")}


@pytest.mark.parametrize("program", commands(), ids=" ".join)
@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # runpy's
def test_commands_have_the_options_that_pages_use(
    program: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if program[-1] == "agents.study":
        pytest.importorskip("ray")
    monkeypatch.syspath_prepend(ROOT)
    monkeypatch.setattr(sys, "argv", [program[-1], "--help"])
    with pytest.raises(SystemExit) as exited:
        if program[0] == "jansen-env":
            jansen_env([program[1], "--help"])
        elif program[0] == "-m":
            runpy.run_module(program[1], run_name="__main__")
        else:
            runpy.run_path(str(ROOT / program[0]), run_name="__main__")
    assert exited.value.code == 0
    known = re.findall(r"(?<![\w-])--?[a-z][\w-]*", capsys.readouterr().out)
    assert commands()[program] <= {*known}


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


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_files_that_are_named_exist(page: Path) -> None:
    if page.name == "CHANGELOG.md":  # of what was
        return
    folders = ("agents", "benchmarks", "docs", "examples", "jansen_env", "tests")
    files = [str(path) for folder in folders for path in (ROOT / folder).glob("**/*.py")]
    for name in set(re.findall(r"\w[\w/]*\.py\b", page.read_text(encoding="utf-8"))):
        assert name == "train.py" or any(file.endswith(f"/{name}") for file in files), name
