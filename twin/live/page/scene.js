// The robot in 3-D: drawn when something changed and can be seen, with housings in the colour of their temperature.
import { scaleAfter, viridis } from './colours.js';
import { byId, drawing, element, setText, style } from './dom.js';
import { isNumber, number, showNumber } from './format.js';
import { Orbit } from './orbit.js';
import { Robot } from './robot.js';

const fovy_deg = 34, filled = 1.06;
const mostPixels = 4e6, softwarePixels = 1e6;
const softwareEvery_ms = 100;  // a processor that draws has other work too

/// A context of WebGL on this canvas, or null.
function contextOf(canvas) {
  const wanted = { antialias: true, alpha: true, powerPreference: 'low-power' };
  return canvas.getContext('webgl2', wanted) ?? canvas.getContext('webgl', wanted);
}

function isSoftware(gl) {
  const more = gl.getExtension('WEBGL_debug_renderer_info');
  return /swiftshader|llvmpipe|softpipe|software/i.test(more ? gl.getParameter(more.UNMASKED_RENDERER_WEBGL) : '');
}

export class Scene {
  /// choose(joint): somebody picked it in the picture.
  constructor(choose) {
    Object.assign(this, { choose, robot: null, newest: null, selected: null, warmest: null, session: 0, drawings: 0 });
    this.wrong = new Map();
    this.values = new Map();
    this.labels = new Map();
    this.canvas = byId('scene_canvas');
    this.views = 0;  // that were asked for by hand
    this.retheme();
    const turned = () => {
      this.canvas.dataset.asked = ++this.views;
      this.dirty = true;
    };
    this.orbit = new Orbit(this.canvas, turned, (x, y) => this.pick(x, y));
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
      if (!this.renderer) await this.start();
      if (!this.renderer) return;
      const answer = await fetch('/geometry.json' + location.search);
      if (!answer.ok) throw new Error(`geometry.json: ${answer.status} ${answer.statusText}`);
      const geometry = await answer.json();
      if (session !== this.session) return;
      this.build(geometry);
    } catch (problem) {
      if (session === this.session) this.say(`The robot cannot be drawn: ${problem.message}`);
    }
  }

  async start() {
    const context = contextOf(this.canvas);
    if (!context) {
      byId('robot').classList.add('none');
      return this.say('This browser has no WebGL, so the robot is not drawn. All else works.');
    }
    await import('./three.min.js');
    const THREE = this.THREE = globalThis.THREE;
    this.software = isSoftware(context);
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, context, antialias: true, alpha: true });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(fovy_deg, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    const key = new THREE.DirectionalLight(0xffffff, 0.45), fill = new THREE.DirectionalLight(0xdfe8ff, 0.15);
    key.position.set(-0.42, -0.38, 1);
    fill.position.set(0.7, -0.5, 0.35);
    const head = this.head = new THREE.DirectionalLight(0xffffff, 0.35);  // comes with the eye
    this.scene.add(key, fill, head, head.target, new THREE.HemisphereLight(0xffffff, 0x9098a8, 0.5));
  }

  forget() {
    this.newest = this.scale = null;
    this.seenLast = {};
    if (!this.robot) return;
    this.scene.remove(this.robot.root);
    this.robot.dispose();
    this.forgetFloor();
    this.renderer.renderLists.dispose();
    this.robot = null;
    this.selected = this.warmest = null;
    for (const map of [this.wrong, this.values, this.labels]) map.clear();
    byId('scene_labels').replaceChildren();
    byId('scene_lines').replaceChildren();
  }

  forgetFloor() {
    if (!this.floor) return;
    this.scene.remove(this.floor);
    this.floor.geometry.dispose();
    this.floor.material.dispose();
    this.floor = null;
  }

  build(geometry) {
    this.robot = new Robot(this.THREE, geometry);
    this.scene.add(this.robot.root);
    this.eye = geometry.eye;
    this.framed = false;
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

  frame() {
    const box = this.robot.box(), { THREE } = this;
    if (box.isEmpty()) box.set(new THREE.Vector3(-0.5, -0.5, 0), new THREE.Vector3(0.5, 0.5, 1));
    const ball = box.getBoundingSphere(new THREE.Sphere());
    this.radius = Math.max(ball.radius, 1e-3);
    this.orbit.place(ball.center.toArray(), this.distance(box, ball.center), this.eye);
    this.forgetFloor();
    const size = 10 ** Math.ceil(Math.log10(this.radius)) / 2;
    const lines = 2 * Math.ceil(2.2 * this.radius / size * 5);
    this.floor = new THREE.GridHelper(lines * size / 5, lines);
    this.floor.rotateX(Math.PI / 2);
    this.floor.position.z = Math.min(0, box.min.z);
    this.retheme();
    this.scene.add(this.floor);
    this.framed = true;
  }

  /// From which all corners of the box are in the picture.
  distance(box, centre) {
    const { THREE, eye } = this, back = new THREE.Vector3(...eye).normalize();
    const right = new THREE.Vector3(0, 0, 1).cross(back).normalize(), up = back.clone().cross(right);
    const slope = Math.tan(this.camera.fov * Math.PI / 360);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new THREE.Vector3(box[i & 1 ? 'max' : 'min'].x,
      box[i & 2 ? 'max' : 'min'].y, box[i & 4 ? 'max' : 'min'].z).sub(centre));
    return filled * Math.max(...corners.map((corner) => corner.dot(back) + Math.max(
      Math.abs(corner.dot(right)) / (slope * this.camera.aspect), Math.abs(corner.dot(up)) / slope)));
  }

  /// The picture's own lines are as those of the page.
  retheme() {
    this.theme = { bad: style('--bad'), ink: style('--ink') };
    this.dirty = true;
    if (!this.floor) return;
    this.floor.material.vertexColors = 0;
    this.floor.material.color.set(style('--line'));
    this.floor.material.needsUpdate = true;
    this.mark();
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
      element('span', { textContent: mark.toFixed(digits).replace('-', '−') })));
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
    this.next = this.software ? now + softwareEvery_ms : 0;
    this.render();
  }

  render() {
    const { canvas, renderer, camera, orbit, robot } = this;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!robot || !this.newest || !width || !height) return;
    if (this.newest.bodies !== robot.bodies.length) return this.say('Poses of another robot came.');
    robot.pose(this.newest.values);
    this.resize(width, height);
    if (!this.framed) this.frame();
    camera.position.set(...orbit.eye());
    this.head.position.set(...orbit.eye());
    this.head.target.position.set(...orbit.target);
    camera.lookAt(...orbit.target);
    camera.near = Math.max(orbit.distance / 100, orbit.distance - 20 * this.radius);
    camera.far = orbit.distance + 20 * this.radius;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    renderer.render(this.scene, camera);
    this.placeLabels(width, height);
    this.dirty = false;
    Object.assign(canvas.dataset, { row: this.newest.row, drawings: ++this.drawings, view: this.views,
      geometries: renderer.info.memory.geometries });
  }

  /// A copy for paper: what WebGL has drawn is gone once it was shown.
  print() {
    this.render();
    const paper = byId('scene_print'), { width, height } = this.canvas;
    Object.assign(paper, { width, height });
    if (this.drawings) paper.getContext('2d').drawImage(this.canvas, 0, 0);
  }

  resize(width, height) {
    const most = this.software ? softwarePixels : mostPixels;
    const ratio = Math.min(devicePixelRatio || 1, Math.sqrt(most / (width * height)));
    if (this.size === `${width} ${height} ${ratio}`) return;
    this.size = `${width} ${height} ${ratio}`;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // What fits into a square fits into the picture, whichever side is longer.
    const half = Math.tan(fovy_deg * Math.PI / 360) / Math.min(1, width / height);
    this.camera.fov = 360 / Math.PI * Math.atan(half);
  }

  /// Those that matter beside their housings, none over another.
  placeLabels(width, height) {
    const all = byId('scene_names').ariaPressed === 'true', taken = [];
    const placed = [...this.labels].map(([joint, label]) => ({ joint, label, at: this.robot.middle(joint) }));
    for (const each of placed) {
      each.at?.project(this.camera);
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
    if (!this.robot || !this.framed) return;
    const { THREE, canvas } = this, ray = new THREE.Raycaster();
    ray.setFromCamera({ x: 2 * x / canvas.clientWidth - 1, y: 1 - 2 * y / canvas.clientHeight }, this.camera);
    const joint = ray.intersectObjects(this.robot.pickable)[0]?.object.userData.joint;
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
