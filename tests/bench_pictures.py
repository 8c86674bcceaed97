"""The pictures of ``docs/bench.md``: ``python tests/bench_pictures.py docs/bench``."""

import argparse
import io
from pathlib import Path
from tempfile import TemporaryDirectory

from browser import ARGUMENTS, chromium
from PIL import Image

from jansen_env.files import write_whole
from jansen_env.viewer.web.bench import write_bench

COLOURS = 128  # of a picture
DESKTOP = {"viewport": {"width": 1400, "height": 840}}
PHONE = {
    "viewport": {"width": 360, "height": 740}, "device_scale_factor": 2, "color_scheme": "dark"
}  # fmt: skip
PICTURES = {
    "desktop": (DESKTOP, "built", "C", (9.0, -13.0), 150),
    "open": (DESKTOP, "paper&rocker=140", None, None, 195),
    "phone": (PHONE, "klann", None, None, 120),
}
"""Options of the browser, design, joint that is dragged by so many pixels, crank angle, degrees."""


def main() -> None:
    """Write the bench, open it in Chromium, take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where they go")
    folder = parser.parse_args().folder
    from playwright.sync_api import sync_playwright  # of the extra `browser`

    with TemporaryDirectory() as name, sync_playwright() as playwright:
        page = write_bench(Path(name) / "bench.html")
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(ARGUMENTS))
        for label, (options, design, joint, way, angle) in PICTURES.items():
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
            picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
            few = picture.quantize(COLOURS, kmeans=1, dither=Image.Dither.NONE)
            path = write_whole(
                folder / f"{label}.png", lambda to, few=few: few.save(to, optimize=True)
            )
            print(f"written: {path} ({path.stat().st_size / 1000:.0f} kB)")
        browser.close()


if __name__ == "__main__":
    main()
