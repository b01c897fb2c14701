"""A bench that says what a test wants: the HTTP and WebSocket side of twin/live, with made-up drives."""
import http.server, json, os, struct, threading

import frames

LIBRARIES = {"three.min.js": "/usr/share/javascript/three/three.min.js"}
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
}
POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'"
QUANTITIES = [
    ("position_rad", "rad"),
    ("velocity_rad_s", "rad/s"),
    ("motor_torque_nm", "Nm"),
    ("friction_nm", "Nm"),
    ("load_nm", "Nm"),
    ("temperature_degC", "degC"),
]
JOINT = {"law": "load", "limit_degC": 120.0, "gear_ratio": 100.0, "parameters": ["Fc", "Fs", "Vs"]}
COMMANDS = ["pause", "resume", "step", "marker", "fault", "ambient", "payload", "wear", "joint_fault"]
COMMANDS += ["record", "export"]


def geometry(joints):
    """A tower of joints, 1 m each: a red box each, and a housing beside it that sticks out."""
    box = {"name": "", "type": "box", "quat": [1, 0, 0, 0], "mesh": None, "housing": None}
    bodies = [{"name": "world", "parent": 0, "joint": None, "geoms": []}]
    for j in range(joints):
        own = {**box, "size": [0.2, 0.2, 0.45], "pos": [0, 0, 0.5], "rgba": [0.8, 0.1, 0.1, 1]}
        housing = {**own, "type": "sphere", "size": [0.3, 0, 0], "housing": f"joint{j + 1}", "pos": [0, -0.3, 0.5]}
        bodies.append({"name": f"link{j}", "parent": j, "joint": f"joint{j + 1}", "geoms": [own, housing]})
    tent = {"name": "tent", "vertices": [0, 0, 0, 0.5, 0, 0, 0, 0.5, 0, 0, 0, 0.5], "faces_of_model": 9}
    tent["faces"] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
    bodies[1]["geoms"].append({**box, "type": "mesh", "size": [1, 1, 1], "pos": [0.3, 0, 0], "rgba": [0, 1, 0, 1]})
    bodies[1]["geoms"][-1]["mesh"] = 0
    return {"bodies": bodies, "meshes": [tent], "left_out": 0, "eye": [0, -1, 0]}


def hello(joints=6, **changes):
    columns = [{"joint": None, "name": "time_s", "unit": "s"}]
    names = [f"joint{i + 1}" for i in range(joints)]
    columns += [{"joint": j, "name": name, "unit": unit} for j in names for name, unit in QUANTITIES]
    return {
        "type": "hello",
        "version": "1.2.3",
        "program": "drive",
        "scenario": "irb6620_hold",
        "session": "first",
        "readonly": False,
        "step_s": 0.001,
        "commands": COMMANDS,
        "joint_faults": [{"name": "wear", "maximum": 4.0}, {"name": "backlash", "maximum": 0.01}],
        "joints": [{"name": j, **JOINT} for j in names],
        "columns": columns,
        "bodies": joints + 1,
        **changes,
    }


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_GET(self):
        bench = self.server.bench
        path = self.path.split("?")[0]
        if path == "/live":
            return self.live(bench)
        name = "index.html" if path == "/" else path[1:]
        if name == "geometry.json" and bench.geometry:
            return self.answer("application/json", json.dumps(bench.geometry).encode())
        file = LIBRARIES.get(name) or os.path.join(bench.folder, name)
        kind = TYPES.get(os.path.splitext(name)[1])
        if "/" in name or not kind or not os.path.isfile(file):
            bench.not_found.append(self.path)
            return self.send_error(404)
        with open(file, "rb") as f:
            self.answer(kind, f.read())

    def answer(self, kind, body):
        self.send_response(200)
        for key, value in (("Content-Type", kind), ("Content-Length", len(body)), ("Content-Security-Policy", POLICY)):
            self.send_header(key, str(value))
        self.end_headers()
        self.wfile.write(body)

    def live(self, bench):
        self.send_response(101)
        self.send_header("Upgrade", "websocket")
        self.send_header("Connection", "Upgrade")
        self.send_header("Sec-WebSocket-Accept", frames.accept_key(self.headers["Sec-WebSocket-Key"]))
        self.send_header("Sec-WebSocket-Protocol", self.headers.get("Sec-WebSocket-Protocol", ""))
        self.end_headers()
        self.wfile.flush()
        self.close_connection = True
        viewer = frames.Socket(self.connection, masks=False)
        bench.joined(viewer)
        try:
            while True:
                bench.said(viewer, json.loads(viewer.receive()[1]))
        except (ConnectionError, OSError):
            bench.viewers.discard(viewer)


class MockBench:
    """Serves `folder` on a port of its own; rows and messages go to every viewer."""

    def __init__(self, folder, said_hello, port=0):
        self.folder, self.hello, self.viewers = folder, said_hello, set()
        self.messages, self.not_found, self.events = [], [], []
        self.refuse = set()  # names of commands
        self.also = {}  # by such names, what else an answer has
        self.geometry = geometry(len(said_hello["joints"]))
        http.server.ThreadingHTTPServer.allow_reuse_address = True
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self.server.daemon_threads, self.server.bench = True, self
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def joined(self, viewer):
        for message in [self.hello, *self.events]:
            viewer.send(json.dumps(message))
        self.viewers.add(viewer)

    def said(self, viewer, message):
        self.messages.append(message)
        if message["type"] == "command":
            ok = message["do"] not in self.refuse
            answer = {"type": "done", "id": message["id"], "ok": ok, "message": "" if ok else "<b>not now</b>"}
            viewer.send(json.dumps({**answer, **self.also.get(message["do"], {})}))

    def tell(self, payload):
        for viewer in list(self.viewers):
            try:
                viewer.send(payload)
            except OSError:
                self.viewers.discard(viewer)

    def say(self, message):
        if message["type"] == "event":
            self.events.append(message)
        self.tell(json.dumps(message))

    def rows(self, first, rows):
        columns = len(self.hello["columns"])
        head = struct.pack("<IIIIQ", 1, len(rows), columns, 0, first)
        self.tell(head + b"".join(struct.pack(f"<{columns}d", *row) for row in rows))

    def poses(self, row, shift):
        """The tower, `shift` [m] to the right."""
        bodies = len(self.geometry["bodies"])
        head = struct.pack("<IIQ", 2, bodies, row)
        self.tell(
            head + b"".join(struct.pack("<7f", shift * (j > 0), 0, max(0, j - 1), 1, 0, 0, 0) for j in range(bodies))
        )

    def kill(self):
        """As a killed process: the port is free, every connection is cut."""
        self.server.shutdown()
        self.server.server_close()
        for viewer in list(self.viewers):
            viewer.close()
        self.viewers.clear()
