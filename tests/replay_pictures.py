"""The pictures of ``docs/replay.md``: ``python tests/replay_pictures.py docs/replay``."""

import argparse
import io
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from browser import ARGUMENTS, chromium
from PIL import Image

from jansen_env.commands.replay import main as record
from jansen_env.files import write_whole

COLOURS = 256  # of a picture
PICTURES: dict[str, tuple[dict[str, Any], list[str], bool]] = {
    "side_by_side": ({"viewport": {"width": 1280, "height": 720}}, [], False),
    "ghosts": ({"viewport": {"width": 1280, "height": 900}, "color_scheme": "dark"}, ["g"], True),
    "phone": ({"viewport": {"width": 360, "height": 780}, "device_scale_factor": 2}, [], False),
}
"""Options of the browser, keys, and whether all of the page is seen."""
STEPS = 80  # control steps until the PID's toe slides


def take(browser: Any, page: Path, folder: Path) -> None:
    """Every picture of a page, as .png files."""
    for name, (options, keys, whole) in PICTURES.items():
        context = browser.new_context(reduced_motion="reduce", **options)
        tab = context.new_page()
        tab.goto(page.as_uri())
        for key in [*keys, *["ArrowRight"] * STEPS]:
            tab.keyboard.press(key)
        tab.get_by_text(f"{0.02 * STEPS:.2f} s", exact=True).first.wait_for()
        picture = Image.open(io.BytesIO(tab.screenshot(full_page=whole))).convert("RGB")
        context.close()
        few = picture.quantize(COLOURS, kmeans=1, dither=Image.Dither.NONE)
        path = write_whole(folder / f"{name}.png", lambda to, few=few: few.save(to, optimize=True))
        print(f"written: {path} ({path.stat().st_size / 1000:.0f} kB)")


def main() -> None:
    """Record, open in Chromium, take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where they go")
    folder = parser.parse_args().folder
    from playwright.sync_api import sync_playwright  # of the extra `browser`

    with TemporaryDirectory() as name, sync_playwright() as playwright:
        page = Path(name) / "walk.html"
        record(["--policy", "pid", "--policy", "pretrained", "--command", "0.1",
                "--out", str(page)])  # fmt: skip
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(ARGUMENTS))
        take(browser, page, folder)
        browser.close()


if __name__ == "__main__":
    main()
