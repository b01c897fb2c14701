"""What if, on the page of a law: the kernel in the page computes what tribotwin curve does, sliders move the drawn
curve, and a page without them stays as it was. Arguments: tribotwin, tribotwin-report."""
import base64, hashlib, html, json, re, sys

import numpy as np

from browser import Browser
from harness import check, content, finish, path, run, work

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
    keys: [...f.querySelectorAll('.key button')].map(b => b.textContent),
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

# ---- Layout, light and dark, narrow, printed, without scripts.
browser.check_page("law page", path("extended.html"), 0, 5)
tab.command("Emulation.setScriptExecutionDisabled", value=True)
browser.open(path("extended.html"))
check("without scripts there is no slider", tab.value("document.querySelectorAll('.sliders').length") == 0)
finish()
