"""The mirror profile in real time, by a bench in plain python-can with its own CRC; frames decoded through the
generated DBC. Arguments as of drive_test.py; then the profile, mirror or mirror-fd."""
import json, math, struct, subprocess, sys, time

import can
import canmatrix.formats

from harness import check, finish, work
from session import connect, hold_scenario, said, start

hil, source, address, interface, channel, profile = sys.argv[1:7]
fd = profile == "mirror-fd"
status_bytes = 16 if fd else 8
# A silence of three cycles stops the drives, and a busy machine may pause this process for a while.
cycle_ms, count = 50, 100
scenario = hold_scenario(source)
nodes = range(1, 7)


def crc(data):
    value = 0xFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ 0x1D) & 0xFF if value & 0x80 else value << 1
    return value ^ 0xFF


check("CRC-8 SAE J1850 of '123456789'", crc(b"123456789") == 0x4B)
with open(work + "/drives.dbc", "w") as f:
    subprocess.run([hil, "dbc", "--profile", profile, scenario], stdout=f, check=True)
matrix = canmatrix.formats.loadp_flat(work + "/drives.dbc")
status_frames = {f.arbitration_id.id: f for f in matrix.frames if f.name.startswith("status")}
check("the DBC has a status of every drive", sorted(status_frames) == [0x180 + n for n in nodes], sorted(status_frames))
check(
    "of its size and format",
    all(f.size == status_bytes and f.is_fd == fd for f in status_frames.values()),
    [(f.size, f.is_fd) for f in status_frames.values()],
)

process = start(
    hil,
    "drive",
    scenario,
    "--can",
    address,
    "--profile",
    profile,
    "--cycle",
    str(cycle_ms),
    "--realtime",
    "--stats",
    work + "/stats.json",
    "-o",
    work + "/run",
)
bus = connect(address, interface, channel, **({"fd": True} if fd else {}))
counters, frames, stamps, last = {n: 0 for n in nodes}, {}, {n: [] for n in nodes}, {}


def command(node, mode, set_point):
    counters[node] = (counters[node] + 1) & 15
    body = bytes([counters[node] | mode << 4]) + struct.pack("<i", round(set_point * 1e6)) + bytes(6 if fd else 2)
    identifier = 0x100 + node
    bus.send(
        can.Message(
            arbitration_id=identifier,
            data=body + bytes([crc(struct.pack("<H", identifier) + body)]),
            is_extended_id=False,
            is_fd=fd,
            bitrate_switch=fd,
        )
    )


def listen(until):
    """Frames are decoded where they are looked at: decoding all would make this robot late."""
    while True:
        message = bus.recv(max(0, until - time.monotonic()))
        if message is None:
            if time.monotonic() >= until:
                return
            continue
        node = message.arbitration_id - 0x180
        if node in stamps and len(message.data) == status_bytes:
            data = bytes(message.data)
            assert crc(struct.pack("<H", message.arbitration_id) + data[:-1]) == data[-1], data.hex()
            frames[node] = data
            stamps[node].append(message.timestamp)


def look():
    for node, data in frames.items():
        last[node] = {name: signal.phys_value for name, signal in status_frames[0x180 + node].decode(data).items()}


listen(time.monotonic() + max(0.5, 0.04 * cycle_ms))
look()
# By the bus's own time stamps: this process may be late.
rates = {n: (len(t) - 1) / (t[-1] - t[0]) for n, t in stamps.items() if len(t) > 20}
check(
    "one status a cycle without being asked",
    len(rates) == len(nodes) and all(0.6 < 1e-3 * cycle_ms * r < 1.4 for r in rates.values()),
    rates,
)
check(
    "off, and 50 degC",
    all(int(last[n]["state"]) == 0 and abs(float(last[n]["temperature"]) - 50) < 0.2 for n in nodes),
    last,
)
start = {n: float(last[n]["position"]) for n in nodes}
begin = time.monotonic()
period_s = 1e-3 * cycle_ms
for k in range(count):
    for n in nodes:
        command(n, 2, start[n] + (0.1 * (1 - math.cos(math.pi * min(1, k / (0.8 * count)))) if n == 4 else 0))
    listen(begin + period_s * (k + 1))
look()
check("joint 4 went to its target", abs(float(last[4]["position"]) - start[4] - 0.2) < 0.01, (start[4], last[4]))
check(
    "the others held", all(abs(float(last[n]["position"]) - start[n]) < 0.005 for n in nodes if n != 4), (start, last)
)
check("they follow positions", all(int(last[n]["state"]) == 2 for n in nodes), last)


def until_all_are(state):
    end = time.monotonic() + 10
    while any(int(last[n]["state"]) != state for n in nodes) and time.monotonic() < end:
        listen(time.monotonic() + 1e-3 * cycle_ms)
        look()
    return time.monotonic() < end


check("without commands: fault", until_all_are(15), last)
for n in nodes:
    command(n, 15, 0)
check("cleared", until_all_are(0), last)
bus.shutdown()
process.terminate()
check("the session ends in order", process.wait(10) == 0, said())
s = json.load(open(work + "/stats.json"))
check(
    "lateness is counted",
    s["lateness_max_us"] > 0 and any(k.startswith("lateness_below") for k in s) and "overruns" in s,
    s,
)
check(
    "the robot kept the time of the clock",
    abs(s["simulated_s"] + 1e-6 * s["skipped_us"] - s["wall_s"]) < 0.3,
    (s["simulated_s"], s["skipped_us"], s["wall_s"]),
)
check(
    "nothing was damaged or repeated",
    all(d["damaged"] == 0 and d["repeated"] == 0 and d["received"] == count + 1 for d in s["drives"]),
    s["drives"],
)
text = said()
check("what it does is said", "moves with the clock" in text, text)
finish()
