"""Pictures of replays, the bench and the page that walks: ``python tests/pictures.py docs``."""

import argparse
import io
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from browser import ARGUMENTS, chromium, draw_path
from PIL import Image

from jansen_env.cli.replay import main as record
from jansen_env.files import write_whole
from jansen_env.viewer.web.bench import write_bench
from jansen_env.viewer.web.walk import write_walk

COLOURS = 256  # of a picture
PHONE = {"viewport": {"width": 360, "height": 780}, "device_scale_factor": 2}
REPLAYS: dict[str, tuple[dict[str, Any], list[str], bool]] = {
    "side_by_side": ({"viewport": {"width": 1280, "height": 720}}, [], False),
    "ghosts": ({"viewport": {"width": 1280, "height": 900}, "color_scheme": "dark"}, ["g"], True),
    "phone": (PHONE, [], False),
}
"""Options of the browser, keys, and whether all of the page is seen."""
STEPS = 80  # control steps until the PID's toe slides
DESKTOP = {"viewport": {"width": 1400, "height": 840}}
BENCHES = {
    "desktop": (DESKTOP, "built", "C", (9.0, -13.0), 150),
    "open": (DESKTOP, "paper&rocker=140", None, None, 195),
    "phone": ({**PHONE, "color_scheme": "dark"}, "klann", None, None, 120),
}
"""Options of the browser, design, joint that is dragged by so many pixels, crank angle, degrees."""


def save(shown: Any, path: Path, **options: Any) -> None:
    """Write a picture of a page, or of an element, with few colours."""
    picture = Image.open(io.BytesIO(shown.screenshot(**options))).convert("RGB")
    few = picture.quantize(COLOURS, kmeans=1, dither=Image.Dither.NONE)
    write_whole(path, lambda to: few.save(to, optimize=True))
    print(f"written: {path} ({path.stat().st_size / 1000:.0f} kB)")


def take_replays(browser: Any, page: Path, folder: Path) -> None:
    """Write every picture of a replay."""
    for name, (options, keys, whole) in REPLAYS.items():
        tab = browser.new_context(reduced_motion="reduce", **options).new_page()
        tab.goto(page.as_uri())
        for key in [*keys, *["ArrowRight"] * STEPS]:
            tab.keyboard.press(key)
        tab.get_by_text(f"{0.02 * STEPS:.2f} s", exact=True).first.wait_for()
        save(tab, folder / f"{name}.png", full_page=whole)


def take_benches(browser: Any, page: Path, folder: Path) -> None:
    """Write every picture of the bench."""
    for name, (options, design, joint, way, angle) in BENCHES.items():
        tab = browser.new_context(reduced_motion="reduce", **options).new_page()
        tab.goto(f"{page.as_uri()}#{design}")
        tab.locator("#angle").fill(str(angle))
        if joint:
            tab.locator("#keep").click()
            tab.wait_for_timeout(200)
            box = tab.locator(f'[data-joint="{joint}"] circle').bounding_box()
            x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
            tab.mouse.move(x, y)
            tab.mouse.down()
            tab.mouse.move(x + way[0], y + way[1])
            tab.mouse.up()
        tab.wait_for_timeout(200)
        save(tab, folder / f"{name}.png")
    tab = browser.new_page(reduced_motion="reduce", viewport={"width": 1000, "height": 760})
    tab.goto(f"{page.as_uri()}#built")
    draw_path(tab)
    tab.click("#next")
    tab.wait_for_timeout(200)
    save(tab.locator("#picture"), folder / "drawn.png")


def take_walk(browser: Any, page: Path, path: Path) -> None:
    """Write the picture of two machines on stairs."""
    choices = "control=rough+policy&terrain=stairs&level=3&robot2=klann&control2=constant+speed"
    tab = browser.new_page(viewport={"width": 1280, "height": 800})
    tab.goto(f"{page.as_uri()}#{choices}")
    tab.wait_for_timeout(9000)
    save(tab, path)


def main() -> None:
    """Record, open in Chromium, take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("docs", type=Path, help="folder of the documentation")
    docs = parser.parse_args().docs
    from playwright.sync_api import sync_playwright  # of the group `browser`

    with TemporaryDirectory() as name, sync_playwright() as playwright:
        page = Path(name) / "walk.html"
        record(
            ["--policy", "pid", "--policy", "pretrained", "--command", "0.1", "--out", str(page)]
        )
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(ARGUMENTS))
        take_replays(browser, page, docs / "replay")
        take_benches(browser, write_bench(Path(name) / "bench.html"), docs / "bench")
        take_walk(browser, write_walk(Path(name) / "page.html"), docs / "play" / "page.png")
        browser.close()


if __name__ == "__main__":
    main()
