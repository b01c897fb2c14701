// Commands: one form for each that hello.commands names, and what the program answered.
import { byId, element } from './dom.js';

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
  degC: ['surroundings [°C]', { min: -50, max: 150, step: 'any', value: 25 }],
  kg: ['payload [kg]', { min: 0, max: 10000, step: 'any', value: 0 }],
  factor: ['factor of boundary friction', { min: 0, max: 100, step: 'any', value: 1.2 }],
};

function numberInput(name) {
  const [label, limits] = inputs[name];
  const input = element('input', { type: 'number', name, required: true, ...limits });
  return element('label', { 'data-key': name }, label + ' ', input);
}

const choice = (name, label, options) => element('label', { 'data-key': name }, label + ' ', element('select', { name },
  ...options.map(([value, text]) => element('option', { value, textContent: text }))));

const simple = {
  pause: { button: 'Pause simulation' }, resume: { button: 'Resume simulation' },
  step: { button: 'Step', numbers: ['cycles'] },
  ambient: { button: 'Set surroundings', numbers: ['degC'] }, payload: { button: 'Set payload', numbers: ['kg'] },
  wear: { button: 'Wear', numbers: ['factor'], joint: true },
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
    const special = { marker: () => this.markerParts(), fault: () => this.faultParts() };
    const parts = special[name] ? special[name]() : this.simpleParts(name);
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
    const joint = row.joint ? [choice('joint', 'joint', this.joints())] : [];
    return [...joint, ...(row.numbers ?? []).map(numberInput), element('button', { textContent: row.button })];
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
    const keys = ['probability', 'delay_s', 'temperature_degC'].map(numberInput);
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
