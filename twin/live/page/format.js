// Numbers and words. A number is shown rounded; its <data> carries all digits as value and tooltip.
import { element, grouped } from './dom.js';

const places = { rad: 4, 'rad/s': 3, degC: 1, K: 1, Nm: 2, s: 3, '%': 1, us: 0, kg: 3, 'bit/s': 0, min: 1, share: 3 };
const printed = { degC: '°C', us: 'µs', share: '' };
export const unitText = (unit) => printed[unit] ?? unit;
export const isNumber = (value) => typeof value === 'number' && Number.isFinite(value);

/// Not a number: an en dash, because nothing is known.
export function rounded(value, unit) {
  if (!isNumber(value)) return '–';
  let digits = places[unit] ?? 2;
  if (unit === 'Nm' && Math.abs(value) >= 1e-6)
    digits = Math.min(6, Math.max(1, 3 - Math.floor(Math.log10(Math.abs(value)))));
  const text = unit ? value.toFixed(digits) : String(value);
  return /[1-9]/.test(text) ? text : text.replace('-', '');  // 0 has no sign
}

export const withUnit = (value, unit) => (isNumber(value) ? `${rounded(value, unit)} ${unitText(unit)}`.trim() : '–');

export function number(name) {
  return element('data', { className: 'number', 'data-name': name });
}

/// `exact`: what the tooltip says, unrounded.
export function showNumber(to, value, unit) {
  show(to, value, unit, () => (unit ? withUnit(value, unit) : isNumber(value) ? grouped(value) : '–'));
}

export function showDuration(to, value_s) {
  show(to, value_s, 's', () => duration(value_s));
}

function show(to, value, unit, text) {
  const exact = isNumber(value) ? String(value) : '';
  if (to.value === exact && to.textContent) return;
  to.value = exact;
  to.title = exact ? `${exact} ${unitText(unit)}`.trim() : 'not known';
  to.textContent = text();
}

export function duration(seconds) {
  if (!isNumber(seconds)) return '–';
  const s = Math.max(0, seconds);
  if (s < 60) return `${s.toFixed(s < 10 ? 1 : 0)} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s`;
  return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}

export const errorCode = (code) => code.toString(16).toUpperCase().padStart(4, '0') + 'h';

const modes = {
  PP: 'profile position', PV: 'profile velocity', HM: 'homing', IP: 'interpolated position',
  CSP: 'cyclic synchronous position', CSV: 'cyclic synchronous velocity', CST: 'cyclic synchronous torque',
};
const modeNumbers = { 0: 'none', 1: 'PP', 3: 'PV', 6: 'HM', 7: 'IP', 8: 'CSP', 9: 'CSV', 10: 'CST' };

/// [abbreviation, words]
export function modeText(mode) {
  if (mode === null || mode === undefined) return ['–', 'mode of operation not known'];
  const short = modeNumbers[mode] ?? String(mode);
  return [short, modes[short] ?? short];
}

export const words = (name) => String(name ?? '–').replace(/_/g, ' ');
