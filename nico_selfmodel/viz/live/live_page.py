"""Drake's Meshcat page as it is worth opening: its sliders open, and not over the picture."""

import threading
import urllib.request
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from pydrake.geometry import Meshcat

from nico_selfmodel.viz.scene.surroundings import ASPECT, NIGHT_SCRIPT
from nico_selfmodel.with_blocks import ClosedAtEnd

PANEL_PX, NARROW_PX = 350, 700
"""Width of the sliders; below which width of the window they stand under the picture [px]."""
SHARE_VH = 45
"""Height of the sliders under the picture, at most [% of the window]."""
_ADDRESS = "url = location.toString();"
_LOOK = f"""
<style>
  html {{ background: #1a1a1a; color-scheme: light dark; }}
  #meshcat-pane {{ width: calc(100vw - {PANEL_PX}px) !important; }}
  .dg.main {{ font-size: 12px; }}
  .dg .property-name {{ width: 52% !important; text-overflow: ellipsis; }}
  .dg .c {{ width: 48% !important; }}
  .dg .c .slider {{ width: 55% !important; }}
  .dg .c input[type=text] {{ width: 40% !important; }}
  @media (max-width: {NARROW_PX}px) {{
    #meshcat-pane {{ width: 100vw !important; height: calc(100vh - var(--panel)) !important; }}
    .dg.main {{ position: fixed !important; top: auto !important; bottom: 0;
      max-height: {SHARE_VH}vh; overflow-y: auto; }}
    .dg.main, .dg.main .close-button {{ width: 100vw !important; margin: 0 !important; }}
  }}
</style>
<script>
  {NIGHT_SCRIPT}
  viewer.gui.width = {PANEL_PX};
  viewer.gui.open();
  for (const folder of Object.values(viewer.gui.__folders)) folder.close();
  const pane = document.getElementById("meshcat-pane");
  let fitted = "";
  function fit() {{
    const high = Math.min(viewer.gui.domElement.offsetHeight, {SHARE_VH / 100} * innerHeight);
    document.documentElement.style.setProperty("--panel", `${{high}}px`);
    const zoom = Math.min(1, pane.offsetWidth / pane.offsetHeight / {ASPECT});
    const found = [high, pane.offsetWidth, pane.offsetHeight, zoom].join();
    if (found === fitted && viewer.camera.zoom === zoom) return;
    fitted = found;
    viewer.camera.zoom = zoom;
    viewer.set_3d_pane_size();
    viewer.camera.updateProjectionMatrix();
  }}
  // Sliders and camera come with the scene, whenever that is.
  setInterval(() => {{ fit(); paint(); }}, 500);
  addEventListener("resize", () => setTimeout(fit, 50));
</script>
"""
_WHOLE = f"""
<script>
  {NIGHT_SCRIPT}
  const pane = document.getElementById("meshcat-pane");
  function fit() {{
    const zoom = Math.min(1, pane.offsetWidth / pane.offsetHeight / {ASPECT});
    if (viewer.camera.zoom === zoom) return;
    viewer.camera.zoom = zoom;
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty();
  }}
  // The camera comes with the scene, whenever that is.
  setInterval(() => {{ fit(); paint(); }}, 500);
</script>
"""
_VIEWPORT = '<head><meta name="viewport" content="width=device-width, initial-scale=1">'


class LivePage(ClosedAtEnd):
    """Serves Meshcat's page with its sliders open, to this machine alone.

    Drake's own page begins with them closed, and over the picture; nothing that it can be told
    changes that. All else that the page asks for is handed on from Drake's server.
    """

    def __init__(self, meshcat: Meshcat) -> None:
        """Begin to serve; `close` ends it."""
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(meshcat.web_url()))
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """What to open."""
        return f"http://localhost:{self._server.server_port}"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def opened(page: str, address: str) -> str:
    """Return Drake's page with its sliders open, and connected to its own server.

    Args:
        page: As Drake serves it; one that this was not made for stays as it is.
        address: Of Drake's server.
    """
    page = page.replace("<head>", _VIEWPORT, 1).replace(_ADDRESS, f'url = "{address}/";', 1)
    head, end, tail = page.rpartition("</body>")
    return f"{head}{_LOOK}{end}{tail}" if end else page


def recorded(page: str) -> str:
    """Return Drake's page of a recording so that narrow windows show all of the scene too.

    Args:
        page: As Drake makes it; one that this was not made for stays as it is.
    """
    head, end, tail = page.replace("<head>", _VIEWPORT, 1).rpartition("</body>")
    return f"{head}{_WHOLE}{end}{tail}" if end else page


def _handler(address: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            try:
                with urllib.request.urlopen(f"{address}{self.path}", timeout=10.0) as answer:
                    content, kind = answer.read(), answer.headers.get("Content-Type", "")
            except OSError:
                self.send_error(404)
                return
            if self.path.partition("?")[0] == "/":
                content = opened(content.decode("utf-8"), address).encode("utf-8")
            with suppress(ConnectionError):  # a reader that left before it had everything
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing of what is asked for."""

    return Handler
