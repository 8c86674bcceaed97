"""The window to walk a robot by hand: with a driver that shows nothing, and under Xvfb."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("pygame_gui", reason="the extra 'play' is not installed")

import pygame as pg
import pygame_gui as gui

from jansen_env.play import window as module
from jansen_env.play.session import Session
from jansen_env.play.window import CLICK_PUSH, PUSH_PER_PIXEL, WINDOW, Window
from jansen_env.rendering import FORCE, SIZE, SKY


@pytest.fixture
def window(monkeypatch):
    """A window that nobody sees, whose time passes by ``now``."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(module, "monotonic", lambda: clock.now)
    one = Window(Session("JansenWalker-v0"))  # whose rigid feet can bounce
    one.clock = clock
    one._clock = SimpleNamespace(tick=lambda fps: None)
    yield one
    one.close()


def turns(window, count=1, seconds=0.02):
    for _ in range(count):
        window.clock.now += seconds
        window.turn()


def press(window, key, text=""):
    pg.event.post(pg.event.Event(pg.KEYDOWN, key=key, unicode=text))
    turns(window)


def release(window, key):
    pg.event.post(pg.event.Event(pg.KEYUP, key=key))
    turns(window)


def click(window, start, end=None):
    """Press the mouse, move it, let go; where the mouse is seen to be, too."""
    window._manager._update_mouse_position = lambda: None
    for kind, place in ((pg.MOUSEBUTTONDOWN, start), (pg.MOUSEBUTTONUP, end or start)):
        window._manager.mouse_position = place
        turns(window)  # so that it is hovered over
        pg.event.post(pg.event.Event(kind, button=1, pos=place))
        turns(window, 4)  # widgets tell one another by events


def pixels(window):
    return pg.surfarray.array3d(window.surface)


def widget(window, name):
    """A slider, a button or a list of the panel."""
    panel = window.panel
    found = {**{n: w for w, n in panel._sliders.items()}, **panel._menus}
    return {**found, **{n: w for w, n in panel._buttons.items()}}[name]


def test_keys_are_the_torque_and_the_picture_follows(window):
    turns(window, 2)
    before = pixels(window)
    press(window, pg.K_RIGHT)
    turns(window, 25)
    assert window.session.input == 1.0
    assert window.session.frame().torque == pytest.approx(20.0)
    assert window.session.score().distance > 0.0
    changed = (pixels(window) != before).any(axis=-1)
    assert changed[: SIZE[0], : SIZE[1]].mean() > 0.05  # the robot
    assert changed[: SIZE[0], SIZE[1] :].any()  # the score
    assert changed[SIZE[0] :, :60].any()  # the slider of the torque
    press(window, pg.K_LEFT)  # both: none
    turns(window, 25)
    assert window.session.input == 0.0
    release(window, pg.K_RIGHT)
    turns(window, 25)
    assert window.session.input == -1.0
    pg.event.post(pg.event.Event(pg.WINDOWFOCUSLOST))
    turns(window, 25)
    assert window.session.input == 0.0


def test_time_stands_still_while_the_help_is_open(window):
    """And all that is done, but to open it, closes it."""
    time = window.session.env.frame().time
    turns(window, 25)
    assert window.session.env.frame().time == time
    slider = widget(window, "friction").rect
    thumb = widget(window, "friction").sliding_button.rect
    for act in (
        lambda: click(window, thumb.center, (slider.left + 20, thumb.centery)),
        lambda: click(window, widget(window, "reset").rect.center),
        lambda: window._move_stick(0.5),
        lambda: click(window, (100, 400)),
    ):
        window.panel.show_help(True)
        act()
        turns(window, 2)
        assert not window.panel.help_open


def pushes(window, monkeypatch):
    given = []
    monkeypatch.setattr(window.session, "push", lambda x, y: given.append((x, y)))
    return given


def test_a_click_pushes_towards_the_axis_and_a_drag_along_itself(window, monkeypatch):
    given = pushes(window, monkeypatch)
    turns(window)
    x, y = window._renderer.picture_position(window.session.frame().q[:2])
    assert x == pytest.approx(SIZE[0] / 2, abs=1)
    click(window, (round(x) - 200, round(y)))
    assert given.pop() == pytest.approx((CLICK_PUSH, 0.0), abs=0.02)
    click(window, (300, 300), (300, 200))
    assert given.pop() == pytest.approx((0.0, 100 * PUSH_PER_PIXEL))
    click(window, (900, 100), (100, 100))  # no more than is allowed
    assert given.pop() == pytest.approx((-10.0, 0.0))
    assert not given and not window.panel.help_open


def test_sliders_buttons_and_lists(window, monkeypatch):
    session = window.session
    turns(window)
    slider = widget(window, "friction").rect
    given = pushes(window, monkeypatch)
    thumb = widget(window, "friction").sliding_button.rect
    click(window, thumb.center, (slider.left + slider.width // 4, thumb.centery))
    assert session.env.get_state()["parameters"]["friction"] == pytest.approx(0.27, abs=0.06)
    click(window, widget(window, "pause").rect.center)
    assert session.paused and not given
    click(window, widget(window, "pause").rect.center)
    assert not session.paused
    for name, text in (("terrain", "stairs"), ("level", "4"), ("robot", "holy"), ("pace", "1/4")):
        pg.event.post(pg.event.Event(
            gui.UI_DROP_DOWN_MENU_CHANGED, ui_element=widget(window, name), text=text
        ))  # fmt: skip
        turns(window, 2)
    assert session.choices == {
        "robot": "holy", "terrain": "stairs", "level": 4, "control": "torque"
    }  # fmt: skip
    assert session.pace == 0.25
    assert session.values()["friction"] == pytest.approx(0.27, abs=0.06)


def test_a_fall_is_shown_and_a_start_offered(window):
    session, reset = window.session, widget(window, "reset")
    session.seed = 1
    press(window, pg.K_r)
    session.steer(1.0)
    before = pixels(window)
    while not session.fallen and session.score().time < 10.0:
        session.advance(0.02)
    turns(window, 2)
    assert "fallen" in session.message and reset.is_selected
    assert (pixels(window)[400:500, 485:515] != before[400:500, 485:515]).any()
    click(window, reset.rect.center)
    assert not session.fallen and not reset.is_selected and session.message == ""


def test_time_is_real_however_long_a_picture_takes(window):
    press(window, pg.K_p)
    press(window, pg.K_p)
    before = window.session.score().time
    turns(window, 10, seconds=0.1)
    assert window.session.score().time - before == pytest.approx(1.0, abs=0.021)


def read_xwd(path: Path) -> np.ndarray:
    """(height, width, 3) the screen of an Xvfb with 24 bit colours, from its file."""
    data = path.read_bytes()
    header = struct.unpack(">25I", data[:100])
    size, width, height, per_line, colours = header[0], header[4], header[5], header[12], header[19]
    start = size + 12 * colours
    rows = np.frombuffer(data, np.uint8, per_line * height, start).reshape(height, per_line)
    return rows[:, : 4 * width].reshape(height, width, 4)[..., 2::-1]


def shows(pixels: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Which pixels have a colour, up to what scaling pictures down changes."""
    return (np.abs(pixels.astype(int) - color) < 8).all(axis=-1)


@pytest.fixture
def screen(tmp_path):
    """An Xvfb of the window's size: its display and the file with its pixels."""
    missing = [name for name in ("Xvfb", "xdotool") if shutil.which(name) is None]
    if missing:
        give_up = pytest.fail if os.environ.get("JANSEN_ENV_SCREEN") == "required" else pytest.skip
        give_up(f"needs {' and '.join(missing)}: apt-get install xvfb xdotool")
    reading, writing = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WINDOW[0]}x{WINDOW[1]}x24",
         "-fbdir", str(tmp_path), "-nolisten", "tcp"],
        pass_fds=[writing], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    with os.fdopen(reading) as number:
        display = f":{number.readline().strip()}"
    yield display, tmp_path / "Xvfb_screen0"
    server.terminate()
    server.wait(10)


def wait_for(condition, seconds=60.0):
    """Until something is the case; whether it came to be."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
def test_in_a_real_window(screen):
    """``python -m jansen_env.play`` with keys and a mouse as the X server gives them."""
    display, file = screen
    env = {**os.environ, "DISPLAY": display, "SDL_VIDEODRIVER": "x11"}
    program = subprocess.Popen(
        [sys.executable, "-m", "jansen_env.play", "--seed", "1"], env=env,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip

    def do(*arguments):
        found = subprocess.run(
            ["xdotool", *arguments], env=env, check=True, capture_output=True, text=True
        )
        return found.stdout.strip()

    def torque():
        """Pixels of the torque's bar in the picture: to the left of 0, to the right."""
        bar = shows(read_xwd(file)[138:144, 20:220], FORCE)
        return int(bar[:, :100].sum()), int(bar[:, 104:].sum())

    try:
        assert wait_for(lambda: shows(read_xwd(file)[5, 400], SKY)), "no picture"
        assert torque() == (0, 0)
        first = read_xwd(file)
        do("keydown", "Right")
        assert wait_for(lambda: torque()[1] > 100), "the torque does not follow the key"
        assert torque()[0] == 0
        do("keyup", "Right")
        assert wait_for(lambda: torque() == (0, 0)), "the torque stays"
        do("keydown", "Left")
        assert wait_for(lambda: torque()[0] > 100)
        do("keyup", "Left")
        assert (read_xwd(file) != first).any(axis=-1)[: SIZE[1], : SIZE[0]].mean() > 0.05
        do("key", "p")
        time.sleep(0.3)
        still = read_xwd(file)
        time.sleep(0.3)
        np.testing.assert_array_equal(read_xwd(file)[: SIZE[1]], still[: SIZE[1]])
        do("key", "p", "key", "r")
        do("mousemove", "200", "250", "click", "1")
        assert wait_for(lambda: (read_xwd(file) != still)[: SIZE[1]].mean() > 0.02)
        assert program.poll() is None
    finally:
        program.terminate()
        output = program.communicate(timeout=20)[0]
    assert "Traceback" not in output and "Warning" not in output
