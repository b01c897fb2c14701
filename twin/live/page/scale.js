// Round numbers for axes.

/// The smallest of 1, 2, 5 or 10 times a power of ten that is at least `raw`.
export function roundStep(raw) {
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= raw * (1 - 1e-9));
}

/// Multiples of a round step within from..to, about `count` of them.
export function ticks(from, to, count) {
  const step = roundStep((to - from) / count), out = [];
  for (let i = Math.ceil(from / step - 1e-9); i * step <= to + step * 1e-9; ++i)
    out.push(Number((i * step).toPrecision(12)));
  return out;
}

export const plain = (value) => String(Number(value.toPrecision(12)));

/// Around low..high with some room. The one before stays while all lies in it and uses half of it: lines do not jump.
export function rangeAfter(before, low, high) {
  if (!(low <= high)) return before ?? [0, 1];
  const middle = (low + high) / 2, span = Math.max(high - low, 1e-4 * Math.abs(middle), 1e-6);
  if (before && low >= before[0] && high <= before[1] && span >= 0.5 * (before[1] - before[0])) return before;
  return [middle - 0.6 * span, middle + 0.6 * span];
}
