"""A master that reads bus.yml as ros2_canopen does: the configuration that its dcfgen would make is written by SDO,
then PDOs run with the SYNC, and each drive is led through CiA 402 as the driver's motor is. Written from CiA 301, 402
and the behaviour of those programs; nothing is theirs."""
import collections, configparser, os, struct

import yaml

from master import Master, is_state

KINDS = {2: "b", 3: "h", 4: "i", 5: "B", 6: "H", 7: "I"}  # data types of CiA 301 that are numbers
OFF = 0x80000000  # of a COB-ID: the PDO does not exist
Entry = collections.namedtuple("Entry", "kind access default mappable")
CONTROL, MODE, STATUS, SHOWN = (0x6040, 0), (0x6060, 0), (0x6041, 0), (0x6061, 0)
POSITION, VELOCITY, TORQUE, SUPPORTED = (0x6064, 0), (0x606C, 0), (0x6077, 0), (0x6502, 0)
PP, PV, HOMING, IP, CSP, CSV, CST = 1, 3, 6, 7, 8, 9, 10  # modes of operation
TARGETS = {PP: (0x607A, 0), PV: (0x60FF, 0), IP: (0x60C1, 1), CSP: (0x607A, 0), CSV: (0x60FF, 0), CST: (0x6071, 0)}
HOMING_METHOD = 0x6098, 0
NEW_POINT, IMMEDIATELY, HALT = 0x10, 0x20, 0x100  # of the controlword; the first also enables IP
ACKNOWLEDGED = 0x1000  # of the statusword, in PP


def size(entry):
    return struct.calcsize("<" + entry.kind)


def number(text, node):
    return sum(node if part == "$NODEID" else int(part, 0) for part in text.split("+"))


def read_eds(path, node):
    """(index, sub-index) -> Entry, of the objects that are numbers."""
    eds = configparser.ConfigParser(interpolation=None, strict=True, delimiters="=")
    eds.read_string(open(path, encoding="ascii").read())
    found = {}
    for name in eds.sections():
        index, _, sub = name.partition("sub")
        kind = eds[name].get("DataType")
        if len(index) == 4 and kind and int(kind, 0) in KINDS:
            o = eds[name]
            default = number(o["DefaultValue"], node) if "DefaultValue" in o else None
            found[int(index, 16), int(sub or "0", 16)] = Entry(
                KINDS[int(kind, 0)], o["AccessType"], default, o["PDOMapping"] == "1"
            )
    return found


def read_bus(folder):
    """bus.yml, and the drives in it: name -> its part."""
    with open(os.path.join(folder, "bus.yml")) as f:
        bus = yaml.safe_load(f)
    return bus, {name: part for name, part in bus.items() if name not in ("options", "master")}


def mapping(pdo):
    return [(m["index"], m["sub_index"]) for m in pdo["mapping"]]


def concise(part, eds):
    """What is written into a drive, in the order of a concise DCF: (index, sub-index, value)."""
    if part["heartbeat_producer"] != eds[0x1017, 0].default:
        yield 0x1017, 0, part["heartbeat_producer"]
    for way, base in (("rpdo", 0x1400), ("tpdo", 0x1800)):
        for number, pdo in part[way].items():
            at = base + number - 1
            cob = pdo.get("cob_id", eds[at, 1].default)
            if cob | OFF != eds[at, 1].default:
                yield at, 1, cob | OFF
            if cob & OFF:
                continue
            if pdo.get("transmission", eds[at, 2].default) != eds[at, 2].default:
                yield at, 2, pdo["transmission"]
            yield at + 0x200, 0, 0
            for k, (index, sub) in enumerate(mapping(pdo), 1):
                yield at + 0x200, k, index << 16 | sub << 8 | 8 * size(eds[index, sub])
            if pdo["mapping"]:
                yield at + 0x200, 0, len(pdo["mapping"])
            if pdo["enabled"]:
                yield at, 1, cob
    for o in part["sdo"]:
        yield o["index"], o["sub_index"], o["value"]


class Drive:
    """The master's picture of a drive: what PDOs brought and what they shall bring, and its motor."""

    def __init__(self, name, part, folder):
        self.name, self.part, self.node = name, part, part["node_id"]
        self.eds = read_eds(os.path.join(folder, part["dcf"]), self.node)
        self.values, self.out, self.received = {}, {}, collections.Counter()
        self.pdos = {way: [p for p in part[way].values() if p["enabled"]] for way in ("rpdo", "tpdo")}
        for pdo in self.pdos["rpdo"]:
            self.out.update((key, 0) for key in mapping(pdo))
        self.mode, self.target, self.handed, self.reset = 0, None, None, False

    def format(self, pdo):
        return "<" + "".join(self.eds[key].kind for key in mapping(pdo))

    def pack(self, pdo):
        return struct.pack(self.format(pdo), *(self.out[key] for key in mapping(pdo)))

    def unpack(self, pdo, data):
        self.received[pdo["cob_id"]] += 1
        self.values.update(zip(mapping(pdo), struct.unpack(self.format(pdo), data)))

    # Joint side, as the joint states.
    def position(self):
        return self.values[POSITION] * self.part["scale_pos_from_dev"]

    def velocity(self):
        return self.values[VELOCITY] * self.part["scale_vel_from_dev"]

    def effort(self):
        return self.values[TORQUE] * self.part["scale_eff_from_dev"]

    def command(self, target):
        """A set point: radians, radians per second, per mille of the rated torque."""
        scale = {PP: "pos", IP: "pos", CSP: "pos", PV: "vel", CSV: "vel"}.get(self.mode)
        self.target = int(target * self.part[f"scale_{scale}_to_dev"] if scale else target)

    def write(self):
        """One turn of the driver: halt, unless a set point of the mode is there."""
        word = self.out[CONTROL] | HALT
        if is_state(self.values[STATUS], "operation enabled"):
            shown = self.mode == self.values[SHOWN]
            if not self.mode or not shown or self.mode in (HOMING, IP):
                word &= ~(NEW_POINT | IMMEDIATELY | 0x40)
            if self.mode in TARGETS and shown and self.target is not None:
                word = (self.hand_over(word) if self.mode == PP else self.forward(word)) & ~HALT
        self.out[CONTROL] = word & ~0x80 if self.reset else word
        self.reset = False

    def forward(self, word):
        self.out[TARGETS[self.mode]] = self.target
        return word | NEW_POINT if self.mode == IP else word

    def hand_over(self, word):
        """A set point of PP is taken at the rising edge of "new set point", until it is acknowledged."""
        word |= IMMEDIATELY
        if self.values[STATUS] & ACKNOWLEDGED or self.target != self.handed and word & NEW_POINT:
            return word & ~NEW_POINT
        if self.target != self.handed:
            self.out[TARGETS[PP]] = self.handed = self.target
            return word | NEW_POINT
        return word

    def step_to(self, wanted):
        """The controlword of the next transition towards a state; set and cleared bits, the others stay."""
        steps = {
            "fault": (0x80, 0),
            "switch on disabled": (0x06, 0x81),
            "ready to switch on": (0x07, 0x88),
            "switched on": (0x0F, 0x80),
            "quick stop active": (0x0F, 0x80),
        }
        direct = {"switch on disabled": (0, 0x82), "quick stop active": (0x02, 0x84)}
        for state, bits in steps.items() if wanted == "operation enabled" else ():
            if is_state(self.values[STATUS], state):
                return bits
        return direct.get(wanted, (0, 0))


class Ros2Master(Master):
    def __init__(self, bus, folder):
        self.config, parts = read_bus(folder)
        self.drives = [Drive(name, part, folder) for name, part in parts.items()]
        self.tpdos = {pdo["cob_id"]: (d, pdo) for d in self.drives for pdo in d.pdos["tpdo"]}
        super().__init__(bus, [d.node for d in self.drives])
        self.syncs = 0

    def take(self, message):
        if message and message.arbitration_id in self.tpdos and not message.is_error_frame:
            drive, pdo = self.tpdos[message.arbitration_id]
            return drive.unpack(pdo, bytes(message.data))
        super().take(message)

    def read_object(self, drive, index, sub=0):
        return self.read(drive.node, index, sub, drive.eds[index, sub].kind)

    def boot(self):
        """NMT reset, identity, configuration, start. Returns what does not fit the EDS."""
        self.boots.clear()
        self.send(0x700 + self.config["master"]["node_id"], b"\0")
        self.nmt(0x82)
        wrong = [] if self.until(lambda: set(self.boots) >= set(self.nodes)) else ["no boot-up message of all"]
        for d in self.drives:
            for key in ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4)):
                if d.eds[key].default not in (None, found := self.read_object(d, *key)):
                    wrong.append((d.name, "%04Xh:%d" % key, found))
            for index, sub, value in concise(d.part, d.eds):
                self.write(d.node, index, sub, d.eds[index, sub].kind, value)
        for d in self.drives:
            self.nmt(1, d.node)
        return wrong

    def turn(self, count=1):
        """So many cycles: SYNC, the set points of the last turn, all answers, then the drivers' turn. False: an answer
        was missing."""
        for _ in range(count):
            before = {cob: d.received[cob] for cob, (d, _) in self.tpdos.items()}
            self.sync()
            self.syncs += 1
            for d in self.drives:
                for pdo in d.pdos["rpdo"]:
                    self.send(pdo["cob_id"], d.pack(pdo))
            if not self.until(lambda: all(d.received[c] > before[c] for c, (d, _) in self.tpdos.items()), 2):
                return False
            for d in self.drives:
                d.write()
        return True

    def reach(self, drives, wanted, cycles=500):
        for _ in range(cycles):
            missing = [d for d in drives if not is_state(d.values[STATUS], wanted)]
            if not missing:
                return True
            for d in missing:
                set_bits, cleared = d.step_to(wanted)
                d.out[CONTROL] = d.out[CONTROL] & ~cleared | set_bits
            self.turn()
        return False

    def init(self, drives):
        """As the service: enabled, then homing where the drive has it and 6098h is not 0. That is not written here."""
        for d in drives:
            d.out[CONTROL], d.reset = 0, True
        if not self.reach(drives, "operation enabled"):
            return False
        if not any(self.read_object(d, *SUPPORTED) >> (HOMING - 1) & 1 for d in drives):
            return True
        homes = not self.enter(drives, HOMING) or any(self.read_object(d, *HOMING_METHOD) for d in drives)
        return not homes and self.enter(drives, 0)

    def enter(self, drives, mode, cycles=500):
        """A mode, in operation enabled; 0: none."""
        for d in drives:
            d.mode, d.target, d.handed = 0, None, None
            if mode and not self.read_object(d, *SUPPORTED) >> (mode - 1) & 1:
                return False
            d.out[MODE] = mode
        for _ in range(cycles):
            if all(d.values[SHOWN] == mode for d in drives):
                break
            self.turn()
        for d in drives:
            d.mode = mode
        return all(d.values[SHOWN] == mode for d in drives)

    def recover(self, drives):
        for d in drives:
            d.reset = True
        return self.reach(drives, "operation enabled")

    def shut_down(self, drives):
        return self.enter(drives, 0) and self.reach(drives, "switch on disabled")
