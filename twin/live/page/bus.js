// What the buses carry: load, SYNC, answers to it, frames.
import { byId, drawing, element, grouped, setText } from './dom.js';
import { isNumber, number, rounded, showNumber } from './format.js';

const rows = [
  ['load', 'load_percent', '%'], ['SYNC period, median', 'sync_period_us.median', 'us'],
  ['SYNC period, 99 %', 'sync_period_us.p99', 'us'], ['SYNC period, largest', 'sync_period_us.max', 'us'],
  ['SYNC to TPDO, median', 'sync_to_tpdo_us.median', 'us'], ['SYNC to TPDO, 99 %', 'sync_to_tpdo_us.p99', 'us'],
  ['SYNC to TPDO, largest', 'sync_to_tpdo_us.max', 'us'], ['SYNCs', 'syncs', ''], ['frames in', 'frames_in', ''],
  ['frames out', 'frames_out', ''], ['frames lost', 'lost', ''], ['foreign frames', 'foreign', ''],
  ['bit rate', 'bit_rate', 'bit/s'],
];

class Bus {
  constructor(name) {
    this.name = name;
    this.values = rows.map(([label, key, unit]) => ({ key, unit, value: number(key), row: null, label }));
    for (const entry of this.values)
      entry.row = element('div', {}, element('dt', { textContent: entry.label }), element('dd', {}, entry.value));
    this.bar = element('span', { className: 'bar' });
    this.histogram = element('div', { className: 'histogram' });
    this.caption = element('figcaption');
    this.root = element('article', { className: 'card bus', id: 'bus_' + name },
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
    this.bar.style.width = `${Math.min(100, flat.load_percent ?? 0)}%`;
    this.showHistogram(bus.sync_to_tpdo_us?.histogram ?? []);
  }

  showHistogram(bins) {
    const key = JSON.stringify(bins);
    if (key === this.key) return;
    this.key = key;
    const most = Math.max(1, ...bins.map((bin) => bin[1]));
    const width = 400, height = 110, each = width / Math.max(1, bins.length);
    const bars = bins.map(([upper_us, count], i) => {
      const tall = count ? Math.max(1, (count / most) * (height - 18)) : 0;
      const wide = Math.max(0.5, each - 1);
      const bar = drawing('rect', { x: i * each + 0.5, y: height - tall, width: wide, height: tall });
      bar.classList.add('bin');
      const lower = i ? `from ${bins[i - 1][0]} ` : '';
      bar.append(drawing('title'));
      bar.firstChild.textContent = `${lower}${upper_us === null ? '' : `below ${upper_us} `}µs: ${count}`;
      return bar;
    });
    this.histogram.replaceChildren(drawing('svg', { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: 'none',
      role: 'img', 'aria-label': 'Histogram of the time from SYNC to TPDO' }, ...bars));
    const edges = bins.map((bin) => bin[0]).filter(isNumber);
    setText(this.caption, bins.length ? 'TPDOs over their time from SYNC [µs]: bins below ' +
      `${edges[0]} … ${edges.at(-1)} µs, tallest ${grouped(most)}` : 'no time from SYNC to TPDO yet');
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
      if (bus.lost > 0) wrong.push([bus.name, `${bus.lost} frames lost since the start`, 'bus_' + bus.name]);
      if (bus.load >= 1) wrong.push([bus.name, `load ${rounded(100 * bus.load, '%')} %`, 'bus_' + bus.name]);
    }
    return wrong;
  }
}
