// Where the eye is: turned, moved and brought nearer by mouse, touch and keyboard.

const turn = 0.008, keyTurn = 5 * Math.PI / 180, keyMove = 0.04, keyZoom = 0.85, click_px = 4;
const highest = Math.PI / 2 - 0.01;

/// An eye at `distance` from `target` (z is up), seen from azimuth and elevation [rad].
export class Orbit {
  /// changed(): something moved; clicked(x, y): of the element, in pixels.
  constructor(element, changed, clicked) {
    Object.assign(this, { element, changed, clicked });
    this.target = [0, 0, 0];
    this.pointers = new Map();
    this.place([0, 0, 0], 1, [1, -1, 0.5]);
    element.addEventListener('pointerdown', (event) => this.down(event));
    element.addEventListener('pointermove', (event) => this.move(event));
    for (const end of ['pointerup', 'pointercancel'])
      element.addEventListener(end, (event) => this.up(event));
    element.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    element.addEventListener('contextmenu', (event) => event.preventDefault());
    element.addEventListener('keydown', (event) => this.key(event));
  }

  /// The place to which `reset` comes back.
  place(target, distance, direction) {
    this.home = { target, distance, azimuth: Math.atan2(direction[1], direction[0]),
      elevation: Math.asin(direction[2] / Math.hypot(...direction)) };
    this.reset();
  }

  reset() {
    Object.assign(this, this.home, { target: [...this.home.target] });
    this.changed();
  }

  eye() {
    const { target, distance, azimuth: a, elevation: e } = this;
    return [target[0] + distance * Math.cos(e) * Math.cos(a), target[1] + distance * Math.cos(e) * Math.sin(a),
      target[2] + distance * Math.sin(e)];
  }

  rotate(right, up) {
    this.azimuth -= right;
    this.elevation = Math.min(highest, Math.max(-highest, this.elevation + up));
    this.changed();
  }

  zoom(factor) {
    const { distance } = this.home;
    this.distance = Math.min(20 * distance, Math.max(0.02 * distance, this.distance * factor));
    this.changed();
  }

  /// By shares of the distance, in the plane of the picture.
  pan(right, up) {
    const { distance, azimuth: a, elevation: e } = this;
    const axes = [[-Math.sin(a), Math.cos(a), 0],
      [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)]];
    for (let k = 0; k < 3; ++k) this.target[k] += distance * (right * axes[0][k] + up * axes[1][k]);
    this.changed();
  }

  down(event) {
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.moved = this.pointers.size > 1 ? Infinity : 0;
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    const now = [event.clientX, event.clientY], by = [now[0] - before[0], now[1] - before[1]];
    this.pointers.set(event.pointerId, now);
    this.moved += Math.abs(by[0]) + Math.abs(by[1]);
    const share = 0.7 / this.element.clientHeight;
    if (others.length) {
      const apart = (place) => Math.max(10, Math.hypot(place[0] - others[0][0], place[1] - others[0][1]));
      this.zoom(apart(before) / apart(now));
      this.pan(-by[0] * share / 2, by[1] * share / 2);
    } else if (event.buttons & 6 || event.shiftKey) this.pan(-by[0] * share, by[1] * share);
    else this.rotate(by[0] * turn, by[1] * turn);
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId) || event.type !== 'pointerup' || this.moved > click_px) return;
    const box = this.element.getBoundingClientRect();
    if (event.button === 0) this.clicked(event.clientX - box.left, event.clientY - box.top);
  }

  /// The page scrolls until the picture was taken hold of.
  wheel(event) {
    if (document.activeElement !== this.element && !event.ctrlKey) return;
    event.preventDefault();
    this.zoom(Math.exp(Math.min(0.4, Math.max(-0.4, event.deltaY * (event.deltaMode ? 0.05 : 0.0015)))));
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (way && event.shiftKey) this.pan(way[0] * keyMove, way[1] * keyMove);
    else if (way) this.rotate(-way[0] * keyTurn, way[1] * keyTurn);
    else if (event.key === '+') this.zoom(keyZoom);
    else if (event.key === '-') this.zoom(1 / keyZoom);
    else if (event.key === 'Home') this.reset();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
