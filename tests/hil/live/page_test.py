"""The page of `tribotwin-hil drive`, `replay` and `shadow` with --web in chromium: its numbers are those of
telemetry.h5, of the statuses and of the CSV, its faults those of the record. Arguments: tribotwin-hil, source tree."""
import csv, os, re, signal, socket, subprocess, sys, threading
from urllib.parse import unquote

from harness import check, content, finish, path, run, work
from web_viewer import PATIENCE_S, begin_web, watch

hil, source = sys.argv[1:]
sys.path[:0] = [os.path.join(source, "tests", "twin", "live", "page"), os.path.join(source, "tests", "hil")]
import devtools, shown
from session import Movement, hold_scenario

scenario = hold_scenario(source)
address, gateway = "socketcand://127.0.0.1:29663/can0", "gateway://127.0.0.1:29663/can0"
nodes = range(1, 7)
JOINTS = [f"joint{n}" for n in nodes]
rate = ("--set", "telemetry_rate_hz=500")
SYNCS = "Number(document.querySelector('.bus [data-name=syncs]').value)"
ROW = "Number(document.querySelector('#drives').dataset.row)"
EVERY = {
    "drop": {"probability": "0.5"}, "delay": {"probability": "0.5", "delay_s": "0.01"},
    "corrupt": {"probability": "0.5"}, "duplicate": {"probability": "0.5"}, "silence": {}, "bus_off": {},
    "link_down": {}, "over_temperature": {"temperature_degC": "140"}, "encoder_freeze": {}, "safe_torque_off": {},
}  # fmt: skip
ALL_DRIVES = ("drop", "delay", "corrupt", "duplicate")
WHOLE_BUS = ("bus_off", "link_down")


def listens():
    """Whether the drives' bus can be reached."""
    try:
        socket.create_connection(("127.0.0.1", int(re.search(r":(\d+)/", address)[1]))).close()
    except ConnectionRefusedError:
        return False
    return True


class Wire(threading.Thread):
    """All that another viewer gets, to the end."""

    def __init__(self, where):
        super().__init__(daemon=True)
        self.where = where
        self.start()

    def run(self):
        self.texts, self.numbers, self.rows, _ = watch(*self.where)

    def statuses(self):
        return {(s["simulated_s"], s["wall_s"]): s for s in self.texts["status"]}


def open_page(tab, name, where):
    tab.go("http://{}:{}/".format(*where))
    connected = tab.until("document.body.dataset.link === 'up'", PATIENCE_S)
    check(f"{name}: the page is connected", connected, content(name + ".log"))
    check("rows come", tab.until(f"{ROW} > 0", PATIENCE_S))


def look(tab, looks, rows=25):
    """When the tiles are that many rows further."""
    row = tab.value(ROW)
    check(f"rows come after row {row}", tab.until(f"{ROW} >= {row + rows}", PATIENCE_S))
    looks.append(tab.value(shown.LOOK))


def flat(prefix, values):
    """{"a.b": number} of nested objects."""
    out = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            out |= flat(name + ".", value)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            out[name] = value
    return out


def check_statuses(name, looks, statuses, *needed):
    """Numbers and words of drives and buses are those of the status with the same clocks; `needed`: of a bus."""
    wrong, count = [], 0
    for one in looks:
        status = statuses.get(tuple(one["status"]))
        if status is None:
            wrong.append(("no such status", one["status"]))
            continue
        for drive in status["drives"] or []:
            tile, said = one["tiles"][drive["joint"]], flat("", drive)
            got = {n: float(v) for n, v, *_ in tile["numbers"] if n in said}
            want = {n: said[n] for n in said if n.startswith("target.") or n == "following_error_rad"}
            wrong += [(drive["joint"], got, want)] if got != want else []
            wrong += [(drive["joint"], tile["state"])] if tile["state"] != drive["state"] else []
            code = f"{drive['error_code']:04X}h" if drive["error_code"] else ""
            wrong += [(drive["joint"], tile["fault"])] if code not in tile["fault"] or bool(code) != (
                "error" in tile["fault"]) else []  # fmt: skip
            count += len(want)
        for bus in status["buses"]:
            said = flat("", bus) | ({"load_percent": 100 * bus["load"]} if bus["load"] is not None else {})
            got = {n: float(v) for n, v, *_ in one["buses"][bus["name"]]}
            wrong += [(n, got[n], said.get(n)) for n in got if got[n] != said.get(n)]
            wrong += [(n, "is not shown") for n in {"syncs", "frames_in", *needed} - set(got)]
            count += len(got)
    check(f"{name}: numbers and words of drives and buses are those of the status then", not wrong, wrong[:4])
    check(f"{name}: there were some", count > 11 * len(looks), count)


def check_wrong(tab):
    """Two drives are wrong, and the page says which and why."""
    answers = [shown.press(tab, "fault", {"kind": "safe_torque_off", "joint": "joint3"}, duration_s="3600"),
               shown.press(tab, "fault", {"kind": "over_temperature", "joint": "joint5"}, duration_s="3600",
                           temperature_degC="140.25")]  # fmt: skip
    check("faults begin", [a[0] for a in answers] == ["done", "done"], answers)
    wrong = "document.querySelector('#wrong_list').innerText"
    both = f"/joint3 error 9000h/.test({wrong}) && /joint5 error 4310h/.test({wrong})"
    check("both drives are wrong on top, in words", tab.until(both, PATIENCE_S), tab.value(wrong))
    marked = tab.value("[...document.querySelectorAll('.tile.wrong')].map(t => t.id)")
    check("their tiles too, and no other", marked == ["drive_joint3", "drive_joint5"], marked)
    emcy = "[...document.querySelectorAll('#event_list li')].map(l => l.innerText).filter(t => t.includes('EMCY'))"
    check("with their EMCYs among the events", tab.until(f"{emcy}.length >= 2", PATIENCE_S), tab.value(emcy))
    said = {re.search(r"joint\d: \w+", e)[0] for e in tab.value(emcy)}
    check("which say what they are", said == {"joint3: 9000h", "joint5: 4310h"}, tab.value(emcy))


def hold(tab):
    """The robot stands, goes on by as many cycles as were asked for, and stands, while SYNCs come on."""
    wall = "Number(document.querySelector('#wall data').value)"
    answer = shown.press(tab, "pause")
    check("pause is obeyed", answer[0] == "done", answer)
    stands = "document.querySelector('#run_state').textContent.startsWith('paused')"
    check("the page says so", tab.until(stands, PATIENCE_S))
    later = lambda: tab.until(f"{wall} > {tab.value(wall) + 0.5}", PATIENCE_S)
    later()
    row, syncs = tab.value(ROW), tab.value(SYNCS)
    later()
    check("the robot stands", tab.value(ROW) == row, (row, tab.value(ROW)))
    check("while SYNCs come", tab.until(f"{SYNCS} > {syncs}", PATIENCE_S))
    answer = shown.press(tab, "step", cycles="5")
    check("step is obeyed", answer[0] == "done", answer)
    rows = 5 * 4 * 500 // 1000  # of 4 ms each, 500 rows a second
    check("it goes on by five cycles", tab.until(f"{ROW} === {row + rows}", PATIENCE_S), (row, tab.value(ROW)))
    later()
    check("and no further", tab.value(ROW) == row + rows, (row, tab.value(ROW)))
    answer = shown.press(tab, "resume")
    check("resume is obeyed", answer[0] == "done" and tab.until(f"{ROW} > {row + 50}", PATIENCE_S), answer)


def press_every_fault(tab):
    """All kinds, on joint 6 where they are of a drive, for a moment."""
    kinds = tab.value(
        "[...document.querySelectorAll('form[data-do=fault] select[name=kind] option')].map(o => o.value)"
    )
    check("the page has every kind of fault", kinds == list(EVERY), kinds)
    for kind, typed in EVERY.items():
        choose = {"kind": kind} | ({} if kind in WHOLE_BUS else {"joint": "" if kind in ALL_DRIVES else "joint6"})
        answer = shown.press(tab, "fault", choose, duration_s="0.012", **typed)
        check(f"{kind} begins", answer[0] == "done", answer)
        # It lasts for simulated time, which stands while the master waits for what the fault took away.
        row = tab.value(ROW)
        check(f"{kind} is over", tab.until(f"{ROW} > {row} + 50", PATIENCE_S))


def check_session_file(tab):
    """Faults of drives and events are in LOG.session; what the others did to the frames is in the log."""
    text = content("moved.log.session")
    faults = [(k, d, s) for k, d, s in re.findall(r" (\w+)=\d+:(\d):(\S+)", text) if k in EVERY]
    begun = [f for f in faults if f[2] != "off"]
    want = [("safe_torque_off", "3", "on"), ("over_temperature", "5", "140.25"), ("over_temperature", "6", "140"),
            ("encoder_freeze", "6", "on"), ("safe_torque_off", "6", "on")]  # fmt: skip
    check("LOG.session has the faults of the drives", begun == want, faults)
    events = [unquote(e) for e in re.findall(r" event=(\S+)", text)]
    missing = [w for w in ("text: here", "-12.5", "7.25", "Fc0: 1.5", "backlash") if not any(w in e for e in events)]
    check("and what happened to the robot", len(events) == 5 and not missing, (events, missing))
    listed = tab.value("[...document.querySelectorAll('#event_list li')].reverse().map(l => l.innerText)")
    kinds = [k for line in listed for k in re.findall(r"(\w+) for 0\.012 s", line)]
    check("the page lists every fault", kinds == list(EVERY), listed)
    again = run(hil, "replay", scenario, "moved.log", "--fast", *rate, "-o", "again", "--cycle", "4")
    check("a replay repeats all", ": 0 differ, 0 missing, 0 added" in again.stdout, again.stdout + again.stderr)


def test_drive(tab):
    process, where = begin_web(hil, "drive", "drive", scenario, "--can", address, "--quiet", "--record",
                               "moved.log", "-o", "drive", "--cycle", "4", *rate)  # fmt: skip
    movement, wire, looks = Movement(address, nodes), Wire(where), []
    try:
        movement.start()
        open_page(tab, "drive", where)
        check("the drives are enabled", movement.enabled.wait(PATIENCE_S))
        enabled = "[...document.querySelectorAll('.tile .state')].every(s => s.textContent === 'operation enabled')"
        check("the page says so", tab.until(enabled, PATIENCE_S))
        for _ in range(4):
            look(tab, looks)
        hold(tab)
        check_wrong(tab)
        others = [shown.press(tab, "marker", text="here"), shown.press(tab, "ambient", temperature_degC="-12.5"),
                  shown.press(tab, "payload", mass_kg="7.25"),
                  shown.press(tab, "wear", {"joint": "joint4", "parameter": "Fc0"}, factor="1.5"),
                  shown.press(tab, "joint_fault", {"joint": "joint2", "fault": "backlash"}, severity="0.002",
                              growth_per_h="0")]  # fmt: skip
        check("what happens to the robot does", [o[0] for o in others] == 5 * ["done"], others)
        for _ in range(4):
            look(tab, looks)
        press_every_fault(tab)
        movement.going = False
        movement.join(30)
        process.send_signal(signal.SIGTERM)
        check("the session ends in order", process.wait(PATIENCE_S) == 0, content("drive.log"))
    finally:
        process.kill()
    wire.join(PATIENCE_S)
    shown.check_looks("drive", shown.Record("drive"), looks, 60)
    check_statuses("drive", looks, wire.statuses(), "sync_to_tpdo_us.p99", "sync_period_us.max")
    check_session_file(tab)


def test_replay(tab):
    process, where = begin_web(hil, "replay", "replay", scenario, "moved.log", *rate, "-o", "replay", "--cycle", "4")
    wire, looks = Wire(where), []
    try:
        open_page(tab, "replay", where)
        for _ in range(5):
            look(tab, looks)
        answer = shown.press(tab, "marker", text="seen again")
        check("replay: a marker is shown and not kept", answer[0] == "done" and "no record has it" in answer[1], answer)
        forms = tab.value("[...document.querySelectorAll('#controls form')].map(f => f.dataset.do)")
        check("replay: nothing else can be done", forms == ["marker", "record", "export"], forms)
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)
    finally:
        process.kill()
    wire.join(PATIENCE_S)
    shown.check_looks("replay", shown.Record("replay"), looks, 60)
    check_statuses("replay", looks, wire.statuses())


def test_shadow(tab):
    """Beside drives that move: what is shown is the line of the CSV of the same row, in its digits."""
    drive = subprocess.Popen([hil, "drive", scenario, "--can", address, "--quiet", "--cycle", "4", *rate], cwd=work)
    devtools.Browser.until(listens, PATIENCE_S)
    process, where = begin_web(hil, "shadow", "shadow", scenario, "--can", gateway, "--csv", "shadow.csv",
                               "--limit", "1e-3", "--limit-time", "0.1", "--joint", "joint2", "--lockstep", "--cycle",
                               "4")  # fmt: skip
    movement, wire, looks = Movement(address, nodes), Wire(where), []
    try:
        movement.start()
        open_page(tab, "shadow", where)
        exceeded = "document.querySelector('#wrong_list').innerText.includes('joint2 the residual has exceeded')"
        check("shadow: an exceeded residual is what is wrong", tab.until(exceeded, PATIENCE_S))
        for _ in range(5):
            look(tab, looks)
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)
        movement.going = False
        movement.join(30)
        drive.send_signal(signal.SIGTERM)
        drive.wait(PATIENCE_S)
    finally:
        process.kill()
        drive.kill()
    wire.join(PATIENCE_S)
    with open(path("shadow.csv")) as file:
        head, *written = list(csv.reader(file))
    digits = lambda name: ".6f" if name == "time_s" else ".3f" if name.endswith("degC") else ".6g"
    wrong, count = [], 0
    for one in looks:
        for joint, tile in one["tiles"].items():
            for name, value, *_ in tile["numbers"]:
                column = f"{joint}.{name}"
                if column not in head:
                    continue
                count += 1
                said = written[one["row"]][head.index(column)]
                if format(float(value), digits(column)) != said:
                    wrong.append((one["row"], column, value, said))
    check("shadow: every number shown is that of the CSV", not wrong, wrong[:5])
    check("shadow: there were some", count > 5 * 6 * 3, count)
    statuses = wire.statuses()
    limits = [(dict((n, float(v)) for n, v, *_ in o["tiles"]["joint2"]["numbers"])["residual.limit_nm"],
               statuses[tuple(o["status"])]["residual"][1]["limit_nm"]) for o in looks]  # fmt: skip
    check("shadow: the limit is that of the status", set(limits) == {(1e-3, 1e-3)}, limits)
    shown_names = {n for o in looks for n, *_ in o["tiles"]["joint2"]["numbers"]}
    check("shadow: what is measured, predicted and left is shown",
          {"measured_nm", "predicted_nm", "residual_nm"} <= shown_names, shown_names)  # fmt: skip


def main():
    browser = devtools.Browser(work)
    try:
        tab = browser.tab()
        tab.window(1440, 900)
        test_drive(tab)
        test_replay(tab)
        test_shadow(tab)
        gone = re.compile(r"ws://127\.0\.0\.1:\d+/live")
        lines = [line for line in tab.console if not gone.search(line)]
        check("no console message but for lost connections", not lines, lines)
    finally:
        browser.close()
    finish()


main()
