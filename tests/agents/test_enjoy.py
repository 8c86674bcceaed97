"""Watching policies, with a display and without."""

import sys
import tracemalloc

import imageio.v3 as iio
import numpy as np
import pytest

from jansen_env.__main__ import main as jansen_env
from jansen_env.cli import enjoy
from jansen_env.cli.named_policies import load_named
from jansen_env.scoring.rollout import make_env

CRANK = "JansenCrank-v0"


@pytest.fixture
def invisible(monkeypatch, tmp_path):
    """No display; works in a folder of its own."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_without_a_display_there_is_a_film(invisible, capsys):
    enjoy.main(["--env", CRANK, "--steps", "6"])
    printed = capsys.readouterr().out
    assert "there is no display for a window" in printed
    assert "recording pretrained on JansenCrank-v0 to" in printed
    assert "command 1 rad/s: return " in printed and ", ended after 0.06 s" in printed
    assert "written: JansenCrank-v0_pretrained.mp4" in printed
    assert len(iio.imread(invisible / "JansenCrank-v0_pretrained.mp4")) == 4  # steps 0, 2, 4, 6


def test_films_have_the_episodes_that_are_asked_for(invisible, capsys):
    """Commands take turns and starts differ; a failure ends an episode and is reported as one."""
    command = f"--policy constant --env {CRANK} --video a.gif --steps 16 --command 2 3 --episodes 3"
    values = "{max_episode_steps: 8, reset_noise_scale: 1.0}"
    enjoy.main([*command.split(), "--env-kwargs", values])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("recording constant on JansenCrank-v0 to a.gif")
    assert [line.split(":")[0] for line in lines[1:4]] == [f"command {v} rad/s" for v in (2, 3, 2)]
    assert all(line.endswith("ended after 0.08 s") for line in lines[1:4])
    assert len({line.split("return")[1] for line in lines[1:4]}) == 3
    assert len(iio.imread("a.gif")) == 6  # the start and the end of each
    enjoy.main(["--policy", "constant", "--env", CRANK, "--command", "-10", "--video", "b.gif"])
    assert ", failed after " in capsys.readouterr().out


@pytest.mark.slow
def test_several_are_filmed_one_above_the_other(invisible, capsys):
    """All begin in the same state.

    The one that ends first stands still until the other ends, too.
    """
    command = "--policy pid --policy constant --env JansenWalker-v0 --video a.mp4"
    command += " --command 0.8 --steps 25 --seed 3"
    enjoy.main([*command.split(), "--env-kwargs", "{fall_pitch: 0.06}"])
    printed = capsys.readouterr().out
    lines = [line for line in printed.splitlines() if "command 0.8 m/s: return " in line]
    assert sorted(line.split(":")[0] for line in lines) == ["constant", "pid"]
    steps = [round(float(line.split()[-2]) / 0.02) for line in lines]
    frames = iio.imread("a.mp4")
    assert len(frames) == max(steps) + 1 and frames.shape[1:] == (1080, 960, 3)
    upper, lower = frames[:, :540], frames[:, 540:]
    assert np.abs(upper[0, :480].astype(int) - lower[0, :480]).mean() < 1.5  # but for the titles
    assert np.abs(upper[15].astype(int) - lower[15]).mean() > 2.0


@pytest.fixture
def window(invisible):
    """An environment in a window that nobody sees."""
    env = make_env(CRANK, {}, render_mode="human")
    yield env
    env.close()


def test_windows_show_all_episodes_or_until_they_are_closed(window, capsys, monkeypatch):
    import pygame

    args = enjoy.parse(["--env", CRANK, "--steps", "4", "--episodes", "3"])
    policy = load_named("pretrained", window)
    assert enjoy.show(policy, window, args)
    assert capsys.readouterr().out.count("return") == 3
    steps = []
    step = window.unwrapped.step
    monkeypatch.setattr(window.unwrapped, "step", lambda action: steps.append(1) or step(action))
    render = window.unwrapped.render

    def close_at_last():
        if len(steps) == 6:
            pygame.event.post(pygame.event.Event(pygame.QUIT))
        render()

    monkeypatch.setattr(window.unwrapped, "render", close_at_last)
    assert enjoy.show(policy, window, args)
    assert window.unwrapped.window_closed and len(steps) == 6
    assert capsys.readouterr().out.count("return") == 2


def test_a_display_that_does_not_answer_gives_a_film(window, monkeypatch):
    args = enjoy.parse(["--env", CRANK, "--steps", "4"])
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    monkeypatch.setenv("DISPLAY", "nowhere:9")
    with pytest.warns(UserWarning, match="the window cannot be opened: "):
        assert not enjoy.show(load_named("pretrained", window), window, args)


def test_long_videos_take_little_memory(tmp_path):
    tracemalloc.start()
    frames = (np.zeros((400, 400, 3), np.uint8) for _ in range(100))  # 48 MB
    enjoy.save_video(frames, tmp_path / "a.mp4", 0.02)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6


def test_a_film_without_its_packages_is_refused_at_once(invisible, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(SystemExit, match="jansen-env enjoy needs imageio_ffmpeg: python -m pip"):
        jansen_env(["enjoy", "--env", CRANK])
    assert capsys.readouterr().out == ""
