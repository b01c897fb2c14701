// Lines over time on a canvas. While a picture follows the newest row it moves on by whole columns of pixels, and only
// the columns that are new are drawn.
import { element, style } from './dom.js';
import { plain, rangeAfter, ticks } from './scale.js';

const margin = { left: 58, right: 8, top: 6, bottom: 22 };
const lineWidth = 1.6;
const again = 3;  // columns before the new ones that are drawn anew, so that no joint is seen

/// Smallest and largest value of each series in each column of pixels that has rows, so that no peak is lost. Column k
/// has the rows whose time divided by `each_s` is k and a fraction.
class Columns {
  constructor(ring, first, indices, each_s, count) {
    Object.assign(this, { ring, first, next: first, indices, each_s, count });
    this.numbers = [];  // upwards
    // low, high; falls: the largest came first; breaks: a value is missing, the line ends here.
    this.series = indices.map(() => ({ low: [], high: [], falls: [], breaks: [] }));
  }

  /// Whether it goes on to rows `first`..`end` in columns of this length.
  fits(ring, first, end, each_s) {
    return this.ring === ring && first >= this.first && end >= this.next && Math.abs(this.each_s / each_s - 1) < 1e-9;
  }

  /// The rows up to `end` that were not taken yet.
  take(end) {
    const { ring, indices, series, numbers, each_s } = this;
    for (let row = Math.max(this.next, ring.begin); row < end; ++row) {
      const column = Math.floor(ring.time(row) / each_s);
      if (column !== numbers.at(-1)) this.begin(column);
      const at = numbers.length - 1;
      for (let s = 0; s < indices.length; ++s) {
        const value = ring.at(row, indices[s]), { low, high, falls, breaks } = series[s];
        if (value < low[at]) [low[at], falls[at]] = [value, true];
        if (value > high[at]) [high[at], falls[at]] = [value, false];
        if (Number.isNaN(value)) breaks[at] = true;
      }
    }
    this.next = end;
    if (numbers.length > 3 * this.count) this.forget(numbers.length - 2 * this.count);
  }

  begin(column) {
    this.numbers.push(column);
    for (const { low, high, falls, breaks } of this.series) {
      low.push(Infinity);
      high.push(-Infinity);
      falls.push(false);
      breaks.push(false);
    }
  }

  forget(count) {
    this.first = this.next;  // a look at what is forgotten begins anew
    this.numbers.splice(0, count);
    for (const one of this.series) for (const values of Object.values(one)) values.splice(0, count);
  }

  /// The place of the first column from `column` on.
  find(column) {
    let low = 0, high = this.numbers.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.numbers[middle] < column) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /// [smallest, largest] of the visible series from column `left` to `right`.
  extremes(left, right, visible) {
    let smallest = Infinity, largest = -Infinity;
    for (let at = this.find(left); at < this.numbers.length && this.numbers[at] <= right; ++at)
      for (let s = 0; s < this.series.length; ++s) {
        if (!visible[s]) continue;
        const { low, high } = this.series[s];
        if (low[at] < smallest) smallest = low[at];
        if (high[at] > largest) largest = high[at];
      }
    return [smallest, largest];
  }
}

export class Chart {
  /// `series`: [{index (of the ring's columns), colour (name of a custom property), dash (or null)}]. `on`: look(from,
  /// to), live(), marks() as [{at_s}], limits() as values.
  constructor(area, series, on) {
    Object.assign(this, { area, series, on, visible: series.map(() => true), range: null, columns: null, drawn: null });
    this.grid = element('canvas');
    this.lines = element('canvas');
    this.chosen = element('div', { className: 'chosen', hidden: true });
    area.append(this.grid, this.lines, this.chosen);
    area.addEventListener('pointerdown', (event) => this.down(event));
    area.addEventListener('dblclick', () => on.live());
    this.observer = new ResizeObserver(() => { this.size = null; });  // asking for it each time would lay out the page
    this.observer.observe(area);
    this.retheme();
  }

  retheme() {
    this.colours = this.series.map(({ colour }) => style(colour));
    this.theme = Object.fromEntries(['grid', 'line', 'soft', 'mark', 'bad'].map((name) => [name, style('--' + name)]));
    this.font = getComputedStyle(document.body).fontFamily;
    this.drawn = null;
  }

  show(at, visible) {
    this.visible[at] = visible;
    this.drawn = null;
  }

  leave() {
    this.observer.disconnect();
  }

  resize() {
    const ratio = devicePixelRatio || 1;
    if (this.size && ratio === this.ratio) return;
    const width = this.area.clientWidth, height = this.area.clientHeight;
    Object.assign(this, { size: { width, height }, ratio, columns: null, drawn: null });
    const box = this.inner = { x: margin.left, y: margin.top, w: Math.max(10, width - margin.left - margin.right),
      h: Math.max(10, height - margin.top - margin.bottom) };
    Object.assign(this.grid, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    Object.assign(this.lines, { width: Math.round(box.w * ratio), height: Math.round(box.h * ratio) });
    const of = (part, whole) => `${100 * part / whole}%`;  // on paper the area is narrower
    Object.assign(this.lines.style, { left: of(box.x, width), top: of(box.y, height), width: of(box.w, width),
      height: of(box.h, height) });
  }

  /// The rows `first`..`end` of the ring from `from` to `to` [s].
  draw(ring, first, end, from, to) {
    this.resize();
    const width = this.lines.width, each_s = (to - from) / width;
    if (!this.columns?.fits(ring, first, end, each_s)) {
      this.columns = new Columns(ring, first, this.series.map(({ index }) => index), each_s, width);
      this.drawn = null;
    }
    const { columns, drawn } = this, newest = columns.numbers.at(-1) ?? 0;
    columns.take(end);
    const right = Math.floor(to / columns.each_s + 1e-6) + 1, left = right - width;
    const range = rangeAfter(this.range, ...columns.extremes(left, right, this.visible));
    const goesOn = drawn && range === this.range && right >= drawn.right && right - drawn.right < width / 2;
    this.range = range;
    const shift = goesOn ? right - drawn.right : 0;
    if (shift > 0 || !goesOn || this.stale) this.drawGrid(left, right);
    this.move(shift);
    this.drawLines(left, goesOn ? Math.min(newest - left, width - shift) - again : 0);
    this.drawn = { left, right };
    this.area.dataset.row = end > 0 ? ring.number(end - 1) : '';
    this.stale = false;
  }

  y(value) {
    return (this.range[1] - value) / (this.range[1] - this.range[0]) * this.lines.height;
  }

  /// To the left by whole pixels.
  move(shift) {
    if (shift === 0) return;
    const c = this.lines.getContext('2d');
    c.globalCompositeOperation = 'copy';
    c.drawImage(this.lines, -shift, 0);
    c.globalCompositeOperation = 'source-over';
  }

  /// All that is right of the pixel `from`.
  drawLines(left, from) {
    const c = this.lines.getContext('2d'), begin = Math.max(0, from), { width, height } = this.lines;
    c.clearRect(begin, 0, width - begin, height);
    c.save();
    c.beginPath();
    c.rect(begin, 0, width - begin, height);
    c.clip();
    c.lineWidth = lineWidth * this.ratio;
    c.lineJoin = 'bevel';
    const at = Math.max(0, this.columns.find(left + begin - again) - 1);  // the line comes from somewhere
    this.series.forEach((series, s) => this.visible[s] && this.drawLine(c, s, left, at));
    c.restore();
  }

  /// From the column in place `at` to the right edge, or to the first one beyond.
  drawLine(c, s, left, at) {
    const { numbers, series } = this.columns, { low, high, falls, breaks } = series[s], right = left + this.lines.width;
    const dash = this.series[s].dash?.map((part) => part * this.ratio);
    c.strokeStyle = this.colours[s];
    c.setLineDash(dash ?? []);
    if (dash && at < numbers.length) c.lineDashOffset = numbers[at] % dash.reduce((sum, part) => sum + part, 0);
    c.beginPath();
    for (let goes = false, beyond = false; at < numbers.length && !beyond; ++at) {
      const x = numbers[at] - left + 0.5;
      beyond = numbers[at] > right;
      if (low[at] <= high[at]) {
        const first = this.y(falls[at] ? high[at] : low[at]), second = this.y(falls[at] ? low[at] : high[at]);
        if (goes) c.lineTo(x, first);
        else c.moveTo(x - 0.5, first);  // a single point is seen, too
        c.lineTo(x, second);
        goes = true;
      }
      if (breaks[at]) goes = false;
    }
    c.stroke();
  }

  drawGrid(left, right) {
    const c = this.grid.getContext('2d'), { ratio, inner: { x, y, w, h }, theme } = this;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, this.size.width, this.size.height);
    c.font = `12px ${this.font}`;
    c.lineWidth = 1;
    c.setLineDash([]);
    c.fillStyle = theme.soft;
    c.strokeStyle = theme.grid;
    const line = (x1, y1, x2, y2) => {
      c.beginPath();
      c.moveTo(x1, y1);
      c.lineTo(x2, y2);
      c.stroke();
    };
    const { each_s } = this.columns, from = left * each_s, to = right * each_s;
    const across = (time) => Math.round(x + (time - from) / (to - from) * w) + 0.5;
    const down = (value) => Math.round(y + this.y(value) / ratio) + 0.5;
    c.textAlign = 'center';
    for (const at of ticks(from, to, Math.max(2, w / 80))) {
      line(across(at), y, across(at), y + h);
      const half = c.measureText(plain(at)).width / 2;
      c.fillText(plain(at), Math.min(across(at), x + w + margin.right - half), y + h + 16);
    }
    c.textAlign = 'right';
    for (const at of ticks(...this.range, Math.max(2, h / 40))) {
      line(x, down(at), x + w, down(at));
      c.fillText(plain(at), x - 5, Math.max(11, down(at) + 4));
    }
    c.strokeStyle = theme.mark;
    c.setLineDash([2, 3]);
    for (const at of this.on.marks(from, to)) line(across(at), y, across(at), y + h);
    c.strokeStyle = theme.bad;
    c.setLineDash([10, 4]);
    for (const at of this.on.limits())
      if (at >= this.range[0] && at <= this.range[1]) line(x, down(at), x + w, down(at));
    c.setLineDash([]);
    c.strokeStyle = theme.line;
    line(x - 0.5, y, x - 0.5, y + h);
    line(x - 0.5, y + h + 0.5, x + w, y + h + 0.5);
  }

  /// Place of a time in pixels of the area; null outside.
  place(time) {
    if (!this.drawn) return null;
    const { each_s } = this.columns, share = (time / each_s - this.drawn.left) / (this.drawn.right - this.drawn.left);
    return share < -1e-9 || share > 1 + 1e-9 ? null : this.inner.x + share * this.inner.w;
  }

  time(x) {
    if (!this.drawn) return null;
    const { left, right } = this.drawn, share = (x - this.inner.x) / this.inner.w;
    return (left + Math.min(1, Math.max(0, share)) * (right - left)) * this.columns.each_s;
  }

  /// A mouse that drags chooses what to look at; with Shift it moves it. A finger scrolls the page; the buttons zoom.
  down(event) {
    if (event.pointerType === 'touch' || event.button !== 0 || !this.drawn) return;
    event.preventDefault();
    this.area.closest('figure').focus({ preventScroll: true });
    const x = (e) => e.clientX - this.area.getBoundingClientRect().left, begin = x(event);
    const view = [this.drawn.left * this.columns.each_s, this.drawn.right * this.columns.each_s];
    const moves = event.shiftKey, perPixel_s = (view[1] - view[0]) / this.inner.w;
    const move = (e) => {
      if (moves) return this.on.look(view[0] - (x(e) - begin) * perPixel_s, view[1] - (x(e) - begin) * perPixel_s);
      const [from, to] = [begin, x(e)].map((at) => Math.min(this.inner.x + this.inner.w, Math.max(this.inner.x, at)))
        .sort((a, b) => a - b);
      this.chosen.hidden = false;
      Object.assign(this.chosen.style, { left: `${from}px`, width: `${to - from}px`, height: `${this.inner.h}px` });
    };
    const over = new AbortController(), { signal } = over;
    const end = (e) => {
      over.abort();
      this.chosen.hidden = true;
      if (e.type === 'pointercancel' || moves || Math.abs(x(e) - begin) < 4) return;
      const share = (at) => Math.min(1, Math.max(0, (at - this.inner.x) / this.inner.w));
      const [from, to] = [begin, x(e)].map((at) => view[0] + share(at) * (view[1] - view[0])).sort((a, b) => a - b);
      this.on.look(from, to);
    };
    this.area.setPointerCapture(event.pointerId);
    this.area.addEventListener('pointermove', move, { signal });
    for (const kind of ['pointerup', 'pointercancel']) this.area.addEventListener(kind, end, { signal });
  }
}
