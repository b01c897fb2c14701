"""`tribotwin run --web` and `tribotwin-hil drive --web`: what a viewer gets is what telemetry.h5 has, to the last bit;
addresses that are wrong or taken. Arguments: tribotwin, tribotwin-hil, source tree."""
import json, os, shutil, signal, socket, subprocess, sys, time

import h5py, yaml

from harness import check, check_refused, content, finish, path, run, work
from recorded_rows import compare_part, rows_of_h5, rows_of_mcap
from web_viewer import PATIENCE_S, compare, messages, watch, web_address

tribotwin, hil, source = sys.argv[1:]
scenario = os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")
SAY = (
    {"type": "watch", "joint": "joint2"},
    {"type": "command", "id": 1, "do": "marker", "text": "the load is on"},
    {"type": "command", "id": 2, "do": "marker", "text": "x" * 201},
    {"type": "command", "id": 4, "do": "shutdown"},
)
COMMANDS_OF_RUN = ["pause", "resume", "step", "marker", "ambient", "payload", "wear", "joint_fault", "record", "export"]
COMMANDS_OF_DRIVE = ["fault", *COMMANDS_OF_RUN]
FAULT = {"type": "command", "do": "fault", "kind": "over_temperature", "duration_s": 1, "temperature_degC": 140}
FAULTS = ("drop", "delay", "corrupt", "duplicate", "silence", "bus_off", "link_down", "over_temperature",
          "encoder_freeze", "safe_torque_off")  # fmt: skip


HAPPENS = (
    {"do": "ambient", "temperature_degC": 61.123456789012345},
    {"do": "payload", "mass_kg": 40},
    {"do": "wear", "joint": "joint2", "parameter": "Fc0", "factor": 3},
    {"do": "joint_fault", "joint": "joint3", "fault": "preload_loss", "severity": 0.25, "growth_per_h": 100},
    {"do": "marker", "text": "null"},
    {"do": "marker", "text": "- a: 'b' #\t\"c\" \u00b0"},
)
HAPPENS_NOT = (
    ({"do": "ambient", "degC": 40}, "ambient: degC: is not known; did you mean 'temperature_degC'?"),
    ({"do": "ambient"}, "ambient: temperature_degC: is missing"),
    ({"do": "ambient", "temperature_degC": 1e4}, "ambient: temperature_degC: is 10000 but must be within -100 .. 300"),
    ({"do": "ambient", "temperature_degC": 40, "time_s": 1}, "ambient: time_s: is not known"),
    ({"do": "payload", "mass_kg": -1}, "payload: mass_kg: is -1 but must be"),
    ({"do": "wear", "joint": "joint9", "parameter": "Fc0", "factor": 2}, "'joint9'"),
    ({"do": "wear", "joint": "joint2", "parameter": "Fc", "factor": 2}, "did you mean 'Fc0'?"),
    ({"do": "wear", "joint": "joint2"}, "wear: factors: is missing"),
    ({"do": "joint_fault", "joint": "joint3", "fault": "rust", "severity": 1}, "fault: 'rust' is not known"),
    ({"do": "joint_fault", "joint": "joint3", "fault": "preload_loss", "severity": 9}, "severity: is 9"),
)
KINDS = [*(3 * ["change"]), "fault", "marker", "marker"]
TYPES = ["ambient", "payload", "wear", "fault", "marker", "marker"]


def answers(texts):
    """(whether, what) was answered to each command."""
    return {d["id"]: (d["ok"], d["message"]) for d in texts.get("done", [])}


def check_commands(name, texts, commands):
    check(f"{name}: commands", texts["hello"][0]["commands"] == commands, texts["hello"][0])
    done = answers(texts)
    check(f"{name}: every command is answered", [done[i][0] for i in (1, 2, 4)] == [True, False, False], done)
    said = [done[i][1] for i in (1, 2, 4)]
    check(f"{name}: the record has a marker", said[0].endswith(" s, in the record"), said)
    check(
        f"{name}: a marker that is none", said[1] == "marker: text: is 201 bytes long, but at most 200 are kept", said
    )
    check(f"{name}: no other command", said[2] == "do must be one of: " + ", ".join(commands), said)
    markers = [e for e in texts.get("event", []) if e["kind"] == "marker"]
    check(f"{name}: the marker is shown", [m["text"] for m in markers] == ["the load is on"], markers)
    check(f"{name}: with the time of its answer", f"at {markers[0]['time_s']:.3f} s" in said[0], (markers, said))


def compare_law(name, texts):
    """With `tribotwin curve` at the same temperature, load and speeds."""
    laws = texts.get("law", [])
    check(f"{name}: a law a second", 2 <= len(laws) <= 6, len(laws))
    law = laws[-1]
    top = law["speed_rad_s"][-1]
    gear = texts["hello"][0]["joints"][1]["gear_ratio"]
    check(f"{name}: the law is that of joint2", (law["joint"], len(law["speed_rad_s"])) == ("joint2", 81), law)
    check(f"{name}: up to the top speed of the motor", top > gear > 1, (top, gear))
    curve = run(
        tribotwin, "curve", os.path.join(source, "mjcf", "irb6620.xml"), "--joint", "joint2", "--json", "--quiet",
        "--temperature", repr(law["temperature_degC"]), f"--load={law['load_norm']!r}", f"--speeds={-top!r}:{top!r}:81",
    )  # fmt: skip
    points = json.loads(curve.stdout)["points"]
    for key in ("speed_rad_s", "friction_nm"):
        expected = [abs(p[key]) if key == "friction_nm" else p[key] for p in points]
        check(f"{name}: {key} of the law is that of 'tribotwin curve'", law[key] == expected, (law[key], expected))


def serve(name, folder, command, *say, answer=None):
    """Texts and rows of a whole run or session, which end as they should."""
    with open(path(folder + ".log"), "w") as log:
        process = subprocess.Popen([*command, "-o", folder, "--web", "127.0.0.1:0"], cwd=work, stderr=log)
        try:
            texts, numbers, rows, end = watch(*web_address(path(folder + ".log")), *say, answer=answer)
            code = process.wait(PATIENCE_S)
        finally:
            process.kill()
    check(f"{name}: ends well", code == 0, content(folder + ".log"))
    check(f"{name}: says good bye", end == 1001, end)
    compare(name, folder, texts["hello"][0], numbers, rows)
    return texts, rows


def follow(name, folder, commands, *command, say=SAY):
    texts, _ = serve(name, folder, command, *say)
    compare_law(name, texts)
    check_commands(name, texts, commands)
    return texts


def test_run():
    texts = follow(
        "run", "run", COMMANDS_OF_RUN, tribotwin, "run", scenario, "--realtime", "--quiet",
        "--set", "duration_s=4", "--set", "telemetry_rate_hz=500",
    )  # fmt: skip
    check("run: hello", texts["hello"][0]["program"] == "run" and texts["hello"][0]["step_s"] == 0.001, texts["hello"])
    statuses = texts["status"]
    check("run: it records", all(s["recording"] for s in texts["status"]), texts["status"][-1])
    check("run: statuses", 5 < len(statuses) < 40 and statuses[-1]["drives"] is None, len(statuses))


def test_drive():
    faults = ({**FAULT, "id": 5, "joint": "joint5"}, {**FAULT, "id": 6}, {**FAULT, "id": 7, "kind": "wear"},
              {**FAULT, "id": 8, "joint": "joint7"}, {**FAULT, "id": 9, "joint": "joint5", "duration_s": [1]},
              {**FAULT, "id": 10, "joint": "joint5", "when": 3}, {**FAULT, "id": 11, "duration_s": 0})  # fmt: skip
    texts = follow(
        "drive", "drive", COMMANDS_OF_DRIVE, hil, "drive", scenario, "--can", "memory:web", "--realtime",
        "--duration", "4", "--record", "faults.log", "--set", "telemetry_rate_hz=500", say=SAY + faults,
    )  # fmt: skip
    check_faults(texts)
    check("drive: hello", texts["hello"][0]["program"] == "drive", texts["hello"])
    last = texts["status"][-1]
    words = [(d["node"], d["nmt"], d["state"], d["mode"], d["error_code"], d["brake"]) for d in last["drives"]]
    expected = [(i, "pre-operational", "switch on disabled", "CSP", 0, True) for i in range(1, 7)]
    expected[4] = (5, "pre-operational", "fault", "CSP", 0x4310, True)
    check("drive: words of the drives", words == expected, words)
    check("drive: its bus", last["buses"][0]["name"] == "web" and last["buses"][0]["frames_out"] >= 6, last)


def check_faults(texts):
    """What the page asked for is what the record has, and a replay repeats it."""
    check("drive: faults", texts["hello"][0]["faults"] == list(FAULTS), texts["hello"][0])
    done = answers(texts)
    check("fault: it begins", done[5][0] and done[5][1].startswith("from "), done)
    for number, says in (
        (6, "fault: joint: is needed: which drive?"),
        (7, "fault: kind: 'wear' is not known; did you mean 'delay'? Accepted: " + ", ".join(FAULTS)),
        (8, "fault: joint: 'joint7' is not known; did you mean 'joint1'? Accepted: joint1, joint2"),
        (9, "fault: duration_s: must be a number or a text"),
        (10, "fault: when: is not known"),
        (11, "fault: duration_s: is 0 but must be within"),
    ):
        check(f"fault: number {number} is refused", not done[number][0] and says in done[number][1], done[number])
    told = [(e["joint"], e["text"]) for e in texts["event"] if e["kind"] == "fault"]
    check("fault: all pages hear of it", told == [("joint5", "over_temperature for 1 s")], told)
    codes = [[d["error_code"] for d in s["drives"]] for s in texts["status"]]
    check("fault: the drive is too hot, no other", [0, 0, 0, 0, 0x4310, 0] in codes, codes)
    check("fault: no other drive", not any(any(c[:4] + c[5:]) for c in codes), codes)
    sent = [line.split()[-1] for line in content("faults.log").splitlines()]
    check("fault: its EMCY is in the record", any(s.startswith("085#1043") for s in sent), sent[:20])
    told = [(e["joint"], e["text"]) for e in texts["event"] if e["kind"] == "emcy"]
    check("fault: its EMCY is an event", told == [("joint5", "4310h the drive is too hot")], told)
    again = run(hil, "replay", scenario, "faults.log", "--fast", "-o", "again", "--set", "telemetry_rate_hz=500")
    check("fault: a replay repeats it", ": 0 differ, 0 missing, 0 added" in again.stdout, again.stdout + again.stderr)
    same_record("fault: the replay", "drive", "again")
    command = [hil, "replay", scenario, "faults.log", "--set", "telemetry_rate_hz=500"]
    texts, _ = serve("fault: a shown replay", "shown_faults", command)
    told = [(e["kind"], e["joint"], e["text"]) for e in texts["event"] if e["kind"] in ("fault", "emcy")]
    expected = [("fault", "over_temperature begins"), ("emcy", "4310h the drive is too hot"),
                ("fault", "over_temperature ends")]  # fmt: skip
    check("fault: the page of a replay tells it", told == [(k, "joint5", t) for k, t in expected], told)


def bits(folder):
    """Of every dataset of every joint."""
    found = {}
    with h5py.File(path(folder, "telemetry.h5")) as file:
        for joint in (j for j in file if isinstance(file[j], h5py.Group)):
            found |= {f"{joint}/{k}": v[:].tobytes() for k, v in file[joint].items() if isinstance(v, h5py.Dataset)}
    return found


def same_record(name, one, other):
    first, second = bits(one), bits(other)
    check(f"{name} has every joint's numbers", len(first) > 20 and first.keys() == second.keys(), list(first)[:3])
    check(f"{name} has the same bits", first == second, [k for k in first if first[k] != second.get(k)])


class Pauses:
    """What a viewer says: pause, after three statuses five rows, then on; and some nonsense."""

    def __init__(self):
        self.paused, self.stepped, self.resumed_s = [], [], None

    def __call__(self, text):
        say = lambda number, do, **more: {"type": "command", "id": number, "do": do, **more}
        if text["type"] == "hello":
            return [say(0, "resume"), say(1, "step", cycles=1), say(2, "pause")]
        if text["type"] != "status" or not text["paused"]:
            return []
        if len(self.paused) < 3:
            self.paused.append(text["simulated_s"])
            return (
                [say(3, "pause"), say(4, "step", cycles=0), say(5, "step", cycles=5)] if len(self.paused) == 3 else []
            )
        self.stepped.append(text["simulated_s"])
        if len(self.stepped) != 4:
            return []
        self.resumed_s = time.monotonic()
        return [say(6, "resume")]


def test_pause():
    """A paused run stands, goes on row by row, and is the same run in the end."""
    command = [tribotwin, "run", scenario, "--quiet", "--set", "duration_s=3", "--set", "telemetry_rate_hz=500"]
    run(*command, "-o", "alone")
    pauses = Pauses()
    texts, rows = serve("pause", "pauses", [*command, "--realtime"], answer=pauses)
    same_record("pause: the record", "alone", "pauses")
    done = answers(texts)
    expected = [False, False, True, False, False, True, True]
    check("pause: what is obeyed, what is refused", [done[i][0] for i in range(7)] == expected, done)
    check("pause: why", done[0][1] == "the run is not paused" == done[1][1].removeprefix("step: "), done)
    stood, stepped = set(pauses.paused), pauses.stepped[-1]
    check("pause: the run stands", len(stood) == 1, pauses.paused)
    between = rows[(rows[:, 0] > max(stood) - 1e-9) & (rows[:, 0] < stepped - 1e-9), 0]
    check("step: five rows", len(between) == 5 and len(set(pauses.stepped[1:])) == 1, (stood, pauses.stepped, between))
    left_s, took_s = 3 - stepped, time.monotonic() - pauses.resumed_s
    check("resume: the clock had stood", took_s > 0.9 * left_s > 1, (took_s, left_s))


def test_pause_of_a_session():
    """The same of a robot that moves with the clock: a step is a SYNC cycle, and a replay stands and goes on too."""
    pauses = Pauses()
    telemetry = ["--set", "telemetry_rate_hz=1000"]
    texts, rows = serve(
        "held", "held", [hil, "drive", scenario, "--can", "memory:held", "--realtime", "--duration", "3", "--record",
        "held_bus.log", *telemetry], answer=pauses,
    )  # fmt: skip
    done = answers(texts)
    expected = [False, False, True, False, False, True, True]
    check("held: what is obeyed, what is refused", [done[i][0] for i in range(7)] == expected, done)
    check("held: why", done[0][1] == "the robot is not paused" == done[1][1].removeprefix("step: "), done)
    stood, stepped = set(pauses.paused), set(pauses.stepped[1:])
    check("held: the robot stands", len(stood) == len(stepped) == 1, (pauses.paused, pauses.stepped))
    check("held: five cycles of 2 ms", abs(max(stepped) - max(stood) - 0.01) < 1e-9, (stood, stepped))
    check("held: rows have no gap", len(rows) > 2 and max(rows[1:, 0] - rows[:-1, 0]) < 0.0011, len(rows))
    words = [
        w for line in content("held_bus.log.session").splitlines() for w in line.split() if w[:5] in ("pause", "resum")
    ]
    check("held: it is in LOG.session", words == ["pause=0", "pause=5", "resume"], words)
    again = run(hil, "replay", scenario, "held_bus.log", "--fast", "-o", "held_again", *telemetry)
    check("held: a replay repeats it", ": 0 differ, 0 missing, 0 added" in again.stdout, again.stdout + again.stderr)
    same_record("held: the replay", "held", "held_again")


class Records:
    """Says what a page records and exports, by the time of the run."""

    def __init__(self, *plan):
        self.plan = list(plan) or [
            (0.5, {"do": "record", "on": True}),
            (0.8, {"do": "record", "on": True}),
            (1.2, {"do": "export", "minutes": 0.01, "format": "h5"}),
            (1.8, {"do": "export", "minutes": 5, "format": "mcap"}),
            (2.2, {"do": "record", "on": False}),
            (2.4, {"do": "record", "on": False}),
            (2.5, {"do": "export", "minutes": 1, "format": "h5", "name": "../h5"}),
        ]
        self.said = 0

    def __call__(self, text):
        now = []
        while text["type"] == "status" and self.said < len(self.plan) and text["simulated_s"] > self.plan[self.said][0]:
            now.append({"type": "command", "id": self.said, **self.plan[self.said][1]})
            self.said += 1
        return now


def check_files(name, folder, telemetry, texts):
    done = {d["id"]: d for d in texts["done"]}
    check(f"{name}: what is obeyed, what is refused", [done[i]["ok"] for i in range(7)] ==
          [True, False, True, True, True, False, False], done)  # fmt: skip
    named = [done[i]["file"]["name"] for i in (0, 2, 3, 4)]
    check(f"{name}: a name by the time", named[0] == named[3] and named[0].startswith("live-0000."), named)
    check(f"{name}: no name of the page's", done[6]["message"].startswith("export: name: is not known"), done[6])
    there = sorted(f for f in os.listdir(path(folder)) if "live" in f)
    check(f"{name}: these files and no other", there == sorted(named[:3]), (there, named))
    statuses = [s["file"] and s["file"]["name"] for s in texts["status"]]
    check(f"{name}: statuses say what is recorded", set(statuses) == {None, named[0]}, statuses)
    for number, read in ((4, rows_of_mcap), (3, rows_of_mcap), (2, rows_of_h5)):
        file = done[number]["file"]
        times, numbers = read(os.path.join(folder, file["name"]))
        check(f"{name}: {file['name']}: as it was answered", (len(times), times[0], times[-1], file["lost_rows"]) ==
              (file["rows"], round(1e9 * file["from_s"]), round(1e9 * file["to_s"]), 0), file)  # fmt: skip
        compare_part(f"{name}: {file['name']}", times, numbers, telemetry, 200)
    check(f"{name}: so many minutes", abs(done[2]["file"]["minutes"] - 0.01) < 1e-4 and
          0.02 < done[3]["file"]["minutes"] < 0.05, done)  # fmt: skip


def test_files():
    """What a page records and exports of a run and of a session is what telemetry.h5 has."""
    telemetry = ["--set", "telemetry_rate_hz=500"]
    texts, _ = serve("files of a run", "files", [tribotwin, "run", scenario, "--realtime", "--quiet", "--set",
                     "duration_s=3", *telemetry], answer=Records())  # fmt: skip
    check_files("files of a run", "files", "files/telemetry.h5", texts)
    os.mkdir(path("bench"))
    texts, _ = serve("files of a session", "recorded", [hil, "drive", scenario, "--can", "memory:files", "--realtime",
                     "--duration", "3", *telemetry, "--web-folder", "bench"], answer=Records())  # fmt: skip
    check_files("files of a session", "bench", "recorded/telemetry.h5", texts)
    check("files of a session: not in another folder", not any("live" in f for f in os.listdir(path("recorded"))))


def test_interrupted_recording():
    """A program that is interrupted closes what is recorded; its folder is that of the record."""
    os.mkdir(path("cut"))
    with open(path("cut.log"), "w") as log:
        process = subprocess.Popen([hil, "drive", scenario, "--can", "memory:cut", "--realtime", "--record",
                                    "cut/session.log", "--web", "127.0.0.1:0"], cwd=work, stderr=log)  # fmt: skip

        def answer(text):
            if text["type"] == "hello":
                return [{"type": "command", "id": 1, "do": "record", "on": True}]
            if text["type"] == "status" and text["simulated_s"] > 1.5:
                process.send_signal(signal.SIGINT)
            return []

        try:
            texts, _, _, end = watch(*web_address(path("cut.log")), answer=answer)
            code = process.wait(PATIENCE_S)
        finally:
            process.kill()
    check("interrupted: ends well", (code, end) == (0, 1001), content("cut.log"))
    name = texts["done"][0]["file"]["name"]
    there = sorted(os.listdir(path("cut")))
    check("interrupted: the recording is there", there == sorted([name, "session.log", "session.log.session"]), there)
    times, _ = rows_of_mcap(os.path.join("cut", name))
    check("interrupted: it is whole", len(times) > 10 and len(set(times[1:] - times[:-1])) == 1, len(times))
    check("interrupted: what came of it is told", any("recorded " + name in e["text"] for e in texts["event"]))


def test_wrong_folders():
    with open(path("a_file"), "w"):
        pass
    for folder in ("nowhere", "a_file"):
        for program, command in ((tribotwin, ["run", scenario]), (hil, ["drive", scenario, "--can", "memory:w"])):
            r = run(program, *command, "--quiet", "-o", "none", "--web", "127.0.0.1:0", "--web-folder", folder)
            check_refused(f"{command[0]} --web-folder {folder}", r, f"--web-folder {folder}: is no folder")
            check(f"{command[0]} --web-folder {folder}: nothing is written", not os.path.exists(path("none")))
    for more in ([], ["--web", "127.0.0.1:0", "--web-readonly"]):
        refused = run(tribotwin, "run", scenario, "--web-folder", ".", *more)
        check_refused(f"--web-folder {more}", refused, "--web", lines=None)


class Happens:
    """Says what happens and what cannot, a second after the start."""

    said = False

    def __call__(self, text):
        if self.said or text["type"] != "status" or text["simulated_s"] < 1:
            return []
        self.said = True
        commands = [*HAPPENS, *(c for c, _ in HAPPENS_NOT)]
        return [{"type": "command", "id": i, **c} for i, c in enumerate(commands)]


def test_events():
    """What happens by a page is in scenario.yaml: a run of that file has the same bits."""
    command = [tribotwin, "run", scenario, "--quiet", "--set", "duration_s=4"]
    texts, _ = serve("events", "events", [*command, "--realtime"], answer=Happens())
    done = answers(texts)
    for number, (_, says) in enumerate(HAPPENS_NOT, len(HAPPENS)):
        check(f"events: refused: {says}", not done[number][0] and says in done[number][1], done[number])
    good = [done[i] for i in range(len(HAPPENS))]
    check("events: obeyed", all(ok and said.endswith("s, in the record") for ok, said in good), good)
    recorded = yaml.safe_load(content("events/scenario.yaml"))["events"]
    types = [e["type"] for e in recorded]
    check("events: all are in scenario.yaml", types == TYPES, types)
    marked = [e["text"] for e in recorded[4:]]
    check("events: the markers are what was said", marked == [c["text"] for c in HAPPENS[4:]], marked)
    times = {e["time_s"] for e in recorded}
    check(
        "events: happened then", len(times) == 1 and done[0][1].startswith(f"at {min(times):.3f} s"), (times, done[0])
    )
    kinds = [e["kind"] for e in texts["event"]]
    check("events: all pages hear of them", kinds == KINDS, texts["event"])
    run(tribotwin, "run", "events/scenario.yaml", "--quiet", "-o", "repeated")
    same_record("events: a run of scenario.yaml", "events", "repeated")
    run(*command, "-o", "without")
    differing = [k for k, v in bits("without").items() if v != bits("events")[k]]
    check("events: they changed the run", len(differing) > 10, differing)


def test_events_of_a_session():
    """What happens to a drive is in LOG.session: a replay repeats it."""

    def commands(text):
        happens = [dict(c) for c in HAPPENS]
        happens[3].pop("growth_per_h")
        if text["type"] != "hello":
            return []
        return [{"type": "command", "id": i, **c} for i, c in enumerate([*happens, HAPPENS[3], HAPPENS_NOT[0][0]])]

    telemetry = ["--set", "telemetry_rate_hz=500"]
    texts, _ = serve(
        "session", "session", [hil, "drive", scenario, "--can", "memory:events", "--realtime", "--duration", "3",
        "--record", "happened.log", *telemetry], answer=commands,
    )  # fmt: skip
    done = answers(texts)
    number = len(HAPPENS)
    check("events: a session obeys them", all(done[i][0] and done[i][1].endswith("s, in the record") for i in
          range(number)), done)  # fmt: skip
    grows = "fault: growth_per_h: makes a severity of"
    check("events: a fault that grows beyond its most", not done[number][0] and grows in done[number][1], done)
    check("events: what cannot be is refused", done[number + 1] == (False, HAPPENS_NOT[0][1]), done)
    kinds = [e["kind"] for e in texts["event"] if e["kind"] != "note"]
    check("events: pages of a session hear of them", kinds == KINDS, texts["event"])
    again = run(hil, "replay", scenario, "happened.log", "--fast", "-o", "replayed", *telemetry)
    check("events: a replay repeats them", ": 0 differ, 0 missing, 0 added" in again.stdout, again.stderr)
    same_record("events: the replay", "session", "replayed")
    told = lambda texts: [
        (e["time_s"], e["kind"], e["joint"], e["text"]) for e in texts["event"] if e["kind"] != "note"
    ]
    shown, _ = serve("events: a shown replay", "shown", [hil, "replay", scenario, "happened.log", *telemetry])
    check("events: the page of a replay tells them", told(shown) == told(texts), (told(shown), told(texts)))
    recorded = content("session/scenario.yaml")
    types = [e["type"] for e in yaml.safe_load(recorded)["events"]]
    check("events: a session has them in its record", types == TYPES, types)
    check("events: and a replay too", content("replayed/scenario.yaml") == recorded, recorded)
    check_session_files()


def check_session_files():
    lines = content("happened.log.session").splitlines()
    at = next(i for i, line in enumerate(lines) if " event=" in line)
    broken = lines[:at] + [lines[at].replace("ambient", "ambience", 1)] + lines[at + 1 :]
    cut = lines[:at] + [lines[at][:-1] + "%"]
    for name, lines, says in (
        ("wrong", broken, "has an event that this scenario cannot have: ambience:"),
        ("cut", cut, "is not 'MICROSECONDS WORD...'"),
    ):
        shutil.copy(path("happened.log"), path(name + ".log"))
        with open(path(name + ".log.session"), "w") as file:
            file.write("\n".join(lines) + "\n")
        refused = run(hil, "replay", scenario, name + ".log", "--fast")
        check_refused(f"events: a session file that is {name}", refused, says)


def test_events_of_cycles():
    """A run that skips cycles could not be repeated with an event that nobody foresaw."""
    ambient = {"type": "command", "id": 1, "do": "ambient", "temperature_degC": 40}
    command = [tribotwin, "run", "irb6620_warmup", "--quiet", "--realtime", "-o", "cycles", "--web", "127.0.0.1:0"]
    with open(path("cycles.log"), "w") as log:
        process = subprocess.Popen(command, cwd=work, stderr=log)
        try:
            said = (json.loads(c) for code, c in messages(*web_address(path("cycles.log")), ambient) if code == 1)
            done = next(m for m in said if m["type"] == "done")
        finally:
            process.kill()
            process.wait()
    why = "ambient: this run skips cycles (multirate); one that knows of the event would skip others"
    check("events: not where cycles are skipped", (done["ok"], done["message"]) == (False, why), done)


def test_wrong_addresses():
    """All exit codes are 2, with the address in the message, and nothing is written."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        in_use = f"127.0.0.1:{taken.getsockname()[1]}"
        for address, says in (
            (in_use, f"--web {in_use}: Address already in use"),
            ("127.0.0.1:x", "'127.0.0.1:x': the port must be 0 to 65535"),
            ("example.org:80", "'example.org:80': the address must be a numeric one of this machine"),
            ("192.0.2.1:0", "--web 192.0.2.1:0: Cannot assign requested address"),
        ):
            for program, command in (
                (tribotwin, ["run", scenario, "--quiet"]),
                (hil, ["drive", scenario, "--can", "memory:w", "--quiet", "--record", "no.log"]),
            ):
                name = f"{command[0]} --web {address}"
                check_refused(name, run(program, *command, "-o", "none", "--web", address), says)
                check(f"{name}: nothing is written", not any(os.path.exists(path(f)) for f in ("none", "no.log")))
    check_refused("--web-readonly alone", run(tribotwin, "run", scenario, "--web-readonly"), "--web", lines=None)


def test_vary():
    with open(path("vary.yaml"), "w") as file:
        file.write(f"model: {source}/mjcf/irb6620.xml\nduration_s: 1\nvary: [{{temperature_degC: [20, 30]}}]\n")
    check_refused("vary has several runs", run(tribotwin, "run", "vary.yaml", "--web"), "shows one run")


test_wrong_addresses()
test_vary()
test_run()
test_drive()
test_pause()
test_pause_of_a_session()
test_wrong_folders()
test_files()
test_interrupted_recording()
test_events()
test_events_of_a_session()
test_events_of_cycles()
finish()
