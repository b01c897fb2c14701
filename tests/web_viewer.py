"""A viewer of a live bench in Python tests: the line `web:`, the WebSocket, rows against telemetry.h5."""
import base64, json, re, socket, struct, subprocess, time

import h5py
import numpy

from harness import check, path, work

PATIENCE_S = 60


def web_address(log):
    """Of the line 'web:', once it is there."""
    for _ in range(PATIENCE_S * 20):
        found = re.search(r"^web: http://(127\.0\.0\.1):(\d+)/$", open(log).read(), re.M)
        if found:
            return found[1], int(found[2])
        time.sleep(0.05)
    raise RuntimeError(f"no line 'web:' in {open(log).read()!r}")


def begin_web(program, name, *command):
    """A process with a page, whose stderr is work/NAME.log, and where the page is."""
    with open(path(name + ".log"), "w") as log:
        process = subprocess.Popen([program, *command, "--web", "127.0.0.1:0"], cwd=work, stderr=log,
                                   stdout=open(path(name + ".out"), "w"))  # fmt: skip
    try:
        return process, web_address(path(name + ".log"))
    except RuntimeError:
        process.kill()
        raise


class WebSocket:
    """As a browser's, with a mask of zeros. `status`: the answer to its request."""

    def __init__(self, host, port, subprotocol, target="/live", origin=None):
        self.connection = socket.create_connection((host, port), PATIENCE_S)
        key = base64.b64encode(bytes(16)).decode()
        from_where = f"Origin: {origin}\r\n" if origin else ""
        self.connection.sendall(
            f"GET {target} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"{from_where}Sec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Protocol: {subprotocol}\r\n\r\n".encode()
        )
        self.stream = self.connection.makefile("rb")
        self.status = self.stream.readline().decode().split()[1]
        while self.stream.readline() not in (b"\r\n", b""):
            pass

    def say(self, message):
        text = json.dumps(message).encode()
        size = struct.pack(">B", 0x80 | len(text)) if len(text) < 126 else struct.pack(">BH", 0xFE, len(text))
        self.connection.sendall(b"\x81" + size + bytes(4) + text)

    def hear(self):
        """(opcode, content) of all that comes, to the end."""
        while head := self.stream.read(2):
            size = head[1]
            if size > 125:
                size = int.from_bytes(self.stream.read(2 if size == 126 else 8), "big")
            yield head[0] & 15, self.stream.read(size)
            if head[0] & 15 == 8:
                return


def messages(host, port, *say, answer=None):
    """(opcode, content) of all that a viewer gets, to the end; it says `say` at once, and to each text what `answer`
    makes of it: a list."""
    viewer = WebSocket(host, port, "tribotwin.live.v1")
    assert viewer.status == "101", viewer.status
    with viewer.connection:
        for message in say:
            viewer.say(message)
        for opcode, content in viewer.hear():
            for message in answer(json.loads(content)) if answer and opcode == 1 else ():
                viewer.say(message)
            yield opcode, content


def watch(host, port, *say, answer=None):
    """Texts by type, the rows with their numbers, and the code of the end. Poses are passed over."""
    texts, numbers, rows, end = {}, [], [], None
    for opcode, content in messages(host, port, *say, answer=answer):
        if opcode == 1:
            message = json.loads(content)
            texts.setdefault(message["type"], []).append(message)
        elif opcode == 2:
            kind, count, columns, zero, first = struct.unpack("<IIIIQ", content[:24])
            if kind == 2:  # poses
                continue
            assert (kind, zero) == (1, 0)
            numbers += range(first, first + count)
            rows.append(numpy.frombuffer(content[24:], "<f8").reshape(count, columns))
        elif opcode == 8:
            end = struct.unpack(">H", content[:2])[0]
    return texts, numpy.array(numbers), numpy.concatenate(rows), end


def compare(name, folder, hello, numbers, rows):
    with h5py.File(path(folder, "telemetry.h5")) as file:
        channels = [file[c["joint"]][c["name"]] if c["joint"] else file[c["name"]] for c in hello["columns"]]
        recorded, units = [c[:] for c in channels], [c.attrs["unit"].decode() for c in channels]
    recorded = numpy.stack(recorded, axis=1)
    check(f"{name}: most rows of the record came", len(numbers) > 0.5 * len(recorded), (len(numbers), len(recorded)))
    check(f"{name}: rows are numbered without a gap", (numpy.diff(numbers) == 1).all(), numbers)
    check(f"{name}: the last row came", numbers[-1] == len(recorded) - 1, (numbers[-1], len(recorded)))
    same = rows.view("u8") == recorded[numbers].view("u8")
    check(f"{name}: every double equals that of telemetry.h5", same.all(), numpy.argwhere(~same)[:5])
    check(f"{name}: something moved", rows.std(axis=0).max() > 0)
    check(f"{name}: units are those of telemetry.h5", units == [c["unit"] for c in hello["columns"]], units)
    joints = [j["name"] for j in hello["joints"]]
    check(f"{name}: joints", joints == [f"joint{i}" for i in range(1, 7)], joints)
