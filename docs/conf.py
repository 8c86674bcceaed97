"""Sphinx's configuration: sphinx-build -W -n -b html docs docs/_build/html."""

from __future__ import annotations

import inspect
import pydoc
import re
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
from docutils import nodes
from sphinx.application import Sphinx
from tabulate import tabulate

import jansen_env
from jansen_env.cli import replay
from jansen_env.viewer.web.bench import write_bench
from jansen_env.viewer.web.page import write_page
from jansen_env.viewer.web.walk import write_walk

sys.path.insert(0, str(Path(__file__).parent))

project = "jansen_env"
author = "the jansen_env developers"
version = release = jansen_env.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "docstrings",  # beside this file
]
exclude_patterns = ["_build", "joss", "pypi.md"]  # the package index shows the latter
templates_path = ["_templates"]
html_theme = "furo"
# Formulas need no network: `npm install` brings MathJax, and the site has its one file.
html_static_path = ["_static", "../node_modules/mathjax/es5/tex-svg.js"]
mathjax_path = "tex-svg.js"
html_css_files = ["cards.css"]
html_title = "jansen_env"
html_show_copyright = False

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "none"  # aliases of arrays would be spelt out; shapes and units are in the text
napoleon_attr_annotations = False
napoleon_use_ivar = True
highlight_language = "none"  # of equations in docstrings

nitpick_ignore_regex = [
    (r"py:attr", r".*"),  # of instances: Python does not know them before there is one
    (r"py:class", r"[\d{].*"),  # shapes and mappings that are returned
]


def environment_page(env_id: str) -> str:
    """Tables of an environment's spaces, and its class docstring, which is Markdown."""
    env: Any = gym.make(env_id).unwrapped
    limit = gym.spec(env_id).max_episode_steps
    (low,), (high,) = env.action_space.low, env.action_space.high
    rows = {
        "make": f'`gymnasium.make("{env_id}")`',
        "make many": f'`gymnasium.make_vec("{env_id}", num_envs=256)`',
        "action": f"1 number from {low:g} to {high:g}, {env.action_space.dtype}",
        "observation": f"[{len(env.observed)} numbers](#observations-by-name), "
        f"{env.observation_space.dtype}",
        "control period": f"{env.control_dt:g} s",
        "time limit": f"{limit} steps, {limit * env.control_dt:g} s",
        "class": f"{{py:class}}`{type(env).__module__}.{type(env).__name__}`",
    }
    docstring = inspect.getdoc(type(env)) or ""
    docstring = re.sub(r":(\w+):`", r"{py:\1}`", docstring)  # roles as Markdown spells them
    docstring = re.sub(r" \(``tests/\S+``\)", "", docstring)
    docstring = re.sub(rf"``(?!{env_id})(Jansen\w+-v0)``", r"[`\1`](\1.md)", docstring)
    docstring = re.sub(r"``docs/(\S+\.md)``", r"[](../\1)", docstring)  # with that page's title
    names = [
        (i, entry.name, entry.unit, entry.low, entry.high) for i, entry in enumerate(env.observed)
    ]
    return "\n\n".join([
        tabulate(rows.items(), ("", ""), "github"),
        docstring,
        "## Observations by name\n\nAs in `env.unwrapped.observed`:",
        tabulate(names, ("", "name", "unit", "from", "to"), "github"),
    ])  # fmt: skip


def replace_comments(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the comments of a page that stand for generated text.

    ``<!-- environment ID -->`` becomes :func:`environment_page`, ``<!-- try NAME -->`` becomes a
    link to the page that is generated for it, and ``<!-- numbers -->`` becomes the table of
    ``pytest --numbers``.
    """
    link = '<p><a href="try/{}.html"><strong>Try it here</strong></a>, with nothing to install.</p>'
    file = Path(app.srcdir) / "_build" / "numbers.md"
    numbers = (
        file.read_text(encoding="utf-8") if file.exists() else "*Not measured for this build.*"
    )
    for pattern, text in (
        (r"<!-- environment (\S+) -->", lambda found: environment_page(found[1])),
        (r"<!-- try (\w+) -->", lambda found: link.format(found[1])),
        ("<!-- numbers -->", lambda _: numbers),
    ):
        source[0] = re.sub(pattern, text, source[0])


def write_pages(app: Sphinx, exception: Exception | None) -> None:
    """Write the pages to walk, design and replay a walk beside the documentation."""
    if exception or app.builder.format != "html":
        return
    folder = Path(app.outdir) / "try"
    folder.mkdir(exist_ok=True)
    write_bench(folder / "bench.html")
    write_walk(folder / "walk.html", apart=True)
    walk = "--policy pid --policy pretrained --command 0.2 --seed 0 --steps 500"
    args = replay.parse(walk.split())
    walks = (replay.record(name, name, args) for name in args.policy)
    write_page(folder / "replay.html", *walks)


def find_reference(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Names as Python finds them, imported and inherited ones too, lead to where they are defined.

    What has no page of its own, such as other packages (a build needs no network), is text.
    """
    if node.get("refdomain") != "py":
        return None
    scopes = [part for part in (node.get("py:module"), node.get("py:class")) if part]
    names = [".".join([*scopes[:n], node["reftarget"]]) for n in range(len(scopes), -1, -1)]
    found = next((found for name in names if (found := pydoc.locate(name)) is not None), None)
    if found is None:
        return None
    home = f"{getattr(found, '__module__', '')}.{getattr(found, '__qualname__', '')}"
    link = env.get_domain("py").resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], home, node, content
    )
    return link or content


UNIT = re.compile(
    r"(?<=\d)\s(?=(?:[kMG]?B|[km]?g|[kmµn]?m|[km]?N|[mµ]?s|W|J|V|A|rad|kPa|MPa)\b|%)"
    r"|(?<=N)\s(?=m\b)"
)
"""The space between a number and its unit, or the one in N m."""


def keep_units(app: Sphinx, document: nodes.document) -> None:
    """Prevent line breaks between a number and its unit."""
    verbatim = (nodes.literal, nodes.math, nodes.FixedTextElement)
    for text in list(document.findall(nodes.Text)):
        if not isinstance(text.parent, verbatim):
            text.parent.replace(text, nodes.Text(UNIT.sub("\N{NO-BREAK SPACE}", text)))


def setup(app: Sphinx) -> None:
    """Connect the functions of this file to the events of Sphinx."""
    app.connect("source-read", replace_comments)
    app.connect("doctree-read", keep_units)
    app.connect("build-finished", write_pages)
    app.connect("missing-reference", find_reference)
