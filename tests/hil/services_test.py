"""The services of CiA 301 and 305 that a master of python-canopen's kind uses beside PDOs, over a bus. Arguments:
tribotwin-hil, source tree, address, python-can interface and channel."""
import subprocess, sys

from harness import check, finish, work
from master import Master, SdoAbort
from session import connect, hold_scenario, said, start

hil, source, address, interface, channel = sys.argv[1:6]
scenario = hold_scenario(source)
nodes = range(1, 7)


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


blocks()
finish()
