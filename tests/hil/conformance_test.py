"""A session with six drives, checked by others: the bus by Wireshark's CANopen dissector, the DBC by canmatrix, the EDS
by Wireshark's EDS reader and the rules of CiA 306; and bus and telemetry against each other. Arguments: tribotwin-hil,
source tree."""
import atexit, collections, configparser, ctypes, logging, math, re, struct, subprocess, sys, time

logging.disable(logging.WARNING)  # python-can of reads that end inside a frame, canmatrix of formats it cannot write
import can, canmatrix.formats, h5py, numpy as np

from harness import check, finish, work
from master import Master, SdoAbort, is_state
from session import hold_scenario

hil, source = sys.argv[1:3]
scenario = hold_scenario(source)
nodes = range(1, 7)
start_rad = {1: 0, 2: -0.1, 3: -1.2, 4: 0, 5: 0, 6: 0}  # of the scenario


def abort_of(call):
    try:
        call()
    except SdoAbort as e:
        return e.code


# ---- The EDS, by CiA 306 alone.
TYPES = {
    2: ("b", -(2**7), 2**7 - 1),
    3: ("h", -(2**15), 2**15 - 1),
    4: ("i", -(2**31), 2**31 - 1),
    5: ("B", 0, 2**8 - 1),
    6: ("H", 0, 2**16 - 1),
    7: ("I", 0, 2**32 - 1),
    9: ("s", 0, 0),
    15: ("D", 0, 0),
}
KEYS = {
    "FileInfo": "FileName FileVersion FileRevision EDSVersion Description CreationTime CreationDate CreatedBy "
    "ModificationTime ModificationDate ModifiedBy",
    "DeviceInfo": "VendorName VendorNumber ProductName ProductNumber RevisionNumber OrderCode "
    "BaudRate_10 BaudRate_20 BaudRate_50 BaudRate_125 BaudRate_250 BaudRate_500 BaudRate_800 BaudRate_1000 "
    "SimpleBootUpMaster SimpleBootUpSlave Granularity DynamicChannelsSupported GroupMessaging "
    "NrOfRXPDO NrOfTXPDO LSS_Supported",
}
# Data types of CiA 301 and 402; of arrays and records: of the sub-indices from 1 on. A: array, R: record.
STANDARD = {
    0x1000: "I",
    0x1001: "B",
    0x1003: "A" + 8 * "I",
    0x1005: "I",
    0x1006: "I",
    0x1008: "s",
    0x1009: "s",
    0x100A: "s",
    0x100C: "H",
    0x100D: "B",
    0x1010: "AIIII",
    0x1011: "AIIII",
    0x1012: "I",
    0x1014: "I",
    0x1015: "H",
    0x1016: "AII",
    0x1017: "H",
    0x1018: "RIIII",
    0x1019: "B",
    0x1021: "D",
    0x1022: "H",
    0x1029: "AB",
    0x1200: "RII",
    0x6007: "h",
    0x603F: "H",
    0x6040: "H",
    0x6041: "H",
    0x605A: "h",
    0x605B: "h",
    0x605C: "h",
    0x605D: "h",
    0x605E: "h",
    0x6060: "b",
    0x6061: "b",
    0x6062: "i",
    0x6064: "i",
    0x6065: "I",
    0x6066: "H",
    0x6067: "I",
    0x6068: "H",
    0x606C: "i",
    0x606D: "H",
    0x606E: "H",
    0x606F: "H",
    0x6070: "H",
    0x6071: "h",
    0x6072: "H",
    0x6074: "h",
    0x6076: "I",
    0x6077: "h",
    0x607A: "i",
    0x607C: "i",
    0x607D: "Aii",
    0x607F: "I",
    0x6080: "I",
    0x6081: "I",
    0x6082: "I",
    0x6083: "I",
    0x6084: "I",
    0x6085: "I",
    0x6086: "h",
    0x608F: "AII",
    0x6091: "AII",
    0x6098: "b",
    0x6099: "AII",
    0x609A: "I",
    0x60A3: "B",
    0x60A4: "AI",
    0x60A9: "I",
    0x60B1: "i",
    0x60B2: "h",
    0x60B8: "H",
    0x60B9: "H",
    0x60BA: "i",
    0x60BB: "i",
    0x60BC: "i",
    0x60BD: "i",
    0x60C0: "h",
    0x60C1: "Ai",
    0x60C2: "RBb",
    0x60C5: "I",
    0x60C6: "I",
    0x60E3: "Abbbbbbbb",
    0x60F4: "i",
    0x60F9: "RHH",
    0x60FB: "RH",
    0x60FD: "I",
    0x60FE: "AII",
    0x60FF: "i",
    0x6502: "I",
    0x67FF: "I",
}
STANDARD |= {
    base + k: shape
    for k in range(5)
    for base, shape in ((0x1400, "RIBH"), (0x1800, "RIBHHB"), (0x1600, "R" + 8 * "I"), (0x1A00, "R" + 8 * "I"))
}


class Eds:
    """The EDS of a node as CiA 306 wants it; `wrong` collects what is not so."""

    MANDATORY = {0x1000, 0x1001, 0x1018}

    def __init__(self, node):
        self.node, self.wrong, self.listed, self.entries = node, [], {}, {}
        subprocess.run([hil, "eds", scenario, "--node", str(node), "-o", work + "/drive.eds", "--force"], check=True)
        self.eds = configparser.ConfigParser(
            strict=True, interpolation=None, delimiters="=", comment_prefixes=";", empty_lines_in_values=False
        )
        self.eds.read_string(open(work + "/drive.eds", encoding="ascii").read())
        self.check_sections()
        self.check_lists()
        for index in self.listed:
            self.check_object(index)
        for way, base, may in (("RX", 0x1600, ("rw", "rww", "wo")), ("TX", 0x1A00, ("rw", "rwr", "ro", "const"))):
            self.check_mappings(way, base, may)
        self.need(
            [self.number(self.eds["DeviceInfo"][k]) for k in ("VendorNumber", "ProductNumber", "RevisionNumber")]
            == [self.entries[0x1018, k][1] for k in (1, 2, 3)],
            "identities differ",
        )

    def number(self, text):
        return sum(self.node if t.upper() == "$NODEID" else int(t, 0) for t in text.split("+"))

    def need(self, good, *what):
        good or self.wrong.append(" ".join(map(str, what)))

    def check_sections(self):
        for section, keys in KEYS.items():
            missing = [k for k in keys.split() if k not in self.eds[section]]
            self.need(not missing, section, "has no", *missing)
        info = self.eds["FileInfo"]
        for when in ("Creation", "Modification"):
            self.need(
                re.fullmatch(
                    r"(0?[1-9]|1[0-2]):[0-5]\d(AM|PM) [01]\d-[0-3]\d-\d{4}",
                    " ".join(info.get(when + k, d) for k, d in (("Time", "1:00AM"), ("Date", "01-01-2000"))),
                ),
                when,
                "is no time",
            )

    def check_lists(self):
        for section, mine in (
            ("MandatoryObjects", lambda i: i in self.MANDATORY),
            ("OptionalObjects", lambda i: i < 0x2000 or i >= 0x6000),
            ("ManufacturerObjects", lambda i: 0x2000 <= i < 0x6000),
        ):
            count = int(self.eds[section]["SupportedObjects"])
            self.need(
                set(self.eds[section]) == {"supportedobjects"} | {str(k + 1) for k in range(count)},
                section,
                "is not numbered 1 to",
                count,
            )
            for k in range(count):
                index = self.number(self.eds[section][str(k + 1)])
                self.need(mine(index) and index not in self.listed, "%04X" % index, "does not belong in", section)
                self.listed[index] = section
        self.need(self.MANDATORY <= set(self.listed), "a mandatory object is missing")
        self.need(
            {"%04X" % i for i in self.listed} == {s for s in self.eds.sections() if re.fullmatch("[0-9A-Fa-f]{4}", s)},
            "lists and sections differ",
        )

    def check_object(self, index):
        name = "%04X" % index
        head = self.eds[name]
        subs = {int(s[7:], 16): self.eds[s] for s in self.eds.sections() if s.startswith(name + "sub")}
        kind = self.number(head["ObjectType"])
        if kind not in (2, 7):
            self.need(self.number(head["SubNumber"]) == len(subs) and 0 in subs, name, "has", len(subs), "sub-indices")
            if index != 0x1003 and not 0x1600 <= index < 0x1C00 or 0x1800 <= index < 0x1A00:
                self.need(self.number(subs[0]["DefaultValue"]) == max(subs), name + ":0 is not the highest sub-index")
        shape = {2: "", 7: "", 8: "A", 9: "R"}[kind] + "".join(
            TYPES[self.number(s["DataType"])][0] for k, s in sorted(subs.items() or [(1, head)]) if k
        )
        self.need(
            index in STANDARD and shape == STANDARD[index] or 0x2000 <= index < 0x6000,
            "%s is %s, not %s" % (name, shape, STANDARD.get(index)),
        )
        for sub, entry in (subs or {0: head}).items():
            self.check_entry(index, sub, entry)

    def check_entry(self, index, sub, e):
        at, (kind, low, high) = "%04X:%X" % (index, sub), TYPES[self.number(e["DataType"])]
        # A domain has none, nor has the serial number, which is each drive's own.
        own = kind == "D" or (index, sub) == (0x1018, 4)
        default = e["DefaultValue"] if not own else e.get("DefaultValue")
        self.need(
            self.number(e["ObjectType"]) == (2 if kind == "D" else 7)
            and e["AccessType"] in ("ro", "wo", "rw", "rwr", "rww", "const")
            and e["PDOMapping"] in "01"
            and 0 < len(e["ParameterName"]) <= 241,
            at,
        )
        if kind not in "sD" and default is not None:
            default = self.number(default)
            lowest, highest = self.number(e.get("LowLimit") or str(low)), self.number(e.get("HighLimit") or str(high))
            self.need(low <= lowest <= default <= highest <= high, at, "is beyond its limits")
        self.entries[index, sub] = kind, default, e["AccessType"], e["PDOMapping"] == "1", e["ParameterName"]

    def check_mappings(self, way, base, may):
        maps = [i for i in self.listed if base <= i < base + 0x200]
        self.need(
            self.number(self.eds["DeviceInfo"][f"NrOf{way}PDO"])
            == len(maps)
            == sum(base - 0x200 <= i < base for i in self.listed),
            f"NrOf{way}PDO",
        )
        for i in maps:
            mapped = [self.entries[i, k + 1][1] for k in range(self.entries[i, 0][1])]
            self.need(sum(m & 0xFF for m in mapped) <= 64, "%04X" % i, "is too long")
            for m in mapped:
                kind, _, access, mappable, _ = self.entries.get((m >> 16, m >> 8 & 0xFF), ("B", 0, "", False, ""))
                self.need(
                    mappable and access in may and 8 * struct.calcsize(kind) == m & 0xFF, "%04X maps %08X" % (i, m)
                )

    def gap_types(self):
        return {k for k in range(1, 8) if self.eds["DummyUsage"].get(f"Dummy{k:04}", "0") == "1"}


def parse_eds(node):
    """{(index, sub): (type, default, access, mappable, name)}, data types that fill gaps in an RPDO, what is wrong."""
    eds = Eds(node)
    return eds.entries, eds.gap_types(), eds.wrong


for n in reversed(nodes):
    entries, dummies, wrong = parse_eds(n)
    check(f"EDS of node {n}: {len(entries)} entries as CiA 306, 301 and 402 want them", not wrong, wrong)

# ---- The EDS, read by Wireshark: its POWERLINK dissector takes names and types of objects from a CANopen EDS.
RANGE = {kind: (low, high) for kind, low, high in TYPES.values()}
extremes = {
    at: RANGE[kind][0] or RANGE[kind][1] for at, (kind, _, _, _, _) in sorted(entries.items()) if kind not in "sD"
}  # the sign shows the type
with open(work + "/eds.pcap", "wb") as f:
    f.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))
    for k, ((index, sub), value) in enumerate(extremes.items()):
        data = struct.pack("<HBx" + entries[index, sub][0], index, sub, value)
        data = (
            b"\x01\x11\x1E\0\0\4"
            + b"\2\0\0\0\0\1"
            + b"\x88\xAB"
            + bytes([6, 1, 240, 5])  # Ethernet; ASnd from node 240 to 1: SDO
            + bytes([4 * (k % 64) | 2, 4 * (k % 64) | 2, 0, 0])
            + struct.pack("<4BHH", 0, k % 256, 0, 1, len(data), 0)
            + data
        )  # number k; write by index
        f.write(struct.pack("<4I", k, 0, len(data), len(data)) + data)
shown = subprocess.run(
    ["tshark", "-r", work + "/eds.pcap", "-O", "epl", "-o", f'uat:epl_nodeid_profiles:"1","{work}/drive.eds"'],
    capture_output=True,
    text=True,
    check=True,
).stdout
differ = []
for frame, ((index, sub), value) in zip(re.split(r"^Frame \d+:", shown, flags=re.M)[1:], extremes.items(), strict=True):
    got = re.findall(r"(?:OD (?:Sub)?Index: (\S+) |Data: (\S+))(?:\((.*)\))?", frame)
    (at, _, name), value_shown = got[-2] if got[-1][1] else got[-1], got[-1][1]
    is_mapping = sub and (0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00)  # dissected as mappings instead
    if not (
        int(at, 0) in (index, sub) and name == entries[index, sub][4] and (is_mapping or value_shown == str(value))
    ):
        differ.append(("%04X:%X" % (index, sub), got, value))
check(f"Wireshark knows {len(extremes)} entries by name and type from the EDS", not differ, differ[:5])

# ---- A session.
process = subprocess.Popen(
    [
        hil,
        "drive",
        scenario,
        "--can",
        "socketcand://127.0.0.1:29611/can0",
        "--record",
        work + "/session.log",
        "-o",
        work + "/live",
        "--set",
        "telemetry_rate_hz=1000",
    ],
    stderr=open(work + "/stderr", "w"),
    preexec_fn=lambda: ctypes.CDLL(None).prctl(1, 9),
)  # dies with this test
atexit.register(process.kill)
for _ in range(100):
    try:
        bus = can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=29611)
        break
    except OSError:
        time.sleep(0.1)
else:
    sys.exit("no drives: " + open(work + "/stderr").read())
master = Master(bus, nodes)

differ = []
for (index, sub), (kind, default, access, _, _) in entries.items():
    if default is None:
        continue
    try:
        got = master.read(1, index, sub, kind) if access != "wo" else default
        if index == 0x1003 and sub:
            got = "no abort"  # CiA 301: an empty error field has no data
    except SdoAbort as a:
        got = default if index == 0x1003 and sub and a.code == 0x08000024 else "abort %08X" % a.code
    if got != default:
        differ.append("%04X:%X is %s, not %s" % (index, sub, got, default))
check(f"node 1 holds its {len(entries)} defaults", not differ, differ)
gear = {n: master.read(n, 0x6091, 1) / master.read(n, 0x6091, 2) for n in nodes}
per_rad = {n: gear[n] * 65536 / (2 * math.pi) for n in nodes}
check("positions at the start", all(master.read(n, 0x6064, 0, "i") == round(start_rad[n] * per_rad[n]) for n in nodes))

master.nmt(0x82)
check("all boot", master.until(lambda: set(nodes) <= set(master.boots)), master.boots)
for n in nodes:
    for index, sub, kind, value in (
        (0x1017, 0, "H", 50),
        (0x2120, 1, "H", 60000),  # frequent heartbeats, patience; TPDO4: temperature and friction
        (0x1A03, 0, "B", 0),
        (0x1A03, 1, "I", 0x21000110),
        (0x1A03, 2, "I", 0x21010120),
        (0x1A03, 0, "B", 2),
        (0x1803, 1, "I", 0x480 + n),
    ):
        master.write(n, index, sub, kind, value)
check("a name, in segments", master.read(5, 0x1008, 0, "s") == "tribotwin drive joint5")
master.write(1, 0x1603, 0, "B", 0)
taken = {
    (k, bits)
    for k in range(1, 8)
    for bits in (8, 16, 32)
    if abort_of(lambda: master.write(1, 0x1603, 1, "I", k << 16 | bits)) is None
}
check(
    "gaps in RPDOs are what the EDS says",
    taken == {(k, 8 * struct.calcsize(TYPES[k][0])) for k in dummies},
    (sorted(taken), dummies),
)
ABORTS = [
    (0x06020000, "Object does not exist in the object dictionary", lambda: master.read(1, 0x5000)),
    (0x06090011, "Sub-index does not exist", lambda: master.read(2, 0x1018, 5)),
    (0x06010002, "Attempt to write a read only object", lambda: master.write(3, 0x6064, 0, "i", 1)),
    (
        0x06070012,
        "Data type does not match, length of service parameter too high",
        lambda: master.write(4, 0x6060, 0, "H", 8),
    ),
    (
        0x06070013,
        "Data type does not match, length of service parameter too low",
        lambda: master.write(4, 0x607A, 0, "H", 8),
    ),
    (0x06090030, "Invalid value for parameter", lambda: master.write(5, 0x605A, 0, "h", 3)),
    (0x06090031, "Value of parameter written too high", lambda: master.write(5, 0x605E, 0, "h", 3)),
    (0x06090032, "Value of parameter written too low", lambda: master.write(5, 0x6080, 0, "I", 0)),
    (0x06040041, "Object cannot be mapped to the PDO", lambda: master.write(1, 0x1603, 1, "I", 0x10080020)),
    (0x08000024, "No data available", lambda: master.read(1, 0x1003, 1)),
    (
        0x05030000,
        "Toggle bit not alternated",
        lambda: (master.request(6, b"\x40\x08\x10\0\0\0\0\0"), master.request(6, b"\x70" + bytes(7))),
    ),
    (0x05040001, "Client/server command specifier not valid or unknown", lambda: master.request(6, b"\x60" + bytes(7))),
    (0x05040002, "Invalid block size", lambda: master.request(6, b"\xA0\x08\x10\0\0\0\0\0")),
]
got = [abort_of(call) for _, _, call in ABORTS]
check(f"{len(ABORTS)} ways to abort", got == [code for code, _, _ in ABORTS], ["%08X" % (g or 0) for g in got])

master.nmt(0x01)
master.cycle()
enable = lambda of: all(
    master.reach(name, word, of, cycles=20)
    for name, word in (("ready to switch on", 0x06), ("switched on", 0x07), ("operation enabled", 0x0F))
)
check("all enabled", enable(list(nodes)), master.status)
start = dict(master.position)
for k in range(300):
    master.cycle(
        {n: round(start[n] + 0.02 * (1 + n % 2) * per_rad[n] * (1 - math.cos(2 * math.pi * k / 300))) for n in nodes}
    )
check(
    "300 cycles of CSP, all enabled", all(is_state(master.status[n], "operation enabled") for n in nodes), master.status
)
master.control(0x02)
check(
    "quick stop",
    master.until(lambda: master.cycle() and all(is_state(master.status[n], "switch on disabled") for n in nodes), 10),
    master.status,
)
check("enabled again", enable(list(nodes)), master.status)
master.fail_to_follow(2)
check(
    "following error: fault and EMCY",
    is_state(master.status[2], "fault") and master.emergencies == [(2, (0x8611, 0x21))],
    master.emergencies,
)
master.control(0x80, [2])
check("reset: EMCY of no error", master.until(lambda: (2, (0, 0)) in master.emergencies), master.emergencies)
for command, state in ((0x80, 0x7F), (0x02, 0x04), (0x01, 0x05)):
    master.nmt(command)
    check(
        "heartbeats after NMT %02X" % command,
        master.until(lambda: all(master.heartbeat[n] == state for n in nodes)),
        master.heartbeat,
    )
master.nmt(0x81, 3)
check("node 3 boots again", master.until(lambda: master.boots.count(3) == 2), master.boots)
master.listen(0.1)
bus.shutdown()
process.terminate()
check("the drives end when asked", process.wait(10) == 0, open(work + "/stderr").read())

# ---- The log, read here and by Wireshark.
frames = []  # time, identifier, data
for line in open(work + "/session.log"):
    at, _, frame = line.split()
    identifier, data = frame.split("#")
    frames.append((at.strip("()"), int(identifier, 16), bytes.fromhex(data)))


def meaning(identifier, d):
    base = identifier & 0x780
    if identifier == 0x080:
        return "SYNC", ()
    if base == 0x000:
        return "NMT", tuple(d)
    if base == 0x080:
        return "EMCY", struct.unpack("<HB", d[:3])
    if base == 0x700:
        return "heartbeat", tuple(d)
    if base < 0x580:
        return "PDO", d
    names_object = d[0] >> 5 in ((2, 3, 4) if base == 0x580 else (1, 2, 4, 5))
    return "SDO", (
        d[0],
        struct.unpack("<I", d[4:])[0] if d[0] == 0x80 else "",
        struct.unpack("<HB", d[1:4]) if names_object else "",
    )


with open(work + "/session.pcap", "wb") as f:
    f.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 227))
    for at, i, d in frames:
        f.write(
            struct.pack("<4I", *map(int, at.split(".")), 8 + len(d), 8 + len(d)) + struct.pack(">IB3x", i, len(d)) + d
        )
tshark = lambda *more: subprocess.run(
    ["tshark", "-r", work + "/session.pcap", "-d", "can.subdissector,canopen", *more],
    capture_output=True,
    text=True,
    check=True,
).stdout
FIELDS = (
    "canopen.cob_id _ws.expert.message _ws.malformed _ws.col.Info canopen.nmt_ctrl.cd canopen.nmt_ctrl.node_id "
    "canopen.em.err_code canopen.em.err_reg canopen.pdo.data.bytes canopen.sdo.cmd canopen.sdo.abort_code "
    "canopen.sdo.main_idx canopen.sdo.sub_idx canopen.nmt_guard.state"
).split()
seen = []
for row in tshark("-T", "fields", *(x for f in FIELDS for x in ("-e", f))).splitlines():
    cob, expert, malformed, info, command, node, code, register, pdo, sdo, abort, index, sub, state = (
        int(t, 0) if re.fullmatch("0x[0-9a-f]+|[0-9]", t) else t for t in row.split("\t")
    )
    seen.append(
        (cob, "wrong", row)
        if expert or malformed
        else (cob, "NMT", (command, node))
        if command != ""
        else (cob, "EMCY", (code, register))
        if code != ""
        else (cob, "heartbeat", (state,))
        if state != ""
        else (cob, "SDO", (sdo, abort, (index, sub) if index != "" else ""))
        if sdo != ""
        else (cob, "PDO", bytes.fromhex(pdo.replace(":", "")))
        if pdo
        else (cob, info, ())
    )
mine = [(i, *meaning(i, d)) for _, i, d in frames]
counts = dict(collections.Counter(kind for _, kind, _ in mine))
check(
    f"Wireshark dissects {len(frames)} frames as they are meant: {counts}",
    seen == mine and len(counts) == 6,
    [(m, s) for m, s in zip(mine, seen) if m != s][:5] or (len(mine), len(seen)),
)
texts = {
    (int(code, 16), text)
    for text, code in re.findall(
        r'showname="Abort code: ([^"]*) \((0x\w+)\)"', tshark("-T", "pdml", "-Y", "canopen.sdo.abort_code")
    )
}
check("and knows every abort code", texts == {(code, text) for code, text, _ in ABORTS}, texts)

# ---- The bus by the DBC, and the telemetry. SYNC k is answered with the state before its 2 steps of 1 ms: row 2 k.
subprocess.run([hil, "dbc", scenario, "-o", work + "/drives.dbc"], check=True)
db = canmatrix.formats.loadp_flat(work + "/drives.dbc")
by_id = {f.arbitration_id.id: f for f in db.frames}
telemetry = h5py.File(work + "/live/telemetry.h5")
rows = {
    n: {c: telemetry[f"joint{n}/{c}"][:] for c in ("position_rad", "temperature_degC", "friction_nm")} for n in nodes
}
sync, worst, answers, unknown = -1, collections.defaultdict(float), 0, set()
for _, i, d in frames:
    base, n = i & 0x780, i & 0x7F
    sync += i == 0x80
    if base == 0x480:  # not in the DBC: mapped by hand above
        temperature, friction = struct.unpack("<hi", d)
        worst["0.1 degC"] = max(worst["0.1 degC"], abs(temperature - 10 * rows[n]["temperature_degC"][2 * sync]))
        if sync:  # friction is of the step that has been
            worst["mNm"] = max(worst["mNm"], abs(friction - 1e3 * rows[n]["friction_nm"][2 * sync - 1]))
    elif 0x180 <= base < 0x580:
        if i not in by_id or by_id[i].size != len(d):
            unknown.add((i, len(d)))
        elif base == 0x380:
            signals = by_id[i].decode(d)
            counts_off = (
                abs(float(signals["position_actual"].phys_value) - rows[n]["position_rad"][2 * sync]) * per_rad[n]
            )
            worst["increments"], answers = max(worst["increments"], counts_off), answers + 1
check("the DBC has every PDO on the bus", not unknown, unknown)
time_s = telemetry["time_s"][:]
check(
    "two rows of telemetry per SYNC; NMT ended the operation without SYNC: some more until the drives were at rest",
    np.allclose(time_s, 1e-3 * np.arange(len(time_s)), atol=1e-9) and 0 < len(time_s) - 2 * (sync + 1) < 500,
    (time_s.shape, sync),
)
check(
    f"{answers} positions, temperatures and frictions on the bus are those of the telemetry, rounded",
    answers > 6 * 300 and len(worst) == 3 and all(w <= 0.5 + 1e-6 for w in worst.values()),
    worst,
)
print("    at most " + ", ".join(f"{w:.3f} x {unit}" for unit, w in worst.items()))

finish()
