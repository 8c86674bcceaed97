"""The widgets beside the picture: the input, buttons, choices and sliders of a session."""

from __future__ import annotations

from typing import Any

import pygame as pg
import pygame_gui as gui
from pygame_gui.elements import (
    UIButton,
    UIDropDownMenu,
    UIHorizontalSlider,
    UILabel,
    UIPanel,
    UITextBox,
)

from jansen_env.play.session import PACES, SLIDERS, Session

MARGIN, LINE, ROW, GAP = 14, 20, 26, 6  # pixels
TRACK = 18  # pixels, height of a slider
LISTED = 252  # pixels of an open list
STEP = 0.01  # of what sliders show

INK, MUTED, EDGE = "#263242", "#647080", "#c8d2dd"
CARD, BUTTON, HOVER, ACCENT = "#ffffff", "#eef3f8", "#dde8f3", "#3a7cbe"
FONT = {"name": "noto_sans", "size": "13"}
FONTS: list[dict[str, str | int | float]] = [
    {"name": "noto_sans", "point_size": size, "style": "bold"} for size in (14, 20)
]
COLOURS = {
    "normal_bg": BUTTON, "hovered_bg": HOVER, "active_bg": HOVER, "selected_bg": "#f6c98a",
    "disabled_bg": "#f4f6f8", "dark_bg": CARD, "disabled_dark_bg": CARD,
    "normal_text": INK, "hovered_text": INK, "active_text": INK, "selected_text": INK,
    "disabled_text": "#a0a9b4", "normal_border": EDGE, "hovered_border": ACCENT,
    "active_border": ACCENT, "selected_border": ACCENT, "disabled_border": "#e2e8ee",
}  # fmt: skip
FLAT = {"shadow_width": "0", "border_width": "1", "shape": "rounded_rectangle",
        "shape_corner_radius": "5"}  # fmt: skip
THEME: dict[str, Any] = {
    "defaults": {"colours": COLOURS, "font": FONT},
    "panel": {"misc": {**FLAT, "border_width": "0", "shape_corner_radius": "0"}},
    "button": {"misc": FLAT},
    "label": {"colours": {"dark_bg": "#00000000"}, "misc": {"text_horiz_alignment": "left"}},
    "#value": {"misc": {"text_horiz_alignment": "right"}},
    "#caption": {"colours": {"normal_text": MUTED}},
    "drop_down_menu": {"misc": FLAT},
    "selection_list": {"misc": {**FLAT, "list_item_height": "24"}},
    "horizontal_slider": {
        "colours": {"dark_bg": "#dce3eb"},
        "misc": {**FLAT, "enable_arrow_buttons": "0", "sliding_button_width": "22"},
    },
    "horizontal_slider.#sliding_button": {
        "colours": {"normal_bg": ACCENT, "hovered_bg": "#2f69a4", "active_bg": "#2f69a4",
                    "selected_bg": "#2f69a4"},
        "misc": FLAT,
    },
    "text_box": {"colours": {"dark_bg": CARD}, "misc": {**FLAT, "padding": "18,12"}},
}  # fmt: skip

HELP = """<font size=5.5><b>Walk it by hand</b></font><br><br>\
<b>Arrow keys</b> left, right: {input}<br>\
<b>Click</b> on the picture: push towards the crank axis; <b>drag</b>: push along it<br>\
<b>Space</b>: push forwards<br>\
<b>R</b>: start again; <b>N</b>: another start, and another ground<br>\
<b>P</b>: pause; <b>S</b>: slow motion<br>\
<b>Gamepad</b>: left stick is the input, first button starts again<br>\
<b>H</b>: this help<br><br>\
Walk far with little slip and little work. Green toes hold, red ones slip; arrows are the \
ground's forces.<br><br>\
Any key, or a click, and it begins."""
INPUTS = {True: "turn the crank, the longer the stronger", False: "walk faster that way"}


class Panel:
    """The widgets, and what they do to a session.

    Args:
        session: to change. manager: of the widgets. box: where they stand, pixels of the window.
        picture: where the help opens.
    """

    def __init__(
        self, session: Session, manager: gui.UIManager, box: pg.Rect, picture: pg.Rect
    ) -> None:
        self.session, self._manager, self._picture = session, manager, picture
        manager.preload_fonts(FONTS)
        self._panel = UIPanel(box, manager=manager, margins={side: 0 for side in SIDES})
        self._width, self._y = box.width - 2 * MARGIN, MARGIN
        self._sliders: dict[Any, str] = {}
        self._values: dict[str, Any] = {}
        self._buttons: dict[Any, str] = {}
        self._menus: dict[str, Any] = {}
        self._places: dict[str, pg.Rect] = {}
        self._help: Any = None
        self._shown, self._fallen = -1, False  # the session's version; whether that is shown
        self._texts: dict[Any, str] = {}
        self._input_label, self._input = self._add_slider("input", "torque", -1.0, 1.0, 0.0)
        self._y += GAP
        self._add_buttons({"reset": "Start again", "another": "Another start"})
        self._add_buttons({"pause": "Pause", "help": "Help"})
        self._y += GAP
        self._place_menus(("robot", "control"), ("terrain", "level"), ("pace",))
        self._y += GAP
        for name, slider in SLIDERS.items():
            self._add_slider(name, slider.label, slider.low, slider.high, slider.low)
        self.refresh()

    @property
    def help_open(self) -> bool:
        """Whether the help is shown."""
        return self._help is not None

    def _add_slider(
        self, name: str, label: str, low: float, high: float, value: float
    ) -> tuple[Any, Any]:
        """A slider under its label and value."""
        line = pg.Rect(MARGIN, self._y, self._width, LINE)
        shown = self._make(UILabel, line, text=label)
        self._values[name] = self._make(UILabel, line, text="", object_id="#value")
        place = pg.Rect(MARGIN, line.bottom, self._width, TRACK)
        slider = self._make(UIHorizontalSlider, place, start_value=value, value_range=(low, high))
        self._sliders[slider] = name
        self._y += LINE + TRACK + GAP
        return shown, slider

    def _add_buttons(self, texts: dict[str, str]) -> None:
        """A row of buttons."""
        for place, (name, text) in zip(self._row(2, ROW), texts.items(), strict=True):
            self._buttons[self._make(UIButton, place, text=text)] = name
        self._y += ROW + GAP

    def _place_menus(self, *rows: tuple[str, ...]) -> None:
        """Where lists stand, and what they are called."""
        for names in rows:
            for name, place in zip(names, self._row(2, LINE), strict=False):
                self._make(UILabel, place, text=name, object_id="#caption")
                self._places[name] = pg.Rect(place.x, place.bottom, place.width, ROW)
            self._y += LINE + ROW + GAP

    def _row(self, count: int, height: int) -> list[pg.Rect]:
        width = (self._width - (count - 1) * GAP) // count
        return [pg.Rect(MARGIN + i * (width + GAP), self._y, width, height) for i in range(count)]

    def _make(self, kind: Any, place: pg.Rect, **more: Any) -> Any:
        return kind(relative_rect=place, manager=self._manager, container=self._panel, **more)

    def handle(self, event: pg.event.Event) -> None:
        """Do what a widget's event stands for."""
        session, widget = self.session, getattr(event, "ui_element", None)
        if event.type == gui.UI_HORIZONTAL_SLIDER_MOVED and widget in self._sliders:
            self.show_help(False)
            name = self._sliders[widget]
            if name == "input":
                session.attempt("steer", value=min(max(event.value, -1.0), 1.0))
            else:
                slider = SLIDERS[name]
                value = min(max(round(event.value / STEP) * STEP, slider.low), slider.high)
                session.attempt("set", name=name, value=value)
        elif event.type == gui.UI_BUTTON_PRESSED and widget in self._buttons:
            self.press(self._buttons[widget])
        elif event.type == gui.UI_DROP_DOWN_MENU_CHANGED:
            self.show_help(False)
            for name, menu in self._menus.items():
                if menu is widget:
                    self._choose(name, event.text)
                    break

    def press(self, name: str) -> None:
        """Do what a button does."""
        if name == "help":
            self.show_help(not self.help_open)
            return
        self.show_help(False)
        if name == "pause":
            self.session.pause(not self.session.paused)
        else:
            self.session.attempt(name)

    def slower(self) -> None:
        """The next pace, after the slowest real time."""
        at = PACES.index(self.session.pace)
        self.session.slow(PACES[(at + 1) % len(PACES)])

    def _choose(self, name: str, text: str) -> None:
        """Take what was picked from a list; where it is refused, the list goes back."""
        session = self.session
        if name == "pace":
            session.slow(dict(zip(map(_pace, PACES), PACES, strict=True))[text])
        else:
            session.attempt("choose", name=name, value=int(text) if name == "level" else text)
        self._shown = -1

    def show_help(self, wanted: bool) -> None:
        """Open the help, or close it."""
        if self._help is not None:
            self._help.kill()
            self._help = None
        if wanted:
            place = pg.Rect(0, 0, 580, 400)
            place.center = self._picture.center
            text = HELP.format(input=INPUTS[self.session.by_hand])
            self._help = UITextBox(text, place, manager=self._manager)

    def refresh(self) -> None:
        """Show how the session stands."""
        session = self.session
        if self._shown != session.version:
            self._shown = session.version
            self._refresh_choices()
        if self._fallen != session.fallen:
            self._fallen = session.fallen
            reset = self._button("reset")
            (reset.select if self._fallen else reset.unselect)()
        value = session.input
        full = session.full_torque if session.by_hand else session.top_speed
        text = f"{value * full:+.1f} N m" if session.by_hand else f"{value * full:+.2f} m/s"
        self._write(self._values["input"], text)
        if abs(self._input.current_value - value) > 1e-3 and not self._grabbed(self._input):
            self._input.set_current_value(value, warn=False)

    def _refresh_choices(self) -> None:
        session = self.session
        values = session.values()
        for slider, name in self._sliders.items():
            if name != "input":
                self._write(self._values[name], f"{values[name]:.2f} {SLIDERS[name].unit}".strip())
                if not self._grabbed(slider):
                    slider.set_current_value(values[name], warn=False)
        chosen = {**session.choices, "pace": _pace(session.pace)}
        options = {**session.options, "pace": tuple(map(_pace, PACES))}
        for name, place in self._places.items():
            now, menu = str(chosen[name]), self._menus.get(name)
            if menu is None or menu.selected_option[0] != now:
                if menu is not None:
                    menu.kill()
                self._menus[name] = self._make(
                    UIDropDownMenu, place, options_list=[str(one) for one in options[name]],
                    starting_option=now, expansion_height_limit=LISTED,
                )  # fmt: skip
        level = self._menus["level"]
        (level.disable if session.choices["terrain"] == "flat" else level.enable)()
        self._write(self._input_label, "torque" if session.by_hand else "speed command")
        self._button("pause").set_text("Go on" if session.paused else "Pause")

    def _button(self, name: str) -> Any:
        return next(button for button, own in self._buttons.items() if own == name)

    def _write(self, label: Any, text: str) -> None:
        """Set a label's text where it is another one: setting it takes time."""
        if self._texts.get(label) != text:
            self._texts[label] = text
            label.set_text(text)

    @staticmethod
    def _grabbed(slider: Any) -> bool:
        return bool(slider.grabbed_slider)


SIDES = ("left", "right", "top", "bottom")


def _pace(pace: float) -> str:
    """A pace as it is shown."""
    return "real time" if pace == 1.0 else f"1/{round(1.0 / pace)}"
