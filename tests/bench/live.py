"""What ten viewers of --web cost the bus: SYNC to TPDO of six drives at 1 kHz over socketcand, with and without, in
turns, each in a session of its own. Arguments: build folder, pairs (10 without), SYNCs of a turn (10,000 without)."""
import atexit, json, os, re, selectors, socket, statistics, subprocess, sys, tempfile, threading, time

build = sys.argv[1]
source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
scenario = os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")
trip = os.path.join(build, "tests", "socketcand_round_trip")
work = tempfile.TemporaryDirectory()
VIEWERS, PORT = 10, 29701

REQUEST = (
    "GET /live HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13"
    "\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: tribotwin.live.v1\r\n\r\n"
)


def request_to(port):
    """A WebSocket that is open."""
    one = socket.create_connection(("127.0.0.1", port))
    one.sendall(REQUEST.format(port).encode())
    answer = one.recv(12, socket.MSG_WAITALL)
    assert answer == b"HTTP/1.1 101", answer + one.recv(1000)
    return one


class Viewers(threading.Thread):
    """Reads all that comes, as fast as it comes: what it costs is the sending."""

    def __init__(self, port, count):
        super().__init__(daemon=True)
        self.bytes, self.sockets, self.ready = 0, [], selectors.DefaultSelector()
        for _ in range(count):
            one = request_to(port)
            one.setblocking(False)
            self.ready.register(one, selectors.EVENT_READ)
            self.sockets.append(one)

    def run(self):
        into = bytearray(1 << 20)
        while self.sockets:
            for key, _ in self.ready.select():
                try:
                    got = key.fileobj.recv_into(into)
                except ConnectionError:
                    got = 0
                self.bytes += got
                if got == 0:
                    self.ready.unregister(key.fileobj)
                    self.sockets.remove(key.fileobj)


def start(name, *more):
    """A session, and where its page is."""
    address = f"socketcand://127.0.0.1:{PORT}/can0"
    with open(os.path.join(work.name, name + ".log"), "w") as log:
        process = subprocess.Popen(
            [os.path.join(build, "bin", "tribotwin-hil"), "drive", scenario, "--quiet", "--cycle", "1", "--force",
             "--set", "telemetry_rate_hz=1000", "--can", address,
             "--stats", os.path.join(work.name, name + ".json"), *more],
            stderr=log,
        )  # fmt: skip
    atexit.register(process.kill)
    for _ in range(200):
        said = open(log.name).read()
        found = re.search(r"web: http://127\.0\.0\.1:(\d+)/", said)
        if found or not more:
            try:
                socket.create_connection(("127.0.0.1", PORT)).close()
                return process, int(found[1]) if found else None
            except OSError:
                pass
        time.sleep(0.05)
    process.kill()
    raise RuntimeError(said)


def turn(name, syncs, *more):
    """Median and 99 % of SYNC to TPDO by the drives' own stamps [us], the round trip's, megabytes per viewer."""
    process, port = start(name, *more)
    viewers = Viewers(port, VIEWERS) if port else None
    if viewers:
        viewers.start()
    call = lambda *a: subprocess.run([trip, str(PORT), *map(str, a)], capture_output=True, text=True, check=True).stdout
    call("000#0100", 181, 1, 0)
    round_trip = [float(x) for x in call("080", 386, syncs, 1000).split()]
    process.terminate()
    process.wait(20)
    answers = json.load(open(os.path.join(work.name, name + ".json")))["sync_to_tpdo_us"]
    return answers["median"], answers["p99"], round_trip[0], round_trip[1], (viewers.bytes if viewers else 0) / VIEWERS


def main():
    pairs = int(sys.argv[2]) if len(sys.argv) > 2 else 10
    syncs = int(sys.argv[3]) if len(sys.argv) > 3 else 10_000
    ratios = []
    for i in range(pairs):
        order = [("without", ()), ("with", ("--web", "127.0.0.1:0"))]
        got = {name: turn(name, syncs, *more) for name, more in (order if i % 2 else order[::-1])}
        a, b = got["without"], got["with"]
        ratios.append([y / x for x, y in zip(a[:4], b[:4])])
        print(
            f"SYNC to TPDO, median (99 %) [us]: without {a[0]:.1f} ({a[1]:.1f}), with {VIEWERS} viewers {b[0]:.1f} "
            f"({b[1]:.1f}); round trip {a[2]:.1f} ({a[3]:.1f}), {b[2]:.1f} ({b[3]:.1f}); each viewer got "
            f"{1e-6 * b[4]:.1f} MB; ratio of the 99 % {ratios[-1][1]:.3f}; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    for what, values in zip(("median", "99 %", "round trip, median", "round trip, 99 %"), zip(*ratios)):
        low, middle, high = statistics.quantiles(values, n=4) if len(values) > 1 else [values[0]] * 3
        print(f"{what}: with / without {middle:.3f}, quartiles {low:.3f} .. {high:.3f}, {len(values)} pairs")


if __name__ == "__main__":
    main()
