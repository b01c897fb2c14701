// Friction over speed: the law at the present temperature, and the points as they come.
import { byId, element, setText, style } from './dom.js';
import { isNumber, number, showNumber } from './format.js';
import { plain, ticks } from './scale.js';

const pointsKept = 1500, perRow = 4;
const margin = { left: 62, right: 12, top: 10, bottom: 40 };

export class Friction {
  constructor(hello, ring, watch) {
    Object.assign(this, { hello, ring, watch, law: null, refusal: null });
    this.canvas = byId('friction_canvas');
    const said = this.said = { law: element('span'), temperature: number('law_degC'), load: number('law_load'),
      points: element('span') };
    said.where = element('span', {}, said.temperature, ' and load ', said.load,
      ' of the largest torque, dashes: backwards. ');
    byId('friction_text').replaceChildren(said.law, said.where, said.points);
    const select = byId('watched');
    const options = hello.joints.map(({ name }) => element('option', { value: name, textContent: name }));
    select.replaceChildren(...options);
    select.onchange = () => this.choose(select.value);
    this.size = new ResizeObserver(() => this.draw());
    this.size.observe(this.canvas);
  }

  choose(name) {
    byId('watched').value = name;
    this.joint = this.hello.joints.find((joint) => joint.name === name);
    const column = (quantity) => this.hello.columns.findIndex((c) => c.joint === name && c.name === quantity);
    this.velocity = column('velocity_rad_s');
    this.friction = column('friction_nm');
    this.law = this.refusal = null;
    this.watch(name);
  }

  accept(law) {
    if (law.joint === this.joint?.name) this.law = law;
  }

  /// Newest last. Speed is the motor's, as the law's; friction counts as positive where it brakes.
  points() {
    const { ring, joint, velocity, friction } = this, ratio = joint?.gear_ratio;
    if (!isNumber(ratio) || velocity < 0 || friction < 0) return [];
    const out = [];
    for (let i = Math.max(ring.begin, ring.end - pointsKept * perRow); i < ring.end; ++i) {
      const v = ring.at(i, velocity);
      if (i % perRow || !isNumber(v)) continue;
      out.push([Math.abs(v) * ratio, ring.at(i, friction) * (v < 0 ? -1 : 1)]);
    }
    return out;
  }

  draw() {
    const points = this.points();
    this.describe(points);
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight, scale = devicePixelRatio || 1;
    if (!width) return;
    if (this.canvas.width !== Math.round(width * scale)) this.canvas.width = Math.round(width * scale);
    if (this.canvas.height !== Math.round(height * scale)) this.canvas.height = Math.round(height * scale);
    const c = this.canvas.getContext('2d');
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, width, height);
    const curves = this.branches();
    const all = [...curves.flat(), ...points].filter(([x, y]) => isNumber(x) && isNumber(y));
    if (all.length === 0) return;
    const range = this.range(all);
    const x = (v) => margin.left + (v / range.x) * (width - margin.left - margin.right);
    const y = (f) => margin.top + (range.high - f) / (range.high - range.low) * (height - margin.top - margin.bottom);
    this.axes(c, { width, height, x, y, range });
    this.drawPoints(c, points, x, y);
    this.drawLaw(c, curves, x, y);
  }

  range(all) {
    const highest = Math.max(...all.map((p) => p[1])), lowest = Math.min(0, ...all.map((p) => p[1]));
    const room = 0.06 * (highest - lowest || 1);
    return { x: Math.max(1e-9, ...all.map((p) => p[0])), high: highest + room, low: lowest < 0 ? lowest - room : 0 };
  }

  axes(c, { width, height, x, y, range }) {
    c.font = `12px ${getComputedStyle(document.body).fontFamily}`;
    c.fillStyle = style('--soft');
    c.strokeStyle = style('--grid');
    c.lineWidth = 1;
    const bottom = height - margin.bottom;
    const line = (x1, y1, x2, y2) => {
      c.beginPath();
      c.moveTo(x1, y1);
      c.lineTo(x2, y2);
      c.stroke();
    };
    c.textAlign = 'center';
    for (const at of ticks(0, range.x, Math.max(2, width / 90))) {
      line(x(at), margin.top, x(at), bottom);
      c.fillText(plain(at), x(at), bottom + 16);
    }
    c.fillText('motor speed [rad/s]', (margin.left + width - margin.right) / 2, height - 6);
    c.textAlign = 'right';
    for (const at of ticks(range.low, range.high, 5)) {
      line(margin.left, y(at), width - margin.right, y(at));
      c.fillText(plain(at), margin.left - 6, y(at) + 4);
    }
    c.save();
    c.translate(13, (margin.top + bottom) / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = 'center';
    c.fillText('friction [Nm]', 0, 0);
    c.restore();
  }

  /// Old points are faint, the newest is a ring.
  drawPoints(c, points, x, y) {
    c.fillStyle = style('--line-1');
    points.forEach(([v, f], i) => {
      c.globalAlpha = 0.08 + 0.5 * (i / points.length) ** 2;
      c.fillRect(x(v) - 1.5, y(f) - 1.5, 3, 3);
    });
    c.globalAlpha = 1;
    const newest = points.at(-1);
    if (!newest) return;
    c.strokeStyle = style('--ink');
    c.lineWidth = 2;
    c.beginPath();
    c.arc(x(newest[0]), y(newest[1]), 5, 0, 7);
    c.stroke();
  }

  /// The law over the amount of the speed, forwards and backwards.
  branches() {
    if (!this.law) return [];
    const all = this.law.speed_rad_s.map((v, i) => [v, this.law.friction_nm[i]]);
    return [all.filter(([v]) => v >= 0), all.filter(([v]) => v <= 0).map(([v, f]) => [-v, f]).reverse()];
  }

  drawLaw(c, curves, x, y) {
    c.strokeStyle = style('--line-0');
    c.lineWidth = 2.2;
    curves.forEach((curve, backwards) => {
      c.setLineDash(backwards ? [5, 5] : []);
      c.beginPath();
      curve.forEach(([v, f], i) => (i ? c.lineTo(x(v), y(f)) : c.moveTo(x(v), y(f))));
      c.stroke();
    });
    c.setLineDash([]);
  }

  describe(points) {
    const { law, joint, refusal, said } = this;
    setText(said.law, law ? `Line: law ${joint.law ?? ''} at ` : refusal ? `No law: ${refusal}. `
      : 'The law has not come yet. ');
    said.where.hidden = !law;
    showNumber(said.temperature, law?.temperature_degC, 'degC');
    showNumber(said.load, law?.load_norm, 'share');
    setText(said.points, !joint?.gear_ratio ? 'No points: the program does not say the gear ratio.'
      : `Squares: the last ${points.length} of every ${perRow}th row, the newest in a circle; at rest friction may ` +
        'be anything up to breakaway.');
  }
}
