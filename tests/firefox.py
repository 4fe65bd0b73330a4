"""Debian's Firefox, driven by its own protocol (Marionette: JSON over a socket), which needs no further program.

Without a display it gives no WebGL: it is shown one that is not there (Xvfb).
Source: firefox-source-docs.mozilla.org/testing/marionette/Protocol.html.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from waiting import until

_PREFERENCES = """
user_pref("marionette.port", {port});
user_pref("webgl.force-enabled", true);
user_pref("app.update.enabled", false);
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("toolkit.telemetry.reportingpolicy.firstRun", false);
user_pref("browser.shell.checkDefaultBrowser", false);
user_pref("browser.startup.homepage_override.mstone", "ignore");
user_pref("network.captive-portal-service.enabled", false);
user_pref("network.connectivity-service.enabled", false);
"""


class Firefox:
    """One window of a Firefox with a profile of its own. Skips the test where Firefox or Xvfb is not there."""

    def __init__(self, folder: Path) -> None:
        program = shutil.which("firefox-esr") or shutil.which("firefox")
        if program is None or shutil.which("Xvfb") is None:
            pytest.skip("no Firefox or no Xvfb found: install Debian's packages firefox-esr, xvfb and libgl1-mesa-dri")
        self._screen, display = _screen()
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        (folder / "user.js").write_text(_PREFERENCES.format(port=port))
        command = [program, "--marionette", "-remote-allow-system-access", "--profile", str(folder)]
        own = {**os.environ, "HOME": str(folder), "DISPLAY": display}
        self._process = subprocess.Popen(command, env=own, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._socket = _connected(port, self._process)
        self._buffer = b""
        self._asked = 0
        self._received()
        self._ask("WebDriver:NewSession", {"capabilities": {"alwaysMatch": {"acceptInsecureCerts": True}}})
        self._ask("WebDriver:SetTimeouts", {"script": 60_000, "pageLoad": 120_000})

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        for process in (self._process, self._screen):
            process.terminate()
            process.wait(timeout=30)

    def open(self, address: str) -> None:
        """Load a page; what the console said of others is forgotten."""
        self._in_browser("Services.console.reset();")
        self._ask("WebDriver:Navigate", {"url": address})

    def run(self, script: str) -> Any:
        """Return what a function's body returns in the page; a promise is waited for."""
        return self._ask("WebDriver:ExecuteScript", {"script": script, "args": []})["value"]

    def wait(self, condition: str, seconds: float = 60) -> None:
        """Wait until an expression is true in the page."""
        until(lambda: self.run(f"return Boolean({condition});"), seconds, condition)

    def said(self) -> list[str]:
        """Return errors and warnings of pages since the last one was opened."""
        return list(
            self._in_browser("""
          return Services.console.getMessageArray().filter(m => m instanceof Ci.nsIScriptError)
            .filter(m => /^(file|http):/.test(m.sourceName) || /Content.Security/.test(m.category + m.errorMessage))
            .map(m => `${m.category} ${m.sourceName.slice(0, 80)}: ${m.errorMessage}`);""")
        )

    def picture(self, selector: str) -> Any:
        """Return the pixels (h, w, 3; BGR) of an element."""
        found = self._ask("WebDriver:FindElement", {"using": "css selector", "value": selector})["value"]
        (element,) = found.values()
        shot = self._ask("WebDriver:TakeScreenshot", {"id": element, "full": False, "scroll": True})["value"]
        pixels = cv2.imdecode(np.frombuffer(base64.b64decode(shot), np.uint8), cv2.IMREAD_COLOR)
        return np.asarray(pixels).astype(int)

    def _in_browser(self, script: str) -> Any:
        self._ask("Marionette:SetContext", {"value": "chrome"})
        try:
            return self.run(script)
        finally:
            self._ask("Marionette:SetContext", {"value": "content"})

    def _ask(self, command: str, values: dict[str, Any]) -> Any:
        self._asked += 1
        text = json.dumps([0, self._asked, command, values]).encode()
        self._socket.sendall(b"%d:%s" % (len(text), text))
        _, number, error, result = self._received()
        assert number == self._asked
        assert error is None, f"{command}: {error['error']}: {error['message']}"
        return result

    def _received(self) -> Any:
        while b":" not in self._buffer:
            self._more()
        length, self._buffer = self._buffer.split(b":", 1)
        while len(self._buffer) < int(length):
            self._more()
        text, self._buffer = self._buffer[: int(length)], self._buffer[int(length) :]
        return json.loads(text)

    def _more(self) -> None:
        part = self._socket.recv(1 << 16)
        assert part, "Firefox ended"
        self._buffer += part


def _screen() -> tuple[subprocess.Popen[bytes], str]:
    """A screen in memory, and its name."""
    ours, theirs = os.pipe()
    command = ["Xvfb", "-displayfd", str(theirs), "-screen", "0", "1400x1000x24"]
    process = subprocess.Popen(command, pass_fds=[theirs], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(theirs)
    with os.fdopen(ours) as number:
        return process, f":{number.readline().strip()}"


def _connected(port: int, process: subprocess.Popen[bytes]) -> socket.socket:
    ends = time.monotonic() + 60
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=120)
        except ConnectionRefusedError:
            assert process.poll() is None, "Firefox did not start"
            assert time.monotonic() < ends, "Firefox does not listen"
            time.sleep(0.2)
