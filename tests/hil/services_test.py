"""The services of CiA 301 and 305 that a master of python-canopen's kind uses beside PDOs, over a bus. Arguments:
tribotwin-hil, source tree, address, python-can interface and channel."""
import logging, subprocess, sys, zlib

logging.disable(logging.WARNING)  # python-can of reads that end inside a frame

from harness import check, check_refused, finish, nightly, run, work
from master import Master, SdoAbort
from session import connect, hold_scenario, in_vm, said, start

hil, source, address, interface, channel = sys.argv[1:6]
scenario = hold_scenario(source)
nodes = range(1, 7)
SAVE, LOAD = 0x65766173, 0x64616F6C


def abort_of(call):
    try:
        call()
    except SdoAbort as e:
        return e.code


class Drives:
    """A session with a master."""

    def __init__(self, *options):
        self.process = start(hil, "drive", scenario, "--can", address, *options)
        self.bus = connect(address, interface, channel)
        self.master = Master(self.bus, nodes)

    def __enter__(self):
        return self.master

    def __exit__(self, *_):
        self.bus.shutdown()
        self.process.terminate()
        check("the drives end when asked", self.process.wait(10) == 0, said())


def blocks():
    subprocess.run([hil, "eds", scenario, "--node", "2", "-o", work + "/2.eds", "--force"], check=True)
    eds = open(work + "/2.eds", "rb").read()
    with Drives() as master:
        check(f"1021h: the EDS in blocks, {len(eds)} bytes", master.block_read(2, 0x1021) == eds)
        check("the same in segments", master.read(2, 0x1021, 0, "s").encode() == eds)
        lost = {5, 127, 128, 300, 301, 302, len(eds) // 7}
        check("lost segments come again", master.block_read(2, 0x1021, block=100, crc=False, lose=lost) == eds)
        data = bytes(k * k % 251 for k in range(4000))
        for crc, lose in ((True, ()), (False, ()), (True, {1, 2, 126, 127, 500, 571, 572})):
            master.block_write(3, 0x2180, 0, b"")
            master.block_write(3, 0x2180, 0, data, crc, lose)
            check(f"4000 bytes down, crc {crc}, lost {len(lose)}", master.block_read(3, 0x2180) == data)
        check("a threshold switches to expedited", master.block_read(3, 0x1000, threshold=4) == b"\x92\1\2\0")
        check("a number in a block", master.block_read(3, 0x1000) == b"\x92\1\2\0")
        check("too long", abort_of(lambda: master.block_write(3, 0x2180, 0, bytes(4097))) == 0x06070012)
        check("read only", abort_of(lambda: master.block_write(3, 0x1021, 0, b"x")) == 0x06010002)
        check("block size", abort_of(lambda: master.block_read(3, 0x1021, block=128)) == 0x05040002)


def node_numbers():
    log = work + "/lss.log"
    with Drives("--unconfigured", "--record", log) as master:
        master.nmt(0x82)
        master.listen(0.3)
        check("drives without numbers are silent", not master.boots and not master.heartbeat)
        check("but say that they are there", {bytes(a)[0] for a in master.lss(0x4C, 0)} == {0x50})
        found = []
        while (identity := master.lss_scan()) and len(found) < 7:
            number = 30 + identity[3]
            found.append(identity)
            check(f"fastscan: {identity} becomes node {number}", master.lss_number(number) == 0)
            master.lss_state(0)
            check("which boots", master.until(lambda: number in master.boots), master.boots)
        check("all six were found", sorted(found) == [(0, 0x7477, 0x10000, k) for k in nodes], found)
        check("with their own identity", [master.read(30 + k, 0x1018, 4) for k in nodes] == list(nodes))
        check("selected", master.lss_select(0, 0x7477, 0x10000, 4))
        check("node id", master.lss(0x5E, 0)[0][:2] == b"\x5E\x22")
        check("bit timing: none to set", master.lss(0x13, 0, 2, kind="BB")[0][:2] == b"\x13\1")
        check("nothing to store to", master.lss(0x17, 0)[0][:2] == b"\x17\1")
        master.lss_state(0)
    again = run(hil, "replay", scenario, log, "--fast", "--unconfigured")
    check("a replay repeats it", again.returncode == 0, again.stdout + again.stderr)
    refused = run(hil, "drive", scenario, "--can", "memory:x", "--profile", "mirror", "--unconfigured")
    check("mirror has no LSS", refused.returncode == 2 and "cia402" in refused.stderr, refused.stderr)


def stored_parameters():
    store = work + "/drives.store"
    with Drives() as master:
        check("no store: cannot", master.read(1, 0x1010, 1) == 0)
        check("no store: refused", abort_of(lambda: master.write(1, 0x1010, 1, "I", SAVE)) == 0x08000020)
    with Drives("--store", store) as master:
        check("a store: can", master.read(1, 0x1010, 1) == 1)
        for node in (1, 2):
            master.write(node, 0x1017, 0, "H", 70 + node)
            master.send_torque(node)
            master.write(node, 0x605A, 0, "h", 6)
            master.write(node, 0x1010, node, "I", SAVE)
        master.block_write(3, 0x2180, 0, b"a note")
        master.write(3, 0x1010, 4, "I", SAVE)
        check("no signature", abort_of(lambda: master.write(1, 0x1010, 1, "I", 1)) == 0x08000020)
        master.lss_select(0, 0x7477, 0x10000, 6)
        master.lss_number(66)
        check("stored by LSS", master.lss(0x17, 0)[0][:2] == b"\x17\0")
        master.lss_state(0)
    copy = open(store, "rb").read()
    log = work + "/stored.log"
    with Drives("--store", store, "--record", log) as master:
        check("the store is not written without need", open(store, "rb").read() == copy)
        check("times", [master.read(n, 0x1017, 0, "H") for n in (1, 2, 3)] == [71, 72, 500])
        check(
            "options: all of node 1, the communication of node 2",
            [master.read(n, 0x605A, 0, "h") for n in (1, 2)] == [6, 2],
        )
        check("mappings", all(master.read(n, 0x1A03, 1) == 0x60770010 for n in (1, 2)))
        check("identifiers", [master.read(n, 0x1803, 1) for n in (1, 2)] == [0x481, 0x482])
        check("user data", master.block_read(3, 0x2180) == b"a note")
        check("node 6 is node 66", master.read(66, 0x1018, 4) == 6 and master.read(66, 0x1200, 1) == 0x642)
        master.write(1, 0x1011, 1, "I", LOAD)
        check("restored after a reset only", master.read(1, 0x1017, 0, "H") == 71)
        master.nmt(0x81, 1)
        check("boots", master.until(lambda: 1 in master.boots))
        check("restored", [master.read(1, 0x1017, 0, "H"), master.read(1, 0x605A, 0, "h")] == [500, 2])
    check("the store forgot it", b"[drive 1]\n[drive 2]" in open(store, "rb").read())
    open(store, "wb").write(copy)
    again = run(hil, "replay", scenario, log, "--fast", "--store", store)
    check("a replay repeats it", again.returncode == 0, again.stdout + again.stderr)
    check("and leaves the store", open(store, "rb").read() == copy)
    damaged_stores(store, copy, log)


def damaged_stores(store, copy, log):
    damaged = copy.replace(b"47 00", b"48 00")
    open(store, "wb").write(damaged)
    line = damaged.count(b"\n")
    for command in (("drive", "--can", "memory:x"), ("replay", log)):
        refused = run(hil, command[0], scenario, *command[1:], "--store", store)
        check_refused(f"{command[0]}: a damaged store", refused, f"{store}:{line}: ")
    text = b"tribotwin-hil store 1\n[drive 2]\n1017h:00 = 01 00\n%s\n"
    for value, says in (
        (b"5000h:00 = 01", "5000h:00: this object does not exist"),
        (b"605Ah:00 = 07 00", "upper limit"),
    ):
        body = text % value
        open(store, "wb").write(body + b"checksum = %08X\n" % zlib.crc32(body))
        refused = run(hil, "drive", scenario, "--can", "memory:x", "--store", store)
        check_refused(f"a store with {value}", refused, (f"{store}:4: ", says))
    check("which stays", open(store, "rb").read().startswith(body))
    refused = run(hil, "drive", scenario, "--can", "memory:x", "--store", scenario)
    check_refused("the scenario is no store", refused, "--store")
    refused = run(hil, "drive", scenario, "--can", "memory:x", "--store", "/nowhere/s")
    check_refused("a folder that is not there", refused, "/nowhere")


FOREIGN = """[FileInfo]
FileName=other.eds
[1000]
ParameterName=device type
DataType=7
AccessType=ro
DefaultValue=0x20192
[1018]
ParameterName=identity
ObjectType=9
SubNumber=2
[1018sub0]
ParameterName=highest
DataType=5
AccessType=const
DefaultValue=1
[1018sub1]
ParameterName=vendor
DataType=7
AccessType=ro
DefaultValue=0xFB
[3000]
ParameterName=gain
DataType=3
AccessType=rw
DefaultValue=-7
LowLimit=-10
HighLimit=10
[3001]
ParameterName=password
DataType=6
AccessType=wo
"""


def configured_drives():
    other, dcf = work + "/other.eds", work + "/node2.dcf"
    open(other, "w").write(FOREIGN)
    text = subprocess.run([hil, "eds", scenario, "--node", "2"], check=True, capture_output=True, text=True).stdout
    check("an EDS with $NODEID", "[1402sub1]" in text and "DefaultValue=$NODEID+0x400\n" in text)
    text = text.replace("[DeviceInfo]", "[DeviceComissioning]\nNodeID=2\n\n[DeviceInfo]")
    for section, value in (
        ("1017", "77"),
        ("1803sub1", "$NODEID+0x480"),
        ("1A03sub0", "2"),
        ("1A03sub1", "0x60410010"),
        ("1A03sub2", "0x60770010"),
        ("605A", "6"),
    ):
        text = text.replace(f"[{section}]\n", f"[{section}]\nParameterValue={value}\n")
    open(dcf, "w").write(text)
    log = work + "/configured.log"
    options = ("--eds", other, "--dcf", dcf)
    with Drives(*options, "--record", log) as master:
        check("vendor of the EDS, number of the drive", [master.read(3, 0x1018, k) for k in (1, 4)] == [0xFB, 3])
        check("an object of the EDS", master.read(4, 0x3000, 0, "h") == -7)
        master.write(4, 0x3000, 0, "h", 10)
        check("which keeps a value", master.read(4, 0x3000, 0, "h") == 10)
        check("within its limits", abort_of(lambda: master.write(4, 0x3000, 0, "h", 11)) == 0x06090031)
        check("write only", abort_of(lambda: master.read(4, 0x3001)) == 0x06010001)
        check("of the DCF", (master.read(2, 0x1017, 0, "H"), master.read(2, 0x605A, 0, "h")) == (77, 6))
        check("no other drive has it", master.read(1, 0x1017, 0, "H") == 500)
        master.nmt(0x81)
        check("all boot", master.until(lambda: set(nodes) <= set(master.boots)), master.boots)
        check("also after a reset", (master.read(2, 0x1017, 0, "H"), master.read(4, 0x3000, 0, "h")) == (77, -7))
        check("a PDO of the DCF", (master.read(2, 0x1803, 1), master.read(2, 0x1A03, 2)) == (0x482, 0x60770010))
    again = run(hil, "replay", scenario, log, "--fast", *options)
    check("a replay repeats it", again.returncode == 0, again.stdout + again.stderr)
    wrong = work + "/wrong.dcf"
    for option, content, says in (
        ("--eds", FOREIGN.replace("LowLimit=-10", "LowLimit=x"), f"{wrong}:27: 3000h:00: the limit 'x'"),
        ("--eds", "[FileInfo]\n", "is it an EDS"),
        ("--dcf", FOREIGN, "NodeID=N in [DeviceComissioning]"),
        ("--dcf", text.replace("NodeID=2", "NodeID=9"), "nodes 1 to 6"),
        ("--dcf", text.replace("Value=77", "Value=x"), "1017h:00: 'x' is no u16 from 0 to 65535"),
        ("--dcf", text.replace("Value=6\n", "Value=66\n"), "drive 2: 605Ah:00: more than its upper limit"),
        ("--dcf", "[DeviceComissioning]\nNodeID=2\n" + FOREIGN, "no ParameterValue"),
    ):
        open(wrong, "w").write(content)
        refused = run(hil, "drive", scenario, "--can", "memory:x", option, wrong)
        check_refused(f"{option}: {says[-40:]}", refused, (wrong, says))
    refused = run(hil, "drive", scenario, "--can", "memory:x", "--dcf", dcf, "--dcf", dcf)
    check_refused("two for one drive", refused, "has a DCF already")
    refused = run(hil, "drive", scenario, "--can", "memory:x", "--dcf", dcf, "--stats", dcf, "--force")
    check_refused("the DCF is no output", refused, "would overwrite")


def guarded():
    """Remote frames, which socketcand cannot carry."""
    with Drives("--realtime") as master:
        answers = []
        for _ in range(4):
            master.heartbeat.pop(2, None)
            master.send_remote(0x702)
            master.until(lambda: 2 in master.heartbeat, 1)
            answers.append(master.heartbeat.get(2))
            master.write(2, 0x1017, 0, "H", 0)
        check("a node that is guarded toggles", answers[1:] == [0x7F, 0xFF, 0x7F], answers)
        master.write(2, 0x100C, 0, "H", 200)
        master.write(2, 0x100D, 0, "B", 5)
        master.nmt(1, 2)
        for _ in range(5):
            master.send_remote(0x702)
            master.listen(0.1)
        check("guarded: no error", not master.emergencies, master.emergencies)
        check("then not: EMCY", master.until(lambda: (2, (0x8130, 0x11)) in master.emergencies), master.emergencies)


blocks()
if nightly or not in_vm:  # by day the same on socketcand, where programs start in less than two seconds
    node_numbers()
    stored_parameters()
    configured_drives()
if interface == "socketcan":
    guarded()
finish()
