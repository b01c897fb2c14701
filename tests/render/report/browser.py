"""Pages in a real browser: what it says about them, and what a reader sees in them."""
import html, json, os, re, subprocess

# The page forbids scripts; a copy without that rule gets one that measures it in a frame of the wanted width.
MEASURE = """<script>addEventListener('load', () => {
  for (const d of document.querySelectorAll('details')) d.open = true;
  const channel = c => { c /= 255; return c <= .03928 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4; };
  const light = c => .2126 * channel(c[0]) + .7152 * channel(c[1]) + .0722 * channel(c[2]);
  const colour = text => { const n = (text.match(/[\\d.]+/g) || []).map(Number); 
    return n.length == 4 && n[3] == 0 ? null :
    n.length >= 3 ? n : null; };
  let worst = 99, where = '', texts = 0;
  for (const e of document.querySelectorAll('body *')) {
    if (![...e.childNodes].some(n => n.nodeType == 3 && n.data.trim())) continue;
    const style = getComputedStyle(e), front = colour(e.closest('svg') ? style.fill : style.color);
    let back = null;
    for (let b = e; b && !back; b = b.parentElement) back = colour(getComputedStyle(b).backgroundColor);
    if (!front || !back) continue;
    const a = light(front), c = light(back), ratio = (Math.max(a, c) + .05) / (Math.min(a, c) + .05);
    ++texts;
    if (ratio < worst) { worst = ratio; where = e.tagName + ': ' + e.textContent.slice(0, 40); }
  }
  const images = [...document.images], wide = [...document.querySelectorAll('main *')].filter(e =>
    !e.closest('.scroll') && !e.closest('svg') && e.getBoundingClientRect().right > innerWidth + 1);
  // Labels of drawings: within their drawing, and not over each other.
  let cut = [], over = [];
  for (const svg of document.querySelectorAll('main svg')) {
    const frame = svg.getBoundingClientRect();
    const boxes = [...svg.querySelectorAll('text')].filter(t => t.textContent.trim()).map(t =>
      [t.textContent, t.getBoundingClientRect()]);
    for (const [text, b] of boxes)
      if (b.left < frame.left - 1 || b.right > frame.right + 1 || b.top < frame.top - 1 || b.bottom > frame.bottom + 1)
        cut.push(text);
    boxes.forEach(([text, a], i) => boxes.slice(i + 1).forEach(([other, b]) => {
      if (Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2 &&
          Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4) over.push(text + ' / ' + other);
    }));
  }
  // Words of tables that go on in the next line.
  const torn = [];
  for (const cell of document.querySelectorAll('th, td')) {
    const text = cell.firstChild;
    if (!text || text.nodeType != 3) continue;
    for (const word of text.data.matchAll(/[^\\s-]+/g)) {
      const range = document.createRange();
      range.setStart(text, word.index);
      range.setEnd(text, word.index + word[0].length);
      if (new Set([...range.getClientRects()].map(r => Math.round(r.top))).size > 1 && word[0].length < 32)
        torn.push(word[0]);
    }
  }
  const ids = [...document.querySelectorAll('[id]')].map(e => e.id);
  parent.postMessage({width: innerWidth, images: images.length,
    broken: images.filter(i => !i.complete || !i.naturalWidth).length,
    drawings: document.querySelectorAll('main svg').length,
    overflow: document.documentElement.scrollWidth - innerWidth, wide: wide.map(e => e.tagName + '.' + e.className),
    contrast: worst, where, texts, cut, over, torn, ids: ids.length - new Set(ids).size,
    scripts: document.scripts.length, title: document.title, text: document.body.innerText}, '*');
});</script>"""


def opening(page):
    """What the page's source says in its first lines; the verdict comes before all but title and identity."""
    main = page[page.index("<main>") :]
    text = lambda s: html.unescape(re.sub(r"<[^>]*>", "", s))
    verdict = re.search(r'<p class="verdict (\w+)" id="verdict">(.*?)</p>', main, re.S)
    if not verdict:
        return {"verdict": "", "light": "", "rule": "", "identity": "", "tiles": [], "action": ""}
    before, after = main[: verdict.start()], main[verdict.end() :]
    light = re.match(r"<p><strong[^>]*>.*?</strong>.*?</p>", after, re.S)
    name, _, rule = text(light.group(0) if light else "").partition(": ")
    identity = re.search(r'<p class="identity[^>]*>(.*?)</p>', before, re.S)
    tiles = re.match(r'<div class="tiles">.*?</div></div></div>', after[light.end() if light else 0 :], re.S)
    action = re.search(r"<p><strong>What to do: </strong>(.*?)</p>", after, re.S)
    return {
        "verdict": text(verdict.group(2)),
        "light": name,
        "rule": rule,
        "identity": text(identity.group(1)) if identity else "",
        "tiles": re.findall(r'<div class="tile">', tiles.group(0)) if tiles else [],
        "action": text(action.group(1)) if action else "",
    }


class Browser:
    """`work`: a folder to keep files in; `check(name, condition, detail)`: how a test reports."""

    def __init__(self, work, check):
        self.work, self.check = work, check
        self.command = [
            "chromium",
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--user-data-dir=" + self.path("browser"),
            "--virtual-time-budget=20000",
        ]

    def path(self, name):
        return os.path.join(self.work, name)

    def console(self, page):
        """What the browser says about the page as it is."""
        r = subprocess.run(
            self.command + ["--enable-logging=stderr", "--v=0", "--dump-dom", "file://" + page],
            capture_output=True,
            text=True,
            timeout=300,
        )
        # What the page says; a line whose source is chrome:// is the browser's own.
        return [s for s in r.stderr.splitlines() if "CONSOLE" in s and "source: chrome://" not in s], r.stdout

    def measured(self, page, width):
        with open(page) as f:
            text = f.read()
        probe = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text).replace(
            "</body>", MEASURE + "</body>"
        )
        assert probe.count("postMessage") == 1
        with open(self.path("probe.html"), "w") as f:
            f.write(probe)
        with open(self.path("frame.html"), "w") as f:
            f.write(
                "<pre id=result></pre><script>addEventListener('message', e => "
                "document.getElementById('result').textContent = JSON.stringify(e.data));</script>"
                "<iframe src=probe.html style='width:%dpx;height:900px;border:0'></iframe>" % width
            )
        r = subprocess.run(
            self.command + ["--dump-dom", "--window-size=1400,1000", "file://" + self.path("frame.html")],
            capture_output=True,
            text=True,
            timeout=300,
        )
        found = re.search(r'<pre id="result">(.*?)</pre>', r.stdout, re.S)
        return json.loads(html.unescape(found.group(1))) if found and found.group(1) else None

    def check_page(self, name, page, images, drawings, widths=(480, 1280)):
        check = self.check
        said, dom = self.console(page)
        check(name + ": no console message", not said, said)
        check(name + ": the browser shows it", "</main>" in dom, dom[:300])
        for width in widths:
            m = self.measured(page, width)
            check(f"{name} at {width}: measured", m is not None and m["width"] == width, m)
            if not m:
                continue
            check(
                f"{name} at {width}: {images} pictures and {drawings} drawings load",
                m["images"] == images and m["broken"] == 0 and drawings in (None, m["drawings"]),
                {k: m[k] for k in m if k != "text"},
            )
            check(
                f"{name} at {width}: nothing is wider than the window",
                m["overflow"] <= 0 and not m["wide"],
                (m["overflow"], m["wide"]),
            )
            check(
                f"{name} at {width}: contrast at least 4.5:1 in {m['texts']} texts",
                m["texts"] > 30 and m["contrast"] >= 4.5,
                (m["contrast"], m["where"]),
            )
            check(
                f"{name} at {width}: no label is cut off or over another",
                not m["cut"] and not m["over"],
                (m["cut"], m["over"]),
            )
            check(f"{name} at {width}: no word of a table is torn", not m["torn"], m["torn"])
            check(
                f"{name} at {width}: no script but ours, ids unique",
                m["scripts"] == 1 and m["ids"] == 0,
                (m["scripts"], m["ids"]),
            )
        return m
