"""Pictures of the report for the documents: `python docs/make_images.py [output/report.html]`, after `make run`.

It needs Chromium (`chromium`) and Poppler (`pdftoppm`), as Debian names them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from matplotlib import image

IMAGES = Path(__file__).with_name("images")
#: Width and height of what is seen of the page at once [pixels].
SCREENS = {"laptop": (1366, 768), "phone": (390, 844)}


def main() -> None:
    """Write the pictures of a laptop's and a phone's first screen and of the first printed page."""
    page = Path(sys.argv[1] if len(sys.argv) > 1 else "output/report.html").resolve().as_uri()
    with tempfile.TemporaryDirectory() as folder:
        for name, (width, height) in SCREENS.items():
            picture, frame = Path(folder) / f"{name}.png", Path(folder) / "frame.html"
            # Chromium's own windows are 500 pixels wide or more.
            style = f"border:0;width:{width}px;height:{height}px"
            frame.write_text(f'<body style="margin:0"><iframe src="{page}" style="{style}"></iframe>', encoding="utf-8")
            shot = ("--allow-file-access-from-files", "--hide-scrollbars", f"--screenshot={picture}")
            _chromium(frame.as_uri(), f"--window-size={max(width, 500)},{height}", *shot)
            _store(picture, name, width)
        printed = Path(folder) / "report.pdf"
        _chromium(page, "--no-pdf-header-footer", f"--print-to-pdf={printed}")
        command = ["pdftoppm", "-r", "100", "-l", "1", "-singlefile", "-png", str(printed), str(Path(folder) / "print")]
        subprocess.run(command, check=True)
        _store(Path(folder) / "print.png", "print", None)


def _chromium(page: str, *options: str) -> None:
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", *options, page]
    subprocess.run(command, check=True, capture_output=True)


def _store(picture: Path, name: str, width: int | None) -> None:
    options = {"quality": 72, "optimize": True}
    image.imsave(IMAGES / f"report-{name}.jpg", image.imread(picture)[:, :width, :3], pil_kwargs=options)


if __name__ == "__main__":
    main()
