"""Memory of `tribotwin-hil drive --web` while ten viewers read, one does not, and one comes and goes.
Arguments: build folder, minutes (20 without)."""
import os, re, resource, statistics, subprocess, sys, tempfile, time

import numpy

from live import Viewers, request_to

PONG = b"\x8a\x80" + bytes(4)
build = sys.argv[1]
minutes = float(sys.argv[2]) if len(sys.argv) > 2 else 20
source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(source, "tests"))
from harness import resident_kib


def main():
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            [os.path.join(build, "bin", "tribotwin-hil"), "drive"]
            + [os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml"), "--quiet", "--can", "memory:rss"]
            + ["--realtime", "--set", "telemetry_rate_hz=1000", "--web", "127.0.0.1:0"],
            stderr=log,
        )
        try:
            found = None
            while not found:
                time.sleep(0.1)
                log.seek(0)
                found = re.search(r"web: http://127\.0\.0\.1:(\d+)/", log.read())
            measure(process.pid, int(found[1]))
        finally:
            process.terminate()
            process.wait(20)


def measure(process, port):
    viewers = Viewers(port, 10)
    viewers.start()
    silent = request_to(port)
    begin, times, sizes = time.monotonic(), [], []
    while time.monotonic() - begin < 60 * minutes:
        request_to(port).close()
        time.sleep(5)
        for one in [silent, *viewers.sockets]:
            one.sendall(PONG)  # who says nothing is sent away after 30 s
        times.append((time.monotonic() - begin) / 3600)
        sizes.append(resident_kib(process))
    silent.close()
    settled = len(times) // 4  # queues fill and the allocator settles before
    slope, _ = numpy.polyfit(times[settled:], sizes[settled:], 1)
    assert len(viewers.sockets) == 10, "a viewer was sent away"
    print(
        f"{60 * times[-1]:.0f} min, {1e-6 * viewers.bytes:.0f} MB sent: RSS {sizes[0]} KiB at first, "
        f"{statistics.median(sizes[settled:]):.0f} median, {max(sizes)} largest, {sizes[-1]} last; "
        f"slope after the first quarter {slope:.0f} KiB an hour"
    )


main()
