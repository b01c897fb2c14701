// What the buses carry: load, SYNC, answers to it, frames.
import { byId, drawing, element, grouped, setBar, setText } from './dom.js';
import { isNumber, number, rounded, showNumber } from './format.js';

const rows = [
  ['load', 'load_percent', '%'], ['SYNC period, median', 'sync_period_us.median', 'us'],
  ['SYNC period, 99 %', 'sync_period_us.p99', 'us'], ['SYNC period, largest', 'sync_period_us.max', 'us'],
  ['SYNC to TPDO, median', 'sync_to_tpdo_us.median', 'us'], ['SYNC to TPDO, 99 %', 'sync_to_tpdo_us.p99', 'us'],
  ['SYNC to TPDO, largest', 'sync_to_tpdo_us.max', 'us'], ['SYNCs', 'syncs', ''], ['frames in', 'frames_in', ''],
  ['frames out', 'frames_out', ''], ['frames lost', 'lost', ''], ['foreign frames', 'foreign', ''],
  ['bit rate', 'bit_rate', 'bit/s'],
];

// A bus may be called socketcand://127.0.0.1:29537/can0.
const placeOf = (name) => 'bus_' + name.replace(/[^\w-]+/g, '_');

const barsHeight = 96, digitWidth = 7.6;  // in a text of 12 px

class Bus {
  constructor(name) {
    this.name = name;
    this.values = rows.map(([label, key, unit]) => ({ key, unit, value: number(key), row: null, label }));
    for (const entry of this.values)
      entry.row = element('div', {}, element('dt', { textContent: entry.label }), element('dd', {}, entry.value));
    this.bar = element('span', { className: 'bar' });
    this.histogram = element('div', { className: 'histogram' });
    this.size = new ResizeObserver(([{ contentRect }]) => { this.width = Math.floor(contentRect.width) || 400; });
    this.size.observe(this.histogram);
    this.caption = element('figcaption');
    this.root = element('article', { className: 'card bus', id: placeOf(name), 'data-name': name },
      element('h2', { textContent: `Bus ${name}` }),
      element('div', { className: 'track', 'aria-hidden': 'true' }, this.bar),
      element('dl', {}, ...this.values.map((entry) => entry.row)),
      element('figure', {}, this.histogram, this.caption));
  }

  show(bus) {
    const flat = { ...bus, load_percent: isNumber(bus.load) ? 100 * bus.load : null };
    for (const { key, unit, value, row } of this.values) {
      const [first, second] = key.split('.');
      const shown = second ? flat[first]?.[second] : flat[first];
      row.hidden = !isNumber(shown);
      row.classList.toggle('bad', key === 'lost' && shown > 0);
      showNumber(value, shown, unit);
    }
    setBar(this.bar, bus.load);
    this.bar.parentElement.hidden = !isNumber(bus.load);
    this.showHistogram(bus.sync_to_tpdo_us?.histogram ?? []);
  }

  showHistogram(bins) {
    const width = this.width ?? 400, key = JSON.stringify([bins, width]);
    if (key === this.key) return;
    this.key = key;
    const most = Math.max(1, ...bins.map((bin) => bin[1]));
    const each = width / Math.max(1, bins.length);
    const bars = bins.map(([upper_us, count], i) => {
      const tall = count ? Math.max(1, (count / most) * (barsHeight - 6)) : 0;
      const wide = Math.max(0.5, each - 1);
      const bar = drawing('rect', { x: i * each + 0.5, y: barsHeight - tall, width: wide, height: tall });
      bar.classList.add('bin');
      const lower = i ? `from ${bins[i - 1][0]} ` : '';
      bar.append(drawing('title'));
      bar.firstChild.textContent = `${lower}${upper_us === null ? '' : `below ${upper_us} `}µs: ${count}`;
      return bar;
    });
    const height = barsHeight + 20;
    this.histogram.replaceChildren(drawing('svg', { width, height, viewBox: `0 0 ${width} ${height}`, role: 'img',
      'aria-label': 'Histogram of the time from SYNC to TPDO' },
    drawing('line', { x1: 0, x2: width, y1: barsHeight + 0.5, y2: barsHeight + 0.5 }), ...bars,
    ...this.edges(bins, each, width)));
    setText(this.caption, bins.length ? 'TPDOs over their time from SYNC, in bins that end at the values below them; ' +
      `the tallest has ${grouped(most)}` : 'no time from SYNC to TPDO yet');
  }

  /// Where bins end, as far as there is room; the last one always, with the unit.
  edges(bins, each, width) {
    const limits = bins.map(([limit], i) => ({ text: String(limit), limit, x: (i + 1) * each })).filter((edge) =>
      edge.limit !== null);
    if (limits.length) limits.at(-1).text += '\u00a0µs';
    const out = [];
    let free = width;
    for (const { text, x } of limits.reverse()) {
      const wide = text.length * digitWidth, from = Math.min(x - wide / 2, width - wide);
      if (from < 0 || from + wide > free) continue;
      free = from - 8;
      out.push(drawing('line', { x1: Math.min(x, width - 0.5), x2: Math.min(x, width - 0.5), y1: barsHeight,
        y2: barsHeight + 5 }), drawing('text', { x: from, y: barsHeight + 17, class: 'edge' }));
      out.at(-1).textContent = text;
    }
    return out;
  }
}

export class Buses {
  constructor() {
    this.buses = new Map();
    byId('buses').replaceChildren();
  }

  /// What is wrong with them, as [name, text, place].
  show(status) {
    const wrong = [];
    for (const bus of status?.buses ?? []) {
      if (!this.buses.has(bus.name)) {
        this.buses.set(bus.name, new Bus(bus.name));
        byId('buses').append(this.buses.get(bus.name).root);
      }
      this.buses.get(bus.name).show(bus);
      if (bus.lost > 0) wrong.push([bus.name, `${bus.lost} frames lost since the start`, placeOf(bus.name)]);
      if (bus.load >= 1) wrong.push([bus.name, `load ${rounded(100 * bus.load, '%')} %`, placeOf(bus.name)]);
    }
    return wrong;
  }
}
