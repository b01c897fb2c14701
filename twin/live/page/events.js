// EMCY, faults and changes on purpose, markers, notes, health: a list, newest first, and a line of time.
import { byId, drawing, element } from './dom.js';
import { isNumber, rounded } from './format.js';

const most = 500;
const kinds = {
  emcy: ['▲', 'EMCY'], fault: ['✖', 'fault'], change: ['✚', 'change'], marker: ['◆', 'marker'],
  note: ['●', 'note'], health: ['■', 'health'],
};

export class Events {
  /// `show(time_s)`: asked for a look at that moment.
  constructor(show) {
    this.show = show;
    this.clear();
    new ResizeObserver(([{ contentRect }]) => { this.width = Math.floor(contentRect.width) || 320; })
      .observe(byId('timeline'));
  }

  clear() {
    this.all = [];
    this.drawn = '';
    byId('event_list').replaceChildren();
    byId('timeline').replaceChildren();
  }

  add(event) {
    this.all.push(event);
    if (this.all.length > most) this.all.shift();
    const [sign, name] = kinds[event.kind] ?? ['●', event.kind];
    const when = element('button', { type: 'button', className: 'time',
      title: `${event.time_s} s: show the histories then`, textContent: `${rounded(event.time_s, 's')} s`,
      onclick: () => this.show(event.time_s) });
    const row = element('li', { className: 'event' }, when,
      element('span', { className: 'kind', textContent: `${sign} ${name}` }),
      element('span', { textContent: `${event.joint ? event.joint + ': ' : ''}${event.text}` }));
    const list = byId('event_list');
    list.prepend(row);
    if (list.children.length > most) list.lastChild.remove();
  }

  within(from, to) {
    return this.all.filter((event) => isNumber(event.time_s) && event.time_s >= from && event.time_s <= to);
  }

  /// The line covers what the page keeps.
  draw(from, to) {
    const shown = this.within(from, to), step = (to - from) / 200;  // finer is not seen
    const width = this.width ?? 320;
    const key = [shown.length, Math.round(from / step), Math.round(to / step), width].join(' ');
    if (key === this.drawn || !(to > from)) return;
    this.drawn = key;
    const lanes = Object.keys(kinds).filter((kind) => this.all.some((event) => event.kind === kind));
    const height = 18 * Math.max(1, lanes.length) + 18, left = 74;
    const x = (t) => left + ((t - from) / (to - from)) * (width - left - 8);
    const words = (text, at) => { const made = drawing('text', at); made.textContent = text; return made; };
    const parts = lanes.flatMap((kind, i) => [words(kinds[kind].join(' '), { x: 0, y: 18 * i + 14 }),
      drawing('line', { x1: left, x2: width - 8, y1: 18 * i + 9, y2: 18 * i + 9, class: 'lane' })]);
    for (const event of shown) {
      const lane = lanes.indexOf(event.kind);
      if (lane < 0) continue;
      const at = { x: x(event.time_s), y: 18 * lane + 14, 'text-anchor': 'middle', class: 'sign' };
      const sign = words(kinds[event.kind][0], at);
      sign.append(drawing('title'));
      sign.lastChild.textContent = `${event.time_s} s ${event.joint ?? ''} ${event.text}`;
      parts.push(sign);
    }
    parts.push(words(`${rounded(from, 's')} s`, { x: left, y: height - 4 }),
      words(`${rounded(to, 's')} s`, { x: width - 8, y: height - 4, 'text-anchor': 'end' }));
    byId('timeline').replaceChildren(drawing('svg', { width, height, role: 'img',
      'aria-label': `${shown.length} events over the time that the page keeps` }, ...parts));
  }
}
