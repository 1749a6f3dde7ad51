"""A Chromium without a window, driven over its debugging pipe."""

import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S

PROGRAM = shutil.which("chromium") or shutil.which("google-chrome")
needs_browser = pytest.mark.skipif(
    not PROGRAM or sys.platform != "linux", reason="chromium: no Chromium is installed on this machine"
)
# The browser reads from descriptor 3 and writes to descriptor 4.
LAUNCHER = 'exec "$@" 3<&"$COMMANDS" 4>&"$ANSWERS"'


class Page:
    """A page of a browser; leaving the context ends the browser.

    Attributes:
        complaints: What the page's console, its exceptions and its dialogs have said.
    """

    def __init__(self, folder: Path) -> None:
        self.complaints: list[str] = []
        theirs_in, self._commands = _pipe()
        self._answers, theirs_out = _pipe()
        self._session: str | None = None
        self._buffer = b""
        self._number = 0
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]
        words = [PROGRAM, *options, "--remote-debugging-pipe", f"--user-data-dir={folder}", "about:blank"]
        self._process = subprocess.Popen(
            ["bash", "-c", LAUNCHER, "bash", *words],
            env={**os.environ, "COMMANDS": str(theirs_in), "ANSWERS": str(theirs_out)},
            pass_fds=(theirs_in, theirs_out), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._commands)
        os.close(self._answers)
        try:
            self._process.wait(PROCESS_S)
        finally:
            # Its helpers may end later than it does.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def open(self, url: str) -> None:
        """Open a page anew and wait until it and its scripts are loaded."""
        for each in ("about:blank", url):  # from the same page another fragment would load nothing
            self._call("Page.navigate", url=each)
            while self._read().get("method") != "Page.loadEventFired":
                pass

    def evaluate(self, expression: str) -> object:
        """Return the value of an expression of JavaScript; that of a promise, when it is there."""
        answer = self._call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press a key and let it go."""
        for kind in ("rawKeyDown", "keyUp"):
            self._call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def _call(self, method: str, **parameters: object) -> dict:
        self._number += 1
        request = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            request["sessionId"] = self._session
        os.write(self._commands, json.dumps(request).encode() + b"\0")
        while (message := self._read()).get("id") != self._number:
            pass
        assert "error" not in message, message
        return message["result"]

    def _read(self) -> dict:
        while b"\0" not in self._buffer:
            readable, _, _ = select.select([self._answers], [], [], PROCESS_S)
            assert readable, f"the browser has said nothing for {PROCESS_S} s"
            more = os.read(self._answers, 1 << 16)
            assert more, "the browser has ended"
            self._buffer += more
        text, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(text)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, facts: dict) -> None:
        if method == "Runtime.exceptionThrown":
            self.complaints.append(facts["exceptionDetails"]["text"])
        elif method == "Log.entryAdded":
            self.complaints.append(f"{facts['entry']['level']}: {facts['entry']['text']}")
        elif method in ("Runtime.consoleAPICalled", "Page.javascriptDialogOpening"):
            self.complaints.append(json.dumps(facts))


# Above the two numbers that the browser gives them.
def _pipe() -> tuple[int, int]:
    low = os.pipe()
    high = tuple(fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10) for fd in low)
    for fd in low:
        os.close(fd)
    return high
