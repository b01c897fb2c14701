// Histories of position, torque, friction and temperature: one time axis, one cursor, every row where it is zoomed in.
import { Chart } from './chart.js';
import { byId, drawing, element, grouped, setText } from './dom.js';
import { isNumber, number, rounded, showNumber, unitText } from './format.js';
import { keptBytes } from './rows.js';

const quantities = [
  ['position_rad', 'Position'], ['motor_torque_nm', 'Motor torque'], ['friction_nm', 'Friction'],
  ['temperature_degC', 'Temperature'], ['measured_nm', 'Measured torque'], ['predicted_nm', 'Predicted torque'],
  ['residual_nm', 'Residual'],
];
// With the dashes no two of eight joints look the same without colour.
const dashes = [null, [9, 4], [3, 3], [12, 3, 3, 3], [18, 5], [6, 3, 2, 3, 2, 3], [2, 6], [14, 3, 6, 3]];

// While rows still fill the window the picture grows in steps: it is drawn anew with each.
const firstView_s = 0.5, viewGrows = 1.3;

const clamped = (value, low, high) => Math.min(high, Math.max(low, value));

function swatch(i) {
  const line = drawing('line', { x1: 1, y1: 5, x2: 31, y2: 5, 'stroke-width': 2.5 });
  line.classList.add(`line-${i % 8}`);
  if (dashes[i % 8]) line.setAttribute('stroke-dasharray', dashes[i % 8].join(' '));
  return drawing('svg', { width: 32, height: 10, viewBox: '0 0 32 10', 'aria-hidden': 'true' }, line);
}

class Plot {
  constructor(plots, name, title, columns) {
    Object.assign(this, { plots, name, columns });
    this.unit = columns[0].unit;
    this.area = element('div', { className: 'area' });
    this.line = element('div', { className: 'cursor', hidden: true });
    this.readout = columns.map((column) => number(`${column.joint}.${name}`));
    this.legend = element('p', { className: 'readout' }, ...columns.map((column, i) => element('span',
      { className: 'value' }, swatch(column.series), ` ${column.joint} `, this.readout[i])));
    const caption = element('figcaption', {}, element('strong', { textContent: `${title} [${unitText(this.unit)}]` }),
      ' over time [s]');
    this.root = element('figure', { tabIndex: 0, className: 'history', 'aria-label': `${title} over time` });
    this.root.append(caption, element('div', { className: 'frame' }, this.area, this.line), this.legend);
    this.area.addEventListener('mousemove', (event) => this.point(event));
    this.area.addEventListener('mouseleave', () => plots.setCursor(null));
    this.root.addEventListener('keydown', (event) => plots.key(event));
    this.chart = new Chart(this.area, columns.map(({ index, series }) =>
      ({ index, colour: `--line-${series % 8}`, dash: dashes[series % 8] })), {
      look: (from, to) => plots.look(from, to), live: () => plots.live(),
      marks: (from, to) => plots.events.within(from, to).map((event) => event.time_s),
      limits: () => (name === 'residual_nm' && isNumber(plots.limit_nm) ? [-plots.limit_nm, plots.limit_nm] : []),
    });
    columns.forEach(({ joint }, at) => this.chart.show(at, plots.shown.has(joint)));
  }

  point(event) {
    const time = this.chart.time(event.clientX - this.area.getBoundingClientRect().left);
    if (time !== null) this.plots.setCursor(time);
  }

  showCursor(ring, row, chosen) {
    const x = chosen ? this.chart.place(ring.time(row)) : null;
    this.line.hidden = x === null;
    this.columns.forEach(({ index }, i) =>
      showNumber(this.readout[i], row < 0 ? null : ring.at(row, index), this.unit));
    if (x !== null) Object.assign(this.line.style, { left: `${x}px`, height: `${this.chart.inner.h}px` });
  }
}

export class Plots {
  constructor(hello, ring, events) {
    this.ring = ring;
    this.events = events;
    this.shown = new Set(hello.joints.map((joint) => joint.name));
    this.fixed = null;   // [from, to] of what is looked at; null follows the newest row
    this.cursor = null;  // time
    this.plots = [];
    const series = new Map(hello.joints.map((joint, i) => [joint.name, i]));
    for (const [name, title] of quantities) {
      const columns = hello.columns.map((column, index) => ({ ...column, index, series: series.get(column.joint) }))
        .filter((column) => column.name === name && column.series !== undefined);
      if (columns.length) this.plots.push(new Plot(this, name, title, columns));
    }
    byId('figures').replaceChildren(...this.plots.map((plot) => plot.root));
    byId('series').replaceChildren(...hello.joints.map((joint, i) => this.choice(joint.name, i)));
    this.size = new ResizeObserver(() => { this.dirty = true; });
    this.size.observe(byId('figures'));
    this.sight = new IntersectionObserver((changes) => {
      for (const { target, isIntersecting } of changes)
        this.plots.find((plot) => plot.root === target).seen = isIntersecting;
      this.dirty = true;
    });
    for (const plot of this.plots) this.sight.observe(plot.root);
    this.time = number('cursor_s');
    byId('cursor_time').replaceChildren(this.time);
    this.controls();
  }

  leave() {
    this.size.disconnect();
    this.sight.disconnect();
    for (const plot of this.plots) plot.chart.leave();
  }

  choice(name, i) {
    const box = element('input', { type: 'checkbox', checked: true });
    box.addEventListener('change', () => {
      this.shown[box.checked ? 'add' : 'delete'](name);
      for (const plot of this.plots)
        plot.columns.forEach((column, at) => column.joint === name && plot.chart.show(at, box.checked));
      this.dirty = true;
    });
    return element('label', {}, box, swatch(i), ' ' + name);
  }

  controls() {
    const on = (id, act) => { byId(id).onclick = act; };
    byId('window').onchange = () => this.live();
    on('hold', () => this.hold());
    on('now', () => this.live());
    on('earlier', () => this.move(-0.5));
    on('later', () => this.move(0.5));
    on('zoom_in', () => this.zoom(0.5));
    on('zoom_out', () => this.zoom(2));
    this.live();
  }

  /// How far back the ring reaches once it is full, at the rate of the rows that are in it.
  showKept() {
    const { ring } = this, rows = ring.last - ring.begin;
    const each_s = rows > 0 ? (ring.time(ring.last) - ring.time(ring.begin)) / rows : 0;
    const minutes = each_s > 0 ? `, ${rounded(ring.capacity * each_s / 60, 'min')} min at the rate of now` : '';
    setText(byId('kept'), `This page keeps the last ${grouped(ring.capacity)} rows of ${ring.columns} numbers ` +
      `(${keptBytes / 2 ** 20} MiB)${minutes}; older ones are forgotten. Lines: every row where they fit, else ` +
      'smallest and largest of each stretch.');
  }

  retheme() {
    for (const plot of this.plots) plot.chart.retheme();
    this.draw(true);
  }

  live() {
    this.fixed = null;
    this.dirty = true;
    this.tell();
  }

  hold() {
    if (this.fixed) return this.live();
    this.look(...this.view());
  }

  look(from, to) {
    if (!(to > from)) return;
    this.fixed = [from, to];
    this.dirty = true;
    this.tell();
  }

  tell() {
    const at = this.fixed;
    byId('hold').setAttribute('aria-pressed', String(at !== null));
    setText(byId('hold'), at ? 'Go on' : 'Hold');
    setText(byId('view'), at ? `held: ${rounded(at[0], 's')} s to ${rounded(at[1], 's')} s, while rows still come in`
      : 'following the newest row');
    byId('plots').classList.toggle('held', at !== null);
  }

  view() {
    if (this.fixed) return this.fixed;
    const { ring } = this;
    if (ring.last < 0) return [0, 1];
    const to = ring.time(ring.last), oldest = ring.time(ring.begin), window_s = Number(byId('window').value);
    const grown_s = firstView_s * viewGrows ** Math.ceil(Math.log((to - oldest) / firstView_s) / Math.log(viewGrows));
    const length_s = Math.min(window_s > 0 ? window_s : Infinity, Math.max(firstView_s, grown_s));
    const from = ring.begin === 0 ? Math.max(oldest, to - length_s) : to - length_s;
    return [from, from + length_s];
  }

  move(share) {
    const [from, to] = this.view(), by = share * (to - from);
    this.look(from + by, to + by);
  }

  zoom(factor) {
    const [from, to] = this.view(), middle = this.cursor ?? (from + to) / 2;
    this.look(middle - factor * (middle - from), middle + factor * (to - middle));
  }

  /// An event came: it is a mark.
  mark() {
    for (const plot of this.plots) plot.chart.stale = true;
    this.dirty = true;
  }

  setCursor(time_s) {
    this.cursor = time_s;
    this.showCursor();
  }

  showCursor() {
    const { ring } = this;
    const chosen = isNumber(this.cursor) ? ring.nearest(this.cursor) : -1;
    const row = chosen >= 0 ? chosen : ring.last;
    for (const plot of this.plots) plot.showCursor(ring, row, chosen >= 0);
    setText(byId('cursor_kind'), chosen >= 0 ? 'cursor at ' : 'newest at ');
    showNumber(this.time, row < 0 ? null : ring.time(row), 's');
    this.time.dataset.row = row < 0 ? '' : ring.number(row);
  }

  key(event) {
    const { ring } = this;
    const [from, to] = this.view();
    const row = this.cursor === null ? ring.nearest(to) : ring.nearest(this.cursor);
    if (row < 0 || event.ctrlKey || event.altKey || event.metaKey) return;
    const steps = { ArrowLeft: -1, ArrowRight: 1 }, edges = { Home: from, End: to };
    if (event.key in edges) this.setCursor(edges[event.key]);
    else if (event.key in steps && event.shiftKey) this.setCursor(ring.time(row) + steps[event.key] * (to - from) / 10);
    else if (event.key in steps) this.setCursor(ring.time(clamped(row + steps[event.key], ring.begin, ring.last)));
    else return;
    if (!this.fixed) this.look(from, to);
    event.preventDefault();
  }

  /// `all`: also what is not in sight.
  draw(all = false) {
    const { ring } = this;
    if (ring.last < 0) return;
    const [from, to] = this.view();
    const first = Math.max(ring.begin, ring.find(from) - 1), last = Math.min(ring.end, ring.find(to) + 1);
    for (const plot of this.plots) if (plot.seen || all) plot.chart.draw(ring, first, last, from, to);
    this.dirty = false;
    byId('figures').dataset.row = ring.number(ring.last);
  }
}
