"""What the script of a page adds: values under the pointer, one cursor in time, zoom, keys that hide, tables that sort,
the robot in 3-D; and the policy that lets no other script run. Arguments: tribotwin, tribotwin-report, source tree."""
import base64, hashlib, json, os, re, sys

import h5py
import numpy as np

from browser import Browser
from harness import check, content, finish, path, run, work
from pendulum import PENDULUM
from robot_checks import check_robot, unpacked, with_many_triangles

twin, report, source = sys.argv[1:4]
browser = Browser(work, check)
tab = browser.tab

run(twin, "run", "irb6620_warmup", "-o", "warmup", "--set", "duration_s=1200", "--quiet")
r = run(report, "warmup")
check("report of a run", r.returncode == 0, r.stderr)
page = content("warmup/report.html")
browser.open(path("warmup/report.html"))

# Only the page's own script runs.
script = re.search(r"<script>(.*?)</script>", page, re.S).group(1)
digest, three = (
    base64.b64encode(hashlib.sha256(text).digest()).decode() for text in (script.encode(), unpacked(page, "three"))
)
policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page).group(1)
check(
    "the policy allows this script, its module and three.js alone",
    policy.endswith(f"script-src 'sha256-{digest}' 'wasm-unsafe-eval' 'sha256-{three}'"),
    policy,
)
check("the warm-up's page is small", os.path.getsize(path("warmup/report.html")) < 3e6)
opened_ms = tab.value("performance.getEntriesByType('navigation')[0].loadEventEnd")
print(f"the page is open after {opened_ms:.0f} ms")
tab.value("document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.other = 1'}))")
check("no other script runs", tab.value("window.other === undefined") and len(tab.console) == 1, tab.console)
tab.console.clear()

AT = """(share, down, kind = 'pointermove', chart = 0) => {
  const svg = document.querySelectorAll('svg.live:not(.sample)')[chart], grid = svg.querySelector('.axis').getBBox();
  const box = svg.getBoundingClientRect(), scale = box.width / svg.viewBox.baseVal.width;
  svg.dispatchEvent(new PointerEvent(kind, {bubbles: true, button: 0, pointerId: 1, pointerType: 'mouse',
    clientX: box.x + scale * (grid.x + share * grid.width), clientY: box.y + scale * (grid.y + down * grid.height)}));
}"""
tab.value("SVGElement.prototype.setPointerCapture = () => {}")


def pointer(*arguments):
    tab.value(f"({AT})({', '.join(map(repr, arguments))})")


def tips():
    return tab.value("[...document.querySelectorAll('.tip')].filter(t => !t.hidden).map(t => t.innerText)")


# Values under the pointer are those of the record, in all figures over time at once.
with h5py.File(path("warmup/telemetry.h5")) as f:
    time, degC = f["cycle_time_s"][:], f["joint2/cycle_temperature_degC"][:]
    power = f["joint2/cycle_friction_power_W"][:]
pointer(0.5, 0.5)
shown = tips()
check("figures over the run have the cursor, that of one cycle has not", len(shown) == 3, shown)
at_s = 60 * float(re.search(r"time ([\d.]+) min", shown[0]).group(1))
k = int(np.argmin(abs(time - at_s)))
values = [float(re.search(r"joint2 ([\d.]+) " + unit, tip).group(1)) for unit, tip in zip(("°C", "W", "°C"), shown)]
check("the cursor is in the middle of the run", abs(at_s - 600) < 10, at_s)
near = slice(max(0, k - 3), k + 4)  # curves of many samples have minima and maxima of stretches
check(
    "its temperature is the record's",
    degC[near].min() - 2e-3 <= values[0] <= degC[near].max() + 2e-3,
    (values, degC[k]),
)
check("its power is the record's", power[near].min() - 0.1 <= values[1] <= power[near].max() + 0.1, (values, power[k]))
check("so is the temperature that is predicted", abs(values[2] - values[0]) < 0.05, values)
minutes = [float(tip.split()[1]) for tip in shown]  # a curve alone says that of its point
check("all figures have the same time", minutes[0] == minutes[1] and abs(minutes[2] - minutes[0]) < 0.2, shown)

# Dragging looks nearer, at the same time in both; Escape shows all again.
MARKS = """[...document.querySelectorAll('svg.live:not(.sample)')].slice(0, 2).map(svg =>
  [...svg.querySelectorAll('text.middle')].map(t => t.textContent).filter(t => /^[\\d.]+$/.test(t)).map(Number))"""
before = tab.value(MARKS)
for share, kind in ((0.25, "pointerdown"), (0.5, "pointermove"), (0.5, "pointerup")):
    pointer(share, 0.5, kind)
after = tab.value(MARKS)
check("before, the whole run", all(marks[0] == 0 and marks[-1] >= 15 for marks in before), before)
check("dragging looks at 5 to 10 min in both", all(4.9 <= min(m) and max(m) <= 10.1 for m in after), after)
tab.value("document.querySelector('svg.live:not(.sample)').focus()")
tab.key("Escape")
check("Escape shows all", tab.value(MARKS) == before, tab.value(MARKS))

# The key hides a curve.
count = "document.querySelector('svg.live:not(.sample) .series').children.length"
curves = tab.value(count)
tab.value("document.querySelectorAll('.key button')[1].click()")
check("a click on the key hides a curve", tab.value(count) == curves - 1, (curves, tab.value(count)))
pointer(0.5, 0.5)
check("what is hidden has no value", "joint2" not in tips()[0] and "joint1" in tips()[0], tips())
tab.value("document.querySelectorAll('.key button')[1].click()")
check("and shows it again", tab.value(count) == curves)

# Law curves: the nearest point, with units.
tab.value("document.querySelector('svg.live:not(.sample)').dispatchEvent(new PointerEvent('pointerleave'))")
found = []
for down in np.linspace(0.05, 0.95, 19):
    pointer(0.5, float(down), "pointermove", 4)
    found += tips()
check(
    "a point of a law has its speed with unit", any(re.match(r"motor speed [\d.]+ rad/s", tip) for tip in found), found
)

# Tables sort, upwards and downwards.
COLUMN = """(() => { const table = [...document.querySelectorAll('table')].find(t => /maximum \\[/.test(t.innerText));
  const heads = [...table.querySelectorAll('thead th')], k = heads.findIndex(h => h.innerText.startsWith('maximum ['));
  if (CLICK) heads[k].click();
  return [...table.tBodies[0].rows].map(r => r.cells[k].innerText); })()"""
unsorted = tab.value(COLUMN.replace("CLICK", "false"))
up, down = (tab.value(COLUMN.replace("CLICK", "true")) for _ in range(2))
numbers = sorted(map(float, unsorted))
check("joints are not sorted by temperature at first", list(map(float, unsorted)) != numbers, unsorted)
check(
    "a click sorts upwards, another downwards",
    list(map(float, up)) == numbers and list(map(float, down)) == numbers[::-1],
    (up, down),
)

# What is sorted as a number, as a date, and as a text.
SORTED = """(texts) => { const table = [...document.querySelectorAll('table')].find(t => t.tBodies[0].rows.length >= 6);
  const rows = [...table.tBodies[0].rows];
  rows.forEach((row, i) => { if (i < texts.length) row.cells[0].textContent = texts[i]; else row.remove(); });
  const head = table.querySelectorAll('thead th')[0];
  do head.click(); while (head.getAttribute('aria-sort') !== 'ascending');
  const sorted = [...table.tBodies[0].rows].map(r => r.cells[0].textContent);
  table.tBodies[0].append(...rows);
  return sorted; }"""
for what, upwards in (
    ("dates", ["2025-12-31", "2026-02-28 23:59 UTC", "2026-03-01T00:00:30Z", "2026-03-15", "2026-11-02", "–"]),
    ("names that begin with a number", ["77-2", "6620-2", "6620-104417", "6620b", "10000-1", "10000-11"]),
    ("numbers", ["-1.30·10⁻²", "10⁻⁵", "less than 0.1 %", "9 Nm", "1e3", "1 h 00 min 00 s"]),
    ("shares", ["0 %", "less than 0.1 %", "2.0 %", "99.7 %", "more than 99.9 %", "100 %"]),
    ("numbers with their error", ["± 0.5", "2.0 ± 0.1", "10 ± 3", "<20", "30 (20 … 40)", "100 %"]),
):
    found = tab.value(f"({SORTED})({json.dumps(upwards[::-1])})")
    check(f"{what} are sorted upwards", found == upwards, found)

# Long numbers beside a colour bar leave room for its label; small ones have a typeset power of ten.
with open(path("over.xml"), "w") as f:
    f.write(PENDULUM.replace('"torque_max_nm" value="0.52"', '"torque_max_nm" value="2e-9"'))
with open(path("over.yaml"), "w") as f:
    f.write("model: over.xml\nduration_s: 5\nmotion: {type: cycle, speed_rad_s: 3, waypoints: ")
    f.write("[{position_rad: -0.5}, {position_rad: 0.6}]}\n")
r = run(twin, "run", "over.yaml", "-o", "over", "--quiet")
check("an overloaded joint runs", r.returncode == 0, r.stderr)
r = run(report, "over")
check("report of an overload", r.returncode == 0, r.stderr)
bars = re.findall(r"quot;from&quot;:[-\d.e]+,&quot;quantity&quot;:&quot;load&quot;", content("over/report.html"))
check("its load has a colour bar", bars, content("over/report.html")[:500])
browser.check_page("an overload", path("over/report.html"), 3, None, widths=(1440, 360))

# A line of one sample is a point, drawn by gnuplot and by the script.
with open(path("pendulum.xml"), "w") as f:
    f.write(PENDULUM)
with open(path("one.yaml"), "w") as f:
    f.write("model: pendulum.xml\nduration_s: 0.02\ncontrol: {type: torque}\ntelemetry_rate_hz: 10\n")
run(twin, "run", "one.yaml", "-o", "one", "--quiet")
with h5py.File(path("one/telemetry.h5")) as f:
    check("the record has one sample", f["time_s"].size == 1, f["time_s"][:])
r = run(report, "one")
check("report of one sample", r.returncode == 0, r.stderr)
browser.open(path("one/report.html"))
POINTS = """[...document.querySelectorAll('svg.live:not(.sample) .series path')].filter(p => p.getTotalLength() === 0
  && p.getAttribute('stroke-linecap') === 'round' && /^M[\\d.]+ [\\d.]+h0$/.test(p.getAttribute('d'))).length"""
tab.until(POINTS)  # charts are drawn a frame after the page is there
check("the script draws a point", tab.value(POINTS) == 1, tab.value(POINTS))
points = re.findall(r'id="[^"]*gnuplot_plot_2".*?</svg>', content("one/report.html"), re.S)
check("gnuplot draws a point", [svg.count("<use ") for svg in points] == [1], points)
browser.open(path("warmup/report.html"))

# A dark page has dark figures; on paper gnuplot's drawings are there.
check("no console message", not tab.console, tab.console)
check("it prints", 1 <= browser.printed(path("warmup/report.html"), path("warmup.pdf")) <= 6)
tab.command("Emulation.setEmulatedMedia", media="print")
onPaper = "[...document.querySelectorAll('main svg')].filter(s => getComputedStyle(s).display !== 'none' && "
onPaper += "s.getBoundingClientRect().width).every(s => s.matches('.drawn'))"
check("on paper there are gnuplot's drawings", tab.value(onPaper))
tab.command("Emulation.setEmulatedMedia", media="")

# The robot in 3-D.
check_robot(check, tab, page, path("warmup/telemetry.h5"), "joint2", lambda: browser.open(path("warmup/report.html")))
with open(path("large.xml"), "w") as f:
    f.write(with_many_triangles(os.path.join(source, "mjcf")))
large = ("--set", "model=" + path("large.xml"), "--set", "duration_s=2", "--set", "multirate.enabled=false")
run(twin, "run", "irb6620_warmup", "-o", "large", *large, "--quiet")
r = run(report, "large")
page = content("large/report.html")
check("a robot too large for a page is not in it", r.returncode == 0 and 'data-robot="' not in page, r.stderr)
said = re.findall(r"The robot is not shown in 3-D: its shapes and poses need (\d+) kB compressed", page)
check("and the page says why", len(said) == 1 and int(said[0]) > 300, said)
finish()
