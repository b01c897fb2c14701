"""What if, on the page of a law: the kernel in the page computes what tribotwin curve does, sliders move the drawn
curve with its band, and a page without them stays as it was. Arguments: tribotwin, tribotwin-report."""
import base64, hashlib, html, json, re, sys

import numpy as np
import yaml

from browser import Browser
from harness import check, content, finish, path, run, work
from reference_law import M_STAR, law as law_extended

twin, report = sys.argv[1:3]
LAWS = {
    "stribeck": "{Fc: 0.034, Fs: 0.046, Fv: 3.68e-4, vs: 10.68, alpha: 1.93}",
    "load": "{Fc0: 0.033, Fcl: 0.0234, Fs0: 0.04, Fsl: 0.126, vs: 9.22, alpha: 1.36, Fv: 3.7e-4}",
    "extended": "{Fc0: 3.11e-2, Fcl: 2.34e-2, Fs0: -2.5e-2, FsT: 1.6e-3, Fsl: 0.126, vs0: -24.81, vsT: 0.98, vsl: 9.22,"
    " alpha: 1.36, Fv0: 1.3e-4, FvT: 1.32e-3, TV0: 20.71}",
    "steady_state_extended": "{Fc0: 7.9, FcT: 0.027, Fcl: 5.4, Fs0: 13, Fsl: 7.8, Vs0: 2, VsT: 0.025, alpha: 1.3,"
    " FvT: 5.7, TV0: 32, beta0: 0.5, betaT: 0.0025}",
    "polynomial": "{f1: 4, f2: 3, f3: -0.4, f4: 0.05, a: -0.012, T0: 20}",
    "stribeck_T": "{Fc0: 60, FcT: 0.8, FcTT: 0.004, Fs0: 90, FsT: 1.2, FsTT: 0.006, vs0: 2, vsT: 0.08, vsTT: -4e-4,"
    " delta: 1.4, Fv0: 1.6, FvT: -0.04, FvTT: 3.5e-4}",
}
NORMALISED = ("stribeck", "load", "extended")
browser = Browser(work, check)
tab = browser.tab


def page_of(law):
    with open(path(law + ".yaml"), "w") as f:
        f.write(f"law: {law}\nparameters: {LAWS[law]}\n")
    r = run(report, "fit", law + ".yaml", "-o", law + ".html")
    check("page of law " + law, r.returncode == 0, r.stderr)
    return content(law + ".html")


def curve(law, speeds, load, T):
    """Of tribotwin curve, in the unit of the law."""
    column = "friction_norm" if law in NORMALISED else "friction_nm"
    options = ("--speeds", ":".join(map(repr, speeds)), f"--load={load!r}", f"--temperature={T!r}", "--json", "--quiet")
    r = run(twin, "curve", law + ".yaml", *options)
    check(f"curve of {law} at load {load:.3g} and {T:.3g} degC", r.returncode == 0, r.stderr)
    points = json.loads(r.stdout)["points"]
    return [p["speed_rad_s"] for p in points], np.array([p[column] for p in points])


# The page's own module, in the page, under the page's own policy.
KERNEL = """(async () => {
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const {kernel, whatIf} = document.querySelector('figure[data-kernel]').dataset, [law] = JSON.parse(whatIf).numbers;
  const {instance: {exports: k}, module} = await WebAssembly.instantiate(bytes(kernel));
  if (WebAssembly.Module.imports(module).length || bytes(law).length !== k.law_size()) return null;
  new Uint8Array(k.memory.buffer, k.law_numbers(), k.law_size()).set(bytes(law));
  return GRID.map(([speeds, load, T]) => speeds.map(v => k.friction_level(v, load, T)));
})()"""

for law in LAWS:
    page = page_of(law)
    script = re.search(r"<script>(.*?)</script>", page, re.S).group(1)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page).group(1)
    chosen = law != "stribeck"
    rest = f"script-src 'sha256-{digest}'" + (" 'wasm-unsafe-eval'" if chosen else "")
    check(f"{law}: the policy allows the page's script, and its module where it has one", policy.endswith(rest), policy)
    check(f"{law}: sliders where there is something to choose", ("data-kernel" in page) == chosen)
    if not chosen:
        continue
    inputs = json.loads(html.unescape(re.search(r'data-what-if="([^"]*)"', page).group(1)))["sliders"]
    (T0, T1), (l0, l1) = ((i["from"], i["to"]) for i in inputs)
    # Beyond the range too, where the law holds its inputs.
    grid, expected = [], []
    for T in sorted({T0, (T0 + 2 * T1) / 3, T1 + 20}):
        for load in sorted({l0, l1 / 3, l1 + 0.1}):
            speeds, values = curve(law, (0, 300, 61), load, T)
            grid.append([speeds, load, T])
            expected.append(values)
    browser.open(path(law + ".html"))
    found = tab.value(KERNEL.replace("GRID", json.dumps(grid)))
    if check(f"{law}: the module needs nothing and takes the law", found):
        worst = np.max(np.abs(np.array(found) / np.array(expected) - 1))
        check(f"{law}: the kernel equals tribotwin curve", worst <= 1e-12, worst, f"within {worst:.1e}")
    check(f"{law}: no console message", not tab.console, tab.console)

# ---- Sliders.
browser.open(path("extended.html"))
check("sliders appear", tab.until("document.querySelectorAll('.sliders input').length == 2"))
SHOWN = """(() => { const f = document.querySelector('figure[data-kernel]');
  return {lines: [...f.querySelectorAll('svg.live:not(.sample) .series path')].map(p => p.getAttribute('d')),
    keys: [...f.querySelectorAll('.key button')].map(b => b.textContent.replaceAll('\\u00a0', ' ')),
    values: [...f.querySelectorAll('.sliders output')].map(o => o.textContent),
    inputs: [...f.querySelectorAll('.sliders input')].map(i => Number(i.value))}; })()"""
HOVER = """(share) => { const svg = document.querySelector('figure[data-kernel] svg.live:not(.sample)');
  const path = svg.querySelectorAll('.series path')[1], at = path.getPointAtLength(share * path.getTotalLength());
  const box = svg.getBoundingClientRect(), scale = box.width / svg.viewBox.baseVal.width;
  svg.dispatchEvent(new PointerEvent('pointermove', {bubbles: true, pointerType: 'mouse',
    clientX: box.x + scale * at.x, clientY: box.y + scale * at.y}));
  return document.querySelector('figure[data-kernel] .tip').innerText; }"""
before = tab.value(SHOWN)
check("at first the middle of both", before["values"] == ["59.6 °C", "0.36"], before["values"])
check(
    "three curves, of which one moves", len(before["lines"]) == 3 and before["keys"][1] == "59.6 °C, load 0.36", before
)


def holds_the_curve(name):
    """What the pointer finds on the moved curve is tribotwin curve's value at what the sliders say."""
    T, load = tab.value(SHOWN)["inputs"]
    tip = tab.value(f"({HOVER})(0.4)")
    found = re.search(r"motor speed ([\d.]+) rad/s\s+friction torque ([\d.]+)", tip)
    if check(name + ": the pointer finds it", found, tip):
        v, y = map(float, found.groups())
        _, expected = curve("extended", (v, v, 1), load, T)
        check(name + ": it is tribotwin curve's", abs(y / expected[0] - 1) < 1e-4, (tip, expected))


holds_the_curve("the curve in the middle")
for number, (name, key) in enumerate((("temperature", "End"), ("load", "Home"))):
    last = tab.value(SHOWN)
    tab.value(f"document.querySelectorAll('.sliders input')[{number}].focus()")
    tab.key("ArrowLeft", 37)
    step = tab.value(SHOWN)
    check(f"{name}: an arrow key moves it a little", step["inputs"][number] < last["inputs"][number], step["inputs"])
    check(f"{name}: and the curve", step["lines"][1] != last["lines"][1])
    tab.key(key, {"End": 35, "Home": 36}[key])
    now = tab.value(SHOWN)
    check(f"{name}: the curve follows to the end", now["lines"][1] not in (step["lines"][1], last["lines"][1]))
    check(f"{name}: the others stay", now["lines"][::2] == before["lines"][::2])
    check(f"{name}: the key says it", now["keys"][1] == "{}, load {}".format(*now["values"]), now)
    holds_the_curve(name)
check("both are at their ends", tab.value(SHOWN)["values"] == ["81.2 °C", "0.00"], tab.value(SHOWN)["values"])
check("no console message from sliders", not tab.console, tab.console)

# ---- The band of an identified law: error propagation with central differences, here of another program's formula.
random = np.random.default_rng(5)
v = np.tile(1.5 * (280 / 1.5) ** (np.arange(12) / 11), 60)
load, T = random.uniform(0, 0.73, 60).repeat(12), random.uniform(38, 81.2, 60).repeat(12)
rows = np.column_stack([v, load, T, law_extended(M_STAR, v, load, T) + random.normal(0, 4e-3, v.size)])
np.savetxt(path("points.csv"), rows, "%.7g", ",", header="speed_rad_s,load_norm,temperature_degC,friction_norm")
with open(path("points.csv")) as f:
    points = f.read().lstrip("# ")
with open(path("points.csv"), "w") as f:
    f.write(points)
r = run(twin, "identify", "points.csv", "--law", "extended", "-o", "params.yaml", "--quiet")
check("the law is identified", r.returncode == 0, r.stderr)
r = run(report, "fit", "params.yaml", "-o", "fit.html", "--quiet")
check("its page is made", r.returncode == 0, r.stderr)
params = yaml.safe_load(content("params.yaml"))
names = list(params["parameters"])
values, sigma = (np.array([params[key][n] for n in names]) for key in ("parameters", "sigma"))
low, high = np.array([params["confidence_95"][n] for n in names]).T
covariance = np.array([params["correlation"][n] for n in names]) * np.outer(sigma, sigma)
sigmas = np.max((high - low) / (2 * sigma))


def half_width(v, load, T):
    steps = np.maximum(0.05 * sigma, 1e-6 * np.abs(values))
    moved = [[law_extended(values + sign * step, v, load, T) for sign in (1, -1)] for step in np.diag(steps)]
    slopes = np.array([(above - below) / (2 * step) for (above, below), step in zip(moved, steps)])
    return sigmas * np.sqrt(np.einsum("iv,ik,kv->v", slopes, covariance, slopes))


def figure(title):
    """Line and band of a figure's series, as the page carries them."""
    drawn = [json.loads(html.unescape(f)) for f in re.findall(r'data-figure="([^"]*)"', content("fit.html"))]
    return next(f for f in drawn if f["title"].startswith(title))["series"]


BAND = KERNEL.replace("[law] =", "[law, sure] =").replace(
    "return GRID", "new Uint8Array(k.memory.buffer, k.uncertainty_numbers(), k.uncertainty_size()).set(bytes(sure));"
    "return GRID"
).replace("friction_level", "friction_half_width")  # fmt: skip
browser.open(path("fit.html"))
check("an identified law has sliders", tab.until("document.querySelectorAll('.sliders input').length == 2"))
grid = [[[2.0, 30.0, 150.0, 270.0], load, T] for load in (0.05, 0.3, 0.7) for T in (40.0, 58.0, 80.0)]
expected = np.array([half_width(np.array(v), load, T) for v, load, T in grid])
found = np.array(tab.value(BAND.replace("GRID", json.dumps(grid))))
worst = np.max(np.abs(found / expected - 1))
check("the kernel's band is that of the covariance", worst < 1e-9, worst, f"within {worst:.1e}")
check("it is one", np.all(expected > 1e-5) and np.ptp(expected) > 1e-4, expected)

# What 'tribotwin-report curve' and the page's other figures draw by the law itself.
static = figure("Friction at a load of")
level = float(re.search(r"Friction at a load of ([\d.]+)", content("fit.html")).group(1))
bands = [(static[i], static[i + 1]) for i in range(len(static) - 1) if static[i]["mark"] == "band"]
check("static curves have bands", len(bands) == 7, [s["mark"] for s in static])
inputs = json.loads(html.unescape(re.search(r'data-what-if="([^"]*)"', content("fit.html")).group(1)))["sliders"]
for (band, line), T in list(zip(bands, np.linspace(inputs[0]["from"], inputs[0]["to"], 7)))[::3]:
    n = len(line["x"])
    upper = np.array(band["y"][:n]) - line["y"]
    kernels = np.array(tab.value(BAND.replace("GRID", json.dumps([[line["x"][1:], level, T]]))))[0]
    # The load in the title has two decimals, the figure's numbers seven digits.
    far = np.max(np.abs(upper[1:] - kernels) / (kernels + 1e-5))
    check(f"{T:.0f} °C: the band of the static curve is the kernel's", far < 0.05, far)

SURE = """(() => { const svg = document.querySelector('figure[data-kernel] svg.live:not(.sample)');
  return [...svg.querySelectorAll('.series path')].map(p => p.getAttribute('d')); })()"""
first = tab.value(SURE)
check("a band, and three curves of which one moves", len(first) == 4, len(first))
for number, key in ((0, "End"), (1, "Home")):
    before = tab.value(SURE)
    tab.value(f"document.querySelectorAll('.sliders input')[{number}].focus()")
    tab.key(key, {"End": 35, "Home": 36}[key])
    now = tab.value(SURE)
    moved = [a != b for a, b in zip(before, now)]
    check(f"slider {number} moves line and band", moved == [True, False, True, False], moved)
tip = tab.value("(" + HOVER.replace("[1], at", "[2], at") + ")(0.7)")
spread = re.search(r"motor speed ([\d.]+) rad/s\s+friction torque [\d.]+ ± ([\d.]+) \(95 %\)", tip)
if check("the pointer finds line and half the band's width", spread, tip):
    T, load = tab.value(SHOWN)["inputs"]
    expected = half_width(np.array([float(spread.group(1))]), load, T)[0]
    check("which is that of the covariance", abs(float(spread.group(2)) / expected - 1) < 0.06, (tip, expected))
check("no console message from the band", not tab.console, tab.console)

# ---- Layout, light and dark, narrow, printed, without scripts.
browser.check_page("law page", path("extended.html"), 0, 5)
tab.command("Emulation.setScriptExecutionDisabled", value=True)
browser.open(path("extended.html"))
check("without scripts there is no slider", tab.value("document.querySelectorAll('.sliders').length") == 0)
finish()
