"""`tribotwin-hil replay --web` and `shadow --web`: what a viewer gets is what telemetry.h5 of the replay and the CSV of
the shadow have. Arguments: tribotwin-hil, source tree."""
import csv, os, signal, subprocess, sys, time

import can
import h5py
import numpy

from harness import check, check_refused, content, finish, path, run, work
from session import Movement, hold_scenario
from web_viewer import PATIENCE_S, begin_web, compare, watch

hil, source = sys.argv[1:]
scenario = hold_scenario(source)
address, gateway = "socketcand://127.0.0.1:29661/can0", "gateway://127.0.0.1:29661/can0"
nodes = range(1, 7)
rate = ("--set", "telemetry_rate_hz=500")
MARK = ({"type": "watch", "joint": "joint1"}, {"type": "command", "id": 1, "do": "marker", "text": "here"},
        {"type": "command", "id": 2, "do": "pause"})  # fmt: skip


def check_answers(name, texts):
    hello = texts["hello"][0]
    check(f"{name}: commands", (hello["program"], hello["commands"]) == (name, ["marker", "record", "export"]), hello)
    done = {d["id"]: (d["ok"], d["message"]) for d in texts.get("done", [])}
    check(f"{name}: it marks", done[1][0] and done[1][1].endswith("no record has it"), done)
    check(f"{name}: no other command", done[2] == (False, "do must be one of: marker, record, export"), done)


def test_replay():
    """The record of the last drive, at its own speed and as fast as possible."""
    process, where = begin_web(
        hil, "replay", "replay", scenario, "moved.log", *rate, "-o", "replay", "--force", "--cycle", "4"
    )
    texts, numbers, rows, end = watch(*where, *MARK)
    code = process.wait(PATIENCE_S)
    check("replay: ends well, and says good bye", (code, end) == (0, 1001), (end, content("replay.log")))
    compare("replay", "replay", texts["hello"][0], numbers, rows)
    check_answers("replay", texts)
    last = texts["status"][-1]
    check("replay: its bus", (last["buses"][0]["name"], last["buses"][0]["syncs"] > 200) == ("can0", True), last)
    states = {d["state"] for s in texts["status"] for d in s["drives"]}
    check("replay: the drives get their words from the record", "operation enabled" in states, states)
    check_targets(texts["hello"][0], texts["status"], rows)
    shown = content("replay.out")
    check("replay: no difference", ": 0 differ, 0 missing, 0 added" in shown, shown)
    wall, simulated = last["wall_s"], last["simulated_s"]
    check("replay: it keeps the time of the record", wall > 0.9 * simulated, (wall, simulated))
    fast = run(hil, "replay", scenario, "moved.log", *rate, "--fast", "--web", "127.0.0.1:0", "--cycle", "4")
    check("replay --fast: waits for no page", fast.returncode == 0 and "web: http://" in fast.stderr, fast.stderr)


def check_targets(hello, statuses, rows):
    """The target of a moving joint, and its distance from where the robot is in the row of that time."""
    columns = [(c["joint"], c["name"]) for c in hello["columns"]]
    position = {round(1e6 * row[0]): row[columns.index(("joint2", "position_rad"))] for row in rows}
    moving = [
        (s["drives"][1]["target"], s["drives"][1]["following_error_rad"], position[round(1e6 * s["simulated_s"])])
        for s in statuses
        if s["drives"][1]["state"] == "operation enabled" and round(1e6 * s["simulated_s"]) in position
    ]
    targets = [target["position_rad"] for target, _, _ in moving]
    check("replay: the target moves", len(targets) > 3 and max(targets) - min(targets) > 1e-3, targets)
    wrong = [m for m in moving if m[1] != m[0]["position_rad"] - m[2] or m[0]["torque_nm"] is not None]
    check("replay: the following error is that of the row", not wrong, wrong[:3])
    begun_s = statuses[0]["simulated_s"]
    early = [d["reaches_limit"] for s in statuses if s["simulated_s"] < begun_s + 4.9 for d in s["drives"]]
    late = [d["reaches_limit"] for s in statuses if s["simulated_s"] > begun_s + 5.6 for d in s["drives"]]
    check("replay: the heat of a moment says nothing of a limit", early and set(early) == {None}, early)
    check("replay: that of five seconds does", late and None not in late, late)
    off = [s["drives"][1] for s in statuses if s["drives"][1]["state"] == "switch on disabled"]
    check("replay: no power, no target", all(d["target"]["position_rad"] is None for d in off), off)


class Held:
    """What a viewer says to drives in lockstep: pause when they move, after a while five cycles, then on."""

    def __init__(self, movement):
        self.movement, self.said, self.paused, self.stepped, self.cycles = movement, False, [], [], []

    def __call__(self, text):
        say = lambda number, do, **more: {"type": "command", "id": number, "do": do, **more}
        if text["type"] != "status" or not self.movement.enabled.is_set() or self.movement.k < 100:
            return []
        if not self.said:
            self.said = True
            return [say(1, "pause")]
        if not text["paused"]:
            return []
        self.cycles.append(text["buses"][0]["syncs"])
        if len(self.paused) < 4:
            self.paused.append(text["simulated_s"])
            return [say(2, "step", cycles=5)] if len(self.paused) == 4 else []
        self.stepped.append(text["simulated_s"])
        return [say(3, "resume")] if len(self.stepped) == 5 else []


def test_drive_is_held():
    """In lockstep: the drives answer each SYNC, the robot stands, and a replay has the same frames and numbers."""
    process, where = begin_web(hil, "held", "drive", scenario, "--can", address, "--quiet", "--record",
                               "held_bus.log", "-o", "held", "--cycle", "4", *rate, "--duration", "4")  # fmt: skip
    movement = Movement(address, nodes, odd_sync=50)
    movement.start()
    held = Held(movement)
    texts, numbers, rows, end = watch(*where, answer=held)
    code = process.wait(PATIENCE_S)
    movement.going = False
    movement.join(20)
    check("held: ends well, and says good bye", (code, end) == (0, 1001), (code, end, content("held.log")))
    compare("held", "held", texts["hello"][0], numbers, rows)
    done = {d["id"]: d["ok"] for d in texts["done"]}
    check("held: obeyed", done == {1: True, 2: True, 3: True}, texts["done"])
    stood, stepped = set(held.paused), set(held.stepped[2:])
    check("held: the robot stands, and moves five cycles of 4 ms", len(stood) == len(stepped) == 1 and
          abs(max(stepped) - max(stood) - 0.02) < 1e-9, (held.paused, held.stepped))  # fmt: skip
    check("held: SYNCs went on", held.cycles[-1] - held.cycles[0] > 100, held.cycles)
    check("held: the drives answered all but the one after the end", movement.unanswered <= 1, movement.unanswered)
    told = [(e["joint"], e["text"][:5]) for e in texts["event"] if e["kind"] == "emcy"]
    expected = [(f"joint{n}", text) for n in nodes for text in ("8240h", "no er")]
    check("held: errors of a moment are events", sorted(told) == sorted(expected), told)
    again = run(hil, "replay", scenario, "held_bus.log", *rate, "--fast", "-o", "held_again", "--cycle", "4")
    check("held: a replay repeats it", ": 0 differ, 0 missing, 0 added" in again.stdout, again.stdout + again.stderr)
    with h5py.File(path("held", "telemetry.h5")) as one, h5py.File(path("held_again", "telemetry.h5")) as other:
        differing = [
            f"{j}/{c}"
            for j in (f"joint{n}" for n in nodes)
            for c in one[j]
            if one[j][c][:].tobytes() != other[j][c][:].tobytes()
        ]
    check("held: the replay has the same bits", not differing, differing)


def test_shadow():
    """Beside a drive that moves: all that the page gets is what the CSV says, in its digits."""
    drive = subprocess.Popen([hil, "drive", scenario, "--can", address, "--quiet", "--record", "moved.log",
                              "--cycle", "4", *rate], cwd=work)  # fmt: skip
    time.sleep(1)
    process, where = begin_web(hil, "shadow", "shadow", scenario, "--can", gateway, "--csv", "shadow.csv",
                               "--limit", "1e-3", "--limit-time", "0.1", "--joint", "joint2", "--lockstep", "--cycle",
                               "4", "--duration", "8")  # fmt: skip
    movement = Movement(address, nodes)  # after the shadow, which must hear how the torque is mapped
    movement.start()
    texts, numbers, rows, end = watch(*where, *MARK)
    code = process.wait(PATIENCE_S)
    movement.going = False
    movement.join(20)
    check("shadow: the drives were enabled", movement.enabled.is_set())
    drive.send_signal(signal.SIGTERM)
    check("the drive ends in order", drive.wait(20) == 0)
    check("shadow: the limit is exceeded, and it says good bye", (code, end) == (3, 1001), content("shadow.log"))
    check_answers("shadow", texts)
    compare_with_csv(texts["hello"][0], numbers, rows)
    check("shadow: it knows no poses, so it shows no robot", texts["hello"][0]["bodies"] == 0, texts["hello"][0])
    last = texts["status"][-1]
    residual = {r["joint"]: r for r in last["residual"]}
    limits = [residual[f"joint{n}"]["limit_nm"] for n in nodes]
    check("shadow: the limit is that of joint2", limits == [None, 1e-3, None, None, None, None], residual)
    check("shadow: it was exceeded there", [r["exceeded"] for r in last["residual"]] == [n == 2 for n in nodes])
    columns = [c["name"] for c in texts["hello"][0]["columns"]]
    now = [None if numpy.isnan(v) else v for c, v in zip(columns, rows[-1]) if c == "residual_nm"]
    check("shadow: the status has the residuals of the last row", [r["residual_nm"] for r in last["residual"]] == now)
    notes = [e["text"] for e in texts.get("event", []) if e["kind"] == "note"]
    check("shadow: what it says is an event", any("joint2: residual" in n for n in notes), notes)
    check("shadow: its bus", last["buses"][0]["syncs"] > 200 and last["drives"] is None, last)


def compare_with_csv(hello, numbers, rows):
    with open(path("shadow.csv")) as file:
        head, *written = list(csv.reader(file))
    check("shadow: the last row came", numbers[-1] == len(written) - 1, (numbers[-1], len(written)))
    check("shadow: most rows came, without a gap", len(numbers) > 0.5 * len(written) and
          list(numbers) == list(range(numbers[0], numbers[-1] + 1)), (len(numbers), len(written)))  # fmt: skip
    names = [f"{c['joint']}.{c['name']}" if c["joint"] else c["name"] for c in hello["columns"]]
    digits = lambda name: ".6f" if name == "time_s" else ".3f" if name.endswith("degC") else ".6g"
    wrong = [
        (n, name, said, row[names.index(name)])
        for n, row in zip(numbers, rows)
        for name, said in zip(head, written[n])
        if format(row[names.index(name)], digits(name)) != said
    ]
    check("shadow: every number is that of the CSV", not wrong, wrong[:5])
    judged = sum(said != "nan" for line in written for name, said in zip(head, line) if name == "joint2.residual_nm")
    check("shadow: most cycles of joint2 are judged", judged > 0.5 * len(written), (judged, len(written)))


def test_wrong():
    for command in (["replay", scenario, "moved.log"], ["shadow", scenario, "--can", "log:moved.log"]):
        r = run(hil, *command, "-o", "none", "--web", "127.0.0.1:x")
        check_refused(f"{command[0]} --web 127.0.0.1:x", r, "the port must be 0 to 65535")
        check(f"{command[0]}: nothing is written", not os.path.exists(path("none")))
        r = run(hil, *command, "--web-readonly")
        check_refused(f"{command[0]} --web-readonly alone", r, "--web", lines=None)


test_drive_is_held()
test_shadow()
test_replay()
test_wrong()
finish()
