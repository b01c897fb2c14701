// What if: sliders that move a curve. Its values come from our own kernel, compiled for the browser (kernel.cc).
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

class WhatIf {
  constructor(chart, kernel) {
    const { figure } = chart, { law, inputs } = figure.dataset;
    Object.assign(this, { chart, kernel, inputs: JSON.parse(inputs) });
    this.moved = chart.data.series.findIndex(({ mark }) => mark === 'line');
    new Uint8Array(kernel.memory.buffer, kernel.law_numbers(), kernel.law_size()).set(bytes(law));
    const chosen = this.inputs.filter(({ from, to }) => from < to);
    chart.area.before(node('div', { class: 'live sliders' }, ...chosen.map((input) => this.slider(input))));
    this.move();
  }

  text({ value, unit, decimals }) {
    return value.toFixed(decimals) + (unit && ' ' + unit);
  }

  slider(input) {
    const range = node('input', { type: 'range', min: input.from, max: input.to, step: 'any' });
    const shown = node('output', {}, this.text(input));
    range.value = input.value;
    range.addEventListener('input', () => {
      input.value = Number(range.value);
      shown.textContent = this.text(input);
      this.move();
    });
    return node('label', {}, node('span', {}, input.name), range, shown);
  }

  move() {
    const { chart, moved, kernel } = this, [temperature, load] = this.inputs;
    const y = chart.data.series[moved].x.map((v) => kernel.friction_level(v, load.value, temperature.value));
    const label = this.inputs.filter(({ from, to }) => from < to)
      .map((input) => (input.unit ? '' : input.name + ' ') + this.text(input)).join(', ');
    chart.change(moved, y, label);
  }
}

for (const chart of charts) {
  const { kernel } = chart.figure.dataset;
  if (kernel) WebAssembly.instantiate(bytes(kernel)).then(({ instance }) => new WhatIf(chart, instance.exports));
}
