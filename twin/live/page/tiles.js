// One tile per drive, what is wrong in words, and the warmest joint.
import { byId, element, setBar, setText } from './dom.js';
import { duration, errorCode, isNumber, modeText, number, showNumber, withUnit, words } from './format.js';

const warning_K = 10;  // as the drives: a warning 10 K before the limit

/// What is wrong with a drive, in words; red is for these alone.
export function wrongs(drive, joint, temperature_degC, residual) {
  const found = [];
  if (residual?.exceeded) found.push(`the residual has exceeded its limit of ${withUnit(residual.limit_nm, 'Nm')}`);
  const text = drive?.error_text ? ': ' + drive.error_text : '';
  if (drive?.error_code) found.push(`error ${errorCode(drive.error_code)}${text}`);
  else if (/fault/.test(drive?.state ?? '')) found.push(words(drive.state));
  if (isNumber(joint.limit_degC) && temperature_degC >= joint.limit_degC)
    found.push(`${withUnit(temperature_degC, 'degC')} is over its limit of ${withUnit(joint.limit_degC, 'degC')}`);
  return found;
}

function limitText(drive, joint, temperature_degC) {
  if (!isNumber(joint.limit_degC)) return 'no limit is known';
  const room_K = joint.limit_degC - temperature_degC;
  if (!(room_K > 0)) return `limit ${withUnit(joint.limit_degC, 'degC')}: exceeded`;
  const near = room_K < warning_K ? 'warm: ' : '';
  const when = isNumber(drive?.time_to_limit_s) ? `, reached in ${duration(drive.time_to_limit_s)}`
    : drive?.reaches_limit === false ? ', not reached at this loss' : '';
  return `${near}${withUnit(room_K, 'K')} below ${withUnit(joint.limit_degC, 'degC')}${when}`;
}

function limitDigits(drive, joint, temperature_degC) {
  if (!isNumber(joint.limit_degC) || !isNumber(temperature_degC)) return '';
  const when = isNumber(drive?.time_to_limit_s) ? `, reached in ${drive.time_to_limit_s} s` : '';
  return `${joint.limit_degC - temperature_degC} K below ${joint.limit_degC} °C${when}`;
}

const facts = [
  ['position', 'position_rad', 'rad'], ['target position', 'target.position_rad', 'rad'],
  ['following error', 'following_error_rad', 'rad'], ['velocity', 'velocity_rad_s', 'rad/s'],
  ['target velocity', 'target.velocity_rad_s', 'rad/s'], ['motor torque', 'motor_torque_nm', 'Nm'],
  ['target torque', 'target.torque_nm', 'Nm'], ['friction', 'friction_nm', 'Nm'], ['load', 'load_nm', 'Nm'],
  ['measured torque', 'measured_nm', 'Nm'], ['predicted torque', 'predicted_nm', 'Nm'],
  ['residual', 'residual_nm', 'Nm'], ['residual limit', 'residual.limit_nm', 'Nm'],
];
const ofDrive = (name) => name.startsWith('target.') || name === 'following_error_rad';
const ofResidual = (name) => name.startsWith('residual.');

/// With spaces at which no line ends; `bus` is a place among the buses, and that of a single one is not said.
const busName = ({ bus }, buses) => (buses.length > 1 && isNumber(bus) ? `bus\u00a0${bus}\u00a0` : '');

class Tile {
  constructor(joint, columns, choose) {
    this.joint = joint;
    this.temperature = number('temperature_degC');
    this.bar = element('span', { className: 'bar' });
    this.state = element('p', { className: 'state' });
    this.network = element('p', { className: 'soft network' });
    this.fault = element('p', { className: 'fault', hidden: true });
    this.limit = element('p', { className: 'soft limit' });
    this.badge = element('span', { className: 'badge', hidden: true, textContent: 'warmest' });
    this.brake = element('dd');
    const told = ([, name]) => columns.has(name) || ofDrive(name) || ofResidual(name);
    this.numbers = facts.filter(told).map(([label, name, unit]) => {
      const value = number(name);
      const row = element('div', {}, element('dt', { textContent: label }), element('dd', {}, value));
      return { name, unit, value, row };
    });
    this.brakeRow = element('div', {}, element('dt', { textContent: 'brake' }), this.brake);
    const name = element('button', { type: 'button', className: 'name', textContent: joint.name,
      title: 'Show its friction over speed', onclick: () => choose(joint.name) });
    this.root = element('article', { className: 'tile', id: 'drive_' + joint.name, tabIndex: -1 },
      element('h3', {}, name, this.badge), this.state, this.network, this.fault,
      element('p', { className: 'temperature' }, this.temperature),
      element('div', { className: 'track', 'aria-hidden': 'true' }, this.bar), this.limit,
      element('details', { open: innerWidth > 600 }, element('summary', { textContent: 'numbers' }),
        element('dl', {}, ...this.numbers.map((n) => n.row), this.brakeRow)));
  }

  show(drive, buses, residual, values, warmest, span) {
    const temperature = values('temperature_degC');
    showNumber(this.temperature, temperature, 'degC');
    setBar(this.bar, (temperature - span[0]) / (span[1] - span[0]));
    const wrong = wrongs(drive, this.joint, temperature, residual);
    const near = isNumber(this.joint.limit_degC) && temperature > this.joint.limit_degC - warning_K;
    this.root.classList.toggle('wrong', wrong.length > 0);
    this.root.classList.toggle('near', near && wrong.length === 0);
    this.root.classList.toggle('warmest', warmest);
    this.badge.hidden = !warmest;
    setText(this.limit, limitText(drive, this.joint, temperature));
    this.limit.title = limitDigits(drive, this.joint, temperature);
    this.showWords(drive, buses, residual, wrong);
    for (const { name, unit, value, row } of this.numbers) {
      const target = name.startsWith('target.') ? drive?.target?.[name.slice(7)] : drive?.[name];
      const shown = ofDrive(name) ? target : ofResidual(name) ? residual?.[name.slice(9)] : values(name);
      row.hidden = (ofDrive(name) || ofResidual(name)) && !isNumber(shown);
      showNumber(value, shown, unit);
    }
  }

  showWords(drive, buses, residual, wrong) {
    const bus = drive && drive.state !== null && drive.state !== undefined;
    setText(this.state, bus ? words(drive.state) : residual ? 'listened to on a bus' : 'simulated, not on a bus');
    const [mode, modeWords] = modeText(drive?.mode);
    const place = bus ? `${busName(drive, buses)}node\u00a0${drive.node}` : '';
    setText(this.network, bus ? `NMT ${words(drive.nmt)} · ${mode} · ${place}` : '');
    this.network.title = bus ? modeWords : '';
    this.fault.hidden = wrong.length === 0;
    setText(this.fault, wrong.length ? '✖ ' + wrong.join('; ') : '');
    this.brakeRow.hidden = typeof drive?.brake !== 'boolean';
    if (typeof drive?.brake === 'boolean') setText(this.brake, drive.brake ? 'set' : 'released');
  }
}

export class Tiles {
  constructor(hello, choose) {
    this.hello = hello;
    this.tiles = hello.joints.map((joint) => new Tile(joint,
      new Set(hello.columns.filter((column) => column.joint === joint.name).map((column) => column.name)), choose));
    byId('drives').replaceChildren(...this.tiles.map((tile) => tile.root));
    this.warmest = null;
  }

  /// value(joint, name): the newest one; status may still be missing.
  show(status, value) {
    const joints = this.hello.joints, drives = status?.drives ?? [];
    const temperatures = joints.map((joint) => value(joint.name, 'temperature_degC'));
    const highest = Math.max(...temperatures.filter(isNumber));
    const warmest = temperatures.indexOf(highest);
    this.warmest = warmest >= 0 ? joints[warmest].name : null;
    const list = [];
    this.tiles.forEach((tile, i) => {
      const drive = drives.find((d) => d.joint === joints[i].name);
      const residual = status?.residual?.find((r) => r.joint === joints[i].name);
      const top = isNumber(joints[i].limit_degC) ? joints[i].limit_degC : Math.max(60, highest);
      tile.show(drive, status?.buses ?? [], residual, (name) => value(joints[i].name, name), i === warmest, [0, top]);
      for (const what of wrongs(drive, joints[i], temperatures[i], residual)) list.push([joints[i].name, what]);
    });
    this.showWarmest(warmest, drives, highest);
    return list;
  }

  showWarmest(index, drives, highest) {
    const text = byId('warmest_text');
    if (index < 0) return setText(text, 'no temperature yet');
    const joint = this.hello.joints[index];
    if (!this.line) {
      this.line = { joint: element('a'), value: number('warmest_degC'), limit: element('span', { className: 'soft' }) };
      text.replaceChildren(this.line.joint, ' ', this.line.value, ' ', this.line.limit);
    }
    setText(this.line.joint, joint.name);
    this.line.joint.href = '#drive_' + joint.name;
    showNumber(this.line.value, highest, 'degC');
    setText(this.line.limit, limitText(drives.find((d) => d.joint === joint.name), joint, highest));
  }
}

/// What is wrong, of drives and of the connection, each with a link to its place.
export function showWrong(list) {
  const box = byId('wrong'), items = byId('wrong_list');
  box.classList.toggle('wrong', list.length > 0);
  const key = JSON.stringify(list);
  if (box.dataset.key === key) return;
  box.dataset.key = key;
  items.replaceChildren(...list.map(([where, what, place]) =>
    element('li', {}, element('a', { href: '#' + (place ?? 'drive_' + where), textContent: where }), ' ' + what)));
  if (list.length === 0) items.append(element('li', { className: 'fine', textContent: '✔ nothing' }));
}
