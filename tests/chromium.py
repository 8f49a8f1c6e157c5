"""A headless Chromium, driven over two pipes: nothing but the standard library is needed."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

COMMAND = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(COMMAND is None, reason="no Chromium on the PATH")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip

SHIM = (
    "import os, sys; os.dup2(int(sys.argv[1]), 3); os.dup2(int(sys.argv[2]), 4); "
    "os.execv(sys.argv[3], sys.argv[3:])"
)
"""The browser reads commands from descriptor 3 and writes answers to 4."""
CONTRASTS = """(() => {
  const channels = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const luminance = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
    .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const found = channels(getComputedStyle(e).backgroundColor);
      if (found.length === 3 || found[3] > 0) return found;
    }
    return null;  // a page without a colour of its own has no contrast to vouch for
  };
  document.querySelectorAll("details").forEach((d) => { d.open = true; });
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let t; (t = texts.nextNode());) {
    const element = t.parentElement, name = element.localName;
    if (!t.textContent.trim() || ["script", "title"].includes(name)) continue;
    const style = getComputedStyle(element);
    if (!element.checkVisibility()) continue;
    const isDrawn = element instanceof SVGElement;
    const text = channels(isDrawn ? style.fill : style.color);
    const inMark = isDrawn && style.fontWeight >= 700;  // a number inside one of these
    const marks = inMark ? [...element.closest("svg").querySelectorAll(".point use")] : [];
    const grounds = inMark ? marks.map((m) => channels(getComputedStyle(m).fill)) : [behind(element)];
    const kind = element.className.baseVal ?? element.className;
    for (const ground of grounds) {
      const [high, low] = [luminance(text), luminance(ground)].sort((a, b) => b - a);
      found.push([(high + 0.05) / (low + 0.05), `${name}.${kind}: ${t.textContent}`]);
    }
  }
  return found.sort((a, b) => a[0] - b[0]);
})()"""
"""Expression: the contrast of each text of a page with its background, and the text, lowest first."""


class Browser:
    """One page of a browser that has an empty profile of its own.

    Parameters
    ----------
    profile : path
        An empty folder.
    """

    def __init__(self, profile: Path):
        read, self._out = os.pipe()
        self._in, write = os.pipe()
        shim = [sys.executable, "-I", "-S", "-c", SHIM, str(read), str(write), COMMAND]
        self._process = subprocess.Popen(
            [*shim, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(read, write), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(read)
        os.close(write)
        self._rest, self._n, self._session = b"", 0, ""
        self.events: list[dict[str, Any]] = []
        page = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, *, of_page: bool = True, **params: Any) -> dict[str, Any]:
        """Send a command to the page (or the browser), keep events that come first, return the answer."""
        self._n += 1
        message = {"id": self._n, "method": method, "params": params}
        if self._session and of_page:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._n:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            got = os.read(self._in, 1 << 16)
            if not got:
                raise RuntimeError("the browser ended")
            self._rest += got
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, path: Path, *, width: int = 1200, scheme: str = "light", media: str = "") -> None:
        """Show a file and wait until it is loaded."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
        )
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", media=media, features=features)
        self.call("Page.navigate", url=path.as_uri())
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._receive())
        self.events = [e for e in self.events if e.get("method") != "Page.loadEventFired"]

    def run(self, expression: str) -> Any:
        """Return the value of a JavaScript expression."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(str(found["exceptionDetails"]))
        return found["result"].get("value")

    def traced(self, expression: str, categories: list[str]) -> tuple[Any, list[dict[str, Any]]]:
        """Return the value of an expression, and the events that the browser traced meanwhile."""
        config = {"recordMode": "recordUntilFull", "traceBufferSizeInKb": 400_000}
        config["includedCategories"] = categories
        self.call("Tracing.start", of_page=False, traceConfig=config)
        value = self.run(expression)
        self.events.clear()
        self.call("Tracing.end", of_page=False)
        while not any(event.get("method") == "Tracing.tracingComplete" for event in self.events):
            self.events.append(self._receive())
        parts = [e["params"]["value"] for e in self.events if e.get("method") == "Tracing.dataCollected"]
        self.events.clear()
        return value, [event for part in parts for event in part]

    def noises(self, page: Path) -> list[str]:
        """Return what the console said, and what a page asked for beside itself, of the events."""
        spoken = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
        said = [str(event) for event in self.events if event.get("method") in spoken]
        sent = [e["params"] for e in self.events if e.get("method") == "Network.requestWillBeSent"]
        urls = [one["request"]["url"] for one in sent]
        return said + [url for url in urls if url != page.as_uri() and not url.startswith("data:")]

    def press(self, key: str, code: int, modifiers: int = 0) -> None:
        """Press a key: its name, its Windows code, and the sum of Alt 1, Ctrl 2 and Shift 8."""
        for kind in ("keyDown", "keyUp"):
            text = {"text": "\r"} if (kind, key) == ("keyDown", "Enter") else {}
            names = {"key": key, "code": key, "windowsVirtualKeyCode": code, "modifiers": modifiers}
            self.call("Input.dispatchKeyEvent", type=kind, **names, **text)

    def close(self) -> None:
        """End the browser."""
        try:
            self._session = ""
            self.call("Browser.close")
        except (RuntimeError, OSError):
            self._process.kill()
        self._process.wait(timeout=20)
        os.close(self._in)
        os.close(self._out)
