"""Every number of a page, outside its figures, is one that a test has computed itself. `take` removes what is expected;
what is left must have none."""
import datetime, functools, html, math, os, re, subprocess, sys


def text_of(page):
    """What is read outside figures, each cell and paragraph on a line of its own, with plain spaces."""
    main = page[page.index("<main>") : page.index("</main>")]
    main = re.sub(r"<svg.*?</svg>", "", main, flags=re.S)
    main = re.sub(r"</(p|div|tr|h\d|figcaption|pre|td|th|summary)>", "\n", main)
    return html.unescape(re.sub("<[^>]*>", "", main)).replace("\xa0", " ")


def number(text):
    """As the page writes it: 1.30·10⁻⁴"""
    mantissa, _, power = text.partition("·10")
    return float(mantissa) * 10 ** int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0)


def typeset(text):
    """As the page writes a number that Python writes so: 1.3e-04"""
    mantissa, _, power = text.partition("e")
    return mantissa + ("·10" + str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")) if power else "")


def in_print(text):
    """Text of programs as pages write it: °C, powers of ten, ranges, deviations."""
    text = re.sub(r"(^|\W)degC\b", r"\1°C", text).replace("joint joint", "joint")
    powers = r"(?<![\w.])\d[\d.]*e[-+]\d\d\d?(?=$|[ ,;)…\n]|\. |\.$)"
    text = re.sub(powers, lambda m: typeset(m[0]), text)
    return re.sub(r"\+- ?(?=\d)", "± ", re.sub(r"(\d[%)]?) ?\.\. ?(?=[-+]?\d)", r"\1 – ", text))


class Numbers:
    def __init__(self, page, check):
        self.text, self.check = text_of(page), check

    def take(self, name, *expected):
        """Lines or parts of lines that must be there; all that is equal to them is removed."""
        missing = [e for e in expected if e not in self.text]
        self.check("number: " + name, not missing, (missing, self.text[:4000]))
        for e in expected:
            self.text = self.text.replace(e, "")

    def match(self, name, pattern, holds):
        """A part with groups, for numbers that are held within a tolerance: `holds(*groups)` for each that there is."""
        found = list(re.finditer(pattern, self.text))
        wrong = [m.group(0) for m in found if not holds(*m.groups())]
        self.check("number: " + name, found and not wrong, (wrong, self.text[:4000]))
        self.text = re.sub(pattern, "", self.text)

    def finish(self, name):
        left = [line for line in self.text.splitlines() if re.search(r"\d", re.sub(r"joint\d+", "", line))]
        self.check(name + ": no number is left that was not computed", not left, left)


def duration(seconds):
    if seconds < 60:
        return f"{seconds:.2f} s"
    h, m, s = round(seconds) // 3600, round(seconds) // 60 % 60, round(seconds) % 60
    return f"{h} h {m:02} min {s:02} s" if h else f"{m} min {s:02} s"


def difference(a, b, unit="", scatter=None):
    """How b differs from a, by the one rule of all pages: three digits, and a ratio where it has a meaning."""
    if not abs(b - a) > 1e-6 * max(abs(a), abs(b)):
        return "none"
    text = ("+" if b > a else "") + typeset(digits(b - a, 3))
    if scatter is not None:
        text += f" ± {typeset(digits(scatter, 2))}"
    text += {"": "", "°C": " K"}.get(unit, " " + unit)
    return text if unit == "°C" or a <= 0 or b < 0 else f"{text}, {100 * (b / a - 1):+.1f} %"


def energy_unit(joule):
    """In which so much work is written, and how many J it is."""
    return next(((u, s) for u, s in (("MJ", 1e6), ("kJ", 1e3)) if abs(joule) >= s), ("J", 1))


def energy(joule):
    unit, size = energy_unit(joule)
    return f"{digits(joule / size, 3)} {unit}"


def of_motor_work(friction_J, motor_J):
    share = f"{digits(100 * friction_J / motor_J, 3)} % of {energy(motor_J)} motor work"
    return share + (", as gravity or stored energy drives, too" if friction_J > 1.005 * motor_J else "")


def percent(share):
    """A share as the page writes it."""
    if 0 < share < 1e-3:
        return "less than 0.1 %"
    if 0.999 < share < 1:
        return "more than 99.9 %"
    return f"{100 * share:.{1 if 0 < share < 0.1 or 0.995 <= share < 1 else 0}f} %"


def digits(value, count):
    """A number as tables of estimates write it."""
    text = f"{value:.{count}g}"
    if "e" not in text or not 1e-6 <= abs(value) < 1e7:
        return text
    text = f"{value:.{max(0, count - 1 - math.floor(math.log10(abs(value))))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def day_of(*files):
    """On which the newest was written (UTC)."""
    newest = datetime.datetime.fromtimestamp(max(map(os.path.getmtime, files)), datetime.timezone.utc)
    return f"{newest:%Y-%m-%d}"


@functools.cache
def version(program=None):
    """Of a program; of tribotwin, which is the first argument of these tests, where none is named."""
    said = subprocess.run([program or sys.argv[1], "--version"], capture_output=True, text=True).stdout
    return said.split()[1].rstrip(",")


def engine_of(campaign):
    """That simulated it, by the first line of the text of its campaign.yaml."""
    return re.match(r"# MuJoCo ([\d.]+),", campaign)[1]


def take_identity(n, program, *files):
    """The end of the page's second line: the day on which the newest file was written, and the program's version."""
    n.take("identity", f"newest file written {day_of(*files)} · page made with tribotwin {version(program)}\n")
