"""What the tests of tribotwin-hil share: drives to start and a bus to them."""
import atexit, os, re, subprocess, time

import can

from harness import work


def hold_scenario(source):
    return os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")


def start(hil, *arguments):
    """A session in the background; its stderr goes to work/stderr. Killed with the test at the latest."""
    process = subprocess.Popen([hil, *arguments], stderr=open(work + "/stderr", "a"))
    atexit.register(process.kill)
    time.sleep(1)
    return process


def said():
    return open(work + "/stderr").read()


def connect(address, interface, channel, **more):
    """python-can's end of the drives' bus; for socketcand the port is that of their address."""
    if interface == "socketcand":
        return can.Bus(
            interface="socketcand", channel=channel, host="127.0.0.1", port=int(re.search(r":(\d+)/", address).group(1))
        )
    return can.Bus(interface=interface, channel=channel, **more)
