// The robot in 3-D: drawn when something changed and can be seen, with housings in the colour of their temperature.
import { scaleAfter, viridis } from './colours.js';
import { byId, drawing, element, setText, style } from './dom.js';
import { isNumber, number, showNumber } from './format.js';
import { View } from './view.js';

const softwareEvery_ms = 100;  // a processor that draws has other work too

export class Scene {
  /// choose(joint): somebody picked it in the picture.
  constructor(choose) {
    Object.assign(this, { choose, newest: null, selected: null, warmest: null, session: 0, drawings: 0 });
    this.wrong = new Map();
    this.values = new Map();
    this.labels = new Map();
    this.canvas = byId('scene_canvas');
    this.views = 0;  // that were asked for by hand
    const turned = () => {
      this.canvas.dataset.asked = ++this.views;
      this.dirty = true;
    };
    this.view = new View(this.canvas, turned, (x, y) => this.pick(x, y));
    this.orbit = this.view.orbit;
    this.retheme();
    this.canvas.addEventListener('keydown', (event) => this.key(event));
    this.canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      this.say('The graphics of this computer gave up; the picture comes back when they do.');
    });
    this.canvas.addEventListener('webglcontextrestored', () => this.say(''));
    byId('scene_in').onclick = () => this.orbit.zoom(0.75);
    byId('scene_out').onclick = () => this.orbit.zoom(1 / 0.75);
    byId('scene_home').onclick = () => this.orbit.reset();
    byId('scene_names').onclick = ({ currentTarget: button }) => {
      button.ariaPressed = String(button.ariaPressed !== 'true');
      this.dirty = true;
    };
    new ResizeObserver(() => { this.dirty = true; }).observe(this.canvas);
    new IntersectionObserver((seen) => { this.seen = seen.at(-1).isIntersecting; }).observe(this.canvas);
  }

  get robot() { return this.view.robot; }

  say(text) {
    setText(byId('scene_problem'), text);
    byId('scene_problem').hidden = !text;
    this.dirty = true;
  }

  /// The robot of this hello; that of another one is forgotten, with all that the graphics hold of it.
  async begin(hello) {
    const session = ++this.session;
    this.forget();
    this.joints = hello.joints.map((joint) => joint.name);
    byId('robot').hidden = !(hello.bodies > 0);
    if (!(hello.bodies > 0)) return;
    try {
      if (!this.view.renderer && !(await this.start())) return;
      const answer = await fetch('/geometry.json' + location.search);
      if (!answer.ok) throw new Error(`geometry.json: ${answer.status} ${answer.statusText}`);
      const geometry = await answer.json();
      if (session !== this.session) return;
      this.build(geometry);
    } catch (problem) {
      if (session === this.session) this.say(`The robot cannot be drawn: ${problem.message}`);
    }
  }

  /// False where the browser has no WebGL.
  async start() {
    if (await this.view.start(() => import('./three.min.js').then(() => globalThis.THREE))) return true;
    byId('robot').classList.add('none');
    this.say('This browser has no WebGL, so the robot is not drawn. All else works.');
    return false;
  }

  forget() {
    this.newest = this.scale = null;
    this.seenLast = {};
    if (!this.robot) return;
    this.view.forget();
    this.selected = this.warmest = null;
    for (const map of [this.wrong, this.values, this.labels]) map.clear();
    byId('scene_labels').replaceChildren();
    byId('scene_lines').replaceChildren();
  }

  build(geometry) {
    this.view.build(geometry);
    for (const joint of this.joints) this.label(joint);
    const simpler = geometry.meshes.filter((mesh) => mesh.faces.length / 3 < mesh.faces_of_model).length;
    const notes = [simpler && `${simpler} of ${geometry.meshes.length} meshes are drawn simplified`,
      geometry.left_out && `shapes of the model that are not drawn: ${geometry.left_out}`];
    setText(byId('scene_notes'), notes.filter(Boolean).map((note) => '; ' + note).join(''));
    this.say('');
    this.colour();
    this.mark();
  }

  /// Beside a joint: its name and what is to be said of it, with a line to its housing.
  label(joint) {
    const text = { before: element('span'), degC: number('temperature_degC'), after: element('span') };
    const line = drawing('line');
    const box = element('button', { type: 'button', className: 'scene_label', 'data-joint': joint, hidden: true,
      tabIndex: -1, onclick: () => this.choose(joint) }, ...Object.values(text));
    byId('scene_labels').append(box);
    byId('scene_lines').append(line);
    this.labels.set(joint, { box, text, line });
  }

  poses(message) {
    this.newest = message;
    this.dirty = true;
  }

  /// The picture's own lines are as those of the page.
  retheme() {
    this.theme = { bad: style('--bad'), ink: style('--ink') };
    this.dirty = true;
    this.view.rule(style('--line'));
    if (this.robot) this.mark();
  }

  /// value(joint, name): the newest one. wrong: [joint, what] of all that is.
  show(value, wrong, warmest) {
    if (!this.robot) return;
    this.warmest = warmest;
    this.values = new Map(this.joints.map((joint) => [joint, value(joint, 'temperature_degC')]));
    this.wrong = new Map(wrong.filter(([where]) => this.joints.includes(where)));
    this.colour();
    this.mark();
  }

  select(joint) {
    this.selected = joint;
    this.mark();
  }

  colour() {
    const known = [...this.values.values()].filter(isNumber);
    const scale = this.scale = scaleAfter(this.scale, known);
    const colours = this.joints.map((joint) => this.values.get(joint)).map((at) =>
      (isNumber(at) ? viridis((at - scale.from) / (scale.to - scale.from)) : null));
    if (this.changed('colours', colours))
      this.joints.forEach((joint, i) => this.robot.colour(joint, colours[i]));
    const key = scale.marks.join(' ');
    if (byId('scene_marks').dataset.key === key) return;
    byId('scene_marks').dataset.key = key;
    const digits = scale.marks[1] - scale.marks[0] < 1 ? 1 : 0;
    byId('scene_marks').replaceChildren(...scale.marks.map((mark) =>
      element('span', { textContent: mark.toFixed(digits) })));
  }

  /// Whether it is another one than at the last time: then the picture is drawn anew.
  changed(what, value) {
    const key = JSON.stringify(value), other = this.seenLast[what] !== key;
    this.seenLast[what] = key;
    this.dirty ||= other;
    return other;
  }

  mark() {
    const { bad, ink } = this.theme;
    const other = this.changed('marks', [[...this.wrong.keys()], this.selected, this.warmest, bad, ink]);
    for (const [joint, { box, text }] of this.labels) {
      const wrong = this.wrong.has(joint), selected = this.selected === joint, warmest = this.warmest === joint;
      if (other) this.robot.mark(joint, wrong ? bad : selected ? ink : null);
      setText(text.before, `${wrong ? '✖ ' : ''}${joint} `);
      showNumber(text.degC, this.values.get(joint), 'degC');
      setText(text.after, warmest ? ' warmest' : '');
      box.title = wrong ? this.wrong.get(joint) : '';
      for (const [name, on] of Object.entries({ wrong, selected, warmest })) box.classList.toggle(name, on);
    }
  }

  /// To be called with every picture of the browser.
  draw(now) {
    if (!this.dirty || document.hidden || !this.seen || now < (this.next ?? 0)) return;
    this.next = this.view.software ? now + softwareEvery_ms : 0;
    this.render();
  }

  render() {
    const { canvas, view, robot } = this;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!robot || !this.newest || !width || !height) return;
    if (this.newest.bodies !== robot.bodies.length) return this.say('Poses of another robot came.');
    view.draw(this.newest.values, width, height);
    this.placeLabels(width, height);
    this.dirty = false;
    Object.assign(canvas.dataset, { row: this.newest.row, drawings: ++this.drawings, view: this.views,
      geometries: view.renderer.info.memory.geometries });
  }

  /// A copy for paper: what WebGL has drawn is gone once it was shown.
  print() {
    this.render();
    const paper = byId('scene_print'), { width, height } = this.canvas;
    Object.assign(paper, { width, height });
    if (this.drawings) paper.getContext('2d').drawImage(this.canvas, 0, 0);
  }

  /// Those that matter beside their housings, none over another.
  placeLabels(width, height) {
    const all = byId('scene_names').ariaPressed === 'true', taken = [];
    const placed = [...this.labels].map(([joint, label]) => ({ joint, label, at: this.robot.middle(joint) }));
    for (const each of placed) {
      each.at?.project(this.view.camera);
      const matters = all || this.wrong.has(each.joint) || [this.warmest, this.selected].includes(each.joint);
      each.shown = Boolean(each.at) && matters && Math.abs(each.at.z) <= 1;
      each.label.box.hidden = !each.shown;
      each.label.line.style.display = each.shown ? '' : 'none';
    }
    for (const { label: { box, line }, at } of placed.filter((each) => each.shown).sort((a, b) => b.at.y - a.at.y)) {
      const x = (at.x + 1) / 2 * width, y = (1 - at.y) / 2 * height, w = box.offsetWidth, h = box.offsetHeight;
      const crowd = taken.reduce((sum, t) => sum + (t.onLeft ? 1 : -1), 0);  // on the left, above that on the right
      const onLeft = x + 28 + w > width || (x - 28 - w > 0 && (x < width / 2 ? crowd < 2 : crowd < -1));
      const left = Math.min(width - w - 4, Math.max(4, onLeft ? x - w - 28 : x + 28));
      let top = Math.min(height - h - 4, Math.max(4, y - h / 2));
      const over = () => taken.find((t) => left < t.left + t.w + 4 && t.left < left + w + 4 &&
        top < t.top + t.h + 4 && t.top < top + h + 4);
      for (let tries = 0, hit; tries < 20 && (hit = over()); ++tries) top = hit.top + hit.h + 5;
      taken.push({ left, top, w, h, onLeft });
      Object.assign(box.style, { left: `${left}px`, top: `${top}px` });
      const ends = { x1: x, y1: y, x2: left < x ? Math.min(x, left + w) : left, y2: top + h / 2 };
      for (const [name, value] of Object.entries(ends)) line.setAttribute(name, value.toFixed(1));
    }
  }

  /// The joint of the part at this place of the picture.
  pick(x, y) {
    const joint = this.robot && this.view.framed ? this.view.pick(x, y) : null;
    if (joint && this.joints.includes(joint)) this.choose(joint);
  }

  key(event) {
    const by = { n: 1, p: -1 }[event.key];
    if (!by || !this.joints || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    const count = this.joints.length, now = this.joints.indexOf(this.selected);
    this.choose(this.joints[now < 0 ? 0 : (now + by + count) % count]);
  }
}
