"""Takes pictures of pages of the site in Chromium: `python -m tools.website.screenshots [PAGE ...]`.

    build/shots/PAGE-390-light.png  PAGE-390-dark.png  PAGE-1280-light.png  PAGE-1280-dark.png

With the argument --keep it makes those of docs/screenshots again, which docs/project/site.md shows, and the preview.

The site is served on a free port of 127.0.0.1; Chromium resolves no other name, so a page that needs the network is
seen to fail. A page stands in a frame of the wanted width, because a window of Chromium cannot be as narrow as a phone.
"""

from __future__ import annotations

import functools
import http.server
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from tools.website.source import ROOT

SITE = ROOT / "build" / "site"
SHOTS = ROOT / "build" / "shots"
SIZES = {390: 844, 1280: 900}
THEMES = ("light", "dark")
KEPT = {
    "index": ((1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")),
    "tutorial/01-bits-on-a-wire": ((1280, "dark"), (390, "light")),
    "how-to/migrate": ((1280, "light"),),
    "reference/messages-modbus": ((1280, "dark"), (390, "light")),
    "class/03-a-register-read-by-hand@6": ((1280, "light"),),
    "class/03-a-register-read-by-hand-sheet": ((1280, "light"),),
}
"""The pictures of docs/screenshots."""
PREVIEW = (1200, 630)
"""The size of docs/_static/preview.png, which other programs show of a link to the site."""
PAGES = ("index", "tutorial/index", "how-to/index", "how-to/modbus", "reference/index", "explanation/late-answers")

_FRAME = """<!doctype html>
<body style="margin:0"><iframe id=f style="border:0;width:{width}px;height:{height}px"></iframe>
<script>
localStorage.setItem("theme", "{theme}");
document.getElementById("f").src = "/{page}.html{anchor}";
</script>"""


class _Handler(http.server.SimpleHTTPRequestHandler):
    """Serves the site, and below /.frame/ a page of one frame."""

    def do_GET(self) -> None:
        parts = urlsplit(self.path).path.split("/", 5)
        if parts[1] != ".frame":
            super().do_GET()
            return
        width, height, theme, page = parts[2:]
        page, _, anchor = page.partition("@")
        anchor = f"#{anchor}" if anchor else ""
        body = _FRAME.format(width=width, height=height, theme=theme, page=page, anchor=anchor).encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing of each request."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder while the block runs; its URL is the value."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Handler, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def take(url: str, target: Path, width: int, height: int) -> None:
    """Write the picture of one URL."""
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(
            [
                "chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                "--no-first-run", "--disable-background-networking", "--disable-component-update",
                "--disable-sync", "--hide-scrollbars", "--virtual-time-budget=4000",
                "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", f"--user-data-dir={profile}",
                f"--window-size={max(width, 500)},{height}", f"--screenshot={target}", url,
            ],
            check=True,
            capture_output=True,
            timeout=60,
        )  # fmt: skip


def cropped(file: Path, width: int, height: int) -> None:
    """Cut the picture to the frame, with 128 colours so that it is small; of fewer, a green lamp becomes black."""
    from PIL import Image

    with Image.open(file) as image:
        small = image.convert("RGB").crop((0, 0, width, height)).quantize(128, dither=Image.Dither.NONE)
    small.save(file, optimize=True)


def main(pages: list[str]) -> int:
    """Take each page at both widths in both themes, or the pictures that are kept."""
    kept = pages == ["--keep"]
    folder = ROOT / "docs" / "screenshots" if kept else SHOTS
    every = [(width, theme) for width in SIZES for theme in THEMES]
    wanted = KEPT if kept else dict.fromkeys(pages or PAGES, tuple(every))
    folder.mkdir(parents=True, exist_ok=True)
    with served(SITE) as url:
        for page, forms in wanted.items():
            for width, theme in forms:
                target = folder / f"{page.replace('/', '-').replace('@', '-')}-{width}-{theme}.png"
                take(f"{url}/.frame/{width}/{SIZES[width]}/{theme}/{page}", target, width, SIZES[width])
                cropped(target, width, SIZES[width])
                sys.stdout.write(f"{target.relative_to(ROOT)}  {target.stat().st_size // 1024} KB\n")
        if kept:
            target = ROOT / "docs" / "_static" / "preview.png"
            take(f"{url}/.frame/{PREVIEW[0]}/{PREVIEW[1]}/light/index", target, *PREVIEW)
            cropped(target, *PREVIEW)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
