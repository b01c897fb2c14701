"""tribotwin-hil shadow on logs that are late, thinned out or of other makers' drives; frames of the latter are decoded
with canmatrix as well. Arguments: tribotwin-hil, source tree."""
import math, os, random, re, struct, subprocess, sys, time

import canmatrix.formats

import harness
from harness import check, check_refused, finish, work
from master import Master
from session import connect, hold_scenario

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
nodes = range(1, 7)
address = "socketcand://127.0.0.1:29623/can0"
os.chdir(work)


def run(*arguments):
    return harness.run(hil, *arguments, timeout=60)


def shadow(log, *more):
    return run("shadow", scenario, "--can", "log:" + log, *more)


def rows(r):
    """Joint -> samples, mean, RMS, largest residual."""
    found = [line.split() for line in r.stdout.splitlines()[2:]]
    return {w[0]: [float(x) if x != "-" else math.nan for x in w[1:5]] for w in found}


def write(name, text):
    with open(name, "w") as f:
        f.write(text)


def record_a_session():
    """session.log: 900 cycles of a moving arm, torques in TPDO4; returns counts of 6064h per rad of the joint and Nm of
    the joint per count of 6077h."""
    process = subprocess.Popen([hil, "drive", scenario, "--can", address, "--quiet", "--record", "session.log"])
    time.sleep(1)
    master = Master(connect(address, "socketcand", "can0"), nodes)
    master.nmt(1)
    check("drives answer", all(master.cycle() for _ in range(10)))
    gear = {n: master.read(n, 0x6091, 1) / master.read(n, 0x6091, 2) for n in nodes}
    counts = {n: 65536 * gear[n] / (2 * math.pi) for n in nodes}
    nm = {n: 1e-6 * master.read(n, 0x6076) * gear[n] for n in nodes}
    for n in nodes:
        master.send_torque(n)
    for word in (0x06, 0x07, 0x0F):
        master.control(word)
        master.cycle()
    start = dict(master.position)
    for k in range(900):
        master.cycle({n: round(start[n] + counts[n] * 0.05 * (1 - math.cos(math.pi * 0.002 * k))) for n in nodes})
    master.bus.shutdown()
    process.terminate()
    check("the session ends in order", process.wait(10) == 0)
    return counts, nm


counts, nm = record_a_session()


def paced(lines, period):
    """The same frames with stamps of a master that keeps its period."""
    cycle = 0
    for line in lines:
        cycle += " 080#" in line
        yield re.sub(r"^\([\d.]*\)", "(%.6f)" % (1e9 + period * cycle), line)


def of(line):
    return int(line.split()[2].split("#")[0], 16)


lines = list(paced(open("session.log"), 0.002))
write("paced.log", "".join(lines))
write("slow.log", "".join(paced(lines, 0.010)))
plain = [l for l in lines if of(l) & 0x780 not in (0x580, 0x600)]  # no SDO: whoever came later
write("plain.log", "".join(plain))
chance = random.Random(1)
write("lost.log", "".join(l for l in lines if of(l) & 0x780 not in (0x380, 0x480) or chance.random() > 0.05))

# 1. The cycle is that of the bus.
native = shadow("paced.log", "--limit", 200)
reference = rows(native)
check("a healthy robot", native.returncode == 0, (native.returncode, native.stdout, native.stderr))
check("its cycle is said", "cycle 2 ms (from the SYNCs)" in native.stdout, native.stdout)
check("every joint was judged", all(reference["joint%d" % n][0] > 650 for n in nodes), native.stdout)
r = shadow("session.log", "--lockstep", "--limit", 200)
check(
    "a master that does not keep its period, in lockstep",
    r.returncode == 0 and all(abs(rows(r)[j][2] - reference[j][2]) < 0.2 * reference[j][2] + 0.1 for j in reference),
    (r.stdout, r.stderr),
)
r = shadow("slow.log")
check(
    "a cycle of 10 ms is found", r.returncode == 0 and "cycle 10 ms (from the SYNCs)" in r.stdout, (r.stdout, r.stderr)
)
check_refused(
    "a cycle that is not that of the bus",
    shadow("slow.log", "--cycle", 2),
    says=["--cycle 2 contradicts the bus", "every 10 ms", "--lockstep"],
)
check("one that is", shadow("slow.log", "--cycle", 10).returncode == 0)

# 2. Lost frames are gaps, and counted.
r = shadow("lost.log", "--limit", 200)
lost = [tuple(map(int, re.search(r" (\d+)/(\d+)  ", line).groups())) for line in r.stdout.splitlines()[2:]]
check("5 % lost: no alarm", r.returncode == 0, (r.stdout, r.stderr))
check("they are counted", all(20 <= x <= 80 for pair in lost for x in pair), lost)
check(
    "the residuals stay", all(rows(r)[j][2] < 1.3 * reference[j][2] + 0.5 for j in reference), (r.stdout, native.stdout)
)

# 3. What cannot be judged.
r = shadow("plain.log", "--limit", 1)
check("no torque: exit 2", r.returncode == 2 and "no torque was heard of joint1" in r.stderr and "6077h" in r.stderr, r)
run(
    "drive",
    scenario,
    "--can",
    "memory:x",
    "--realtime",
    "--quiet",
    "--profile",
    "mirror",
    "--duration",
    1.5,
    "--record",
    "held.log",
)
r = shadow("held.log", "--profile", "mirror", "--limit", 1)
check(
    "an arm that its brakes hold is no alarm: exit 2",
    r.returncode == 2 and "brakes" in r.stderr and "limit exceeded" not in r.stdout,
    (r.returncode, r.stdout, r.stderr),
)

# 4. The drives' EDS and DCF: the same frames without the SDO requests that the shadow would learn the mapping from.
eds = run("eds", scenario, "--node", 1).stdout


def with_values(text, values, key="DefaultValue"):
    """The EDS with other values of objects."""
    for section, value in values.items():
        text, changed = re.subn(
            r"(\[%s\]\n(?:(?!\[).*\n)*?)DefaultValue=.*" % section, r"\g<1>%s=%s" % (key, value), text
        )
        assert changed == 1, section
    return text


torque_map = {
    "1A03sub0": "1",
    "1A03sub1": "0x60770010",
    "1803sub1": "$NODEID+0x480",
    "1803sub2": "01",
    "1802sub1": "0x40000380 + $NodeID",
}
write("vendor.eds", with_values(eds, torque_map).replace("\n", "\r\n"))


def check_same(name, r, tolerance_nm=0.01):
    found = rows(r)
    check(
        name,
        r.returncode == 0
        and all(
            abs(a - b) < tolerance_nm + 1e-2 * abs(b) for j in reference for a, b in zip(found[j][1:], reference[j][1:])
        ),
        (r.returncode, r.stdout, r.stderr, native.stdout),
    )


# Rated torques and gears of the joints differ, and the file has those of joint 1: both are left to the scenario.
all_eds = with_values(with_values(eds, torque_map), {"6076": "0", "6091sub1": "1000"})
write("vendor.eds", all_eds.replace("\n", "\r\n"))
check_same("an EDS with $NODEID", shadow("plain.log", "--limit", 200, "--mean-torque", "--map", "vendor.eds"))
write(
    "vendor.dcf",
    with_values(all_eds, {"1A03sub0": "1\nParameterValue=1", "1803sub1": "0x80000000\nParameterValue=$NODEID+0x480"}),
)
check_same("a DCF", shadow("plain.log", "--limit", 200, "--mean-torque", "--map", "vendor.dcf"))
maps = []
for n in nodes:
    own = with_values(run("eds", scenario, "--node", n).stdout, torque_map) + "\n[DeviceComissioning]\nNodeID=%d\n" % n
    write("joint%d.dcf" % n, own)
    maps += ["--map", "joint%d=joint%d.dcf" % (n, n)]
check_same(
    "a DCF per joint, with its node", shadow("plain.log", "--limit", 200, "--mean-torque", "--first-node", 50, *maps)
)
# A mapping as CompactSubObj: the mapped objects in a list, and their number with the array.
compact, changed = re.subn(
    r"\[1A03\]\n(?:(?!\[1A04)(?:.*\n))*",
    "[1A03]\nParameterName=map\nObjectType=8\nDataType=7\nAccessType=rw\nCompactSubObj=1\n"
    "[1A03Value]\nNrOfEntries=1\n1=0x60770010\n",
    all_eds,
)
assert changed == 1
write("compact.eds", compact)
check_same("a compact mapping", shadow("plain.log", "--limit", 200, "--mean-torque", "--map", "compact.eds"))
write("coarse.eds", with_values(all_eds, {"608Fsub1": "0"}))
check_same(
    "increments by hand",
    shadow("plain.log", "--limit", 200, "--mean-torque", "--map", "coarse.eds", "--increments", 65536),
)


def line_of(text, section, key="DefaultValue"):
    inside = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("["):
            inside = line == "[%s]" % section
        if inside and line.startswith(key):
            return number


for name, section, value, says in (
    ("no number", "1803sub1", "$NODEID+x", ["1803h:01", "'$NODEID+x'"]),
    ("a number of more than 32 bits", "1803sub1", "0x1FFFFFFFF", ["1803h:01"]),
    ("two node numbers", "1803sub1", "$NODEID+$NODEID", ["1803h:01"]),
    ("a transmission type of 256", "1803sub2", "256", ["0 to 255"]),
    ("too many mapped objects", "1A03sub0", "65", ["at most 64"]),
    ("a position of 16 bits", "1A02sub2", "0x60640010", ["6064h", "it has 32"]),
    ("no resolution", "608Fsub1", "0", ["608Fh:01 is 0"]),
    ("another gear", "6091sub1", "2000", ["gear ratio", "joint1"]),
    ("a rated torque in words", "6076", "much", ["6076h", "'much'"]),
):
    text = with_values(all_eds, {section: value})
    write("wrong.eds", text)
    check_refused(
        "EDS: " + name,
        shadow("plain.log", "--map", "wrong.eds"),
        says=["wrong.eds:%d: " % line_of(text, section), *says],
    )
of_type_u32 = "DataType=7\nAccessType=rw\n"
for name, text, says in (
    ("a section without its end", "[1800\n", "wrong.eds:1: "),
    ("a line that is none", "[1800]\nnonsense\n", "wrong.eds:2: "),
    ("two values", "[1800sub1]\nDefaultValue=1\ndefaultvalue=2\n", "wrong.eds:3: "),
    ("no drive", "[FileInfo]\nFileName=x\n", "is it an EDS or DCF?"),
    ("a device without TPDOs", "[1000]\n" + of_type_u32, "no TPDO"),
    ("no resolution at all", "[1800]\nObjectType=9\n[1800sub1]\nDefaultValue=0x181\n" + of_type_u32, "--increments"),
    ("an object of no type", "[1800]\nObjectType=9\n[1800sub1]\nDefaultValue=0x181\n", "wrong.eds:4: "),
):
    write("wrong.eds", text)
    check_refused("EDS: " + name, shadow("plain.log", "--map", "wrong.eds"), says=says)

# 5. A DBC of other frames: 29-bit identifiers, Motorola byte order, degrees with an offset, a multiplexed torque.
step_deg, step_nm = 1e-4, 0.05
dbc = 'VERSION ""\n\nBU_: master\n\n'
for n in nodes:
    dbc += (
        f"BO_ {0x98FF0000 + n} Axis{n}: 8 Vector__XXX\n"
        f' SG_ Angle : 7|32@0- ({step_deg},-180) [0|0] "deg" master\n'
        ' SG_ Mux M : 32|4@1+ (1,0) [0|15] "" master\n'
        ' SG_ State : 36|4@1+ (1,0) [0|15] "" master\n'
        f' SG_ Torque m5 : 47|24@0- ({step_nm},0) [0|0] "Nm" master\n'
        f' SG_ TorqueFloat m6 : 40|24@1- (1,0) [0|0] "bar" master\n\n'
    )
write("other.dbc", dbc)
matrix = canmatrix.formats.loadp_flat("other.dbc")
axis = {f.arbitration_id.id: f for f in matrix.frames}
last, foreign, decoded = {}, [], {"Angle": 0.0, "Torque": 0.0}
for line in lines:
    stamp, bus, frame = line.split()
    identifier, data = frame.split("#")[0], bytes.fromhex(frame.split("#")[1]) if "R" not in frame else b""
    node, kind = int(identifier, 16) & 0x7F, int(identifier, 16) & 0x780
    if kind == 0x380:
        word, count = struct.unpack("<Hi", data)
        last[node] = word & 0x6F == 0x27, math.degrees(count / counts[node])
    if kind == 0x480 and node in last:
        enabled, angle = last[node]
        torque = struct.unpack("<h", data)[0] * nm[node]
        raw = round((angle + 180) / step_deg).to_bytes(4, "big", signed=True)
        raw += bytes([5 | (3 if enabled else 1) << 4]) + round(torque / step_nm).to_bytes(3, "big", signed=True)
        foreign.append("%s can0 %08X#%s\n" % (stamp, 0x18FF0000 + node, raw.hex().upper()))
        if len(foreign) % 50 == 0:
            seen = axis[0x18FF0000 + node].decode(raw)
            decoded["Angle"] = max(decoded["Angle"], abs(float(seen["Angle"].phys_value) - angle))
            decoded["Torque"] = max(decoded["Torque"], abs(float(seen["Torque"].phys_value) - torque))
write("foreign.log", "".join(foreign))
check("canmatrix reads the same", decoded["Angle"] <= step_deg and decoded["Torque"] <= step_nm, decoded)
signals = ["--signal", "position=Axis{node}.Angle", "--signal", "torque=Axis{number}.Torque"]
enabled = ("--signal", "enabled=Axis{node}.State==3,4")
r = shadow("foreign.log", "--limit", 200, "--mean-torque", "--map", "other.dbc", *signals, *enabled)
check_same("a DBC", r, 1.5)
check("without SYNCs the positions are the cycle", "from the positions of joint1" in r.stdout, r.stdout)
r = shadow("foreign.log", "--limit", 200, "--map", "other.dbc", *signals)
check("a DBC without a state: exit 2", r.returncode == 2 and "no state was heard of joint1" in r.stderr, r)
r = shadow("foreign.log", "--limit", 1e5, "--map", "other.dbc", *signals, "--signal", "enabled=always")
check("drives that are always enabled", r.returncode == 0, r)
check_same(
    "a factor",
    shadow(
        "foreign.log",
        "--limit",
        200,
        "--mean-torque",
        "--map",
        "other.dbc",
        "--signal",
        "position=Axis{node}.Angle*gear*2/gear/2",
        "--signal",
        "torque=Axis{node}.Torque",
        "--signal",
        "enabled=Axis{node}.State==3",
    ),
    1.5,
)
own = run("dbc", scenario).stdout
write("own.dbc", own)
r = shadow(
    "plain.log",
    "--map",
    "own.dbc",
    "--signal",
    "position=TPDO3_n{node}_{joint}.position_actual",
    "--signal",
    "statusword=TPDO3_n{node}_{joint}.statusword",
)
check("our own DBC", r.returncode == 0 and "joint6 0 " in " ".join(r.stdout.split()), r)

for name, old, new, says in (
    ("a factor of 0", f"({step_deg},-180)", "(0,-180)", [":6: ", "factor"]),
    ("a factor in words", f"({step_deg},-180)", "(one,-180)", [":6: ", "factor 'one'"]),
    ("an offset in words", f"({step_deg},-180)", "(1,x)", [":6: ", "offset 'x'"]),
    ("a signal longer than its frame", "47|24@0-", "47|40@0-", [":9: ", "Torque", "8 bytes"]),
    ("a signal of 65 bits", "47|24@0-", "47|65@0-", [":9: ", "1 to 64"]),
    ("a byte order of 2", "7|32@0-", "7|32@2-", [":6: ", "SG_ NAME"]),
    ("an identifier of 12 bits", str(0x98FF0001), "2048", [":5: ", "11 bits"]),
    ("an identifier in words", str(0x98FF0001), "x", [":5: ", "identifier 'x'"]),
    ("a message twice", str(0x98FF0002), str(0x98FF0001), [":12: ", "line 5"]),
    ("a signal twice", "TorqueFloat", "Torque", [":10: ", "line 9"]),
    ("a frame of 65 bytes", "Axis1: 8", "Axis1: 65", [":5: ", "65"]),
):
    assert old in dbc
    write("wrong.dbc", dbc.replace(old, new, 1))
    check_refused("DBC: " + name, shadow("foreign.log", "--map", "wrong.dbc", *signals), says=["wrong.dbc", *says])

# What one frame with simple multiplexing cannot hold is left out with a note, where no signal is of it.
strange = {
    "extended multiplexing": (
        ' SG_ More m5M : 60|2@1+ (1,0) [0|3] "" master\n SG_ Deep m1 : 62|2@1+ (1,0) [0|3] "" master\n'
    ),
    "64 can be read": ' SG_ Serial : 0|128@1+ (1,0) [0|0] "" master\n',
}
for why, signal in strange.items():
    for message, wanted in (("BO_ 2566834431 EEC1: 8 Vector__XXX\n", False), ("", True)):
        text = dbc + message + signal if message else dbc.replace(" SG_ Mux M", signal + " SG_ Mux M", 1)
        write(
            "strange.dbc", text + 'BA_DEF_ BO_ "VFrameFormat" ENUM "J1939PG";\nBA_ "VFrameFormat" BO_ 2566834431 0;\n'
        )
        r = shadow("foreign.log", "--map", "strange.dbc", *signals, "--signal", "enabled=Axis{node}.State==3,4")
        if wanted:
            check_refused(
                "DBC, of a signal that is wanted: " + why, r, says=["strange.dbc:", why, "needs message Axis1"]
            )
        else:
            check("DBC, left out: " + why, r.returncode == 0 and "note: strange.dbc: 1 of 7" in r.stderr, r)
            check("and the reason: " + why, "EEC1" in r.stderr and why in r.stderr, r.stderr)
for line, left_out in (
    (f"SG_MUL_VAL_ {0x98FF0001} Torque Mux 5-5;\n", False),
    (f"SG_MUL_VAL_ {0x98FF0001} Torque Mux 5-6;\n", True),
    (f"SG_MUL_VAL_ {0x98FF0001} Torque Mux 5-5, 9-9;\n", True),
):
    write("strange.dbc", dbc + line)
    r = shadow("foreign.log", "--map", "strange.dbc", *signals, "--signal", "enabled=Axis{node}.State==3,4")
    check("DBC: " + line.strip(), r.returncode == (2 if left_out else 0) and ("SG_MUL_VAL_" in r.stderr) == left_out, r)
write("long.dbc", dbc + 'BO_ 2566834432 DM1: 1785 Vector__XXX\n SG_ All : 0|14280@1+ (1,0) [0|0] "" master\n')
r = shadow("foreign.log", "--map", "long.dbc", *signals, "--signal", "enabled=Axis{node}.State==3,4")
check("DBC: a message of many frames", r.returncode == 0 and "1785 bytes are more than a frame" in r.stderr, r)

write("empty.dbc", 'VERSION ""\n')
for name, more, says in (
    ("no signals named", ["--map", "other.dbc"], ["which signals"]),
    ("no message", ["--map", "empty.dbc", *signals], ["empty.dbc", "no message"]),
    ("another unit", ["--map", "other.dbc", "--signal", "position=Axis{node}.Torque"], ["other.dbc:9", "Nm", "rad"]),
    (
        "an unknown unit",
        ["--map", "other.dbc", "--signal", "position=Axis{node}.TorqueFloat"],
        ["other.dbc:10", "'bar'"],
    ),
    ("no such message", ["--map", "other.dbc", "--signal", "position=Axes.Angle"], ["message 'Axes'"]),
    ("no such signal", ["--map", "other.dbc", "--signal", "position=Axis1.Angel"], ["Axis1", "'Angel'", "Angle, Mux"]),
    ("no such joint", ["--map", "other.dbc", "--signal", "joint7.position=Axis1.Angle"], ["joint7"]),
    ("no such quantity", ["--map", "other.dbc", "--signal", "speed=Axis1.Angle"], ["'speed'", "position"]),
    ("a factor of 0", ["--map", "other.dbc", "--signal", "position=Axis1.Angle*0"], ["factor '0'"]),
    ("no position", ["--map", "other.dbc", "--signal", "torque=Axis1.Torque"], ["position of joint1"]),
    ("twice", ["--map", "other.dbc", *signals, "--signal", "joint2.position=Axis2.Angle"], ["joint2", "another"]),
    ("no kind", ["--map", "session.log"], [".dbc, .eds, .dcf"]),
    ("no file", ["--map", "nowhere.eds"], ["nowhere.eds"]),
    ("a joint that there is not", ["--map", "joint9=vendor.eds"], ["joint9"]),
    ("DBC and EDS", ["--map", "other.dbc", *signals, "--map", "vendor.eds"], ["joint1", "both"]),
):
    check_refused("--map: " + name, shadow("foreign.log", *more), says=says)
before = open("other.dbc").read()
check_refused(
    "a map as the CSV",
    shadow("foreign.log", "--map", "other.dbc", *signals, "--force", "--csv", "other.dbc"),
    says=["-o other.dbc", "--map other.dbc"],
)
check("it stays as it was", open("other.dbc").read() == before)

finish()
