"""A session in a window: the renderer's picture, widgets, keys, the mouse and a gamepad."""

from __future__ import annotations

import math
import os
from time import monotonic
from typing import Any

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame as pg
import pygame_gui as gui

from jansen_env.play.panel import CARD, EDGE, INK, MUTED, THEME, Panel
from jansen_env.play.session import LARGEST_PUSH, Session
from jansen_env.rendering import CRANK, SIZE, Renderer

PANEL_WIDTH, SCORE_HEIGHT = 290, 76  # pixels
WINDOW = (SIZE[0] + PANEL_WIDTH, SIZE[1] + SCORE_HEIGHT)
FPS = 50  # pictures a second, at most; time passes whatever they take
CLICK = 6  # pixels, up to which a drag is a click
CLICK_PUSH = 3.0  # N s
PUSH_PER_PIXEL = 0.03  # N s of a drag
DEAD_ZONE = 0.12  # of a gamepad's stick


class Window:
    """A window and what its user does to a session.

    Raises:
        RuntimeError: no display can be opened.
    """

    def __init__(self, session: Session) -> None:
        self.session, self.closed = session, False
        try:
            pg.display.init()
            # Without a display SDL quietly opens a window nobody sees, unless told which to use.
            if pg.display.get_driver() == "offscreen" and "SDL_VIDEODRIVER" not in os.environ:
                raise pg.error("no display found")
            self.surface = pg.display.set_mode(WINDOW)
        except pg.error as error:
            pg.display.quit()
            raise RuntimeError(f"no window: {error}") from error
        pg.font.init()
        pg.display.set_caption("Jansen linkage: walk it by hand")
        self._manager = gui.UIManager(WINDOW, THEME, enable_live_theme_updates=False)
        picture, beside = pg.Rect((0, 0), SIZE), pg.Rect(SIZE[0], 0, PANEL_WIDTH, WINDOW[1])
        self.panel = Panel(session, self._manager, beside, picture)
        self.panel.show_help(True)
        self._fonts = {size: pg.font.Font(None, size) for size in (20, 22, 34)}
        self._keys = {pg.K_LEFT: False, pg.K_RIGHT: False}
        self._drag: tuple[int, int] | None = None  # where it began
        self._env, self._renderer = None, self._new_renderer()
        self._joystick: Any = None
        self._stick = 0.0
        pg.joystick.init()
        self._clock, self._before = pg.time.Clock(), monotonic()

    def turn(self) -> None:
        """Do what the user has done, let the time since the last turn pass, and draw."""
        for event in pg.event.get():
            self._handle(event)
        now = monotonic()
        if not self.panel.help_open:  # who reads does not find the robot fallen
            self.session.advance(now - self._before)
        self._manager.update(now - self._before)
        self._before = now
        self._draw()
        self._clock.tick(FPS)

    def close(self) -> None:
        """Close the window."""
        pg.joystick.quit()
        pg.display.quit()
        self.closed = True

    # What the user does.

    def _handle(self, event: pg.event.Event) -> None:
        if event.type == pg.QUIT:
            self.closed = True
        elif event.type in (pg.KEYDOWN, pg.KEYUP):
            self._handle_key(event.key, event.type == pg.KEYDOWN, getattr(event, "unicode", ""))
        elif event.type == pg.WINDOWFOCUSLOST:  # the release of a key goes elsewhere
            self._release()
        elif event.type in (pg.JOYDEVICEADDED, pg.JOYDEVICEREMOVED):
            self._joystick = pg.joystick.Joystick(0) if pg.joystick.get_count() else None
        elif event.type == pg.JOYAXISMOTION and event.axis == 0:
            self._move_stick(event.value)
        elif event.type == pg.JOYBUTTONDOWN and event.button == 0:
            self.panel.press("reset")
        elif not self._handle_mouse(event):
            self._manager.process_events(event)
            self.panel.handle(event)

    def _handle_key(self, key: int, down: bool, text: str) -> None:
        if key in self._keys:
            self._keys[key] = down
            self.session.hold(self._keys[pg.K_RIGHT] - self._keys[pg.K_LEFT])
        elif not down:
            return
        elif key in (pg.K_h, pg.K_F1) or text == "?":
            self.panel.press("help")
            return
        elif key == pg.K_SPACE:
            self.session.attempt("push", x=CLICK_PUSH, y=0.0)
        elif key in KEYS:
            self.panel.press(KEYS[key])
        elif key == pg.K_s:
            self.panel.slower()
        self.panel.show_help(False)

    def _release(self) -> None:
        self._keys = dict.fromkeys(self._keys, False)
        self.session.hold(0)

    def _move_stick(self, value: float) -> None:
        """The input is where the stick is, and 0 in the middle."""
        stick = 0.0 if abs(value) < DEAD_ZONE else min(max(value, -1.0), 1.0)
        if stick != self._stick:
            self._stick = stick
            self.session.steer(stick)
            self.panel.show_help(False)

    def _handle_mouse(self, event: pg.event.Event) -> bool:
        """Push where the picture is clicked or dragged on; whether the event was for that."""
        if event.type == pg.MOUSEBUTTONDOWN and event.button == 1:
            if event.pos[0] >= SIZE[0] or event.pos[1] >= SIZE[1]:
                return False
            self._drag = event.pos
            self.panel.show_help(False)
            return True
        if event.type == pg.MOUSEBUTTONUP and event.button == 1 and self._drag is not None:
            impulse = self._impulse(self._drag, event.pos)
            self._drag = None
            if impulse is not None:
                self.session.attempt("push", x=impulse[0], y=impulse[1])
            return True
        return False

    def _impulse(self, start: tuple[int, int], end: tuple[int, int]) -> tuple[float, float] | None:
        """N s of a drag, along it, or of a click, towards the crank axis; None of one on it."""
        size = PUSH_PER_PIXEL * math.dist(start, end)
        dx, dy = (float(b - a) for a, b in zip(start, end, strict=True))
        if math.hypot(dx, dy) < CLICK:
            axis = self._renderer.picture_position(self.session.frame().q[:2])
            dx, dy, size = axis[0] - start[0], axis[1] - start[1], CLICK_PUSH
        length = math.hypot(dx, dy)
        if length == 0.0:
            return None
        size = min(size, LARGEST_PUSH)
        return size * dx / length, -size * dy / length

    # What is shown.

    def _new_renderer(self) -> Renderer:
        self._env = self.session.env
        return Renderer(**self.session.scene(), mode="rgb_array", fps=FPS)

    def _draw(self) -> None:
        if self._env is not self.session.env:
            self._renderer = self._new_renderer()
        self._renderer.show(**self.session.scene())
        picture = self._renderer.draw(self.session.frame())
        assert picture is not None  # in this mode there is one
        self.surface.blit(pg.image.frombuffer(picture.data, SIZE, "RGB"), (0, 0))
        self._draw_drag()
        self._draw_score()
        self._draw_message()
        self.panel.refresh()
        self._manager.draw_ui(self.surface)
        pg.display.flip()

    def _draw_score(self) -> None:
        score = self.session.score()
        pg.draw.rect(self.surface, CARD, (0, SIZE[1], SIZE[0], SCORE_HEIGHT))
        for start, end in (((0, SIZE[1]), SIZE), ((SIZE[0] - 1, 0), (SIZE[0] - 1, WINDOW[1]))):
            pg.draw.line(self.surface, EDGE, start, end)
        shown = {
            "distance": f"{score.distance:.2f} m",
            "slip per metre": _ratio(score.slip_per_metre, 3, " m/m"),
            "cost of transport": _ratio(score.cost_of_transport, 2),
            "mean speed": f"{score.speed:.2f} m/s".replace("-0.00", "0.00"),
            "time": f"{score.time:.1f} s",
        }
        for i, (name, value) in enumerate(shown.items()):
            x = 28 + i * (SIZE[0] - 28) // len(shown)
            self._text(name, 20, MUTED, (x, SIZE[1] + 16))
            self._text(value, 34, INK, (x, SIZE[1] + 36))

    def _draw_message(self) -> None:
        text = self.session.message or ("Paused" if self.session.paused else "")
        if text:
            image = self._fonts[22].render(text, True, CARD, wraplength=SIZE[0] - 120)
            box = image.get_rect(midbottom=(SIZE[0] // 2, SIZE[1] - 26))
            pg.draw.rect(self.surface, INK, box.inflate(28, 18), border_radius=8)
            self.surface.blit(image, box)

    def _draw_drag(self) -> None:
        if self._drag is None:
            return
        end = pg.mouse.get_pos()
        length = math.dist(self._drag, end)
        if length < CLICK:
            return
        ux, uy = ((b - a) / length for a, b in zip(self._drag, end, strict=True))
        x, y = end
        pg.draw.line(self.surface, CRANK, self._drag, end, 4)
        pg.draw.polygon(
            self.surface, CRANK,
            [(x + 12 * ux, y + 12 * uy), (x - 7 * uy, y + 7 * ux), (x + 7 * uy, y - 7 * ux)],
        )  # fmt: skip
        size = min(PUSH_PER_PIXEL * length, LARGEST_PUSH)
        label = self._fonts[22].render(f"{size:.1f} N s", True, INK)
        box = label.get_rect(midtop=(self._drag[0], self._drag[1] + 14))
        pg.draw.rect(self.surface, CARD, box.inflate(14, 8), border_radius=6)
        self.surface.blit(label, box)

    def _text(self, text: str, size: int, color: str, place: tuple[int, int]) -> None:
        self.surface.blit(self._fonts[size].render(text, True, color), place)


KEYS = {pg.K_r: "reset", pg.K_n: "another", pg.K_p: "pause"}


def _ratio(value: float | None, digits: int, unit: str = "") -> str:
    return "\u2013" if value is None else f"{value:.{digits}f}{unit}"


def play(session: Session) -> None:
    """Show a session in a window until its user closes it.

    Raises:
        RuntimeError: no display can be opened.
    """
    window = Window(session)
    try:
        while not window.closed:
            window.turn()
    finally:
        window.close()
