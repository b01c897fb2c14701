// Commands: one form for each that hello.commands names, and what the program answered.
import { byId, element, setText } from './dom.js';
import { number, showNumber } from './format.js';

const answersKept = 20, patience_ms = 5000;

/// Of hil/faults: which keys a kind has beside kind and duration_s, and whether it needs a drive.
export const faults = {
  drop: { keys: ['probability'] }, delay: { keys: ['probability', 'delay_s'] },
  corrupt: { keys: ['probability'] }, duplicate: { keys: ['probability'] },
  silence: { joint: true, keys: [] }, bus_off: { whole: true, keys: [] },
  link_down: { whole: true, keys: [] }, over_temperature: { joint: true, keys: ['temperature_degC'] },
  encoder_freeze: { joint: true, keys: [] }, safe_torque_off: { joint: true, keys: [] },
};

const inputs = {
  cycles: ['rows', { min: 1, max: 1000000, step: 1, value: 1 }],
  duration_s: ['duration [s]', { min: 0.000001, max: 1e9, step: 'any', value: 1 }],
  probability: ['probability', { min: 0, max: 1, step: 'any', value: 0.01 }],
  delay_s: ['delay [s]', { min: 0, max: 10, step: 'any', value: 0.01 }],
  temperature_degC: ['temperature [°C]', { min: -100, max: 1000, step: 'any', value: 150 }],
  mass_kg: ['payload [kg]', { min: 0, max: 1e6, step: 'any', value: 0 }],
  factor: ['factor', { min: 0, max: 1000, step: 'any', value: 1.2 }],
  severity: ['severity', { min: 0, step: 'any', value: 0.1 }],
  growth_per_h: ['growth [1/h]', { min: 0, max: 1e6, step: 'any', value: 0 }],
  minutes: ['last minutes', { min: 0.001, max: 1e6, step: 'any', value: 5 }],
};
const surroundings = ['surroundings [°C]', { min: -100, max: 300, step: 'any', value: 25 }];

function numberInput(name, [label, limits] = inputs[name]) {
  const input = element('input', { type: 'number', name, required: true, ...limits });
  return element('label', { 'data-key': name }, label + ' ', input);
}

const messageKinds = [['ros2', 'ROS 2'], ['json', 'JSON']];

const choice = (name, label, options) => element('label', { 'data-key': name }, label + ' ', element('select', { name },
  ...options.map(([value, text]) => element('option', { value, textContent: text }))));

const simple = {
  pause: { button: 'Pause' }, resume: { button: 'Resume' },
  step: { button: 'Step', numbers: ['cycles'] }, payload: { button: 'Set payload', numbers: ['mass_kg'] },
};

export class Acting {
  /// `send(message)`: whether it left.
  constructor(hello, send) {
    Object.assign(this, { hello, send, pending: new Map(), count: 0 });
    const forms = hello.commands.map((name) => this.form(name)).filter((form) => form);
    byId('controls').replaceChildren(...forms);
    byId('answers').replaceChildren();
    byId('acting').hidden = hello.readonly || forms.length === 0;
    byId('readonly').hidden = !hello.readonly;
  }

  joints() {
    return this.hello.joints.map((joint) => [joint.name, joint.name]);
  }

  form(name) {
    const special = { marker: 'markerParts', fault: 'faultParts', ambient: 'ambientParts', wear: 'wearParts',
      joint_fault: 'jointFaultParts', record: 'recordParts', export: 'exportParts' };
    const parts = special[name] ? this[special[name]]() : this.simpleParts(name);
    if (!parts) return null;  // a command of a later program, which this page does not know
    const form = element('form', { 'data-do': name }, ...parts);
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.command(name, form);
    });
    return form;
  }

  simpleParts(name) {
    const row = simple[name];
    if (!row) return null;
    const label = this.hello.program === 'drive' ? 'cycles' : 'rows';  // what a step is
    const input = (key) => numberInput(key, key === 'cycles' ? [label, inputs[key][1]] : inputs[key]);
    return [...(row.numbers ?? []).map(input), element('button', { textContent: row.button })];
  }

  ambientParts() {
    return [numberInput('temperature_degC', surroundings), element('button', { textContent: 'Set surroundings' })];
  }

  /// Wear multiplies a parameter of the joint's law.
  wearParts() {
    const joint = choice('joint', 'joint', this.joints()), parameter = choice('parameter', 'parameter', []);
    const fit = () => {
      const { parameters = [] } = this.hello.joints.find(({ name }) => name === joint.lastChild.value) ?? {};
      parameter.lastChild.replaceChildren(...parameters.map((name) => element('option', { textContent: name })));
    };
    joint.lastChild.addEventListener('change', fit);
    fit();
    return [joint, parameter, numberInput('factor'), element('button', { textContent: 'Wear' })];
  }

  /// Faults of a drive, which grow; those of the bus are `fault`.
  jointFaultParts() {
    const all = this.hello.joint_faults ?? [];
    const fault = choice('fault', 'fault', all.map(({ name }) => [name, name.replace(/_/g, ' ')]));
    const severity = numberInput('severity');
    const fit = () => {
      severity.lastChild.max = all.find(({ name }) => name === fault.lastChild.value)?.maximum ?? '';
    };
    fault.lastChild.addEventListener('change', fit);
    fit();
    return [choice('joint', 'joint', this.joints()), fault, severity, numberInput('growth_per_h'),
      element('button', { textContent: 'Damage' })];
  }

  /// One button that begins and ends it, and what is recorded.
  recordParts() {
    const messages = choice('messages', 'messages', messageKinds), button = element('button');
    const row = (name, label) => {
      const value = number(name);
      return { value, root: element('div', {}, element('dt', { textContent: label }), element('dd', {}, value)) };
    };
    const numbers = { rows: row('file.rows', 'rows'), lost_rows: row('file.lost_rows', 'rows lost'),
      minutes: row('file.minutes', 'minutes') };
    const name = element('p', { className: 'recorded' });
    const list = element('dl', {}, ...Object.values(numbers).map(({ root }) => root));
    this.recording = { messages, button, name, list, numbers, on: false };
    this.showRecording(null);
    return [messages, button, element('div', { className: 'wide' }, name, list)];
  }

  showRecording(file) {
    const { recording } = this;
    if (!recording) return;
    recording.on = Boolean(file);
    setText(recording.button, file ? 'Stop recording' : 'Start recording');
    recording.messages.hidden = recording.messages.lastChild.disabled = recording.on;
    recording.list.hidden = !recording.on;
    setText(recording.name, file ? `● ${file.name} gets all rows` : 'No page records.');
    for (const [key, unit] of [['rows', ''], ['lost_rows', ''], ['minutes', 'min']])
      showNumber(recording.numbers[key].value, file?.[key], unit);
    recording.numbers.lost_rows.root.classList.toggle('bad', file?.lost_rows > 0);
  }

  exportParts() {
    const format = choice('format', 'format', [['h5', 'telemetry (HDF5)'], ['mcap', 'MCAP']]);
    const messages = choice('messages', 'messages', messageKinds);
    const fit = () => { messages.hidden = messages.lastChild.disabled = format.lastChild.value !== 'mcap'; };
    format.lastChild.addEventListener('change', fit);
    fit();
    return [numberInput('minutes'), format, messages, element('button', { textContent: 'Export' })];
  }

  show(status) {
    this.showRecording(status?.file ?? null);
  }

  markerParts() {
    const input = element('input', { name: 'text', required: true, maxLength: 200, id: 'marker_text' });
    input.autocomplete = 'off';
    return [element('label', { 'data-key': 'text' }, 'marker ', input), element('button', { textContent: 'Mark' })];
  }

  faultParts() {
    const known = (this.hello.faults ?? Object.keys(faults)).filter((kind) => kind in faults);
    const kind = choice('kind', 'fault', known.map((name) => [name, name.replace(/_/g, ' ')]));
    const joint = choice('joint', 'drive', [['', 'all drives'], ...this.joints()]);
    const keys = ['probability', 'delay_s', 'temperature_degC'].map((key) => numberInput(key));
    const fit = () => {
      const row = faults[kind.lastChild.value] ?? { keys: [] };
      const all = joint.querySelector('option');
      all.disabled = all.hidden = Boolean(row.joint);
      if (row.joint && joint.lastChild.value === '') joint.lastChild.value = this.hello.joints[0].name;
      for (const label of [joint, ...keys]) {
        label.hidden = label === joint ? Boolean(row.whole) : !row.keys.includes(label.dataset.key);
        label.lastChild.disabled = label.hidden;
      }
    };
    kind.lastChild.addEventListener('change', fit);
    fit();
    return [kind, joint, numberInput('duration_s'), ...keys, element('button', { textContent: 'Inject' })];
  }

  command(name, form) {
    const message = { type: 'command', id: ++this.count, do: name };
    if (name === 'record') message.on = !this.recording.on;
    for (const input of form.elements)
      if (input.name && !input.disabled && input.value !== '')
        message[input.name] = input.type === 'number' ? input.valueAsNumber : input.value;
    const what = [name, ...Object.entries(message).filter(([key]) => !['type', 'id', 'do'].includes(key))
      .map(([key, value]) => `${key} ${value}`)].join(', ');
    const row = element('li', { textContent: `${what}: asked` });
    byId('answers').prepend(row);
    if (byId('answers').children.length > answersKept) byId('answers').lastChild.remove();
    if (!this.send(message)) return this.say(row, `${what}: not sent, there is no connection`, false);
    const timer = setTimeout(() => this.say(row, `${what}: no answer yet`, false), patience_ms);
    this.pending.set(message.id, { row, what, timer });
    if (name === 'marker') form.reset();
  }

  say(row, text, ok) {
    row.textContent = text;
    row.className = ok ? 'done' : 'bad';
  }

  done({ id, ok, message }) {
    const asked = this.pending.get(id);
    if (!asked) return;
    clearTimeout(asked.timer);
    this.pending.delete(id);
    const answer = `${ok ? '✔' : '✖'} ${asked.what}: ${ok ? 'done' : 'refused'}`;
    this.say(asked.row, answer + (message ? ', ' + message : ''), ok);
  }

  /// The connection is lost: nobody will answer.
  abandon() {
    for (const { row, what, timer } of this.pending.values()) {
      clearTimeout(timer);
      this.say(row, `${what}: the connection was lost before an answer`, false);
    }
    this.pending.clear();
  }
}
