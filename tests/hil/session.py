"""What the bench's tests share: checks, a folder, drives to start, a bus to them."""
import atexit, os, re, shutil, subprocess, sys, tempfile, time

import can

work = tempfile.mkdtemp(prefix="tribotwin_hil_")
atexit.register(shutil.rmtree, work, True)
failures = []


def check(name, condition, detail=""):
    print("ok  " if condition else "FAIL", name, "" if condition else detail, flush=True)
    if not condition:
        failures.append(name)


def finish():
    print(f"{len(failures)} failed" if failures else "all passed")
    sys.exit(bool(failures))


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


def connect(address, interface, channel):
    """python-can's end of the drives' bus; for socketcand the port is that of their address."""
    if interface == "socketcand":
        return can.Bus(
            interface="socketcand", channel=channel, host="127.0.0.1", port=int(re.search(r":(\d+)/", address).group(1))
        )
    return can.Bus(interface=interface, channel=channel)
