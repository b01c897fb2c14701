"""What the tests of tribotwin-hil share: drives to start and a bus to them."""
import atexit, os, re, subprocess, threading, time

import can

from harness import work
from master import Master

# There a program takes two seconds to start.
in_vm = os.environ.get("CAN_VM") == "vm"


def hold_scenario(source):
    return os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")


def start(hil, *arguments):
    """A session in the background that has opened its bus or has ended; its stderr goes to work/stderr. Killed with the
    test at the latest."""
    log = open(work + "/stderr", "a")
    before = log.tell()
    process = subprocess.Popen([hil, *arguments], stderr=log)
    atexit.register(process.kill)
    if "--quiet" in arguments:  # says nothing when it is there
        time.sleep(3 if in_vm else 1)
        return process
    wait(lambda: " drives, node" in said()[before:] or process.poll() is not None)
    return process


def wait(condition, seconds=30):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)


def said():
    return open(work + "/stderr").read()


def connect(address, interface, channel, **more):
    """python-can's end of the drives' bus; for socketcand the port is that of their address."""
    if interface == "socketcand":
        return can.Bus(
            interface="socketcand", channel=channel, host="127.0.0.1", port=int(re.search(r":(\d+)/", address).group(1))
        )
    return can.Bus(interface=interface, channel=channel, **more)


class Movement(threading.Thread):
    """A master that enables the drives and moves joint 2, a SYNC every 4 ms, until it is told to end; the SYNC number
    `odd_sync` has a counter that no drive was told of."""

    def __init__(self, address, nodes, odd_sync=None):
        super().__init__(daemon=True)
        self.address, self.nodes = address, nodes
        self.going, self.enabled = True, threading.Event()
        self.k, self.odd_sync, self.unanswered = 0, odd_sync, 0

    def run(self):
        master = Master(connect(self.address, "socketcand", "can0"), self.nodes)
        master.nmt(1)
        master.be_patient(10000)
        for n in self.nodes:
            master.send_torque(n)
        for word in (0x80, 0x00, 0x06, 0x07, 0x0F):
            master.control(word)
            master.cycle()
            master.cycle()
        home = dict(master.position)
        self.enabled.set()
        while self.going:
            begun = time.monotonic()
            self.k += 1
            step = 20000 * (1 - abs(self.k % 500 / 250 - 1))
            if self.k == self.odd_sync:
                master.send(0x80, b"\x01")
            targets = {n: home[n] + round(step) if n == 2 else home[n] for n in self.nodes}
            try:
                self.unanswered += self.going and not master.cycle(targets)
            except can.CanError:  # the drives have ended
                break
            time.sleep(max(0, 0.004 - (time.monotonic() - begun)))
        master.bus.shutdown()
