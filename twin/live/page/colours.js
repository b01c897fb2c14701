// The colours of temperatures: viridis (van der Walt 2015, CC0), which rises in lightness and does not need hue.

import { roundStep } from './scale.js';

const table = [
  0x440154, 0x48186a, 0x472d7b, 0x424086, 0x3b528b, 0x33638d, 0x2c728e, 0x26828e, 0x21918c, 0x1fa088, 0x28ae80,
  0x3fbc73, 0x5ec962, 0x84d44b, 0xaddc30, 0xd8e219, 0xfde725,
];

/// [red, green, blue] of 0..255 for a share of 0..1.
export function viridis(share) {
  const at = (table.length - 1) * (share > 0 ? Math.min(share, 1) : 0);
  const low = Math.min(Math.floor(at), table.length - 2);
  return [16, 8, 0].map((shift) => {
    const from = (table[low] >> shift) & 255, to = (table[low + 1] >> shift) & 255;
    return Math.round(from + (at - low) * (to - from));
  });
}

/// Round ends around all values, at least 5 apart, and the marks between: {from, to, marks}.
export function scaleAround(values) {
  let low = Math.min(...values), high = Math.max(...values);
  if (!(low <= high)) [low, high] = [20, 80];
  if (high - low < 5) [low, high] = [(low + high) / 2 - 2.5, (low + high) / 2 + 2.5];
  const step = roundStep((high - low) / 5);
  const first = Math.floor(low / step + 1e-9), last = Math.ceil(high / step - 1e-9);
  const marks = Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
  return { from: first * step, to: last * step, marks };
}

/// The scale that was, as long as all values lie in it and use at least 40 % of it: it does not flicker.
export function scaleAfter(before, values) {
  const low = Math.min(...values), high = Math.max(...values);
  const fits = before && low >= before.from && high <= before.to;
  return fits && (high - low >= 0.4 * (before.to - before.from) || before.to - before.from <= 8) ? before
    : scaleAround(values);
}
