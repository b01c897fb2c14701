// The live bench: joins the connection with what is shown.
import { Acting } from './acting.js';
import { Buses } from './bus.js';
import { Connection } from './connection.js';
import { byId, setText } from './dom.js';
import { Events } from './events.js';
import { number, showDuration, showNumber } from './format.js';
import { Friction } from './friction.js';
import { Plots } from './plots.js';
import { Ring } from './rows.js';
import { Scene } from './scene.js';
import { Tiles, showWrong } from './tiles.js';

const textEvery_ms = 100;  // faster, nobody reads numbers
const drawingShare = 2;    // of the time at most half goes into drawing

const page = { hello: null, status: null, link: { up: false, text: 'connecting' }, problem: null };
page.scene = new Scene((joint) => choose(joint));
const counts = { rows: number('rows'), lost: number('rows_lost'), events: number('events_lost') };
const clocks = { simulated: number('simulated_s'), wall: number('wall_s') };

/// A hello of another session, or of other columns, begins anew; that of the same session goes on.
function begin(hello) {
  const same = page.hello && page.hello.session === hello.session &&
    JSON.stringify(page.hello.columns) === JSON.stringify(hello.columns);
  page.status = null;
  page.problem = null;
  page.events ??= new Events((time_s) => page.plots?.look(time_s - 2, time_s + 2));
  page.events.clear();
  const watched = page.friction?.joint?.name;
  page.hello = hello;
  setText(byId('program'), hello.program);
  setText(byId('scenario'), `${hello.scenario} · version ${hello.version}`);
  document.title = `${hello.scenario} · tribotwin ${hello.program}`;
  if (!same) build(hello);
  page.acting = new Acting(hello, (message) => page.connection.send(message));
  page.buses = new Buses();
  const joints = hello.joints.map((joint) => joint.name);
  if (joints.length) page.friction.choose(joints.includes(watched) ? watched : joints[0]);
}

/// The joint that somebody picked, in the picture, on its tile or in the list.
function choose(joint) {
  page.friction.choose(joint);
  page.scene.select(joint);
  for (const { name } of page.hello.joints) byId('drive_' + name).classList.toggle('selected', name === joint);
}

function build(hello) {
  page.ring = new Ring(hello.columns.length);
  page.columns = new Map(hello.columns.map((column, i) => [`${column.joint} ${column.name}`, i]));
  page.plots?.leave();
  page.friction?.size.disconnect();
  page.plots = new Plots(hello, page.ring, page.events);
  page.friction = new Friction(hello, page.ring, (joint) => page.connection.send({ type: 'watch', joint }));
  page.tiles = new Tiles(hello, choose);
  byId('watched').onchange = ({ target }) => choose(target.value);
  page.scene.begin(hello);
}

const messages = {
  hello: begin,
  status: (status) => { page.status = status; },
  event: (event) => {
    page.events?.add(event);
    page.plots?.mark();
  },
  law: (law) => page.friction?.accept(law),
  done: (answer) => {
    if (answer.id === null && !answer.ok && page.friction) page.friction.refusal = answer.message;
    page.acting?.done(answer);
  },
};

const newest = (joint, name) => {
  const { ring } = page, column = page.columns.get(`${joint} ${name}`);
  return ring.last < 0 || column === undefined ? null : ring.at(ring.last, column);
};

function showText() {
  const { status, ring, link } = page;
  setText(byId('connection_text'), link.text);
  byId('connection').dataset.state = !link.up ? 'down' : link.stale ? 'stale' : 'up';
  document.body.dataset.link = byId('connection').dataset.state;
  byId('retry').hidden = link.up;
  const wrong = link.up ? [] : [['connection', page.hello ? 'lost: what is shown is old' : 'none yet', 'connection']];
  if (link.stale) wrong.push(['connection', 'silent: what is shown is old', 'connection']);
  if (page.problem) wrong.push(['connection', page.problem, 'connection']);
  if (page.hello) {
    const drives = page.tiles.show(status, newest);
    wrong.push(...drives, ...page.buses.show(status));
    page.scene.show(newest, drives, page.tiles.warmest);
    byId('drives').dataset.row = ring.last < 0 ? '' : ring.number(ring.last);  // whose numbers the tiles show
    showDuration(clocks.simulated, status?.simulated_s);
    showDuration(clocks.wall, status?.wall_s);
    const recording = status?.recording ? ', recording' : '';
    setText(byId('run_state'), status ? (status.paused ? 'paused' : 'running') + recording : '–');
    showNumber(counts.rows, ring.received, '');
    showNumber(counts.lost, ring.lost, '');
    byId('lost').classList.toggle('bad', ring.lost > 0);
    showNumber(counts.events, status?.lost_events, '');
    byId('lost_events').parentElement.hidden = !(status?.lost_events > 0);
    page.acting.show(status);
    page.plots.limit_nm = status?.residual?.find((residual) => residual.limit_nm !== null)?.limit_nm;
    page.plots.showKept();
    page.plots.showCursor();
    if (ring.last >= 0) page.events.draw(ring.time(ring.begin), ring.time(ring.last));
  }
  showWrong(wrong);
}

let nextText = 0, nextDrawing = 0, drawnRows = -1;
function frame(now) {
  requestAnimationFrame(frame);
  if (page.hello && now >= nextDrawing) {
    const begin = performance.now();
    const fresh = page.ring.written !== drawnRows, { plots } = page;
    if ((fresh && !plots.fixed) || plots.dirty) plots.draw();
    drawnRows = page.ring.written;
    nextDrawing = now + (drawingShare - 1) * (performance.now() - begin);
  }
  page.scene.draw(now);
  if (now >= nextText) {
    page.friction?.draw();
    showText();
    nextText = now + textEvery_ms;
  }
}

const keys = {
  h: () => page.plots?.hold(), Escape: () => page.plots?.live(), '+': () => page.plots?.zoom(0.5),
  '-': () => page.plots?.zoom(2), m: () => byId('marker_text')?.focus(),
  w: () => page.tiles?.warmest && byId('drive_' + page.tiles.warmest).focus(),
};
addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest('input, select, textarea')) return;
  if (!keys[event.key]) return;
  event.preventDefault();
  keys[event.key]();
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
  page.plots?.retheme();
  page.friction?.draw();
  page.scene.retheme();
});

/// On paper all is drawn, in dark on white, and canvases keep their shape.
function print(begins) {
  document.documentElement.classList.toggle('printed', begins);
  page.plots?.retheme();
  page.friction?.draw();
  for (const drawn of document.querySelectorAll('.area, #friction_canvas')) {
    const { clientWidth: width, clientHeight: height } = drawn;
    Object.assign(drawn.style, begins ? { width: `${width}px`, aspectRatio: `${width} / ${height}` }
      : { width: '', aspectRatio: '' });
  }
  page.scene.retheme();
  if (begins) page.scene.print();
}
addEventListener('beforeprint', () => print(true));
addEventListener('afterprint', () => print(false));

byId('rows').append(counts.rows);
byId('lost').append(counts.lost);
byId('lost_events').append(counts.events);
byId('simulated').append(clocks.simulated);
byId('wall').append(clocks.wall);
byId('retry').onclick = () => page.connection.retry();
page.connection = new Connection({
  message: (message) => messages[message.type]?.(message),
  rows: (rows) => page.ring?.add(rows),
  poses: (poses) => page.scene.poses(poses),
  state: (link) => {
    page.link = link;
    if (!link.up) page.acting?.abandon();
  },
  problem: (text) => { page.problem = text; },
});
requestAnimationFrame(frame);
