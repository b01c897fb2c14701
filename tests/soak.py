"""Six drives at 1 kHz for so many minutes, while masters come, go and are killed and drives have faults on purpose:
soak.py BUILD MINUTES. Every SYNC must be answered by the sixth drive, which has no faults, and within 100 ms unless the
machine stood still meanwhile, which is known under SCHED_RR alone (chrt --rr 1); memory may grow by 1 MB an hour
(counted from 30 min on), and the record must be whole in the end. Arguments: build folder, minutes."""
import json, os, re, socket, statistics, subprocess, sys, tempfile, threading, time

import h5py, numpy

from harness import free_ports, resident_kib

build, minutes = os.path.abspath(sys.argv[1]), float(sys.argv[2])
source = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SYNCS = 10000  # of a master
real_time = os.sched_getscheduler(0) == os.SCHED_RR  # Without it nothing is excused.
STANDSTILL_S = 0.05  # A virtual machine is given no processor for longer than this now and then.
standstills = []  # (from, to) [s], time.monotonic, of any processor


def watch(processor):
    """Notes when this processor did not run a thread that comes before the drives and only reads the clock."""
    os.sched_setaffinity(threading.get_native_id(), {processor})
    if real_time:
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_RR, os.sched_param(60))
    last = time.monotonic()
    while True:
        time.sleep(0.002)
        now = time.monotonic()
        if now - last > STANDSTILL_S:
            standstills.append((last, now))
        last = now


def unexplained(late_s):
    """How many of these SYNCs were answered late while every processor ran, as far as that is known."""
    return sum(not real_time or not any(begin < at + 0.1 and end > at for begin, end in standstills) for at in late_s)


def faults(file):
    """One every 5 s of simulated time, by turns."""
    kinds = [
        "kind: over_temperature, duration_s: 0.05, temperature_degC: 140",
        "kind: silence, duration_s: 0.5",
        "kind: encoder_freeze, duration_s: 0.4",
        "kind: safe_torque_off, duration_s: 0.1",
        "kind: corrupt, duration_s: 0.2, probability: 0.2",
        "kind: duplicate, duration_s: 0.2, probability: 0.5",
    ]
    with open(file, "w") as f:
        f.write("faults:\n")
        for k in range(1, int(12 * minutes) + 1):
            f.write(f"  - {{{kinds[k % len(kinds)]}, node: {1 + k % 5}, time_s: {5 * k}}}\n")


def master(port, arguments, killed_after=None):
    """Median and 99 % of an answer [us], cycles a second, SYNCs not answered in time; after these, when those were sent
    that were answered later [s]. None of one that is killed."""
    command = [build + "/tests/socketcand_round_trip", str(port), *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        return [float(word) for word in process.communicate(timeout=killed_after)[0].split()]
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return None


def turns(drives, port, record):
    """One row per master that ended: hours, memory [KiB], the record's bytes, what it measured. How many were killed.
    When the SYNCs were sent that were answered late [s]."""
    begin, rows, killed, late_s = time.monotonic(), [], 0, []
    while time.monotonic() - begin < 60 * minutes:
        if len(rows) % 3 == 2 and killed <= len(rows) // 3:
            master(port, ["080", "386", str(SYNCS), "1000"], killed_after=3)
            killed += 1
            continue
        with socket.create_connection(("127.0.0.1", port)):  # a client that says nothing
            measured = master(port, ["080", "386", str(SYNCS), "1000"])
        assert drives.poll() is None and len(measured) >= 4, "the drives have ended, or do not answer"
        hours = (time.monotonic() - begin) / 3600
        rows.append([hours, resident_kib(drives.pid), os.path.getsize(record), *measured[:4]])
        late_s += measured[4:]
    return numpy.array(rows), killed, late_s


def main():
    with tempfile.TemporaryDirectory() as work:
        for processor in os.sched_getaffinity(0):
            threading.Thread(target=watch, args=[processor], daemon=True).start()
        [port], record = free_ports(1), work + "/run/telemetry.h5"
        faults(work + "/faults.yaml")
        drives = subprocess.Popen(
            [build + "/bin/tribotwin-hil", "drive", source + "/twin/scenarios/irb6620_hold.yaml", "--quiet"]
            + ["--can", f"socketcand://127.0.0.1:{port}/can0", "--cycle", "1", "--faults", work + "/faults.yaml"]
            + ["-o", work + "/run"]
        )
        try:
            time.sleep(2)
            master(port, ["000#0100", "181", "1", "0"])  # NMT start
            rows, killed, late_s = turns(drives, port, record)
        finally:
            drives.terminate()
            code = drives.wait(60)
        with h5py.File(record) as file, open(work + "/run/summary.json") as summary:
            seconds, simulated = file["time_s"][-1], json.load(summary)["simulated_s"]
    hours, kib, size, median, slowest, _, missed = rows.T
    never, odd = missed.sum() - len(late_s), unexplained(late_s)
    longest = max((end - begin for begin, end in standstills), default=0)
    settled = slice(len(rows) // 4, None)  # the allocator settles before
    slope = numpy.polyfit(hours[settled], kib[settled], 1)[0] / 1024 if len(rows) > 4 else 0
    print(
        f"{60 * hours[-1]:.0f} min, {len(rows)} masters, {killed} killed, {len(rows) * SYNCS} SYNCs: "
        f"{never:.0f} missed; answer {statistics.median(median):.0f} us, 99 % {statistics.median(slowest):.0f} us; "
        f"later than 100 ms: {len(late_s)}, of these {odd} while the machine ran; it stood still for over "
        f"{1000 * STANDSTILL_S:.0f} ms {len(standstills)} times, {1000 * longest:.0f} ms at most; "
        f"memory {kib[0]:.0f} to {kib[-1]:.0f} KiB, {slope:.2f} MB an hour after the first quarter; "
        f"record {(size[-1] - size[0]) / 1e6 / max(hours[-1] - hours[0], 1e-9):.0f} MB an hour, {seconds:.1f} s in it"
    )
    whole = code == 0 and abs(seconds - simulated) < 0.2
    sys.exit(bool(never > 0 or odd > 0 or not whole or (minutes >= 30 and slope > 1)))


main()
