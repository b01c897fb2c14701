"""A real bus that breaks under running drives: link down and up, device deleted and made again, queue full, foreign and
malformed frames. Only inside tests/can_vm/run.sh. Arguments: tribotwin-hil, source tree."""
import atexit, glob, json, os, random, socket, struct, subprocess, sys, time

import can

import harness
from harness import check, check_refused, finish, nightly, work
from master import Master, is_state
from session import hold_scenario, said, start, wait

if "CAN_VM" not in os.environ:
    sys.exit("run me by tests/can_vm/run.sh: I take buses down")
hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
nodes = range(1, 7)


def sh(command):
    subprocess.run(command, shell=True, check=True)


def refused(name, *arguments, says):
    check_refused(name, harness.run(hil, *arguments), says)


def receivers():
    """Lines of the kernel's tables of who receives from which interface."""
    return sum(len(open(table).readlines()) for table in glob.glob("/proc/net/can/rcvlist_*"))


def stats():
    return json.load(open(work + "/stats.json"))


def enable(m):
    for word in (0x80, 0x00, 0x06, 0x07, 0x0F):
        m.control(word)
        m.cycle()
        m.cycle()


def master():
    m = Master(can.Bus(interface="socketcan", channel="vcan0"), nodes)
    m.nmt(1)
    m.cycle()
    enable(m)
    return m


def enabled(m):
    return all(is_state(m.status.get(n, 0), "operation enabled") for n in nodes)


refused("no such interface", "drive", scenario, "--can", "vcan7", says="vcan7")
sh("ip link set vcan1 down")
refused("an interface that is down", "drive", scenario, "--can", "vcan1", says="down")
sh("ip link set vcan1 up")
refused(
    "an impossible budget", "drive", scenario, "--can", "vcan0", "--bitrate", "1e6", "--cycle", "0.5", says="of the bus"
)

process = start(hil, "drive", scenario, "--can", "vcan0", "--stats", work + "/stats.json")
m = master()
check("enabled", enabled(m), m.status)

# Link down for half a second: the master's frames and ours go nowhere.
sh("ip link set vcan0 down")
time.sleep(0.5)
sh("ip link set vcan0 up")
m.bus.shutdown()
m = Master(can.Bus(interface="socketcan", channel="vcan0"), nodes)
check("drives beat again without a restart", m.until(lambda: len(m.heartbeat) == 6, 3), m.heartbeat)
m.cycle()
check(
    "none is enabled: commands were lost", all(not is_state(m.status[n], "operation enabled") for n in nodes), m.status
)
m.until(lambda: m.cycle() and all(is_state(m.status[n], "fault") for n in nodes), 3)
m.bus.shutdown()
m = master()
check("enabled again", enabled(m), m.status)

# The device vanishes and is made again.
sh("ip link del vcan0")
time.sleep(0.4)
sh("ip link add dev vcan0 type vcan && ip link set dev vcan0 mtu 72 up")
m.bus.shutdown()
m = Master(can.Bus(interface="socketcan", channel="vcan0"), nodes)
check("drives beat on the new device", m.until(lambda: len(m.heartbeat) == 6, 5), m.heartbeat)
m.until(lambda: m.cycle() and all(is_state(m.status[n], "fault") for n in nodes), 3)
m.bus.shutdown()
m = master()
check("enabled on the new device", enabled(m), m.status)

# A queue that drains sixty frames a second: most of what master and drives say is refused by the kernel.
sh("tc qdisc add dev vcan0 root tbf rate 8kbit burst 32 limit 160")
refusals = 0
hold = dict(m.position)
for k in range(300):
    try:
        m.cycle(hold, wait=False)
    except can.CanError:
        refusals += 1
    m.listen(0.002)
check("the queue is full", refusals > 100, refusals)
sh("tc qdisc del dev vcan0 root")
m.listen(0.2)
m.heartbeat.clear()
check(
    "drives beat once the queue drains",
    process.poll() is None and m.until(lambda: len(m.heartbeat) == 6, 3),
    (m.heartbeat, said()),
)
m.cycle()
check(
    "none is enabled: commands were lost in the queue",
    m.until(lambda: m.cycle() and all(is_state(m.status[n], "fault") for n in nodes), 3),
    m.status,
)
m.bus.shutdown()
m = master()
check("enabled after the queue", enabled(m), m.status)

# Frames of any kind between SYNCs: a hundred thousand, by day twenty thousand.
raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
raw.bind(("vcan0",))
rng = random.Random(4)
m.bus.set_filters([{"can_id": i, "can_mask": 0x780, "extended": False} for i in (0x180, 0x380, 0x580, 0x700)])
hold = dict(m.position)
foreign = [
    i for i in range(0x81, 0x7FF) if i & 0x780 not in (0x080, 0x180, 0x200, 0x300, 0x380, 0x400, 0x580, 0x600, 0x700)
] + [0x80000123, 0x40000101, 0x20000004]
sent = 0
for k in range(1000 if nightly else 200):
    for _ in range(100):
        identifier = rng.choice(foreign)
        data = rng.randbytes(rng.randrange(9))
        if rng.random() < 0.1:
            frame = struct.pack(
                "=IBB2x64s", identifier & ~0x40000000, rng.choice((12, 16, 64)), rng.randrange(4), rng.randbytes(64)
            )
        else:
            frame = struct.pack("=IB3x8s", identifier, len(data), data)
        try:
            raw.send(frame)
            sent += 1
        except OSError:
            pass
    m.cycle(hold)
check(f"{sent} foreign frames: no drive minds", enabled(m), m.status)
raw.close()

# A listener beside live drives: it sees what they do and sends nothing.
before = receivers()
listener = subprocess.Popen(
    [
        hil,
        "shadow",
        scenario,
        "--lockstep",
        "--can",
        "vcan0",
        "--duration",
        "8",
        "--limit",
        "1000",
        "--limit-time",
        "0.1",
    ],
    stdout=subprocess.PIPE,
    text=True,
)
atexit.register(listener.kill)
wait(lambda: receivers() > before)
for n in nodes:
    m.send_torque(n)
enable(m)  # they missed the SYNC meanwhile
target = dict(m.position)
k = 0
while listener.poll() is None and k < 6000:
    k += 1
    target = {n: target[n] + (400 if k % 400 < 200 else -400) for n in nodes}
    m.cycle(target)
    time.sleep(0.001)
table = listener.communicate(timeout=20)[0]
rows = [line.split() for line in table.splitlines()[2:]]
check(
    "a shadow beside live drives",
    listener.returncode == 0 and len(rows) == 6 and all(int(r[1]) > 100 for r in rows),
    (listener.returncode, table),
)
m.bus.shutdown()

# Frames of random identifiers, lengths and data, as fast as the bus takes them: commands, NMT and SYNC among them.
flood = 1_000_000 if nightly else 50_000
sh(f"cangen vcan0 -g 0 -n {flood} -I r -L r -D r -i")
check("the random frames: the drives are still there", process.poll() is None, said())
m = Master(can.Bus(interface="socketcan", channel="vcan0"), nodes)
m.listen(0.5)
m.boots.clear()
m.nmt(0x81)
check("they reset on command", m.until(lambda: set(m.boots) >= set(nodes), 5), m.boots)
m.bus.shutdown()
m = master()
check("enabled after the random frames", enabled(m), m.status)
process.terminate()
check("the session ends in order", process.wait(10) == 0, said())
s = stats()
check("counted: the losses of the link", s["bus"]["link_losses"] >= 2, s["bus"])
check("counted: what the queue refused", s["bus"]["send_busy"] > 0, s["bus"])
check("counted: every frame was received or lost", s["bus"]["received"] + s["bus"]["receive_lost"] > flood, s["bus"])
text = said()
check("reported: one line each time", "vcan0" in text and "down" in text, text)
finish()
