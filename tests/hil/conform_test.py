"""tribotwin-hil conform against tribotwin-hil drive, in two processes. Arguments: tribotwin-hil, source tree, address
of the drives, address of conform, interface and channel of python-can."""
import json, os, signal, subprocess, sys, time

import harness
from harness import check, finish, work
from master import Master, is_state
from session import connect, hold_scenario, start

hil, source, drives, address, interface, channel = sys.argv[1:7]
scenario = hold_scenario(source)
start(hil, "drive", scenario, "--can", drives, "--quiet")


def conform(*arguments, timeout=250):
    return harness.run(hil, "conform", "--can", address, "--quiet", *arguments, timeout=timeout)


# ---- A check of each service, on the axis that carries the arm; conform_test.cc makes all of them on its own clock.
services = (
    "nmt.boot_up nmt.start heartbeat.change objects.mandatory eds sdo.segmented_upload sdo.block_upload "
    "sdo.block_download store.signature lss.selective pdo.every_sync pdo.remapped rpdo.with_sync emcy.history "
    "consumer.lost state.02 status.pdo state.13_14 mode.display quick_stop.2 abort_connection.heartbeat_1 "
    "csp.follows pp.absolute hm"
).split()
subprocess.run([hil, "eds", scenario, "--node", "2", "-o", work + "/drive.eds"], check=True)
whole = ("--node", "2", "--eds", work + "/drive.eds", "--motion", "--homing", "--only", ",".join(services))
r = conform(*whole, "--json", "-o", work + "/report.json")
report = json.load(open(work + "/report.json"))
bad = [c for c in report["checks"] if c["verdict"] == "fail"]
check(
    f"our drive passes: {report['passed']} checks, {report['not_applicable']} not applicable",
    r.returncode == 0
    and not bad
    and report["passed"] + report["not_applicable"] == len(report["checks"]) > len(services)
    and report["passed"] > len(services)
    and report["complete"]
    and not report["notes"],
    (r.returncode, r.stderr, bad, report["notes"]),
)
check("every check has a clause", all(c["clause"].startswith("CiA ") for c in report["checks"]))
before = open(work + "/report.json").read()
r = conform("--node", "2", "--only", "nmt.start", "-o", work + "/report.json")
check(
    "a report that exists stays without --force",
    r.returncode == 2 and "report.json" in r.stderr and open(work + "/report.json").read() == before,
    (r.returncode, r.stderr),
)

# ---- A device that differs from its data sheet.
text = open(work + "/drive.eds").read()
open(work + "/other.eds", "w").write(text.replace("ProductNumber=0x7477", "ProductNumber=0x1"))
r = conform("--node", "3", "--eds", work + "/other.eds", "--only", "eds.identity,state.04")
check(
    "a failed check: its clause, what was expected and seen, exit code 3",
    r.returncode == 3
    and "FAIL  eds.identity  (CiA 306, DeviceInfo)" in r.stdout
    and "seen: 7477h" in r.stdout
    and "give --motion" in r.stdout,
    (r.returncode, r.stdout[-2000:], r.stderr),
)

# ---- Nobody there, and Ctrl-C in a motion.
r = conform("--node", "9")
check(
    "no node answers: exit code 1",
    r.returncode == 1 and "node 9 does not answer" in r.stderr and r.stdout == "",
    (r.returncode, r.stdout, r.stderr),
)
bus = connect(drives, interface, channel)
master = Master(bus, [1])
running = subprocess.Popen(
    [
        hil,
        "conform",
        "--can",
        address,
        "--node",
        "1",
        "--motion",
        "--only",
        "csp,pv",
        "--quiet",
        "-o",
        work + "/cut.txt",
    ],
    stderr=subprocess.PIPE,
    text=True,
)
enabled = master.until(lambda: any(is_state(w, "operation enabled") for w in master.status.values()), 120)
running.send_signal(signal.SIGINT)
stderr = running.communicate(timeout=60)[1]
master.listen(0.5)
word = master.read(1, 0x6041, 0, "H")
check(
    "interrupted while the drive is enabled: exit code 1, a report, no power",
    enabled
    and running.returncode == 1
    and "without power" in stderr
    and "interrupted" in open(work + "/cut.txt").read()
    and is_state(word, "switch on disabled"),
    (enabled, running.returncode, stderr, hex(word)),
)
bus.shutdown()
finish()
