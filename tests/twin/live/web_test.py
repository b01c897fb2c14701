"""`tribotwin run --web` and `tribotwin-hil drive --web`: what a viewer gets is what telemetry.h5 has, to the last bit;
addresses that are wrong or taken. Arguments: tribotwin, tribotwin-hil, source tree."""
import json, os, socket, subprocess, sys

from harness import check, check_refused, finish, path, run, work
from web_viewer import PATIENCE_S, compare, watch, web_address

tribotwin, hil, source = sys.argv[1:]
scenario = os.path.join(source, "twin", "scenarios", "irb6620_hold.yaml")
SAY = (
    {"type": "watch", "joint": "joint2"},
    {"type": "command", "id": 1, "do": "marker", "text": "the load is on"},
    {"type": "command", "id": 2, "do": "marker", "text": "x" * 201},
    {"type": "command", "id": 3, "do": "marker", "text": 5},
    {"type": "command", "id": 4, "do": "pause"},
)


def check_commands(name, texts):
    check(f"{name}: commands", texts["hello"][0]["commands"] == ["marker"], texts["hello"][0])
    done = {d["id"]: d for d in texts.get("done", [])}
    said = [done[i]["message"] for i in sorted(done)]
    check(f"{name}: every command is answered", [done[i]["ok"] for i in sorted(done)] == [True] + [False] * 3, done)
    check(f"{name}: a marker is not in a record", said[0].endswith("shown only, no record has it"), said)
    check(f"{name}: a marker that is none", said[1] == said[2] == "marker: text must be 1 to 200 bytes", said)
    check(f"{name}: no other command", said[3] == "do must be one of: marker", said)
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


def follow(name, folder, *command):
    with open(path(folder + ".log"), "w") as log:
        process = subprocess.Popen([*command, "-o", folder, "--web", "127.0.0.1:0"], cwd=work, stderr=log)
        try:
            texts, numbers, rows, end = watch(*web_address(path(folder + ".log")), *SAY)
            code = process.wait(PATIENCE_S)
        finally:
            process.kill()
    said = open(path(folder + ".log")).read()
    check(f"{name}: ends well", code == 0, said)
    check(f"{name}: says good bye", end == 1001, end)
    compare(name, folder, texts["hello"][0], numbers, rows)
    compare_law(name, texts)
    check_commands(name, texts)
    return texts


def test_run():
    texts = follow(
        "run", "run", tribotwin, "run", scenario, "--realtime", "--quiet", "--set", "duration_s=4", "--set",
        "telemetry_rate_hz=500",
    )  # fmt: skip
    check("run: hello", texts["hello"][0]["program"] == "run" and texts["hello"][0]["step_s"] == 0.001, texts["hello"])
    statuses = texts["status"]
    check("run: it records", all(s["recording"] for s in texts["status"]), texts["status"][-1])
    check("run: statuses", 5 < len(statuses) < 40 and statuses[-1]["drives"] is None, len(statuses))


def test_drive():
    texts = follow("drive", "drive", hil, "drive", scenario, "--can", "memory:web", "--realtime", "--duration", "4")
    check("drive: hello", texts["hello"][0]["program"] == "drive", texts["hello"])
    last = texts["status"][-1]
    words = [(d["node"], d["nmt"], d["state"], d["mode"], d["error_code"], d["brake"]) for d in last["drives"]]
    expected = [(i, "pre-operational", "switch on disabled", "CSP", 0, True) for i in range(1, 7)]
    check("drive: words of the drives", words == expected, words)
    check("drive: its bus", last["buses"][0]["name"] == "web" and last["buses"][0]["frames_out"] >= 6, last)


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
finish()
