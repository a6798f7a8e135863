"""Regenerate the pictures of the documentation.

    uv run python docs/make_pictures.py

The AdeptOne's first joint gets dry friction that its model does not know; two experiments are diagnosed, a third is
held out, and parts of `report.html` become ``docs/img/report.png``. Needs Chromium or Chrome.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageChops

from diagnosis.preparation import arrange
from diagnosis.report import render
from diagnosis.run import diagnose
from envs.log import Log
from envs.plant.plant import record
from envs.plant.sensors import AmplifierNoise
from envs.robots import find_robot

IMAGES = Path(__file__).parent / "img"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
HIDDEN = ("coulomb_friction=6.9",)
NOISE = AmplifierNoise(rms=0.005)
EXCITATIONS = (
    "multisine:amplitude=1.2,band=0.5-8,joints=1",
    "chirp:amplitude=1.2,band=0.6-6,joints=1",
    "multisine:amplitude=1,band=0.4-5,joints=1",
)
WIDTH, HEIGHT = 1000, 1800
ABRIDGED = "<style>html{background:#fff} .part:not(.gap):not(.cause), footer {display: none}</style></head>"
"""What makes a picture of a page: its first sentence, the gap, and the cause."""


def logs() -> list[Log]:
    """Two experiments to fit and one to hold out."""
    robot = find_robot("adeptone")
    return [
        record(robot, HIDDEN, text, duration=20.0, seed=seed, noise=NOISE, name=f"experiment_{seed + 1}").log
        for seed, text in enumerate(EXCITATIONS)
    ]


def photograph(page: str, target: Path) -> None:
    """The page as PNG of 256 colours, trimmed below."""
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        sys.exit(f"no browser found. Install one of {', '.join(BROWSERS)}")
    with tempfile.TemporaryDirectory() as folder:
        source, shot = Path(folder) / "page.html", Path(folder) / "page.png"
        source.write_text(page, encoding="utf-8")
        size = (f"--window-size={WIDTH},{HEIGHT}", "--force-device-scale-factor=1.5", "--hide-scrollbars")
        options = ("--headless", "--no-sandbox", "--disable-gpu", *size, f"--screenshot={shot}")
        subprocess.run([browser, *options, source.as_uri()], check=True, capture_output=True, timeout=120)
        image = Image.open(shot).convert("RGB")
        ink = ImageChops.difference(image, Image.new("RGB", image.size, "white")).getbbox()
        bottom = min(ink[3] + 30, image.height) if ink else image.height
        target.parent.mkdir(exist_ok=True)
        image.crop((0, 0, image.width, bottom)).quantize(256).save(target, optimize=True)


def main() -> None:
    """Diagnose, render, photograph."""
    first, second, third = logs()
    diagnosis = diagnose(arrange([first, second], [third], "adeptone"))[0]
    print(diagnosis.sentence)
    photograph(render(diagnosis).replace("</head>", ABRIDGED, 1), IMAGES / "report.png")


if __name__ == "__main__":
    main()
