// What if: sliders that move curves. Their values come from our own kernel, compiled for the browser (kernel.cc).
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

/// A law over speed at another temperature and load, with its band where the page knows how sure the law is.
class LawCurve {
  constructor({ chart, kernel, numbers: [law, uncertainty], label }) {
    Object.assign(this, { chart, kernel, label });
    const { series } = chart.data;
    this.moved = series.findIndex(({ mark }) => mark === 'line');
    this.band = series.findIndex(({ mark }) => mark === 'band');
    new Uint8Array(kernel.memory.buffer, kernel.law_numbers(), kernel.law_size()).set(bytes(law));
    if (uncertainty)
      new Uint8Array(kernel.memory.buffer, kernel.uncertainty_numbers(), kernel.uncertainty_size())
        .set(bytes(uncertainty));
  }

  move(temperature, load) {
    const { chart, moved, band, kernel } = this, { series } = chart.data, { x } = series[moved];
    const y = x.map((v) => kernel.friction_level(v, load, temperature));
    const curves = [[moved, y, this.label()]];
    if (band >= 0) {
      const half = x.map((v) => kernel.friction_half_width(v, load, temperature));
      const low = y.map((at, k) => Math.max(0, at - half[k]));
      curves.push([band, [...y.map((at, k) => at + half[k]), ...low.reverse()], series[band].label]);
    }
    chart.change(curves);
  }
}

/// Joints of a run over time at another ambient temperature, and with more standing still.
class WarmUp {
  constructor({ chart, kernel, numbers, more }) {
    Object.assign(this, { chart, kernel, more, joints: numbers.map(bytes) });
    this.said = node('p', { class: 'live soft', role: 'status' });
    chart.area.after(this.said);
  }

  move(ambient, standing) {
    const { chart, kernel, more } = this, ends = [], outside = [];
    const curves = this.joints.map((numbers, i) => {
      new Uint8Array(kernel.memory.buffer, kernel.warm_up_numbers(), kernel.warm_up_size()).set(numbers);
      const { name, recorded, low, high } = more.joints[i];
      kernel.warm_up_begin(ambient, standing);
      const y = more.cycles.map((cycles) => kernel.warm_up_work(cycles));
      ends.push(`${name} ${y.at(-1).toFixed(1)}\u00a0°C (${recorded.toFixed(1)}\u00a0°C)`);
      if (y.some((at) => at < (low ?? -Infinity))) outside.push(`${name} below ${low}\u00a0°C`);
      if (y.some((at) => at > (high ?? Infinity))) outside.push(`${name} above ${high}\u00a0°C`);
      return [i, y, name];
    });
    chart.change(curves);
    this.said.textContent = `At the end (in the run): ${ends.join(', ')}.` +
      (outside.length ? ` Where nobody measured the law: ${outside.join(', ')}.` : '');
  }
}

const moves = { law: LawCurve, 'warm-up': WarmUp };

class WhatIf {
  constructor(chart, kernel) {
    const { kind, sliders, numbers, more } = JSON.parse(chart.figure.dataset.whatIf);
    this.sliders = sliders;
    const chosen = sliders.filter(({ from, to }) => from < to);
    const label = () => chosen.map((s) => (s.unit ? '' : s.name + ' ') + this.text(s)).join(', ');
    this.curve = new moves[kind]({ chart, kernel, numbers, more, label });
    chart.area.before(node('div', { class: 'live sliders' }, ...chosen.map((slider) => this.slider(slider))));
    this.move();
  }

  text({ value, unit, decimals }) {
    return value.toFixed(decimals) + (unit && ' ' + unit);
  }

  slider(slider) {
    const range = node('input', { type: 'range', min: slider.from, max: slider.to, step: 'any' });
    const shown = node('output', {}, this.text(slider));
    range.value = slider.value;
    range.addEventListener('input', () => {
      slider.value = Number(range.value);
      shown.textContent = this.text(slider);
      this.move();
    });
    return node('label', {}, node('span', {}, slider.name), range, shown);
  }

  move() {
    this.curve.move(...this.sliders.map(({ value }) => value));
  }
}

for (const chart of charts) {
  const { kernel } = chart.figure.dataset;
  if (kernel) WebAssembly.instantiate(bytes(kernel)).then(({ instance }) => new WhatIf(chart, instance.exports));
}
