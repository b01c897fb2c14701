"""What the page shows, number by number, against what a program has recorded."""
import struct

import h5py

from harness import check, path

# One look, within which nothing changes: [name, value, tooltip, text] of each number, and of which row they are.
LOOK = """(() => {
  const numbers = (root) => [...root.querySelectorAll('data')]
    .filter(d => d.value !== '' && !d.closest('[hidden]')).map(d => [d.dataset.name, d.value, d.title, d.textContent]);
  const one = (selector) => document.querySelector(selector);
  const exact = (selector) => Number(one(selector).value);
  const tile = (t) => ({ numbers: numbers(t), limit: t.querySelector('.limit').title,
    state: t.querySelector('.state').textContent, fault: t.querySelector('.fault').textContent });
  return {
    row: Number(one('#drives').dataset.row), cursor: Number(one('#cursor_time data').dataset.row),
    tiles: Object.fromEntries([...document.querySelectorAll('.tile')].map(t => [t.id.slice(6), tile(t)])),
    histories: numbers(one('#figures')), time: numbers(one('#cursor_time')), law: numbers(one('#friction_text')),
    watched: one('#watched').value,
    warmest: [one('#warmest_text a').textContent, exact('#warmest_text data')],
    labels: [...document.querySelectorAll('.scene_label:not([hidden])')].map(l => [l.dataset.joint,
      Number(l.querySelector('data').value)]),
    status: [exact('#simulated data'), exact('#wall data')],
    buses: Object.fromEntries([...document.querySelectorAll('.bus')].map(b => [b.dataset.name, numbers(b)])),
    counted: [exact('#rows data'), exact('#lost data')],
  };
})()"""


def same_bits(a, b):
    return struct.pack("<d", a) == struct.pack("<d", b)


def is_rounded(text, value):
    """Whether a text as '\u22121.23 Nm' or '12 345' is this number, to its last digit."""
    words = text.replace("\u2212", "-").replace("\u00a0", "").split(" ")
    if not words[-1].strip("-.0123456789") == "":
        words.pop()  # the unit
    digits = "".join(words)
    decimals = len(digits.partition(".")[2])
    return abs(float(digits) - value) <= 0.5 * 10.0**-decimals * (1 + 1e-9)


def untidy(numbers):
    """Those whose tooltip has other digits than their value, or whose text is not that value rounded."""
    times = ("simulated_s", "wall_s")
    return [
        n for n in numbers
        if n[2].split()[0] != n[1] or (n[0] not in times and not is_rounded(n[3], float(n[1])))
    ]  # fmt: skip


class Record:
    """telemetry.h5 of a folder: `value(row, joint, name)`."""

    def __init__(self, folder):
        self.columns = {}
        with h5py.File(path(folder, "telemetry.h5")) as file:
            self.columns[None, "time_s"] = file["time_s"][:]
            for joint in (j for j in file if isinstance(file[j], h5py.Group)):
                self.columns |= {(joint, k): v[:] for k, v in file[joint].items() if isinstance(v, h5py.Dataset)}
        self.rows = len(self.columns[None, "time_s"])

    def value(self, row, joint, name):
        return float(self.columns[joint, name][row])


def differing(record, look):
    """All numbers of rows that this look shows otherwise than the record has them, and how many it showed."""
    wrong, count = [], 0

    def compare(row, joint, name, value):
        nonlocal count
        count += 1
        if not same_bits(float(value), record.value(row, joint, name)):
            wrong.append((row, joint, name, value, record.value(row, joint, name)))

    for joint, tile in look["tiles"].items():
        for name, value, *_ in tile["numbers"]:
            if (joint, name) in record.columns:
                compare(look["row"], joint, name, value)
    for name, value, *_ in look["histories"]:
        compare(look["cursor"], *name.split(".", 1), value)
    for _, value, *_ in look["time"]:
        compare(look["cursor"], None, "time_s", value)
    for joint, value in [look["warmest"], *look["labels"]]:
        compare(look["row"], joint, "temperature_degC", value)
    warmest = max(look["tiles"], key=lambda joint: record.value(look["row"], joint, "temperature_degC"))
    if record.value(look["row"], look["warmest"][0], "temperature_degC") != record.value(
        look["row"], warmest, "temperature_degC"
    ):
        wrong.append((look["row"], "warmest", look["warmest"], warmest))
    return wrong, count


def check_looks(name, record, looks, at_least):
    """`at_least`: numbers of a look."""
    found = [differing(record, look) for look in looks]
    wrong = [w for some, _ in found for w in some]
    check(f"{name}: every number shown is that of telemetry.h5, to the bit ({len(looks)} looks)", not wrong, wrong[:5])
    fewest = min(count for _, count in found)
    check(f"{name}: each look has all numbers", fewest >= at_least, fewest)
    rows = [look["row"] for look in looks]
    check(f"{name}: of different rows", len(set(rows)) > len(rows) // 2, rows)
    sets = [t["numbers"] for look in looks for t in look["tiles"].values()]
    sets += [n for look in looks for n in [look["histories"], look["time"], look["law"], *look["buses"].values()]]
    loose = [u for numbers in sets for u in untidy(numbers)]
    check(f"{name}: tooltips have all digits, texts are rounded well", not loose, loose[:5])


def answers(tab):
    """[class, text] of what the program answered to the page, oldest first."""
    return tab.value("[...document.querySelectorAll('#answers li')].reverse().map(l => [l.className, l.textContent])")


def press(tab, command, choose=(), **typed):
    """Fills in the form of a command by keyboard and presses its button with the mouse; what was answered."""
    form = f"form[data-do={command}] "
    before = tab.value("document.querySelector('#answers').childElementCount")
    for key, value in dict(choose).items():
        tab.choose(f"{form}select[name={key}]", value)
    for key, value in typed.items():
        tab.fill(f"{form}input[name={key}]", value)
    tab.click(form + "button")
    first = "document.querySelector('#answers li:first-child')"
    settled = f"/: (done|refused|not sent)/.test({first}.textContent)"
    tab.until(f"document.querySelector('#answers').childElementCount > {before} && {settled}", 60)
    return tab.value(f"[{first}.className, {first}.textContent]")
