"""The console script finds its commands, and none ends in a traceback for want of a package."""

import subprocess
import sys

import pytest

from jansen_env import __version__
from jansen_env.__main__ import COMMANDS, main
from jansen_env.cli import demo
from jansen_env.cli.flags import Parser
from jansen_env.cli.process import guarded

OPTIONAL = (
    "PIL",
    "cma",
    "ezdxf",
    "imageio",
    "imageio_ffmpeg",
    "matplotlib",
    "mujoco",
    "rich",
    "scipy",
    "stable_baselines3",
    "tabulate",
    "torch",
    "yaml",
)
WITHOUT = f"import sys; sys.modules.update(dict.fromkeys({OPTIONAL}))"
RUN = f"{WITHOUT}; from jansen_env.__main__ import main; main(sys.argv[1:])"


def run(*arguments, code=RUN, **kwargs):
    command = [sys.executable, "-W", "error", "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, **kwargs)


def test_version_and_help(capsys):
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as ended:
            main([flag])
        assert ended.value.code == 0
    version, *shown = capsys.readouterr().out.splitlines()
    assert version == __version__
    assert [line.split()[0] for line in shown[-len(COMMANDS) :]] == [*COMMANDS]


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_tells_its_arguments(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"usage: jansen-env {command} ")
    assert shown.count(f"\n  jansen-env {command}") == 2  # examples


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["enjoi"], "did you mean 'enjoy'?"),
        (
            ["evaluate", "--policy", "pid", "--env", "JansenRough-v0"],
            "mean 'JansenWalkerRough-v0'?",
        ),
        (["mjcf", "paper", "--out", "/proc/x/x.xml"], "/proc"),  # before the work
    ],
)
def test_an_error_of_a_command_comes_before_its_usage(arguments, words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    first, second, *_ = capsys.readouterr().err.splitlines()
    error, usage = (first, second) if arguments[0] in COMMANDS else (second, first)
    assert ended.value.code == 2 and words in error and usage.startswith("usage: ")


def test_ctrl_c_ends_a_command_without_a_traceback():
    with pytest.raises(SystemExit) as ended, guarded("command"), Parser("", None).refusing():
        raise KeyboardInterrupt
    assert ended.value.code == 130


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [["evaluate", "--policy", "pid"], ["paper", "--out", "x"], ["enjoy", "--video", "x.gif"]],
    ids=" ".join,
)
def test_a_missing_package_is_named(command, tmp_path):
    done = run(*command, cwd=tmp_path)
    assert done.returncode == 1 and not list(tmp_path.iterdir())
    (last,) = done.stderr.splitlines()[-1:]
    assert last.startswith(f"jansen-env {command[0]} needs ")
    assert last.endswith(': python -m pip install -c constraints.txt -e ".[tools]"')


@pytest.mark.slow
def test_what_needs_no_other_package(tmp_path):
    """A replay of the packaged policy, the pages, and MuJoCo's file need no other package."""
    done = run("replay", "--policy", "pretrained", "--steps", "20", "--out", "x.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.html").stat().st_size > 50_000
    assert run("play", "--no-open", "--out", "pages", cwd=tmp_path).returncode == 0
    assert run("mjcf", "paper", "--out", "x.xml", cwd=tmp_path).returncode == 0
    assert run("demo", "--no-open", "--out", "demo", cwd=tmp_path).returncode == 0
    assert run("verify", "--walk", "crank", cwd=tmp_path).returncode == 0
    assert '-c constraints.txt -e ".[mujoco]"' in run("mjcf", "built").stderr  # of its springs


def test_an_environment_without_policies_shows_its_baseline(tmp_path, monkeypatch):
    monkeypatch.setattr("jansen_env.policies.pretrained.names", lambda _: [])
    main(["replay", "--env", "JansenGoal-v0", "--steps", "5", "--out", str(tmp_path / "x.html")])
    assert [path.name for path in tmp_path.glob("*.npz")] == ["x_pid.npz"]


@pytest.mark.parametrize(
    ("shown", "opened", "message"),
    [
        (True, True, "The page is open in your browser:"),
        (True, False, "Open this page in any browser:"),  # there is no browser
        (False, True, "Open this page in any browser:"),  # a text browser could not show it
    ],
)
def test_the_demo_opens_a_page_where_it_can_be_seen(
    shown, opened, message, monkeypatch, capsys, tmp_path
):
    calls = []
    monkeypatch.setattr(demo, "display", lambda: shown)
    monkeypatch.setattr("webbrowser.open", lambda page: calls.append(page) or opened)
    main(["demo", "--out", str(tmp_path)])
    page = tmp_path / "walk.html"
    printed = capsys.readouterr().out
    assert f"{message}\n  {page}\n" in printed and "jansen-env play " in printed
    assert calls == [page.as_uri()] * shown
    assert "control=rough+policy" in page.read_text(encoding="utf-8")


def test_a_model_asks_for_its_library(tmp_path):
    (tmp_path / "model.zip").write_bytes(b"")
    *_, last = run("replay", "--policy", "model.zip", cwd=tmp_path).stderr.splitlines()
    assert last.endswith('python -m pip install -c constraints.txt -e ".[train]"')
