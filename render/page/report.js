// The figures of a page, drawn again from their own values (data-figure), so that they answer: zoom, values, keys that
// hide, one cursor in time; and tables that sort. Without scripts, and on paper, the drawings of gnuplot stay.
import { viridis } from './colours.js';
import { plain, ticks } from './scale.js';

const seconds = { s: 1, min: 60, h: 3600 };
const across_px = 70, down_px = 45;  // between marks
const digits = 5;
const charts = [];

/// Outlines of marks that are not dots, about where the pen is.
const outlines = {
  circle: (r) => `m${-r} 0a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`,
  cross: (r) => `m${-r} ${-r}l${2 * r} ${2 * r}m0 ${-2 * r}l${-2 * r} ${2 * r}`,
};

function node(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function drawn(tag, attributes = {}, text = '') {
  const made = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text) made.textContent = text;
  return made;
}

const raised = (power) => [...power].map((c) => (c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[c])).join('');
/// A number as pages write it: 2.5·10⁻⁷.
const written = (value) => plain(value).replace(/e\+?(-?\d+)$/, (_, power) => `·10${raised(power)}`);
/// Without an end of a line between a number and its unit.
const unbroken = (label) => label.replace(/(\d) (?=[°%±]|[KNWs]\b)|± /g, (space, digit) => (digit ?? '±') + '\u00a0');
const shown = (value) => written(Number(value.toPrecision(digits)));
const unitOf = ({ unit }) => (unit && unit !== '-' ? ' ' + unit : '');

/// gnuplot's enhanced text of a symbol as [text, style] pairs.
function parts(symbol) {
  const out = [];
  for (const [, italic, group, one, rest] of symbol.matchAll(/\{\/:Italic ([^}]*)\}|_\{([^}]*)\}|_(.)|([^{_]+)/g))
    out.push(italic ? [italic, 'italic'] : group || one ? [group || one, 'sub'] : [rest, '']);
  return out;
}

function label(axis, attributes) {
  const text = drawn('text', attributes);
  text.append(axis.quantity + (axis.symbol ? ' ' : ''));
  let lowered = false;
  for (const [part, kind] of parts(axis.symbol)) {
    const span = drawn('tspan', { class: kind, dy: kind === 'sub' ? 3 : lowered ? -3 : 0 }, part);
    lowered = kind === 'sub';
    text.append(span);
  }
  text.append(drawn('tspan', { dy: lowered ? -3 : 0 }, axis.unit ? ` [${axis.unit}]` : ''));
  return text;
}

/// With the middle of its quantity left out as far as it is longer than its place. It is in the page already.
function fit(text, room) {
  const words = text.firstChild, whole = words.data;
  for (let kept = whole.length - 2; kept > 8 && text.getComputedTextLength() > room; kept -= 2)
    words.data = `${whole.slice(0, kept / 2)}…${whole.slice(-kept / 2)}`;
}

class Chart {
  constructor(figure) {
    const data = JSON.parse(figure.dataset.figure);
    Object.assign(this, { figure, data, hidden: new Set(), view: null, pixels: 0 });
    this.overTime = data.x.quantity.startsWith('time') && data.x.unit in seconds;
    this.counts = data.series.every(({ x }) => x.every((at) => at === null || Number.isInteger(at)));
    this.perUnit_s = data.x.quantity === 'time' ? seconds[data.x.unit] : undefined;  // those look at the same time
    this.svg = drawn('svg', { class: 'live', tabindex: 0, role: 'img',
      'aria-label': figure.querySelector('svg').getAttribute('aria-label') });
    this.tip = node('div', { class: 'tip', role: 'status' });
    this.tip.hidden = true;
    this.area = node('div', { class: 'live area' }, this.svg, this.tip);
    const head = node('div', { class: 'live head' }, node('strong', {}, unbroken(data.title)), this.tools());
    figure.prepend(head, this.key(), this.area);
    figure.classList.add('alive');
    this.svg.addEventListener('pointermove', (event) => this.hover(event));
    this.svg.addEventListener('pointerdown', (event) => this.down(event));
    this.svg.addEventListener('pointerleave', () => this.everywhere((chart) => chart.leave()));
    this.svg.addEventListener('blur', () => this.everywhere((chart) => chart.leave()));
    this.svg.addEventListener('dblclick', () => this.look(null));
    this.svg.addEventListener('keydown', (event) => this.typed(event));
    // Not the area, whose height a drawing changes: browsers complain of such loops.
    new ResizeObserver(() => this.draw()).observe(head);
  }

  /// Those with the same time, or this one alone.
  everywhere(act) {
    for (const chart of charts) if (chart === this || (this.perUnit_s && chart.perUnit_s)) act(chart);
  }

  tools() {
    const box = node('span', { class: 'tools' });
    const tool = (text, name, act) => {
      const button = node('button', { type: 'button', 'aria-label': name, title: name }, text);
      button.onclick = act;
      box.append(button);
    };
    tool('+', 'Nearer', () => this.zoom(0.5));
    tool('−', 'Farther', () => this.zoom(2));
    tool('↺', 'All of it', () => this.look(null));
    return box;
  }

  key() {
    const box = node('div', { class: 'live key' });
    this.keys = new Map();
    this.data.series.forEach((series, i) => {
      if (!series.label) return;
      const name = unbroken(series.label);
      const button = node('button', { type: 'button', 'aria-pressed': 'true' }, this.sample(series), name);
      button.onclick = () => {
        // All bands at once: one entry of the key stands for them. A curve takes the points of its stroke along.
        const alike = (other, k) => k === i || (series.mark === 'band' && other.mark === 'band') ||
          (series.mark === 'line' && other.mark === 'points' && !other.label && other.stroke === series.stroke);
        const hide = !this.hidden.has(i);
        this.data.series.forEach((other, k) => alike(other, k) && this.hidden[hide ? 'add' : 'delete'](k));
        button.setAttribute('aria-pressed', String(!this.hidden.has(i)));
        this.draw();
      };
      this.keys.set(i, button);
      box.append(button);
    });
    return box;
  }

  /// Other curves in the place of series: [index, y, label], ...
  change(curves) {
    for (const [i, y, label] of curves) {
      Object.assign(this.data.series[i], { y, label });
      this.keys.get(i).lastChild.data = unbroken(label);
    }
    this.draw();
  }

  sample(series) {
    const svg = drawn('svg', { class: 'sample', viewBox: '0 0 26 10', 'aria-hidden': 'true' });
    const area = ['area', 'bars', 'band'].includes(series.mark), points = /points|error/.test(series.mark);
    const stroke = series.mark === 'band' && series.shade.length ? 'currentColor' : this.colour(series);
    const line = { d: 'M0 5H26', 'stroke-width': 2, 'stroke-dasharray': this.dash(series) };
    const outline = outlines[series.shape];
    const dot = { d: 'M13 5' + (outline ? outline(3.5) : 'h0'), fill: 'none', 'stroke-linecap': 'round',
      'stroke-width': outline ? 1.6 : series.shape === 'disc' ? 8 : 6 };
    svg.append(area ? drawn('path', { d: 'M1 1h24v8h-24z', stroke, fill: stroke, 'fill-opacity': 0.3 })
      : drawn('path', { stroke, ...(points ? dot : line) }));
    return svg;
  }

  /// By the colour axis where it has one, else as in all figures.
  colour(series, point = 0) {
    const { shade, stroke } = series, { colour } = this.data;
    if (!shade.length) return `var(--s${stroke})`;
    const value = shade[shade.length > 1 ? point : 0];
    return `rgb(${viridis(Math.round(32 * (value - colour.from) / (colour.to - colour.from)) / 32)})`;
  }

  dash(series) {
    return series.mark === 'reference' ? '6 5' : series.shade.length ? '' : series.dash;
  }

  visible() {
    return this.data.series.filter((_, i) => !this.hidden.has(i));
  }

  /// From the first to the last mark around all values, as far as the axis does not say.
  whole(name) {
    const axis = this.data[name];
    let low = Infinity, high = -Infinity;
    for (const series of this.data.series) {
      const wide = series.mark === 'bars' && name === 'x' ? Math.abs(series.x[1] - series.x[0]) / 2 || 0 : 0;
      series[name].forEach((value, k) => {
        if (value === null) return;
        const spread = wide || (name === 'y' && series.error[k]) || 0;
        low = Math.min(low, value - spread, series.mark === 'bars' && name === 'y' ? 0 : Infinity);
        high = Math.max(high, value + spread);
      });
    }
    if (!(low < high)) [low, high] = [low - (0.1 * Math.abs(low) || 1), high + (0.1 * Math.abs(high) || 1)];
    if (name === 'x' && this.overTime)  // as it is, from 0 where it begins soon after
      return [axis.from ?? (low > 0 && low < 0.1 * high ? 0 : low), axis.to ?? high];
    const marks = ticks(low, high, 6), step = marks.length > 1 ? marks[1] - marks[0] : high - low;
    const from = axis.from ?? step * Math.floor(low / step + 1e-9);
    const to = axis.to ?? step * Math.ceil(high / step - 1e-9);
    return from < to ? [from, to] : [low, high];
  }

  get x() { return this.view?.x ?? (this.wholeX ??= this.whole('x')); }
  get y() { return this.view?.y ?? (this.wholeY ??= this.whole('y')); }

  /// {x, y} as [from, to]; null: all. Figures over time look at the same time.
  look(view) {
    const { perUnit_s } = this, x = view?.x.map((at) => at * perUnit_s);
    this.view = view;
    this.everywhere((chart) => {
      if (chart !== this) chart.view = x ? { x: x.map((at) => at / chart.perUnit_s), y: chart.y } : null;
      chart.svg.dataset.zoomed = String(Boolean(view));
      chart.draw();
    });
  }

  zoom(factor) {
    const around = ([from, to]) => [0.5 - factor / 2, 0.5 + factor / 2].map((share) => from + share * (to - from));
    const x = around(this.x), [from, to] = this.wholeX ?? this.whole('x');
    if (x[1] - x[0] >= to - from) this.look(null);
    else this.look({ x, y: this.overTime ? this.y : around(this.y) });
  }

  draw() {
    const width = this.area.clientWidth;
    if (!width) return;
    const height = Math.round(Math.min(400, Math.max(240, 0.62 * width)));
    const marks = { y: ticks(...this.y, Math.max(2, height / down_px)) };
    const left = 34 + 7 * Math.max(...marks.y.map((at) => written(at).length));
    const right = this.data.colour ? this.colourBarWidth() : 14;
    this.box = { left, top: 8, width: Math.max(40, width - left - right), height: height - 54 };
    const room = Math.max(across_px, 9 * 1.4 * Math.max(...ticks(...this.x, 4).map((at) => written(at).length)));
    marks.x = ticks(...this.x, Math.max(1, this.box.width / room)).filter((x) => !this.counts || Number.isInteger(x));
    this.svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    const clip = `clip${charts.indexOf(this)}`, { top } = this.box;
    const frame = drawn('clipPath', { id: clip });
    frame.append(drawn('rect', { x: left - 3, y: top - 3, width: this.box.width + 6, height: this.box.height + 6 }));
    const inside = drawn('g', { 'clip-path': `url(#${clip})`, class: 'series' });
    for (const series of this.visible()) inside.append(...this.paths(series));
    this.cursor = drawn('path', { class: 'cursor' });
    this.svg.replaceChildren(frame, ...this.axes(marks, height), inside, this.cursor);
    if (this.data.colour) this.svg.append(...this.colourBar(width));
    const middle = left + this.box.width / 2;
    for (const text of this.svg.querySelectorAll('.name'))
      fit(text, text.hasAttribute('transform') ? height - 44 : 2 * Math.min(middle, width - middle) - 4);
    this.tip.hidden = true;
    this.pixels = width;
  }

  px(at) { return this.box.left + (at - this.x[0]) / (this.x[1] - this.x[0]) * this.box.width; }
  py(at) { return this.box.top + (this.y[1] - at) / (this.y[1] - this.y[0]) * this.box.height; }

  axes(marks, height) {
    const { left, top, width, height: deep } = this.box, bottom = top + deep, out = [];
    const at = (value) => value.toFixed(1);
    const grid = marks.x.map((x) => `M${at(this.px(x))} ${top}V${bottom}`)
      .concat(marks.y.map((y) => `M${left} ${at(this.py(y))}H${left + width}`));
    out.push(drawn('path', { class: 'grid', d: grid.join('') }));
    out.push(drawn('path', { class: 'axis', d: `M${left} ${top}V${bottom}H${left + width}` }));
    for (const x of marks.x) {
      const half = 4 * written(x).length;
      const middle = Math.min(this.px(x), left + width + 12 - half);
      out.push(drawn('text', { x: at(middle), y: bottom + 17, class: 'middle' }, written(x)));
    }
    for (const y of marks.y) out.push(drawn('text', { x: left - 6, y: at(this.py(y) + 4), class: 'end' }, written(y)));
    out.push(label(this.data.x, { x: left + width / 2, y: height - 6, class: 'middle name' }));
    out.push(label(this.data.y, { transform: `translate(14 ${top + deep / 2}) rotate(-90)`, class: 'middle name' }));
    return out;
  }

  /// With its numbers and, beside the longest of them, its label.
  colourBarWidth() {
    const { from, to } = this.data.colour;
    return 50 + 7 * Math.max(4, ...ticks(from, to, 5).map((at) => written(at).length));
  }

  colourBar(width) {
    const { colour } = this.data, { top, height } = this.box, left = width - this.colourBarWidth() + 12, out = [];
    const fill = drawn('linearGradient', { id: `bar${charts.indexOf(this)}`, x1: 0, y1: 1, x2: 0, y2: 0 });
    for (let k = 0; k <= 16; ++k)
      fill.append(drawn('stop', { offset: k / 16, 'stop-color': `rgb(${viridis(k / 16)})` }));
    out.push(fill, drawn('rect', { x: left, y: top, width: 10, height, fill: `url(#${fill.id})` }));
    for (const at of ticks(colour.from, colour.to, 5)) {
      const y = top + (colour.to - at) / (colour.to - colour.from) * height;
      out.push(drawn('text', { x: left + 14, y: (Math.min(top + height, y + 4)).toFixed(1) }, written(at)));
    }
    out.push(label(colour, { transform: `translate(${width - 5} ${top + height / 2}) rotate(-90)`,
      class: 'middle name' }));
    return out;
  }

  /// A series as paths, one per colour.
  paths(series) {
    const { mark } = series, stroke = this.colour(series), dash = this.dash(series);
    if (mark === 'points' || mark === 'error_bars') return this.points(series);
    if (mark === 'bars') return [drawn('path', { d: this.bars(series), fill: stroke, 'fill-opacity': 0.75 })];
    const d = this.line(series) + (mark === 'area' || mark === 'band' ? 'Z' : '');
    if (mark === 'band') return [drawn('path', { d, fill: stroke, 'fill-opacity': 0.2 })];
    const line = drawn('path', { d, stroke, 'stroke-width': mark === 'reference' ? 1.2 : 1.8, 'stroke-dasharray': dash,
      fill: mark === 'area' ? stroke : 'none', 'fill-opacity': 0.12 });
    return mark === 'area' ? [line] : [line, ...this.points(this.alone(series))];
  }

  /// Points of a line that has no neighbour on either side, which no stroke of it would show.
  alone({ x, y, shade, stroke }) {
    const there = (k) => (x[k] ?? null) !== null && (y[k] ?? null) !== null;
    const of = (values) => values.filter((_, k) => there(k) && !there(k - 1) && !there(k + 1));
    return { mark: 'points', x: of(x), y: of(y), error: [], shade: shade.slice(0, 1), stroke, shape: 'dot' };
  }

  line({ x, y }) {
    let d = '', goes = false;
    for (let k = 0; k < x.length; ++k) {
      const there = x[k] !== null && y[k] !== null;
      if (there) d += `${goes ? 'L' : 'M'}${this.px(x[k]).toFixed(2)} ${this.py(y[k]).toFixed(2)}`;
      goes = there;
    }
    return d;
  }

  bars({ x, y }) {
    const half = 0.46 * (Math.abs(x[1] - x[0]) || 1);
    const bar = (at, k) => `M${this.px(at - half)} ${this.py(0)}V${this.py(y[k])}H${this.px(at + half)}V${this.py(0)}Z`;
    return x.map(bar).join('');
  }

  points(series) {
    const { x, y, error, shape } = series, many = series.mark === 'points' && x.length > 1000, byColour = new Map();
    const outline = outlines[shape];
    for (let k = 0; k < x.length; ++k) {
      if (x[k] === null || y[k] === null) continue;
      const colour = this.colour(series, k), at = `M${this.px(x[k]).toFixed(1)} ${this.py(y[k]).toFixed(1)}`;
      const spread = error[k] ? `M${this.px(x[k]).toFixed(1)} ${this.py(y[k] - error[k]).toFixed(1)}` +
        `V${this.py(y[k] + error[k]).toFixed(1)}` : '';
      const before = byColour.get(colour) ?? ['', ''];
      byColour.set(colour, [before[0] + at + (outline ? outline(4) : 'h0'), before[1] + spread]);
    }
    const dot = many ? 2.6 : shape === 'disc' ? 8 : 4.5;
    return [...byColour].flatMap(([stroke, [d, bars]]) => [
      drawn('path', { d: bars, stroke, 'stroke-width': 1.2 }),
      drawn('path', { d, stroke, 'stroke-width': outline ? 1.6 : dot, 'stroke-linecap': 'round',
        'stroke-opacity': many ? 0.45 : 1 })]);
  }

  /// Where the pointer is, in the picture's own pixels.
  place(event) {
    const box = this.svg.getBoundingClientRect(), scale = this.pixels / box.width;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
  }

  value([x, y]) {
    const { left, top, width, height } = this.box, share = (part) => Math.min(1, Math.max(0, part));
    return [this.x[0] + share((x - left) / width) * (this.x[1] - this.x[0]),
      this.y[1] - share((y - top) / height) * (this.y[1] - this.y[0])];
  }

  hover(event) {
    if (this.dragging || !this.box) return;
    const place = this.place(event), [x] = this.value(place);
    if (this.overTime) this.cursorAt(x);
    else this.near(place);
  }

  cursorAt(x) {
    this.everywhere((chart) => chart.at(chart === this ? x : x * this.perUnit_s / chart.perUnit_s));
  }

  leave() {
    this.tip.hidden = true;
    this.cursor?.setAttribute('d', '');
  }

  /// All curves at a time of this axis.
  at(time) {
    if (!this.box || time < this.x[0] || time > this.x[1]) return this.leave();
    this.time = time;
    const lines = [];
    let taken = time;
    for (const series of this.visible()) {
      if (['reference', 'band'].includes(series.mark) || !series.label) continue;
      let best = -1;
      series.x.forEach((x, k) => {
        if (x === null || series.y[k] === null) return;
        if (best < 0 || Math.abs(x - time) < Math.abs(series.x[best] - time)) best = k;
      });
      if (best < 0) continue;
      taken = series.x[best];
      lines.push(this.row(series, best, `${series.label} ${this.valueAt(series, best)}`));
    }
    this.say(`${this.data.x.quantity} ${shown(lines.length === 1 ? taken : time)}${unitOf(this.data.x)}`, lines,
      this.px(time), this.box.top);
    const { top, height } = this.box, x = this.px(time).toFixed(1);
    this.cursor.setAttribute('d', `M${x} ${top}V${top + height}`);
  }

  /// "36.4 ± 0.3 °C" of a point with an error, "36.4 ± 0.3 °C (95 %)" of a line with a band around it.
  valueAt(series, k) {
    const { data } = this, unit = unitOf(data.y), y = series.y[k];
    if (series.error[k]) return `${shown(y)} ± ${shown(series.error[k])}${unit}`;
    const around = data.series.slice(0, data.series.indexOf(series)).findLast(({ mark, stroke, x }) =>
      mark === 'band' && (series.shade.length || stroke === series.stroke) && x.includes(series.x[k]));
    if (series.mark !== 'line' || !around) return shown(y) + unit;
    const half = around.y[around.x.indexOf(series.x[k])] - y;
    return `${shown(y)} ± ${written(Number(half.toPrecision(2)))}${unit} (95 %)`;
  }

  row(series, k, text) {
    const line = node('div', {}, node('i', {}), text);
    line.firstChild.style.background = this.colour(series, k);
    return line;
  }

  /// The nearest point of any curve.
  near([x, y]) {
    let best = null;
    for (const series of this.visible().filter(({ mark }) => mark !== 'band'))
      series.x.forEach((at, k) => {
        if (at === null || series.y[k] === null) return;
        const far = Math.hypot(this.px(at) - x, this.py(series.y[k]) - y);
        if (far < (best?.far ?? 40)) best = { far, series, k };
      });
    if (!best) return this.leave();
    const { series, k } = best, { data } = this, px = this.px(series.x[k]), py = this.py(series.y[k]);
    const lines = [this.row(series, k, `${data.y.quantity} ${this.valueAt(series, k)}`)];
    const shade = series.shade[series.shade.length > 1 ? k : 0];
    if (shade !== undefined)
      lines.push(node('div', {}, `${data.colour.quantity} ${shown(shade)}${unitOf(data.colour)}`));
    if (series.label) lines.push(node('div', {}, series.label));
    this.say(`${data.x.quantity} ${shown(series.x[k])}${unitOf(data.x)}`, lines, px, py);
    this.cursor.setAttribute('d', `M${px - 5} ${py}h10M${px} ${py - 5}v10`);
  }

  say(head, lines, x, y) {
    this.tip.replaceChildren(node('strong', {}, head), ...lines);
    this.tip.hidden = false;
    const left = x + 12 + this.tip.offsetWidth > this.pixels ? x - 12 - this.tip.offsetWidth : x + 12;
    Object.assign(this.tip.style, { left: `${Math.max(0, left)}px`, top: `${Math.max(0, y)}px` });
  }

  /// A mouse that drags chooses what to look at; a finger scrolls the page.
  down(event) {
    if (event.pointerType === 'touch' || event.button !== 0) return;
    const begin = this.place(event), over = new AbortController(), { signal } = over;
    const frame = drawn('rect', { class: 'chosen' });
    this.svg.append(frame);
    this.svg.setPointerCapture(event.pointerId);
    this.dragging = true;
    const box = (e) => {
      const end = this.place(e), flat = Math.abs(end[1] - begin[1]) < 12, { top, height } = this.box;
      return [[Math.min(begin[0], end[0]), Math.max(begin[0], end[0])],
        flat ? [top, top + height] : [Math.min(begin[1], end[1]), Math.max(begin[1], end[1])]];
    };
    this.svg.addEventListener('pointermove', (e) => {
      const [[x0, x1], [y0, y1]] = box(e);
      for (const [name, value] of Object.entries({ x: x0, y: y0, width: x1 - x0, height: y1 - y0 }))
        frame.setAttribute(name, value);
    }, { signal });
    const end = (e) => {
      over.abort();
      frame.remove();
      this.dragging = false;
      const [[x0, x1], [y0, y1]] = box(e);
      if (e.type === 'pointercancel' || x1 - x0 < 6) return;
      const [from, high] = this.value([x0, y0]), [to, low] = this.value([x1, y1]);
      if (from < to && low < high) this.look({ x: [from, to], y: [low, high] });
    };
    for (const kind of ['pointerup', 'pointercancel']) this.svg.addEventListener(kind, end, { signal });
  }

  typed(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === '+') this.zoom(0.5);
    else if (event.key === '-') this.zoom(2);
    else if (event.key === '0' || event.key === 'Escape') this.look(null);
    else if (way && this.overTime) {
      const [from, to] = this.x;
      this.cursorAt(Math.min(to, Math.max(from, (this.time ?? from) + way * (to - from) / 100)));
    } else return;
    event.preventDefault();
  }
}

/// What a cell says as a number: "-1.30·10⁻⁴", "12.5 %", "1 h 23 min 05 s", of a date "2026-11-25 14:20 UTC" its
/// seconds; NaN where it says none, such as a name "6620-104417".
function number(text) {
  const small = '⁰¹²³⁴⁵⁶⁷⁸⁹', plainOf = (c) => (c === '⁻' ? '-' : small.indexOf(c));
  const power = (all, times, digits) => `${times ? '' : '1'}e${[...digits].map(plainOf).join('')}`;
  const ascii = text.trim().replace(/\u00a0/g, ' ').replace(/(·?)10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, power);
  const time = /^(?:(\d+) h )?(\d+) min (\d+) s/.exec(ascii);
  if (time) return 3600 * (time[1] ?? 0) + 60 * time[2] + Number(time[3]);
  const date = /^(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d))?)?(?:Z| UTC)?$/.exec(ascii);
  if (date) return Date.UTC(date[1], date[2] - 1, ...date.slice(3).map((part) => part ?? 0)) / 1000;
  const found = /^(?:± ?|[<>] ?|(?:less|more) than )?([+-]?[\d.]+(?:e[+-]?\d+)?)(?![-\p{L}\d._])/u.exec(ascii);
  return found ? parseFloat(found[1]) : NaN;
}

function sortable(table) {
  const body = table.tBodies[0], heads = [...table.querySelectorAll('thead th')];
  if (!body || body.rows.length < 2) return;
  const sort = (column) => {
    const down = heads[column].getAttribute('aria-sort') === 'ascending';
    for (const head of heads) head.removeAttribute('aria-sort');
    heads[column].setAttribute('aria-sort', down ? 'descending' : 'ascending');
    const rows = [...body.rows].map((row) => ({ row, text: row.cells[column]?.textContent ?? '' }));
    for (const each of rows) each.value = number(each.text);
    const byNumber = rows.some(({ value }) => !Number.isNaN(value)), sign = down ? -1 : 1;
    rows.sort((a, b) => {
      if (!byNumber) return sign * a.text.localeCompare(b.text, undefined, { numeric: true });
      if (Number.isNaN(a.value) || Number.isNaN(b.value)) return Number.isNaN(a.value) - Number.isNaN(b.value);
      return sign * (a.value - b.value);
    });
    body.append(...rows.map(({ row }) => row));
  };
  heads.forEach((head, column) => {
    head.tabIndex = 0;
    head.title = 'Sort by this column';
    head.addEventListener('click', () => sort(column));
    head.addEventListener('keydown', (event) => {
      if (event.key !== 'Enter' && event.key !== ' ') return;
      event.preventDefault();
      sort(column);
    });
  });
}

for (const figure of document.querySelectorAll('figure[data-figure]')) charts.push(new Chart(figure));
for (const table of document.querySelectorAll('table')) sortable(table);
