"""A CANopen master in plain python-can: knows CiA 301 and 402 from the standards, nothing from this project."""
import struct, time

import can

STATES = {  # mask, value
    "switch on disabled": (0x4F, 0x40),
    "ready to switch on": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "operation enabled": (0x6F, 0x27),
    "quick stop active": (0x6F, 0x07),
    "fault reaction active": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}
SIZES = {"B": 0x2F, "b": 0x2F, "H": 0x2B, "h": 0x2B, "I": 0x23, "i": 0x23}


def crc16(data):
    """CRC-16/XMODEM."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = crc << 1 ^ (0x11021 if crc & 0x8000 else 0)
    return crc


def is_state(word, name):
    mask, value = STATES[name]
    return word & mask == value


class SdoAbort(Exception):
    def __init__(self, code):
        super().__init__("SDO abort %08X" % code)
        self.code = code


class Master:
    def __init__(self, bus, nodes):
        self.bus, self.nodes = bus, list(nodes)
        self.status, self.position, self.heartbeat, self.emergencies, self.boots = {}, {}, {}, [], []
        self.tpdo3 = {n: 0 for n in self.nodes}
        self.answers, self.received = {}, {}  # of SDOs: the last one, all
        self.lss_answers = []
        self.log = []

    def send(self, identifier, data=b""):
        self.bus.send(can.Message(arbitration_id=identifier, data=bytes(data), is_extended_id=False))

    def send_remote(self, identifier):
        self.bus.send(can.Message(arbitration_id=identifier, is_remote_frame=True, dlc=1, is_extended_id=False))

    def take(self, message):
        if message is None or message.is_error_frame:  # python-can 4.1 marks all of socketcand as extended
            return
        identifier, data = message.arbitration_id, bytes(message.data)
        node = identifier & 0x7F
        if identifier & 0x780 == 0x180 and node in self.tpdo3:
            self.status[node] = struct.unpack("<H", data[:2])[0]
        elif identifier & 0x780 == 0x380 and node in self.tpdo3:
            self.status[node], self.position[node] = struct.unpack("<Hi", data)
            self.tpdo3[node] += 1
        elif identifier & 0x780 == 0x580:
            self.answers[node] = data
            self.received.setdefault(node, []).append(data)
        elif identifier & 0x780 == 0x080 and node:
            self.emergencies.append((node, struct.unpack("<HB", data[:3])))
        elif identifier == 0x7E4:
            self.lss_answers.append(data)
        elif identifier & 0x780 == 0x700:
            (self.boots if data == b"\0" else []).append(node)
            self.heartbeat[node] = data[0]

    def listen(self, seconds):
        end = time.monotonic() + seconds
        while True:
            left = end - time.monotonic()
            message = self.bus.recv(max(0, left))
            self.take(message)
            if left <= 0 and message is None:
                return

    def until(self, condition, seconds=5):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self.take(self.bus.recv(0.01))
        return True

    def request(self, node, data):
        self.answers.pop(node, None)
        self.send(0x600 + node, data)
        if not self.until(lambda: node in self.answers, 2):
            raise TimeoutError("no SDO answer from node %d" % node)
        answer = self.answers.pop(node)
        if answer[0] == 0x80:
            raise SdoAbort(struct.unpack("<I", answer[4:])[0])
        return answer

    def read(self, node, index, sub=0, kind="I"):
        data = self.rest(node, self.request(node, struct.pack("<BHB4x", 0x40, index, sub)))
        return data.decode() if kind == "s" else struct.unpack("<" + kind, data)[0]

    def write(self, node, index, sub, kind, value):
        self.request(
            node, struct.pack("<BHB", SIZES[kind], index, sub) + struct.pack("<" + kind, value).ljust(4, b"\0")
        )

    def block_read(self, node, index, sub=0, block=127, crc=True, threshold=0, lose=()):
        """A block upload; `lose`: numbers of received segments that this end pretends not to have got."""
        answer = self.request(node, struct.pack("<BHBBBxx", 0xA4 if crc else 0xA0, index, sub, block, threshold))
        if answer[0] & 0xE0 != 0xC0:
            return self.rest(node, answer)
        size, data, last = struct.unpack("<I", answer[4:])[0], b"", False
        lose, count = set(lose), 0
        self.answer_to(node, b"\xA3")
        while not last:
            sequence = 0
            while True:
                segment = self.next_answer(node)
                count += 1
                if segment[0] & 0x7F == sequence + 1 and count not in lose:
                    sequence, last, data = sequence + 1, bool(segment[0] & 0x80), data + segment[1:]
                if segment[0] & 0x80 or segment[0] & 0x7F == block:
                    break
            self.answer_to(node, bytes([0xA2, sequence, block]))
        end = self.next_answer(node)
        assert end[0] & 0xE3 == 0xC1
        data = data[: len(data) - (end[0] >> 2 & 7)]
        self.answer_to(node, b"\xA1")
        assert len(data) == size and struct.unpack("<H", end[1:3])[0] == (crc16(data) if crc else 0)
        return data

    def block_write(self, node, index, sub, data, crc=True, lose=()):
        """A block download; `lose`: numbers of segments that are not sent."""
        start = struct.pack("<BHBI", 0xC6 if crc else 0xC2, index, sub, len(data))
        answer = self.request(node, start)
        assert answer[0] & 0xE3 == 0xA0
        at, block, count, lose = 0, answer[4], 0, set(lose)
        while at < max(1, len(data)):
            self.received[node] = []
            for sequence in range(1, block + 1):
                part = data[at + 7 * (sequence - 1) :][:7]
                last = at + 7 * sequence >= len(data)
                count += 1
                if count not in lose:
                    self.send(0x600 + node, bytes([sequence | (0x80 if last else 0)]) + part.ljust(7, b"\0"))
                if last:
                    break
            answer = self.next_answer(node)
            assert answer[0] == 0xA2
            at, block = at + 7 * answer[1], answer[2]
        unused = (7 - len(data) % 7) % 7 if data else 7
        end = struct.pack("<BH5x", 0xC1 | unused << 2, crc16(data) if crc else 0)
        assert self.request(node, end)[0] == 0xA1

    def rest(self, node, answer):
        """The value of an upload that began with this answer."""
        if answer[0] & 2:  # expedited
            return answer[4 : 8 - (answer[0] >> 2 & 3)]
        size, data, toggle = struct.unpack("<I", answer[4:])[0], b"", 0
        while len(data) < size:
            part = self.request(node, bytes([0x60 | toggle]) + bytes(7))
            assert part[0] & 0x10 == toggle
            data += part[1 : 8 - (part[0] >> 1 & 7)]
            toggle ^= 0x10
        return data

    def answer_to(self, node, data):
        self.received[node] = []
        self.send(0x600 + node, bytes(data).ljust(8, b"\0"))

    def next_answer(self, node):
        if not self.until(lambda: self.received[node], 2):
            raise TimeoutError("no SDO answer from node %d" % node)
        answer = self.received[node].pop(0)
        if answer[0] == 0x80:
            raise SdoAbort(struct.unpack("<I", answer[4:])[0])
        return answer

    def lss(self, command, *values, kind="<I", seconds=0.2):
        """An LSS request; the answers that come within the time, as bytes."""
        self.lss_answers = []
        self.send(0x7E5, (bytes([command]) + struct.pack(kind, *values)).ljust(8, b"\0"))
        self.until(lambda: self.lss_answers, seconds)
        return self.lss_answers

    def lss_state(self, configuration):
        self.send(0x7E5, bytes([0x04, configuration]).ljust(8, b"\0"))

    def lss_select(self, vendor, product, revision, serial):
        for command, value in ((0x40, vendor), (0x41, product), (0x42, revision)):
            self.lss(command, value, seconds=0)
        return [a[0] for a in self.lss(0x43, serial)] == [0x44]

    def lss_number(self, number):
        """The error code of configure node-id."""
        return self.lss(0x11, number, kind="<B")[0][1]

    def lss_scan(self, seconds=0.05):
        """Fastscan: the identity of one drive without a number, which is in configuration then."""
        # Silence is an answer here: twice, so that a short pause of the machine is none.
        ask = lambda *values: any(self.lss(0x51, *values, kind="<IBBB", seconds=seconds) for _ in range(2))
        found = [0, 0, 0, 0]
        if not ask(0, 128, 0, 0):
            return None
        for part in range(4):
            for bit in range(31, -1, -1):
                if not ask(found[part], bit, part, part):
                    found[part] |= 1 << bit
            if not ask(found[part], 0, part, (part + 1) % 4):
                return None
        return tuple(found)

    def nmt(self, command, node=0):
        self.send(0x000, [command, node])

    def sync(self):
        self.send(0x080)

    def cycle(self, targets=None, control=0x0F, period=0.002, wait=True):
        """One SYNC: set points first, then SYNC, then all answers."""
        before = dict(self.tpdo3)
        if targets is not None:
            for node in self.nodes:
                self.send(0x400 + node, struct.pack("<Hi", control, targets[node]))
        self.sync()
        return self.until(lambda: all(self.tpdo3[n] > before[n] for n in self.nodes), 2) if wait else True

    def send_torque(self, node):
        """Has the drive send its torque with every SYNC, in TPDO4."""
        for index, sub, kind, value in (
            (0x1A03, 0, "B", 0),
            (0x1A03, 1, "I", 0x60770010),
            (0x1A03, 0, "B", 1),
            (0x1803, 2, "B", 1),
            (0x1803, 1, "I", 0x480 + node),
        ):
            self.write(node, index, sub, kind, value)

    def be_patient(self, milliseconds=1000):
        """Has the drives wait longer for a SYNC (2120h): a busy machine may pause this process for a while."""
        for node in self.nodes:
            self.write(node, 0x2120, 1, "H", milliseconds)

    def control(self, word, nodes=None):
        for node in nodes or self.nodes:
            self.send(0x200 + node, struct.pack("<H", word))

    def reach(self, name, word, nodes=None, cycles=2000):
        """Commands `word` and cycles until all are in that state."""
        nodes = nodes or self.nodes
        self.control(word, nodes)
        for _ in range(cycles):
            self.cycle()
            if all(is_state(self.status[n], name) for n in nodes):
                return True
        return False

    def fail_to_follow(self, node):
        """A following error: a window of almost nothing and a command that the drive cannot follow."""
        self.write(node, 0x6065, 0, "I", 10)
        self.write(node, 0x6066, 0, "H", 4)
        target = dict(self.position)
        for _ in range(400):
            target[node] += 200
            self.cycle(target)
            if is_state(self.status[node], "fault"):
                break
