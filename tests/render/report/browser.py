"""Pages in a real browser: what it says about them, and what a reader sees in them. By day a page is looked at in its
widest window and in one of the narrower ones, and in the dark in one; its name draws which, so that the pages together
have all of them. By night each page has all."""
import atexit, base64, html, os, random, re, sys, urllib.parse

from harness import nightly

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "twin", "live", "page"))
import devtools

WIDTHS = (1440, 768, 480, 360)

# Evaluated by the DevTools, which the page's own policy does not forbid.
MEASURE = """(() => {
  for (const d of document.querySelectorAll('details')) d.open = true;
  const channel = c => { c /= 255; return c <= .03928 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4; };
  const light = c => .2126 * channel(c[0]) + .7152 * channel(c[1]) + .0722 * channel(c[2]);
  const colour = text => { const n = (text.match(/[\\d.]+/g) || []).map(Number);
    return n.length == 4 && n[3] == 0 ? null : n.length >= 3 ? n : null; };
  let worst = 99, where = '', texts = 0;
  const judge = (e, style, text) => {
    const front = colour(e.closest('svg') ? style.fill : style.color);
    let back = null;
    for (let b = e; b && !back; b = b.parentElement) back = colour(getComputedStyle(b).backgroundColor);
    if (!front || !back) return;
    const a = light(front), c = light(back), ratio = (Math.max(a, c) + .05) / (Math.min(a, c) + .05);
    ++texts;
    if (ratio < worst) { worst = ratio; where = e.tagName + ': ' + text.slice(0, 40); }
  };
  for (const e of document.querySelectorAll('body *')) {
    if ([...e.childNodes].some(n => n.nodeType == 3 && n.data.trim())) judge(e, getComputedStyle(e), e.textContent);
    const before = getComputedStyle(e, '::before');
    if (e.dataset && e.dataset.label && before.content != 'none') judge(e, before, e.dataset.label);
  }
  const named = e => e.tagName + '.' + e.className + ': ' + e.textContent.slice(0, 40);
  const outside = [...document.querySelectorAll('main *')].filter(e => !e.closest('svg'));
  const wide = outside.filter(e => !e.closest('.scroll') && e.getBoundingClientRect().right > innerWidth + 1);
  const hidden = outside.filter(e => !e.matches('.scroll') && e.clientWidth && e.scrollWidth > e.clientWidth + 1);
  const scrolls = [...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth + 1);
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
  // So do heads that stand before a value where rows are lists.
  const ruler = document.createElement('canvas').getContext('2d');
  for (const cell of document.querySelectorAll('td[data-label]')) {
    const style = getComputedStyle(cell, '::before');
    if (style.content === 'none' || !cell.clientWidth) continue;
    ruler.font = style.font;
    for (const word of cell.dataset.label.split(/[\\s-]+/))
      if (word.length < 16 && ruler.measureText(word).width > parseFloat(style.width) + 1) torn.push('head ' + word);
  }
  // Numbers whose unit or percent sign begins the next line.
  const parted = [], texts_of = document.createTreeWalker(document.querySelector('main'), NodeFilter.SHOW_TEXT);
  for (let text; (text = texts_of.nextNode());) {
    if (text.parentElement.closest('svg, pre')) continue;
    for (const word of text.data.matchAll(/\\d (?:%|°C|K|Nm|W|k?J|MJ|s|min|h|mrad)(?![\\w/])/g)) {
      const range = document.createRange();
      range.setStart(text, word.index);
      range.setEnd(text, word.index + word[0].length);
      if (new Set([...range.getClientRects()].map(r => Math.round(r.top))).size > 1) parted.push(word[0]);
    }
  }
  const ids = [...document.querySelectorAll('[id]')].map(e => e.id), images = [...document.images];
  const first = document.querySelector('main > h1 ~ #verdict');
  // What is not in the page's language: another sign of numbers, units as programs spell them.
  const leaves = [...document.querySelectorAll('main *')].filter(e => !e.closest('pre') && !e.children.length);
  const strange = /(^|[^\\w])degC\\b|−\\d|\\de[+-]\\d|\\w\\^[23]\\b|\\+-|joint joint|\\d \\.\\. ?\\d/;
  const foreign = leaves.map(e => e.textContent).filter(t => strange.test(t));
  return {width: innerWidth, images: images.length,
    broken: images.filter(i => !i.complete || !i.naturalWidth).length,
    drawings: document.querySelectorAll('main svg.drawn').length,
    shown: [...document.querySelectorAll('main svg.drawn, svg.live:not(.sample)')].filter(e => e.clientWidth).length,
    alive: document.querySelectorAll('figure.alive').length, data: document.querySelectorAll('[data-figure]').length,
    white: [...document.querySelectorAll('main svg:not(.inverts)')].filter(e =>
      [e, ...e.querySelectorAll('rect')].some(r => [getComputedStyle(r).backgroundColor, getComputedStyle(r).fill]
        .includes('rgb(255, 255, 255)'))).length,
    overflow: document.documentElement.scrollWidth - innerWidth, wide: wide.map(named), hidden: hidden.map(named),
    scrolls: scrolls.map(named), verdict: first ? first.getBoundingClientRect().top + scrollY : null,
    contrast: worst, where, texts, cut, over, torn, foreign,
    opens: document.querySelector('main p:not(.identity)') === first, ids: ids.length - new Set(ids).size,
    scripts: document.scripts.length, title: document.title, parted,
    text: document.body.innerText.replaceAll('\\u00a0', ' ')};
})()"""


def drawn(name, widths):
    """By day one of the widths, by night all; the same ones each time."""
    return list(widths) if nightly else random.Random(f"20261129 {name}").sample(sorted(widths), min(1, len(widths)))


def opening(page):
    """What the page's source says in its first lines; the verdict comes before all but title and identity."""
    main = page[page.index("<main>") :].replace("\xa0", " ")
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
        self.process = devtools.Browser(work)
        atexit.register(self.process.close)
        self.tab = self.process.tab()
        self.tab.patience_s = 120  # pages of many drawings, on a busy machine

    def open(self, page):
        """What the browser says about the page as it is."""
        self.tab.console.clear()
        self.tab.requests.clear()
        self.tab.window(1440, 1000)
        self.tab.go("file://" + urllib.parse.quote(page))
        return self.tab.console

    def opens_in_s(self, page):
        """From asking for the page to the end of its load event, by the page's own clock; the middle of three."""
        ended = "performance.getEntriesByType('navigation')[0].loadEventEnd"
        times = []
        for _ in range(3):
            self.open(page)
            self.tab.until(ended + " > 0")
            times.append(self.tab.value(ended) / 1e3)
        return sorted(times)[1]

    def measured(self, width, scheme="light"):
        self.tab.window(width, 1000, scheme)
        return self.tab.value(MEASURE)

    def without_scripts(self, name, page, images, drawings):
        """The page is whole for readers whose mail or archive runs no scripts."""
        self.tab.command("Emulation.setScriptExecutionDisabled", value=True)
        self.open(page)
        for m in [self.measured(width) for width in drawn(name + " without scripts", {min(WIDTHS), max(WIDTHS)})]:
            self.check_width(f"{name} without scripts at {m['width']}", m, images, drawings)
            self.check(f"{name} without scripts: drawings stay", m["alive"] == 0 and m["shown"] == m["drawings"], m)
        dark = self.measured(max(WIDTHS), "dark")
        self.check(
            f"{name} without scripts, dark: contrast", dark["contrast"] >= 4.5, (dark["contrast"], dark["where"])
        )
        self.check(f"{name} without scripts, dark: no drawing is white", dark["white"] == 0, dark["white"])
        self.tab.command("Emulation.setScriptExecutionDisabled", value=False)

    def on_paper(self, name):
        """The page as it is laid out for A4 upright: gnuplot's drawings, all of them whole."""
        self.tab.window(718, 1000)
        self.tab.command("Emulation.setEmulatedMedia", media="print")
        m = self.tab.value(MEASURE)
        live = self.tab.value("[...document.querySelectorAll('.live')].some(e => e.getClientRects().length)")
        self.tab.command("Emulation.setEmulatedMedia", media="")
        self.check(f"{name} on paper: gnuplot's drawings", not live and m["shown"] == m["drawings"], (live, m["shown"]))
        self.check(
            f"{name} on paper: nothing is cut off or over another",
            m["overflow"] <= 0 and not m["wide"] and not m["hidden"] and not m["cut"] and not m["over"],
            {k: m[k] for k in ("overflow", "wide", "hidden", "cut", "over")},
        )
        self.check(f"{name} on paper: no word of a table is torn", not m["torn"], m["torn"])
        self.check(f"{name} on paper: contrast at least 4.5:1", m["contrast"] >= 4.5, (m["contrast"], m["where"]))

    def printed(self, page, file):
        """Prints the page as it is when it is opened; how many pages A4 it has."""
        self.open(page)
        paper = {"paperWidth": 8.27, "paperHeight": 11.69, "preferCSSPageSize": True, "printBackground": True}
        pdf = base64.b64decode(self.tab.command("Page.printToPDF", **paper)["data"])
        with open(file, "wb") as f:
            f.write(pdf)
        return len(re.findall(rb"/Type\s*/Page\b", pdf))

    def check_page(self, name, page, images, drawings, widths=WIDTHS):
        """What holds of every page; returns what was measured in the widest window, in which `text` is what is read."""
        with open(page) as f:
            said = opening(f.read())
        self.check(
            f"{name}: verdict, light with its rule, identity, three to five tiles, what to do",
            3 <= len(said["tiles"]) <= 5 and all(said.values()),
            said,
        )
        self.open(page)
        for width in drawn(name + " dark", {max(widths), min(widths)}):
            dark = self.measured(width, "dark")
            self.check(
                f"{name} at {width}, dark: contrast at least 4.5:1",
                dark["contrast"] >= 4.5,
                (dark["contrast"], dark["where"]),
            )
            self.check(f"{name} at {width}, dark: no figure is white", dark["white"] == 0, dark["white"])
        all_widths = [self.measured(w) for w in (*drawn(name, set(widths) - {max(widths)}), max(widths))]
        for m in all_widths:
            self.check_width(f"{name} at {m['width']}", m, images, drawings)
        self.check(name + ": no console message", not self.tab.console, self.tab.console)
        last = all_widths[-1]
        self.check(
            f"{name}: each drawing of values is alive, and no other",
            last["alive"] == last["data"] and last["shown"] == last["drawings"],
            {k: last[k] for k in ("alive", "data", "shown", "drawings")},
        )
        self.on_paper(name)
        self.without_scripts(name, page, images, drawings)
        fetched = [r for r in self.tab.requests[1:] if not r.startswith("data:")]
        self.check(name + ": nothing is fetched", not fetched, fetched)
        return all_widths[-1]

    def check_width(self, name, m, images, drawings):
        check = self.check
        check(
            f"{name}: {images} pictures and {drawings} drawings load",
            m["images"] == images and m["broken"] == 0 and drawings in (None, m["drawings"]),
            {k: m[k] for k in m if k != "text"},
        )
        check(
            f"{name}: nothing is wider than the window or than what it is in",
            m["overflow"] <= 0 and not m["wide"] and not m["hidden"],
            (m["overflow"], m["wide"], m["hidden"]),
        )
        check(f"{name}: no table scrolls", not m["scrolls"], m["scrolls"])
        check(f"{name}: the verdict is in sight", m["verdict"] is not None and m["verdict"] < 400, m["verdict"])
        check(f"{name}: the verdict is the first sentence", m["opens"])
        check(f"{name}: one sign of numbers, °C, typeset powers", not m["foreign"], m["foreign"][:5])
        check(
            f"{name}: contrast at least 4.5:1 in {m['texts']} texts",
            m["texts"] > 30 and m["contrast"] >= 4.5,
            (m["contrast"], m["where"]),
        )
        check(f"{name}: no label is cut off or over another", not m["cut"] and not m["over"], (m["cut"], m["over"]))
        check(f"{name}: no word of a table is torn", not m["torn"], m["torn"])
        check(f"{name}: no number is parted from its unit", not m["parted"], m["parted"][:5])
        check(f"{name}: one script, ids unique", m["scripts"] == 1 and m["ids"] == 0, (m["scripts"], m["ids"]))
