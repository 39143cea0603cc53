# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium, by WebDriver (https://www.w3.org/TR/webdriver2/), with Python's own library."""
import base64
import contextlib
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"


def is_there():
    return all(shutil.which(program) for program in ("chromium", "chromedriver"))


class Browser:
    def __init__(self, driver):
        self.base = driver
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage"]
        self.session = self.call("POST", "/session", {"capabilities": {"alwaysMatch": {
            "goog:loggingPrefs": {"browser": "ALL"}, "goog:chromeOptions": {"args": flags}}}})["sessionId"]

    def begin(self, width=1280, height=900, scheme="light"):
        """With no page, as if it had just been started."""
        self.do("POST", "/url", {"url": "about:blank"})
        self.errors()
        self.devtools("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.devtools("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def call(self, method, path, body=None):
        request = urllib.request.Request(self.base + path, method=method, headers={"Content-Type": "application/json"},
                                         data=None if body is None else json.dumps(body).encode())
        try:
            return json.load(urllib.request.urlopen(request, timeout=120))["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.load(error)["value"]["message"]) from None

    def do(self, method, path, body=None):
        return self.call(method, f"/session/{self.session}{path}", body)

    def devtools(self, command, **parameters):
        return self.do("POST", "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def run(self, script, *arguments):
        return self.do("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def run_async(self, script, *arguments):
        return self.do("POST", "/execute/async", {"script": script, "args": list(arguments)})

    def open(self, path):
        """Until all figures are drawn."""
        self.do("POST", "/url", {"url": path.as_uri()})
        deadline = time.monotonic() + 100
        while self.run("return document.documentElement.dataset.ready") != "yes":
            if time.monotonic() > deadline:
                raise AssertionError(f"not drawn: {self.errors()}")
            time.sleep(0.05)

    def find(self, selector):
        return self.do("POST", "/element", {"using": "css selector", "value": selector})[ELEMENT]

    def click(self, selector):
        self.do("POST", f"/element/{self.find(selector)}/click", {})

    def type(self, selector, keys):
        self.do("POST", f"/element/{self.find(selector)}/value", {"text": keys})

    def press(self, key):
        """Wherever the focus is."""
        self.do("POST", "/actions", {"actions": [{"type": "key", "id": "keyboard", "actions": [
            {"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]}]})

    def text(self, selector):
        return self.do("GET", f"/element/{self.find(selector)}/text")

    def attribute(self, selector, name):
        return self.do("GET", f"/element/{self.find(selector)}/attribute/{name}")

    def errors(self):
        """What the console was told since last asked."""
        return [entry["message"] for entry in self.do("POST", "/se/log", {"type": "browser"})]

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.devtools("Page.captureScreenshot")["data"]))

    def close(self):
        self.do("DELETE", "")


@contextlib.contextmanager
def driver():
    # Chromium leaves folders behind: here they go.
    folder = tempfile.TemporaryDirectory(prefix="ontime-test-", ignore_cleanup_errors=True)
    process = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                               env=dict(os.environ, TMPDIR=folder.name))
    try:
        for line in process.stdout:
            if found := re.search(r"started successfully on port (\d+)", line):
                break
        else:
            raise AssertionError("chromedriver does not start")
        yield f"http://127.0.0.1:{found[1]}"
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()
        folder.cleanup()
