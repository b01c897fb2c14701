"""What if, on the page of a run: its kernel steps heat as the twin does; at the run's own values it is the run, at
others it agrees with whole runs as the page says; and what cannot be predicted is not shown. Arguments: tribotwin,
tribotwin-report, thermal_steps."""
import base64, html, json, re, struct, subprocess, sys

import h5py
import numpy as np

from browser import Browser
from harness import check, content, finish, path, run, work
from pendulum import PENDULUM

twin, report, thermal_steps = sys.argv[1:4]
browser = Browser(work, check)
tab = browser.tab
CHANGES = {"day": {}, "hot": {"ambient_degC": 40}, "cold": {"ambient_degC": 5, "motion.dwell_s": 2.5}}


def made(scenario, folder, changes):
    settings = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    r = run(twin, "run", scenario, "-o", folder, "--quiet", *settings)
    check(f"{folder}: the run works", r.returncode == 0, r.stderr)


def page_of(folder):
    r = run(report, folder, "--force")
    check(f"{folder}: the page is made", r.returncode == 0 and r.stderr == "", r.stderr)
    return content(folder + "/report.html")


def record(folder, joint):
    """Time at the end of every cycle, and the temperature then."""
    with h5py.File(path(folder, "telemetry.h5")) as f:
        return f["cycle_time_s"][:], f[joint + "/cycle_temperature_degC"][:]


# The page's own module in the page, under its own policy: temperatures after every cycle, of each joint of each case.
KERNEL = """(async () => {
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const {kernel} = document.querySelector('figure[data-kernel]').dataset;
  const {instance: {exports: k}} = await WebAssembly.instantiate(bytes(kernel));
  return CASES.map(([numbers, ambient, standing, count]) => {
    if (bytes(numbers).length !== k.warm_up_size()) return null;
    new Uint8Array(k.memory.buffer, k.warm_up_numbers(), k.warm_up_size()).set(bytes(numbers));
    k.warm_up_begin(ambient, standing);
    return Array.from({length: count}, () => k.warm_up_work(1)); });
})()"""


def kernel(cases):
    return tab.value(KERNEL.replace("CASES", json.dumps(cases)))


for folder, changes in CHANGES.items():
    made("er3a_c60_day", folder, {"duration_s": 5400, **changes})
page = page_of("day")
policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page).group(1)
check(
    "the policy allows one script, its module and three.js",
    re.search(r"script-src 'sha256-\S+' 'wasm-unsafe-eval' 'sha256-\S+'$", policy),
    policy,
)
what_if = json.loads(html.unescape(re.search(r'data-what-if="([^"]*)"', page).group(1)))
joints, numbers = [j["name"] for j in what_if["more"]["joints"]], what_if["numbers"]
check("every joint is predicted", joints == [f"joint{i}" for i in range(1, 7)], joints)
caption = html.unescape(re.search(r"<figcaption>(Lines: the temperature.*?)</figcaption>", page).group(1))
module = base64.b64decode(re.search(r'data-kernel="([^"]*)"', page).group(1))
check("the module is small", len(module) < 20e3, len(module), f"{len(module)} bytes")
browser.open(path("day/report.html"))

# ---- The kernel's step is that of the twin.
LEVELS = 256
NETWORKS = {
    "first_order": ((0.118, 10944), (1, 25), (10944, 1), (0.118 / 10944, 0)),
    "second_order": ((0.1348, 0.005452, 17.694, 1020.64), (2, 25), (17.694, 1020.64), (0.1348, 0.005452)),
}
for name, (parameters, head, t_s, gains) in NETWORKS.items():
    ambient, start, power, cycle_s, count = 41.5, 12.25, 310.0, 3.374, 2000
    joint = struct.pack(f"<{11 + LEVELS}d", *head, *t_s, *gains, 0, start, cycle_s, 0, 100, *[power] * LEVELS)
    arguments = (name, head[1], ambient, start, 0.6 * power, cycle_s, count, *parameters)
    native = subprocess.run([thermal_steps, *map(str, arguments)], capture_output=True, text=True)
    expected = np.array([float(line) for line in native.stdout.split()])
    found = kernel([(base64.b64encode(joint).decode(), ambient, 24, count)])[0]
    if check(f"{name}: both step", found and len(expected) == count, native.stderr):
        worst = np.max(np.abs(np.array(found) / expected - 1))
        check(f"{name}: the kernel's step is the twin's", worst <= 1e-12, worst, f"within {worst:.1e}")
        check(f"{name}: it warms", expected[-1] > expected[0] + 5, expected[[0, -1]])

# ---- The run itself, and whole runs at other values.
times, _ = record("day", "joint1")
own = kernel([(n, 20, 0, len(times)) for n in numbers])
rms = {j: np.sqrt(np.mean((np.array(y) - record("day", j)[1]) ** 2)) for j, y in zip(joints, own)}
said = re.search(r"the run itself; they differ by ([\d.]+) K \(rms, (joint\d)\)", caption)
worst = max(rms, key=rms.get)
if check("the page says how far it is from its own run", said, caption):
    right = said.group(2) == worst and abs(float(said.group(1)) - rms[worst]) <= 0.06 * rms[worst]
    check("and that is so", right and rms[worst] < 0.1, (said.groups(), rms))
accuracy_K = float(re.search(r"robots that ship agree within ([\d.]+) K\.$", caption).group(1))
check("its accuracy is worth saying", accuracy_K <= 0.5, accuracy_K)
for folder, changes in CHANGES.items():
    time, _ = record(folder, "joint1")
    standing = 60 * (1 - times[0] / time[0])
    predicted = kernel([(n, changes.get("ambient_degC", 20), standing, len(times)) for n in numbers])
    errors, moved = [], []
    for joint, y in zip(joints, predicted):
        degC = record(folder, joint)[1]
        errors.append(np.max(np.abs(np.interp(time, times, y) - degC)[time >= times[0]]))
        moved.append(abs(degC[-1] - record("day", joint)[1][-1]))
    check(f"{folder}: as accurate as it says", max(errors) <= accuracy_K, errors, f"within {max(errors):.2f} K")
    check(f"{folder}: it is another run", folder == "day" or min(moved) > 8, moved)

# ---- Sliders move the curves of all joints, and the sentence below.
SHOWN = """(() => { const f = document.querySelector('figure[data-kernel]');
  const paths = [...f.querySelectorAll('svg.live:not(.sample) .series path')].map(p => p.getAttribute('d'));
  return {lines: paths.filter(d => d), said: f.querySelector('p[role=status]').innerText.replaceAll('\\u00a0', ' '),
    names: [...f.querySelectorAll('.sliders label span')].map(s => s.textContent),
    values: [...f.querySelectorAll('.sliders output')].map(o => o.textContent)}; })()"""
check("sliders appear", tab.until("document.querySelectorAll('[data-kernel] .sliders input').length == 2"))
before = tab.value(SHOWN)
check("they choose the room and pauses", before["names"] == ["ambient temperature", "standing still"], before["names"])
check("at first the run's own values", before["values"] == ["20.0 °C", "0 min per h"], before["values"])
SET = """(i, value) => { const range = document.querySelectorAll('.sliders input')[i];
  range.value = value; range.dispatchEvent(new Event('input')); }"""


def ends(shown):
    """Of the sentence: joint, predicted, in the run."""
    return [(j, float(a), float(b)) for j, a, b in re.findall(r"(joint\d) ([\d.]+) °C \(([\d.]+) °C\)", shown["said"])]


for joint, now, then in ends(before):
    check(f"{joint}: at first what the run had", abs(now - then) <= 0.21, before["said"])
tab.value(f"({SET})(0, 40)")
hot = tab.value(SHOWN)
check(
    "all lines move, and no other curve",
    [a != b for a, b in zip(hot["lines"], before["lines"])] == [True] * 6 + [False] * 8,
)
check("the sentence has all joints", [j for j, *_ in ends(hot)] == joints, hot["said"])
for joint, now, then in ends(hot):
    degC = [record(folder, joint)[1][-1] for folder in ("hot", "day")]
    right = abs(now - degC[0]) <= accuracy_K + 0.05 and abs(then - degC[1]) <= 0.051
    check(f"{joint}: the sentence is that of a run at 40 °C", right, (now, then, degC))
tab.value(f"({SET})(1, 30)")
paused = tab.value(SHOWN)
check("pauses cool", all(a < b for (_, a, _), (_, b, _) in zip(ends(paused), ends(hot))), paused["said"])
check("it says so", paused["values"] == ["40.0 °C", "30 min per h"], paused["values"])
tab.value("document.querySelector('figure[data-kernel] .key button').click()")
check("a joint is hidden with its circles", len(tab.value(SHOWN)["lines"]) == len(paused["lines"]) - 2)
check("no console message", not tab.console, tab.console)

# ---- What cannot be predicted is not shown, and the page says why.
COMMON = {"law": "polynomial", "f1": 0.02, "f2": 0.002, "f3": 0, "f4": 0, "a": -0.02, "T0": 20}
COMMON |= {"torque_max_nm": 0.52, "gear_ratio": 288.35, "thermal": "first_order", "R_th": 300, "kappa": 200}
WINDING = {"winding_resistance_ohm": 3.4, "torque_constant_nm_A": 0.00124}
WINDING |= {"winding_heat_capacity_J_K": 0.4, "winding_thermal_resistance_K_W": 15}
GEAR_LOSS = {"friction": "gear_loss", "mu_avg": 0.3, "mu_dif": 0, "h": 0.01}


def bench(name, drives, scenario="", ambient="ambient_degC: 25\n"):
    """The page of pendulums side by side that work for five minutes. `drives`: their keys beside the common ones."""
    instances = bodies = actuators = ""
    body, actuator = (re.search(f"<{tag}.*</{tag}>", PENDULUM, re.S).group(0) for tag in ("body", "actuator"))
    for i, (joint, keys) in enumerate(drives.items()):
        written = "".join(f'<config key="{k}" value="{v}"/>' for k, v in {**COMMON, **keys}.items() if v is not None)
        instances += f'<instance name="{joint}">{written}</instance>'
        bodies += (
            body.replace("pendulum", f"body{i}").replace("hinge", joint).replace('pos="0 0 0.2"', f'pos="0 {i} 1"')
        )
        actdim = 6 if keys is WINDING else 4 if keys is GEAR_LOSS else 3
        one = actuator.replace("servo", joint).replace("hinge", joint).replace('actdim="3"', f'actdim="{actdim}"')
        actuators += re.search("<plugin.*/>", one).group(0)
    model = re.sub("<instance.*</instance>", instances, PENDULUM, flags=re.S)
    model = model.replace(body, bodies).replace(actuator, f"<actuator>{actuators}</actuator>")
    with open(path(name + ".xml"), "w") as f:
        f.write(model)
    with open(path(name + ".yaml"), "w") as f:
        f.write(f"model: {name}.xml\nduration_s: 300\n{ambient}{scenario}")
        f.write("motion: {type: cycle, speed_rad_s: 3, waypoints: [{position_rad: -0.5}, {position_rad: 0.6}]}\n")
    made(name + ".yaml", name, {})
    return page_of(name)


def not_predicted(page):
    return html.unescape("".join(re.findall(r"Not predicted for other ambient temperatures: ([^<]*)", page)))


pendulums = {
    "plain": {},
    "wound": WINDING,
    "lossy": GEAR_LOSS,
    "held": {"thermal": "prescribed", "R_th": None, "kappa": None},
}
page = bench("mixed", pendulums, "temperature_degC: 35\nevents: [{time_s: 9, type: marker, text: nothing}]\n")
reasons = "wound: the winding of its motor heats it, too. lossy: its friction power is not that of its law."
check("joints with more heat than their law's are left out", not_predicted(page) == reasons, not_predicted(page))
shown = json.loads(html.unescape(re.search(r'data-what-if="([^"]*)"', page).group(1)))["more"]["joints"]
check("the others are predicted", [j["name"] for j in shown] == ["plain"], shown)
check("a start that is given stays", "(joints start as warm as in the run)" in page)
# A record that its model's thermal network does not explain: friction is that of the law, which heat does not change.
bench("drift", {"hinge": {"a": 0}})
for rise_K, kept in ((0.3, True), (2, False)):
    with h5py.File(path("drift/telemetry.h5"), "r+") as f:
        degC = f["hinge/cycle_temperature_degC"]
        first = degC[:] if kept else first
        degC[:] = first + np.linspace(0, rise_K, len(first))
    off = re.fullmatch(
        r"hinge: the prediction differs from the run itself by ([\d.]+) K \(rms\)\.", not_predicted(page_of("drift"))
    )
    check(f"{rise_K} K more at the end: {'predicted' if kept else 'declined'}", bool(off) != kept, off)
check("the page says by how much", off and abs(float(off.group(1)) - 2 / np.sqrt(3)) < 0.06, off)
wear = "events: [{time_s: 150, type: wear, joint: hinge, factors: {f1: 1.5}}]\n"
page = bench("worn", {"hinge": {}}, wear)
check("a run that changes is not predicted", "data-what-if" not in page and "wasm" not in page.split("<body")[0])
reason = "an event of the scenario changes the run."
check("the page says why", not_predicted(page) == reason, not_predicted(page))
page = bench("rooms", {"left": {"T_amb": 15}, "right": {"T_amb": 30}}, ambient="")
reason = "the scenario has no ambient_degC, and those of the drives differ."
check("nor are drives in different rooms", not_predicted(page) == reason, not_predicted(page))
page = bench("coarse", {"hinge": {}}, "telemetry_rate_hz: 5\n")
reason = "the record has fewer than 20 samples of a work cycle."
check("nor a record with few samples", not_predicted(page) == reason, not_predicted(page))
finish()
