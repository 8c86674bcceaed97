"""Sphinx's configuration: sphinx-build -W -n -b html docs docs/_build/html."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
from sphinx.application import Sphinx

import jansen_env

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
exclude_patterns = ["_build"]
templates_path = ["_templates"]
html_theme = "furo"
html_title = "jansen_env"
html_show_copyright = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "none"  # aliases of arrays would be spelt out; shapes and units are in the text
napoleon_attr_annotations = False
napoleon_use_ivar = True
highlight_language = "none"  # of equations in docstrings

# Shown as text, not as links: other packages' names (their inventories are not fetched, so that a
# build needs no network), compiled code, and constants and attributes without a docstring.
nitpick_ignore_regex = [
    (r"py:.*", r"(collections|gymnasium|gym|np|numpy|pymunk|stable_baselines3|torch)\..*"),
    (r"py:.*", r"jansen_env\.engine.*"),
    (r"py:(attr|data)", r".*"),
    (r"py:class", r"[\d{].*"),  # shapes and mappings that are returned
    (r"py:(func|mod|class)", r"agents\..*"),  # of which the API has a choice
]


def environment_page(env_id: str) -> str:
    """The class docstring of an environment, which is Markdown, under a table of its spaces."""
    env: Any = gym.make(env_id).unwrapped
    limit = gym.spec(env_id).max_episode_steps
    rows = {
        "make": f'`gymnasium.make("{env_id}")`',
        "make many": f'`gymnasium.make_vec("{env_id}", num_envs=256)`',
        "action space": f"`{env.action_space}`",
        "observation space": f"`{env.observation_space}`",
        "control period": f"{env.control_dt:g} s",
        "time limit": f"{limit} steps, {limit * env.control_dt:g} s",
        "class": f"{{py:class}}`{type(env).__module__}.{type(env).__name__}`",
    }
    table = "\n".join(f"| {name} | {' '.join(text.split())} |" for name, text in rows.items())
    docstring = inspect.getdoc(type(env)) or ""
    docstring = re.sub(r":(\w+):`", r"{py:\1}`", docstring)  # roles as Markdown spells them
    return f"| | |\n| --- | --- |\n{table}\n\n{docstring}"


def insert_environment(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the comment ``<!-- environment ID -->`` of a page by :func:`environment_page`."""
    source[0] = re.sub(
        r"<!-- environment (\S+) -->", lambda found: environment_page(found[1]), source[0]
    )


def find_reference(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Resolve what the package hands on, such as ``jansen_env.Robot``, where it is documented."""
    package, _, name = node.get("reftarget", "").rpartition(".")
    if node.get("refdomain") != "py" or package != "jansen_env":
        return None
    target = f"{getattr(getattr(jansen_env, name, None), '__module__', '')}.{name}"
    return env.get_domain("py").resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], target, node, content
    )


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", insert_environment)
    app.connect("missing-reference", find_reference)
