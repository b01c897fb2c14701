"""A tab of Debian's chromium, driven over its DevTools socket."""
import base64, itertools, json, os, subprocess, threading, time, urllib.request

import frames, png


class Browser:
    def __init__(self, folder, *more):
        self.folder = os.path.join(folder, "browser")
        self.process = subprocess.Popen(
            ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
            + ["--enable-unsafe-swiftshader", *more]  # WebGL without a graphics card
            + ["--remote-debugging-port=0", "--hide-scrollbars", "--user-data-dir=" + self.folder, "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.port = int(self.until(self.port_file, 30).split()[0])

    def port_file(self):
        try:
            with open(os.path.join(self.folder, "DevToolsActivePort")) as f:
                return f.read() or None
        except FileNotFoundError:
            return None

    @staticmethod
    def until(condition, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = condition()
            if found:
                return found
            time.sleep(0.03)
        raise TimeoutError(f"not within {seconds} s")

    def tab(self):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/json/list") as answer:
            page = next(t for t in json.load(answer) if t["type"] == "page")
        socket = frames.connect("127.0.0.1", self.port, "/devtools/page/" + page["id"])
        socket.connection.settimeout(None)  # a test may leave the tab alone for minutes
        return Tab(socket)

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Tab:
    """Commands and what the page did: `console` (errors, warnings, exceptions), `requests` (addresses)."""

    patience_s = 30  # of a command, and of a page's load

    def __init__(self, socket):
        self.socket, self.answers, self.numbers = socket, {}, itertools.count(1)
        self.console, self.requests, self.loads = [], [], 0
        self.arrived = threading.Condition()
        threading.Thread(target=self.listen, daemon=True).start()
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.command(domain + ".enable")
        # Errors without an exception, such as loops of observers, are told to the page alone.
        tell = (
            "addEventListener('error', (event) => { if (!event.error && event.message) console.error(event.message); })"
        )
        self.command("Page.addScriptToEvaluateOnNewDocument", source=tell)

    def listen(self):
        try:
            while True:
                message = json.loads(self.socket.receive()[1])
                with self.arrived:
                    if "id" in message:
                        self.answers[message["id"]] = message
                    else:
                        self.note(message["method"], message["params"])
                    self.arrived.notify_all()
        except (ConnectionError, OSError):
            pass

    def note(self, method, event):
        if method == "Runtime.exceptionThrown":
            details = event["exceptionDetails"]
            self.console.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Runtime.consoleAPICalled" and event["type"] in ("error", "warning", "assert"):
            self.console.append(str([a.get("value") for a in event["args"]]))
        elif method == "Log.entryAdded" and event["entry"]["level"] in ("error", "warning"):
            # Of the processor that draws in place of a graphics card: it reads back what it drew.
            if "GL Driver Message (OpenGL, Performance" in event["entry"]["text"]:
                return
            self.console.append(event["entry"]["text"] + " " + event["entry"].get("url", ""))
        elif method == "Network.requestWillBeSent":
            self.requests.append(event["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(event["url"])
        elif method == "Page.loadEventFired":
            self.loads += 1

    def command(self, method, **parameters):
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        with self.arrived:
            if not self.arrived.wait_for(lambda: number in self.answers, self.patience_s):
                raise TimeoutError(method)
            answer = self.answers.pop(number)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return answer["result"]

    def go(self, address):
        loads = self.loads
        self.command("Page.navigate", url=address)
        with self.arrived:
            if not self.arrived.wait_for(lambda: self.loads > loads, self.patience_s):
                raise TimeoutError("load of " + address)

    def value(self, expression):
        """Of JavaScript in the page. The DevTools evaluate it, which the page's own policy forbids to the page."""
        result = self.command("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in result:
            raise RuntimeError(expression + ": " + str(result["exceptionDetails"].get("exception", result)))
        return result["result"].get("value")

    def until(self, expression, seconds=30):
        """The first true value, else the last one."""
        end = time.monotonic() + seconds
        while True:
            value = self.value(expression)
            if value or time.monotonic() > end:
                return value
            time.sleep(0.05)

    def window(self, width, height, scheme="light"):
        mobile = {"deviceScaleFactor": 1, "mobile": False}
        self.command("Emulation.setDeviceMetricsOverride", width=width, height=height, **mobile)
        scheme = [{"name": "prefers-color-scheme", "value": scheme}]
        self.command("Emulation.setEmulatedMedia", features=scheme)

    def key(self, key, code=0, modifiers=0):
        text = {"text": key} if len(key) == 1 and not modifiers else {}
        press = {"key": key, "windowsVirtualKeyCode": code, "modifiers": modifiers}
        self.command("Input.dispatchKeyEvent", type="keyDown", **press, **text)
        self.command("Input.dispatchKeyEvent", type="keyUp", **press)

    def click(self, selector):
        """With the mouse, in the middle of what is seen of it."""
        place = self.value(
            f"""(() => {{ const e = document.querySelector({json.dumps(selector)});
          e.scrollIntoView({{block: 'center'}}); const r = e.getBoundingClientRect();
          const x = r.x + r.width / 2, y = r.y + r.height / 2, at = document.elementFromPoint(x, y);
          return e === at || e.contains(at) ? [x, y] : String(at?.outerHTML).slice(0, 200); }})()"""
        )
        if isinstance(place, str):
            raise RuntimeError(f"{selector} is covered by {place}")
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, *place, button="left", clickCount=1)

    def fill(self, selector, text):
        """Clicks on an input and types in place of what is there."""
        self.click(selector)
        select_all = {"modifiers": 2, "commands": ["selectAll"]}
        self.command("Input.dispatchKeyEvent", type="keyDown", key="a", windowsVirtualKeyCode=65, **select_all)
        self.command("Input.dispatchKeyEvent", type="keyUp", key="a", windowsVirtualKeyCode=65, modifiers=2)
        self.command("Input.insertText", text=str(text))

    def choose(self, selector, value):
        """Goes through a list by the arrow keys."""
        at = f"document.querySelector({json.dumps(selector)})"
        self.value(at + ".focus()")
        places = self.value(f"(e => [e.selectedIndex, [...e.options].findIndex(o => o.value === {json.dumps(value)})])"
                            f"({at})")  # fmt: skip
        if places[1] < 0:
            raise RuntimeError(f"{selector} has no {value}")
        way = ("ArrowDown", 40) if places[1] > places[0] else ("ArrowUp", 38)
        while self.value(at + ".value") != value:
            before = self.value(at + ".selectedIndex")
            self.key(*way)
            if self.value(at + ".selectedIndex") == before:
                raise RuntimeError(f"{selector} stays at {before} of {places}")

    def mouse(self, kind, x, y, **more):
        self.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, x, y, by_x, by_y, button="left"):
        held = {"left": 1, "right": 2}[button]
        self.mouse("mousePressed", x, y, button=button, clickCount=1)
        self.mouse("mouseMoved", x + by_x / 2, y + by_y / 2, button=button, buttons=held)
        self.mouse("mouseMoved", x + by_x, y + by_y, button=button, buttons=held)
        self.mouse("mouseReleased", x + by_x, y + by_y, button=button, clickCount=1)

    def pixels(self, selector):
        """What is seen of an element: rows of (red, green, blue), as an array."""
        box = self.value(
            f"""(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{block: 'center'}});
          const r = e.getBoundingClientRect(); return [r.x + scrollX, r.y + scrollY, r.width, r.height]; }})()"""
        )
        clip = dict(zip(("x", "y", "width", "height"), box), scale=1)
        shot = self.command("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)
        return png.pixels(base64.b64decode(shot["data"]))

    def picture(self, file, whole=True):
        shot = self.command("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        with open(file, "wb") as f:
            f.write(base64.b64decode(shot["data"]))
