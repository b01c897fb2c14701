// The robot of a run in 3-D, with a slider over time. It and three.js are unpacked when the figure comes into sight;
// where the browser cannot unpack or has no WebGL, there is no such figure.
const inflated = (text) => new Response(
  new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream('deflate'))).text();

/// three.js, which the page carries once. The page's policy names the hash of its text.
async function loadThree() {
  const library = node('script', {}, await inflated(document.querySelector('[data-three]').dataset.three));
  document.head.append(library);  // is run here
  library.remove();
  return globalThis.THREE;
}

class RobotFigure {
  constructor(figure) {
    this.figure = figure;
    this.canvas = node('canvas', { tabindex: 0, role: 'img',
      'aria-label': 'The robot in 3-D. Arrows turn it, + and − zoom' });
    this.range = node('input', { type: 'range', min: 0, max: 0, step: 1, disabled: '' });
    this.range.addEventListener('input', () => this.show());
    this.time = node('output');
    this.degC = node('p', { class: 'live soft', role: 'status' });
    this.bar = node('div', { class: 'live bar' });
    figure.prepend(node('div', { class: 'alive' },
      node('div', { class: 'live head' }, node('strong', {}, 'The robot over the run'), this.tools()),
      this.canvas, node('div', { class: 'live sliders' }, node('label', {}, node('span', {}, 'time'), this.range,
        this.time)), this.degC, this.bar));
    this.view = new View(this.canvas, () => this.changed(), (x, y) => this.pick(x, y));
    this.canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    this.canvas.addEventListener('webglcontextrestored', () => this.changed());
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.changed());
    new ResizeObserver(() => this.changed()).observe(this.canvas);
    figure.hidden = false;
    const sight = new IntersectionObserver((seen) => {
      if (!seen.at(-1).isIntersecting) return;
      sight.disconnect();
      this.load();
    }, { rootMargin: '200px' });
    sight.observe(this.canvas);
  }

  tools() {
    const tool = (text, name, act) => {
      const button = node('button', { type: 'button', 'aria-label': name, title: name }, text);
      button.onclick = act;
      return button;
    };
    return node('span', { class: 'tools' }, tool('+', 'Nearer', () => this.view.orbit.zoom(0.75)),
      tool('−', 'Farther', () => this.view.orbit.zoom(1 / 0.75)),
      tool('↺', 'All of it', () => this.view.orbit.reset()));
  }

  async load() {
    const { geometry, joints, scale, moments } = JSON.parse(await inflated(this.figure.dataset.robot));
    if (!(await this.view.start(loadThree))) {
      this.figure.hidden = true;
      return;
    }
    for (const moment of moments) moment.pose = Float32Array.from(moment.pose);
    Object.assign(this, { joints, scale, moments });
    this.view.build(geometry);
    this.colourBar();
    Object.assign(this.range, { max: moments.length - 1, value: moments.length - 1, disabled: false });
    this.show();
  }

  colourBar() {
    const [from, to] = this.scale, stops = Array.from({ length: 33 }, (_, k) => `rgb(${viridis(k / 32)})`);
    const strip = node('div', { class: 'strip' }), marks = node('div', { class: 'marks', 'aria-hidden': 'true' });
    strip.style.background = `linear-gradient(90deg, ${stops.join(', ')})`;
    for (const at of ticks(from, to, 6)) {
      const mark = node('span', {}, plain(at));
      mark.style.setProperty('--at', (at - from) / (to - from));
      marks.append(mark);
    }
    this.bar.append(strip, marks, node('div', { class: 'soft' }, 'lubricant temperature [°C]'));
  }

  /// The moment under the slider: its own time, temperatures and pose.
  show() {
    const { time, degC } = this.moments[this.range.value], [from, to] = this.scale;
    this.time.textContent = time;
    this.range.setAttribute('aria-valuetext', time);
    const ink = getComputedStyle(this.figure).color, said = [];
    this.joints.forEach((joint, i) => {
      const { robot } = this.view, known = degC[i] !== null, chosen = joint === this.chosen;
      robot.colour(joint, known ? viridis((degC[i] - from) / (to - from)) : null);
      robot.mark(joint, chosen ? ink : null);
      const text = known ? `${joint}\u00a0${degC[i].toFixed(1)}\u00a0°C` : `${joint}: no temperature`;
      if (known || chosen) said.push(' · ', chosen ? node('strong', {}, text) : text);
    });
    this.degC.replaceChildren(...said.slice(1));
    this.changed();
  }

  /// The joint that moves a part gets a rim, and its name stands out, until the next click.
  pick(x, y) {
    if (!this.moments) return;
    const joint = this.view.pick(x, y);
    this.chosen = joint === this.chosen ? null : joint;
    this.show();
  }

  /// Once per picture of the browser.
  changed() {
    if (this.moments) this.asked ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.asked = null;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.view.rule(getComputedStyle(this.figure).borderTopColor);
    this.view.draw(this.moments[this.range.value].pose, width, height, this.moments.map(({ pose }) => pose));
    this.canvas.dataset.shown = this.range.value;
  }
}

if (globalThis.DecompressionStream && globalThis.WebGLRenderingContext)
  for (const figure of document.querySelectorAll('figure[data-robot]')) new RobotFigure(figure);
